"""Limits, ticks and points of axes: what they show."""

from collections.abc import Callable

import numpy as np
from matplotlib.ticker import MaxNLocator, NullLocator

_POINTS = 1500
"""A scatter shows no more than this; its medians take all points."""


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
    values = values[np.isfinite(values)]
    if values.size == 0:
        return
    low, high = np.quantile(values, [quantile, 1.0 - quantile])
    if around is not None:
        low, high = min(low, around), max(high, around)
    pad = margin * (high - low) or 0.05 * abs(high) or 1.0
    set_limits(low - pad, high + pad)


def few_ticks(ax, count=5):
    ax.xaxis.set_major_locator(ticks(count))
    ax.yaxis.set_major_locator(ticks(5))


def ticks(count):
    return MaxNLocator(count, steps=[1, 2, 5, 10])


def log_scale(ax):
    ax.set_yscale("log")
    ax.yaxis.set_minor_locator(NullLocator())
    ax.yaxis.set_major_formatter(lambda value, _: f"{value:g}")


def finite(x, y):
    keep = np.isfinite(x) & np.isfinite(y)
    return x[keep], y[keep]


def thin(x, y):
    """Returns indices of at most _POINTS finite points, the same ones each time."""
    keep = np.flatnonzero(np.isfinite(x) & np.isfinite(y))
    if keep.size > _POINTS:
        keep = np.sort(np.random.default_rng(0).choice(keep, _POINTS, replace=False))
    return keep
