"""Figure of how a filter comes to know the numbers of a glider."""

import dataclasses
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from axes import legend_beside, log_scale, ticks
from glider.report.plots.style import BLUE, GREEN, ORANGE, STYLE

COLORS = (BLUE, ORANGE, GREEN)
DASHES = (0, (4, 2))


@dataclasses.dataclass(frozen=True, kw_only=True)
class Knowledge:
    """Knowledge that a filter has of m numbers during a flight."""

    name: str
    """Name of the flight, for the legend."""

    times: np.ndarray
    """(K,) [s]."""

    means: np.ndarray
    """(K, m) estimates."""

    stds: np.ndarray
    """(K, m) their standard deviations."""

    bounds: np.ndarray
    """(K, m) the least deviations by Fisher information."""

    truth: np.ndarray
    """(m,)."""


def save_knowledge_figure(
    path: Path,
    labels: Sequence[str],
    drifting: Sequence[Knowledge],
    constant: Sequence[Knowledge],
) -> None:
    """Saves what was learnt in some flights: estimates, then deviations.

    Args:
        path: of the picture.
        labels: of the m numbers, with units.
        drifting: flights where the filter lets the numbers drift.
        constant: the same flights where it takes them for constants.
    """
    with rc_context(STYLE):
        figure = Figure(figsize=(9.5, 8.4), layout="constrained")
        axes = figure.subplots(3, len(labels), squeeze=False, sharex="col")
        titles = (
            "estimate ± 2 deviations (dashed: the truth)",
            "deviation, if the number may drift",
            "deviation, if it is a constant (dashed: the least possible)",
        )
        for column, label in enumerate(labels):
            for row, title in enumerate(titles):
                axes[row, column].set_title(title, loc="left")
                axes[row, column].set_ylabel(label)
                axes[row, column].xaxis.set_major_locator(ticks(5))
            for known, color in zip(drifting, COLORS, strict=False):
                plot_estimate(axes[0, column], known, column, color)
                plot_deviation(axes[1, column], known, column, color)
            for known, color in zip(constant, COLORS, strict=False):
                plot_deviation(axes[2, column], known, column, color, bound=True)
            axes[2, column].set_xlabel("time [s]")
        legend_beside(axes[0, 0])
        figure.savefig(path, dpi=150)


def plot_estimate(ax: Axes, known: Knowledge, column: int, color: str) -> None:
    """Draws one number's estimate with twice its deviation, and the truth.

    The first estimates, before the filter knows anything, may lie outside.
    """
    mean, spread = known.means[:, column], 2.0 * known.stds[:, column]
    ax.fill_between(
        known.times, mean - spread, mean + spread, color=color, alpha=0.15, lw=0.0
    )
    ax.plot(known.times, mean, color=color, lw=1.6, label=known.name)
    truth = known.truth[column]
    ax.plot(known.times[[0, -1]], [truth, truth], color=color, lw=1.2, ls=DASHES)
    reach = 3.0 * np.median(spread)
    low, high = ax.get_ylim() if len(ax.lines) > 2 else (truth, truth)
    ax.set_ylim(min(low, truth - reach), max(high, truth + reach))


def plot_deviation(
    ax: Axes, known: Knowledge, column: int, color: str, bound: bool = False
) -> None:
    """Draws one number's deviation on a logarithmic scale."""
    ax.plot(known.times, known.stds[:, column], color=color, lw=1.6, label=known.name)
    if bound:
        ax.plot(known.times, known.bounds[:, column], color=color, lw=1.2, ls=DASHES)
    log_scale(ax)
