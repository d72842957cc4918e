"""Flights to a wire, drawn by Matplotlib."""

from collections.abc import Iterable

import numpy as np
from matplotlib.axes import Axes

from glider.planning.plan import Plan
from glider.planning.problem import Hook
from glider.simulation.flown_flights import FlownFlight

RED, BLUE = "#D55E00", "#0072B2"


def plot_perches(
    ax: Axes,
    plan: Plan,
    flown: Iterable[FlownFlight],
    replayed: Iterable[FlownFlight] = (),
    wire: tuple[float, float] = (0.0, 0.0),
    color: str = BLUE,
) -> None:
    """Draws paths to the wire in the vertical plane, one scale on both axes.

    Args:
        ax: to draw into.
        plan: that the flights follow.
        flown: flights with feedback.
        replayed: flights without.
        wire: (x, z) [m]; a ring shows the reach of the article's hook.
        color: of the flights with feedback.
    """
    groups = ((replayed, RED, "without feedback"), (flown, color, "with feedback"))
    for flights, shade, words in groups:
        paths = [flight.states[:, :2].T for flight in flights]
        for k, path in enumerate(paths):
            label = f"{len(paths)} flights {words}" if k == 0 else None
            ax.plot(*path, color=shade, lw=0.8, alpha=0.5, label=label)
    ax.plot(*plan.states[:, :2].T, color="k", lw=1.8, ls=(0, (4, 2)), label="plan")
    angle, reach = np.linspace(0.0, 2.0 * np.pi, 60), Hook().reach
    ring = np.array(wire)[:, None] + reach * np.array([np.cos(angle), np.sin(angle)])
    ax.plot(*ring, color="k", lw=1.0, label=f"{100 * reach:.0f} cm of the wire")
    ax.set_aspect("equal", adjustable="datalim")
    ax.set(xlabel="x [m]", ylabel="z [m]")
    ax.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0), frameon=False)
