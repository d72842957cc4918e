"""The launches that can perch at all, as a map."""

from pathlib import Path

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.collections import QuadMesh
from matplotlib.figure import Figure

from glider.physics.state import STATE_NAMES
from glider.planning.reach import Reach
from glider.report.plots.axes import few_ticks
from glider.report.plots.style import STYLE

CELLS = 24
"""Number of cells along each axis, at most."""

_LABELS = {
    "xdot": "launch speed [m/s]",
    "z": "height [m]",
    "pitch": "pitch, nose down [rad]",
}


def plot_share(ax: Axes, reach: Reach, across: str, along: str) -> QuadMesh:
    """Draws the share of launches with a plan over two of their states.

    Args:
        ax: to draw into.
        reach: the launches.
        across, along: names of states.
    """
    cells = int(np.clip(np.sqrt(len(reach.planned) / 12), 4, CELLS))
    x, y = (reach.launches[:, STATE_NAMES.index(name)] for name in (across, along))
    total, *edges = np.histogram2d(x, y, cells)
    planned, *_ = np.histogram2d(x[reach.planned], y[reach.planned], edges)
    share = np.where(total > 0, planned / np.maximum(total, 1), np.nan)
    mesh = ax.pcolormesh(*edges, share.T, vmin=0.0, vmax=1.0, cmap="viridis")
    ax.set_xlabel(_LABELS[across])
    ax.set_ylabel(_LABELS[along])
    few_ticks(ax)
    return mesh


def plot_misses(ax: Axes, reach: Reach) -> None:
    """Draws how near to the wire launches without a plan can come, over the speed."""
    speed = reach.launches[:, STATE_NAMES.index("xdot")]
    short = ~reach.planned
    ax.plot(speed[short], reach.misses[short], ".", ms=2, alpha=0.5)
    ax.set_xlabel(_LABELS["xdot"])
    ax.set_ylabel("least miss without a plan [m]")
    ax.set_ylim(bottom=0.0)
    few_ticks(ax)


def save_reach_figure(path: Path, reach: Reach) -> None:
    """Draws the map over speed, height and pitch, and the misses beside it."""
    with rc_context(STYLE):
        figure = Figure(figsize=(10.5, 3.2), layout="constrained")
        axes = figure.subplots(1, 3)
        plot_share(axes[0], reach, "xdot", "z")
        mesh = plot_share(axes[1], reach, "xdot", "pitch")
        figure.colorbar(mesh, ax=axes[1], label="share of launches with a plan")
        plot_misses(axes[2], reach)
        figure.savefig(path)
