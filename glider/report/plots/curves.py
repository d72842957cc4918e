"""What a plate lacks, over the angle of attack, with its band."""

import numpy as np
from matplotlib.axes import Axes

from glider.report.plots.axes import few_ticks
from glider.report.plots.style import BLUE, GREEN, RED

BAND = 2.0
"""Standard errors on either side."""


def plot_curve(
    ax: Axes, alpha: np.ndarray, lack: np.ndarray, std: np.ndarray, named: np.ndarray
) -> None:
    """Draws what the plate lacks, the part with a name, and the rest that is carried.

    Args:
        ax: to draw into.
        alpha: (n,) [rad].
        lack: (n,) all that the plate lacks.
        std: (n,) standard error of it.
        named: (n,) what the named effects explain.
    """
    degrees = np.degrees(alpha)
    ax.fill_between(
        degrees,
        lack - BAND * std,
        lack + BAND * std,
        color=BLUE,
        alpha=0.18,
        lw=0,
        label=f"± {BAND:g} standard errors",
    )
    ax.plot(degrees, lack, color=BLUE, lw=2.4, label="the plate lacks")
    ax.plot(degrees, named, color=GREEN, lw=1.8, ls=(0, (4, 1.5)), label="named")
    ax.plot(
        degrees, lack - named, color=RED, lw=1.8, ls=(0, (1, 1)), label="has no name"
    )
    ax.axhline(0.0, color="#444444", lw=0.7)
    few_ticks(ax, 7)
