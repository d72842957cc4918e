"""Limits, ticks and points of axes: what they show."""

from collections.abc import Callable

import numpy as np
from matplotlib.axes import Axes
from matplotlib.legend import Legend
from matplotlib.ticker import MaxNLocator, NullLocator

from glider.report.plots.binning import bounds


def limit(
    set_limits: Callable[[float, float], object],
    values: np.ndarray,
    margin: float = 0.08,
    quantile: float = 0.004,
    around: float | None = None,
) -> None:
    """Sets an axis to where the points are; see `bounds`."""
    found = bounds(values, margin, quantile, around)
    if found is not None:
        set_limits(*found)


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
