"""Figures of funnels and the flights in them."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from diagrams.perch_plots import AFTER, BEFORE
from diagrams.studies.funnel_estimate import save_estimate_figure
from diagrams.studies.funnel_study import WORDS, FunnelComparison, FunnelStudy
from glider.report.plots.axes import few_ticks, legend_beside
from glider.report.plots.style import STYLE
from glider.report.wording import counted
from glider.verification.funnel.funnel import Funnel, tube_outline

_STATES = {
    "z": (1, 1.0, "m"),
    "pitch": (2, 180.0 / np.pi, "°"),
    "xdot": (4, 1.0, "m/s"),
    "zdot": (5, 1.0, "m/s"),
}


def save_funnel_figures(path: Path, found: FunnelComparison) -> None:
    """Saves the figure of both funnels and, where asked for, of flights on an estimate.

    Args:
        path: of the first; the second is saved at `beside` it.
        found: what to draw.
    """
    studies = {WORDS[name]: study for name, study in found.studies.items()}
    save_funnel_figure(path, studies)
    if found.estimated:
        save_estimate_figure(beside(path), found.estimated)


def beside(path: Path) -> Path:
    """Returns where the figure of flights on an estimate goes: NAME_estimate.png."""
    return path.with_stem(f"{path.stem}_estimate")


def save_funnel_figure(path: Path, studies: Mapping[str, FunnelStudy]) -> None:
    """Saves the tubes in the vertical plane and their half-widths over time.

    Args:
        path: of the picture.
        studies: name to funnel and flights, two at most.
    """
    funnels = {name: study.funnel for name, study in studies.items()}
    colors = dict(zip(funnels, (BEFORE, AFTER), strict=False))
    with rc_context(STYLE):
        figure = Figure(figsize=(10.0, 2.9 * len(funnels) + 3.0), layout="constrained")
        grid = figure.add_gridspec(len(funnels) + 1, len(_STATES))
        for row, (name, funnel) in enumerate(funnels.items()):
            ax = figure.add_subplot(grid[row, :])
            _draw_band(ax, funnel, colors[name])
            flights = studies[name].flights
            for k, flown in enumerate(flights):
                label = counted(flights, "flight") if k == 0 else None
                ax.plot(*flown[:, :2].T, color="k", lw=0.5, alpha=0.35, label=label)
            ax.set_title(name, loc="left")
            legend_beside(ax)
        for column, (state, (index, factor, unit)) in enumerate(_STATES.items()):
            ax = figure.add_subplot(grid[-1, column])
            for name, funnel in funnels.items():
                times = funnel.nominal.times
                widths = factor * funnel.half_widths(times)[:, index]
                ax.plot(times, widths, color=colors[name], label=name)
            ax.set_ylim(bottom=0.0)
            ax.set_xlabel("time [s]")
            ax.set_ylabel(f"± {state} alone, a slice [{unit}]")
            few_ticks(ax, 4)
        figure.savefig(path, dpi=120)


def _draw_band(ax: Axes, funnel: Funnel, color: str) -> None:
    """Draws the positions that a funnel allows."""
    outline = tube_outline(funnel)
    ax.fill(*outline.T, color=color, alpha=0.25, lw=0.0, label="funnel, projected")
    ax.plot(*funnel.nominal.states[:, :2].T, color=color, lw=1.5)
    ax.set_aspect("equal", adjustable="datalim")
    ax.set_xlabel("x [m]")
    ax.set_ylabel("z [m]")
    few_ticks(ax)
