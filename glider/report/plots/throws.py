"""Proposed throws beside flown ones."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes

from glider.report.plots.axes import few_ticks
from glider.report.plots.style import BLUE, GREEN, ORANGE, PURPLE, RED

THROW_COLORS = (BLUE, RED, GREEN, ORANGE, PURPLE)
"""Of the proposed throws in turn."""

_LINES = ("-", "--", ":", "-.", (0, (5, 1, 1, 1, 1, 1)))
"""Of the explanations in turn."""


def plot_throws(
    ax: Axes,
    flown: Sequence[np.ndarray],
    proposed: Sequence[np.ndarray],
    floor: float,
    tube: np.ndarray | None = None,
) -> None:
    """Draws paths in the vertical plane.

    Args:
        ax: to draw into.
        flown: (n, 2 or more) x, z of each flown flight [m].
        proposed: (explanations, n, 2 or more) of each throw [m].
        floor: least z that a throw may have [m].
        tube: (n, 2) outline of the positions that a funnel allows [m]; None for none.
    """
    if tube is not None:
        ax.fill(*tube.T, color="#DDE8F4", lw=0.0, label="funnel, projected", zorder=0)
    for k, path in enumerate(flown):
        label = "flown" if k == 0 else None
        ax.plot(*path[:, :2].T, color="#C4C4C4", lw=0.9, label=label)
    for k, paths in enumerate(proposed):
        color = THROW_COLORS[k % len(THROW_COLORS)]
        for e, path in enumerate(paths):
            label = f"throw {k + 1}" if e == 0 else None
            style = _LINES[e % len(_LINES)]
            ax.plot(*path[:, :2].T, color=color, lw=1.8, ls=style, label=label)
        ax.plot(*paths[0, 0, :2], "o", color=color, ms=4)
    ax.axhline(floor, color="k", lw=0.9, ls=":", label="floor")
    few_ticks(ax)


def plot_differences(
    ax: Axes, times: Sequence[np.ndarray], proposed: Sequence[np.ndarray]
) -> None:
    """Draws how far the other explanations put each throw from the first one.

    Args:
        ax: to draw into.
        times: (n,) of each throw [s].
        proposed: (explanations, n, 2 or more) of each throw [m].
    """
    for k, (time, paths) in enumerate(zip(times, proposed, strict=True)):
        color = THROW_COLORS[k % len(THROW_COLORS)]
        for e, path in enumerate(paths[1:], start=1):
            apart = np.linalg.norm(path[:, :2] - paths[0, :, :2], axis=1)
            ax.plot(time, 1e3 * apart, color=color, lw=1.6, ls=_LINES[e % len(_LINES)])
    few_ticks(ax)


def plot_tapes(
    ax: Axes,
    times: Sequence[np.ndarray],
    angles: Sequence[np.ndarray],
    travel: tuple[float, float],
) -> None:
    """Draws the elevator's angle that commands ask for.

    Args:
        ax: to draw into.
        times: (k,) of each throw [s].
        angles: (k,) of each throw [rad].
        travel: of the elevator [rad].
    """
    for k, (time, angle) in enumerate(zip(times, angles, strict=True)):
        color = THROW_COLORS[k % len(THROW_COLORS)]
        ax.plot(time, np.degrees(angle), color=color, lw=1.6)
    for stop in travel:
        ax.axhline(np.degrees(stop), color="k", lw=0.9, ls=":")
    few_ticks(ax)
