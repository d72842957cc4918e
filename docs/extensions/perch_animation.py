"""A perch, animated: one launch in a head wind, before and after the correction.

`python docs/extensions/perch_animation.py` writes docs/pictures/perch.gif, which README
shows, too.
"""

from pathlib import Path

import matplotlib
import numpy as np
from matplotlib.animation import PillowWriter
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from side_view import draw_glider

from glider import GliderModel, PerchingProblem, plan, tracking_policy
from glider.paths import models_path
from glider.report.plots.style import COLORS, STYLE
from glider.simulation.flown_flights import FlownFlight
from glider.simulation.fly import fly

PICTURE = Path(__file__).parents[1] / "pictures" / "perch.gif"

FRAMES_PER_SECOND = 20
SLOW = 0.25
"""Speed of the animation relative to the flight."""

PAUSE = 1.5
"""Time that the last frame stays [s]."""

SEED = 3
"""Of the launch."""

TRUTH = "head_wind"


def fly_both() -> dict[str, FlownFlight]:
    """Flies one launch with the nominal model's plan and with the corrected one's."""
    truth = GliderModel.load(models_path("truths", f"{TRUTH}.yaml"))
    corrected = GliderModel.load(models_path("identified", f"{TRUTH}.yaml"))
    problem = PerchingProblem()
    launch = problem.draw_launches(1, np.random.default_rng(SEED))
    flown = {}
    for key, model in (("nominal", GliderModel()), ("corrected", corrected)):
        policy = tracking_policy(model, plan(model, problem))
        flights = fly(truth, policy, launch, problem=problem, keep_paths=True)
        flown[key] = flights.flight(0)
    return flown


def write(path: Path = PICTURE) -> None:
    """Flies, and writes the animation."""
    flown = fly_both()
    longest = max(flight.times[-1] for flight in flown.values())
    frames = np.arange(0.0, longest, SLOW / FRAMES_PER_SECOND)
    still = np.full(round(PAUSE * FRAMES_PER_SECOND), longest)
    writer = PillowWriter(fps=FRAMES_PER_SECOND)
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(8.0, 2.7), dpi=90, layout="constrained")
        ax = figure.subplots()
        with writer.saving(figure, str(path), dpi=90):
            for time in [*frames, *still]:
                draw_frame(ax, flown, time)
                writer.grab_frame()


def draw_frame(ax: Axes, flown: dict[str, FlownFlight], time: float) -> None:
    """Draws both gliders at a time, and their paths so far."""
    ax.clear()
    parameters = GliderModel().parameters
    for key, flight in flown.items():
        ends = (
            "perches" if flight.perched else f"misses by {100.0 * flight.miss:.0f} cm"
        )
        row = min(np.searchsorted(flight.times, time), len(flight.times) - 1)
        label = f"plan of the {key} model: {ends}"
        path = flight.states[: row + 1, :2]
        ax.plot(*path.T, color=COLORS[key], lw=1.0, label=label)
        draw_glider(ax, parameters, flight.states[row, :4], color=COLORS[key])
    ax.plot(0.0, 0.0, "o", color="black", ms=5.0, label="wire")
    ax.set_aspect("equal")
    ax.set(xlim=(-3.9, 0.6), ylim=(-0.5, 0.8), xlabel="x [m]", ylabel="z [m]")
    ax.legend(loc="upper left", frameon=False, ncols=3)


if __name__ == "__main__":
    write()
