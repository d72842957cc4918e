"""The figures of what was found: evidence, curves, folds, differences of flights."""

import math

import numpy as np
from matplotlib.figure import Figure

from glider.report.error_table import unit_beside_noise
from glider.report.flight_errors import bounded
from glider.report.numbers import DEGREE, Unit
from glider.report.plots.axes import legend
from glider.report.plots.bars import plot_evidence
from glider.report.plots.curves import plot_curve
from glider.report.plots.flight_values import plot_pairs, plot_spread
from glider.report.plots.style import TERMS, VARIABLES
from glider.sysid.result import Result

WIDTH = 10.0
"""Of a whole figure [inch]."""


def draw_evidence(result: Result) -> Figure | None:
    """Draws what each kind gains alone."""
    if not result.candidates:
        return None
    figure = Figure(
        figsize=(WIDTH, 1.0 + 0.23 * len(result.candidates)), layout="constrained"
    )
    plot_evidence(
        figure.subplots(),
        result.candidates,
        picked=[e.kind for e in result.effects],
        confused=[k for e in result.effects for k in e.indistinguishable_from],
    )
    return figure


def draw_curves(result: Result) -> Figure | None:
    """Draws what the plate lacks in each term, over the angle of attack."""
    curves = result.curves
    if not curves:
        return None
    columns = min(len(curves), 2)
    rows = math.ceil(len(curves) / columns)
    width = WIDTH if columns == 2 else 0.7 * WIDTH  # The legend needs that.
    figure = Figure(figsize=(width, 0.5 + 2.7 * rows), layout="constrained")
    grid = figure.subplots(rows, columns, squeeze=False).ravel()
    for ax, curve in zip(grid, curves, strict=False):
        plot_curve(ax, curve.alpha, curve.lack, curve.std, curve.named)
        ax.set_title(TERMS.get(curve.term, curve.term.replace("_", " ")))
        ax.set_xlabel(VARIABLES["alpha"][0])
    for ax in grid[len(curves) :]:
        ax.set_visible(False)
    legend(figure, grid[0])
    return figure


def draw_folds(result: Result) -> Figure | None:
    """Draws the errors of each fold, refitted and corrected, as pairs."""
    if not result.folds:
        return None
    figure = Figure(figsize=(WIDTH, 3.0), layout="constrained")
    panels = {
        "position, free rollout": "position_rms_m",
        "position, along the measured pitch": "measured_pitch_position_rms_m",
        "pitch, free rollout": "pitch_rms_rad",
    }
    for ax, (title, field) in zip(figure.subplots(1, 3), panels.items(), strict=True):
        before, after = (
            bounded(np.array([getattr(e, field) for e in errors], dtype=float))
            for errors in (
                [f.refitted for f in result.folds],
                [f.corrected for f in result.folds],
            )
        )
        unit = DEGREE
        if field != "pitch_rms_rad":
            unit = unit_beside_noise(result, *before, *after)
        plot_pairs(ax, before / unit.size, after / unit.size)
        ax.set_title(title)
        ax.set_ylabel(f"RMS [{unit.name}]")
    return figure


def draw_spreads(result: Result) -> Figure | None:
    """Draws what differs from flight to flight, each flight's own value."""
    spreads = {n: s for n, s in result.spreads.items() if s.values}
    if not spreads:
        return None
    figure = Figure(figsize=(WIDTH, 0.5 + 2.1 * len(spreads)), layout="constrained")
    axes = figure.subplots(len(spreads), squeeze=False)[:, 0]
    for ax, (name, spread) in zip(axes, spreads.items(), strict=True):
        unit = DEGREE if spread.unit == "rad" else Unit(name=spread.unit)
        own = {f: v / unit.size for f, v in spread.values.items()}
        plot_spread(ax, own, spread.std / unit.size)
        ax.set_title(name.replace("_", " "))
        ax.set_ylabel(f"[{unit.name}]" if unit.name not in ("", "-") else "")
    axes[-1].set_xlabel("flight, in the order of the campaign")
    return figure
