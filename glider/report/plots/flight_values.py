"""One number a flight, or two that belong together."""

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes

from glider.report.plots.axes import log_scale
from glider.report.plots.style import BLUE, COLORS, LABELS, RED

MOST_NAMES = 3
"""Flights that are named: those farthest off."""


def plot_pairs(ax: Axes, before: np.ndarray, after: np.ndarray) -> None:
    """Draws pairs of errors, joined: blue where the second is smaller, else red.

    Args:
        ax: to draw into.
        before: (n,) of the refitted plate; NaN leaves a gap.
        after: (n,) of the corrected model.
    """
    for pair in zip(before, after, strict=True):
        color = BLUE if pair[1] < pair[0] else RED
        ax.plot([0, 1], pair, color=color, lw=1.2, alpha=0.75, zorder=2)
    for place, (model, values) in enumerate(
        {"refitted": before, "corrected": after}.items()
    ):
        ax.plot(
            np.full(len(values), place),
            values,
            "o",
            color=COLORS[model],
            ms=6,
            zorder=3,
        )
    ax.set_xlim(-0.35, 1.35)
    ax.set_xticks([0, 1], [LABELS["refitted"], LABELS["corrected"]])
    ax.grid(False, axis="x")
    shown = np.concatenate([before, after])
    shown = shown[np.isfinite(shown) & (shown > 0.0)]
    if shown.size and shown.max() > 5.0 * shown.min():
        log_scale(ax)
        ax.set_ylim(0.6 * shown.min(), 1.6 * shown.max())
    elif shown.size:
        ax.set_ylim(0.0, 1.12 * shown.max())


def plot_spread(ax: Axes, values: Mapping[str, float], std: float) -> None:
    """Draws each flight's own value about the model's, in order of the flights.

    Args:
        ax: to draw into.
        values: name of a flight to its own value, about the model's.
        std: standard deviation over flights, a band.
    """
    ax.axhspan(-std, std, color=BLUE, alpha=0.14, lw=0)
    ax.axhline(0.0, color="#444444", lw=0.7)
    numbers = np.array(list(values.values()), dtype=float)
    places = np.arange(1, len(numbers) + 1)
    ax.vlines(places, 0.0, numbers, color=BLUE, lw=0.8, alpha=0.5)
    ax.plot(places, numbers, "o", color=BLUE, ms=4)
    for i in _farthest(numbers):
        ax.annotate(
            list(values)[i].removesuffix(".csv"),
            (places[i], numbers[i]),
            xytext=(0, 5 if numbers[i] > 0 else -5),
            textcoords="offset points",
            ha="center",
            va="bottom" if numbers[i] > 0 else "top",
            fontsize=8,
        )
    ax.set_xlim(0.0, len(numbers) + 1.0)
    ax.margins(y=0.2)
    ax.grid(False, axis="x")


def _farthest(numbers: np.ndarray) -> Sequence[int]:
    """Returns the places of the largest finite numbers."""
    size = np.where(np.isfinite(numbers), np.abs(numbers), -1.0)
    return [int(i) for i in np.argsort(-size)[:MOST_NAMES] if size[i] >= 0.0]
