"""The figures of what was found: evidence, curves, folds, differences of flights."""

import math

from matplotlib.figure import Figure

from glider.report.figure_data import carried_curves, fold_panels, spread_panels
from glider.report.plots.axes import few_ticks, legend
from glider.report.plots.bars import plot_evidence
from glider.report.plots.curves import plot_curve
from glider.report.plots.flight_values import plot_pairs, plot_spread
from glider.report.plots.style import RED, TERMS, VARIABLES
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
    panels = fold_panels(result)
    for ax, panel in zip(figure.subplots(1, 3), panels, strict=True):
        plot_pairs(ax, panel.refitted, panel.corrected)
        ax.set_title(panel.title)
        ax.set_ylabel(f"RMS [{panel.unit.name}]")
    return figure


def draw_spreads(result: Result) -> Figure | None:
    """Draws what differs from flight to flight, each flight's own value."""
    panels = spread_panels(result)
    if not panels:
        return None
    figure = Figure(figsize=(WIDTH, 0.5 + 2.1 * len(panels)), layout="constrained")
    axes = figure.subplots(len(panels), squeeze=False)[:, 0]
    for ax, panel in zip(axes, panels, strict=True):
        plot_spread(ax, panel.values, panel.std)
        ax.set_title(panel.title)
        unit = panel.unit.name
        ax.set_ylabel(f"[{unit}]" if unit not in ("", "-") else "")
    axes[-1].set_xlabel("flight, in the order of the campaign")
    return figure


def draw_carried(result: Result) -> Figure | None:
    """Draws what the model carries without a name."""
    curves = carried_curves(result)
    if not curves:
        return None
    columns = min(len(curves), 2)
    rows = math.ceil(len(curves) / columns)
    figure = Figure(figsize=(WIDTH, 2.7 * rows), layout="constrained")
    grid = figure.subplots(rows, columns, squeeze=False).ravel()
    for ax, curve in zip(grid, curves, strict=False):
        label, factor = VARIABLES[curve.variable]
        ax.plot(curve.place * factor, curve.value, color=RED, lw=1.8)
        ax.axhline(0.0, color="#444444", lw=0.7)
        ax.set_title(TERMS[curve.term])
        ax.set_xlabel(label)
        few_ticks(ax, 7)
    for ax in grid[len(curves) :]:
        ax.set_visible(False)
    return figure
