"""Limits, ticks and points of axes: what they show."""

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.legend import Legend
from matplotlib.ticker import MaxNLocator, NullLocator

_POINTS = 1500
"""Largest number of points that a scatter shows; its medians take all."""


def limit(
    set_limits: Callable[[float, float], object],
    values: np.ndarray,
    margin: float = 0.08,
    quantile: float = 0.004,
    around: float | None = None,
) -> None:
    """Sets an axis to where the points are; a few wild ones do not squash it.

    Args:
        set_limits: `ax.set_xlim` or `ax.set_ylim`.
        values: of the points.
        margin: added at both ends, relative to the range.
        quantile: of points that may lie outside at each end.
        around: a value that must lie inside.
    """
    found = bounds(values, margin, quantile, around)
    if found is not None:
        set_limits(*found)


def bounds(
    values: np.ndarray,
    margin: float = 0.08,
    quantile: float = 0.004,
    around: float | None = None,
) -> tuple[float, float] | None:
    """Returns what `limit` sets an axis to; None where no value is finite."""
    values = values[np.isfinite(values)]
    if values.size == 0:
        return None
    low, high = np.quantile(values, [quantile, 1.0 - quantile])
    if around is not None:
        low, high = min(low, around), max(high, around)
    pad = margin * (high - low) or 0.05 * abs(high) or 1.0
    return float(low - pad), float(high + pad)


def legend(figure: Figure, *axes: Axes) -> None:
    """Adds one legend above all axes, each label once."""
    shown: dict[str, Any] = {}
    for ax in axes:
        for handle, label in zip(*ax.get_legend_handles_labels(), strict=True):
            shown.setdefault(label, handle)
    figure.legend(
        shown.values(), shown.keys(), loc="outside upper center", ncols=len(shown)
    )


def legend_beside(ax: Axes) -> Legend:
    """Adds a legend to the right of the axes, where it covers nothing, and returns it.

    The figure's layout must be constrained, which makes room.
    """
    return ax.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0), borderaxespad=0.0)


def few_ticks(ax, count=5):
    """Gives the axes at most about `count` ticks along x, and five along y."""
    ax.xaxis.set_major_locator(ticks(count))
    ax.yaxis.set_major_locator(ticks(5))


def ticks(count):
    """Returns a locator of at most about `count` round numbers."""
    return MaxNLocator(count, steps=[1, 2, 5, 10])


def log_scale(ax):
    """Makes the vertical axis logarithmic, with plain numbers at its powers of ten."""
    ax.set_yscale("log")
    ax.yaxis.set_minor_locator(NullLocator())
    ax.yaxis.set_major_formatter(lambda value, _: f"{value:g}")


def evidence_ticks(low: float, high: float) -> list[float]:
    """Returns round numbers for an axis of evidence [nats] from low < 0 to high > 0."""
    above = [10.0**p for p in range(1, math.ceil(math.log10(high)) + 1)]
    below = [-(10.0**p) for p in range(1, 9) if 10.0**p <= -low]
    return [*below[-1:], 0.0, *above[:: math.ceil(len(above) / 6)]]


def finite(x, y):
    """Returns the points, x and y, of which both numbers are finite."""
    keep = np.isfinite(x) & np.isfinite(y)
    return x[keep], y[keep]


def thin(x, y):
    """Returns indices of at most _POINTS finite points, the same ones each time."""
    keep = np.flatnonzero(np.isfinite(x) & np.isfinite(y))
    if keep.size > _POINTS:
        keep = np.sort(np.random.default_rng(0).choice(keep, _POINTS, replace=False))
    return keep
