"""Flights to a wire."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes

from glider.planning.problem import Hook
from glider.report.plots.axes import few_ticks, legend_beside
from glider.report.plots.style import COLORS, RED

REPLAYED = RED
BEFORE = RED
AFTER = COLORS["corrected"]
REACH = Hook().reach


def plot_perches(
    ax: Axes,
    planned: np.ndarray,
    flown: Sequence[np.ndarray],
    replayed: Sequence[np.ndarray] = (),
    wire: tuple[float, float] = (0.0, 0.0),
    color: str = AFTER,
) -> None:
    """Draws paths to the wire in the vertical plane, one scale on both axes.

    Args:
        ax: to draw into.
        planned: (N, 2 or more) x, z [m].
        flown: of each flight, the same.
        replayed: the same of flights without feedback.
        wire: (x, z) [m]; a ring shows the reach of the article's hook.
        color: of the flights.
    """
    groups = ((replayed, REPLAYED, "without feedback"), (flown, color, "with feedback"))
    for paths, shade, words in groups:
        for k, path in enumerate(paths):
            label = f"{len(paths)} flights {words}" if k == 0 else None
            ax.plot(*path[:, :2].T, color=shade, lw=0.8, alpha=0.5, label=label)
    ax.plot(*planned[:, :2].T, color="k", lw=1.8, ls=(0, (4, 2)), label="plan")
    angle = np.linspace(0.0, 2.0 * np.pi, 60)
    ring = np.array(wire)[:, None] + REACH * np.array([np.cos(angle), np.sin(angle)])
    ax.plot(*ring, color="k", lw=1.0, label=f"{100 * REACH:.0f} cm of the wire")
    ax.set_aspect("equal", adjustable="datalim")
    ax.set_xlabel("x [m]")
    ax.set_ylabel("z [m]")
    legend_beside(ax)
    few_ticks(ax)


def plot_commands(
    ax: Axes, times: np.ndarray, planned: np.ndarray, flown: Sequence[np.ndarray]
) -> None:
    """Draws elevator angles over time.

    Args:
        ax: to draw into.
        times: (N,) of the plan [s].
        planned: (N,) [rad].
        flown: (K, 2) time [s] and elevator [rad] of each flight.
    """
    for path in flown:
        ax.plot(path[:, 0], np.degrees(path[:, 1]), color=AFTER, lw=0.7, alpha=0.5)
    ax.plot(times, np.degrees(planned), color="k", lw=1.8, ls=(0, (4, 2)))
    ax.set_xlabel("time [s]")
    ax.set_ylabel("elevator, up > 0 [°]")
    few_ticks(ax, 4)


def plot_misses(ax: Axes, misses: Sequence[float], label: str, color: str) -> None:
    """Draws which share of flights misses the wire by less than a distance.

    Args:
        ax: to draw into.
        misses: of each flight [m].
        label: for the legend.
        color: of the line.
    """
    ordered = np.sort(misses)
    share = np.arange(1, len(ordered) + 1) / len(ordered)
    ax.step(1000.0 * ordered, 100.0 * share, where="post", color=color, label=label)
    ax.set_xscale("log")
    ax.set_xlabel("miss [mm]")
    ax.set_ylabel("flights that miss by less [%]")
    # A flight left of the line has the wire within reach.
    ax.axvline(1000.0 * REACH, color="k", lw=1.0)
