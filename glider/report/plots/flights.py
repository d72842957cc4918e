"""One flight beside what models predict of it."""

import math
from collections.abc import Mapping

import numpy as np
from matplotlib.axes import Axes

from glider.report.plots.axes import few_ticks, limit, log_scale, ticks
from glider.report.plots.style import COLORS, line


def plot_paths(
    ax: Axes, measured: np.ndarray, flown: Mapping[str, np.ndarray], fitted: np.ndarray
) -> None:
    """Draws one flight's path in the vertical plane.

    Args:
        ax: to draw into.
        measured: (n, 2 or more) x, z [m].
        flown: model to the same; a model that leaves the picture is cut off.
        fitted: (n,) whether the launch state was fitted on that row.
    """
    ax.plot(*measured[fitted, :2].T, color="#D9D9D9", lw=9, solid_capstyle="butt")
    ax.plot(*measured[:, :2].T, color=COLORS["measured"], lw=3.0, label="measured")
    for model, pose in flown.items():
        ax.plot(*pose[:, :2].T, **line(model))
    limit(ax.set_xlim, measured[:, 0], margin=0.06, quantile=0.0)
    limit(ax.set_ylim, measured[:, 1], margin=0.35, quantile=0.0)
    few_ticks(ax)


def plot_pitch(
    ax: Axes,
    time: np.ndarray,
    measured: np.ndarray,
    flown: Mapping[str, np.ndarray],
    fitted_until: float,
) -> None:
    """Draws one flight's pitch over time.

    Args:
        ax: to draw into.
        time: (n,) [s].
        measured: (n,) [rad].
        flown: model to the same; a model that leaves the picture is cut off.
        fitted_until: the launch state was fitted up to here [s].
    """
    _shade(ax, time, fitted_until)
    ax.plot(time, np.degrees(measured), color="k", lw=3.0, label="measured")
    for model, pitch in flown.items():
        ax.plot(time, np.degrees(pitch), **line(model))
    limit(ax.set_ylim, np.degrees(measured), margin=0.35, quantile=0.0)
    ax.set_xlim(time[0], time[-1])
    few_ticks(ax, 4)


def plot_distance(
    ax: Axes,
    time: np.ndarray,
    distance: Mapping[str, np.ndarray],
    fitted_until: float,
    noise: float,
) -> None:
    """Draws the distance of each model from the flight over time.

    Args:
        ax: to draw into.
        time: (n,) [s].
        distance: model to (n,) [m].
        fitted_until: the launch state was fitted up to here [s].
        noise: standard deviation of a measured coordinate [m].
    """
    _shade(ax, time, fitted_until)
    for model, d in distance.items():
        ax.plot(time, np.where(d > 0.0, d, np.nan), **line(model))
    if math.isfinite(noise) and noise > 0.0:
        ax.axhline(noise, color="k", lw=0.9, ls=":")
    log_scale(ax)
    d = np.concatenate([np.ravel(d) for d in distance.values()] or [np.zeros(0)])
    d = d[np.isfinite(d) & (d > 0.0)]
    if d.size:
        low, high = np.quantile(d, 0.02), min(d.max(), 100.0)
        if math.isfinite(noise) and noise > 0.0:
            low = min(max(low, 0.2 * noise), 0.5 * noise)
        ax.set_ylim(0.7 * low, 2.0 * max(high, low))
    ax.set_xlim(time[0], time[-1])
    ax.xaxis.set_major_locator(ticks(4))


def _shade(ax, time, until):
    ax.axvspan(time[0], until, color="#EDEDED", lw=0, zorder=0)
