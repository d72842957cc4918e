"""Plans, simulated and logged flights as tracks for Meshcat."""

import numpy as np

from diagrams.playback import Track
from diagrams.scene import NUM_POSITIONS
from glider.planning.plan import Plan
from glider.simulation.flown_flights import INSTANT, FlownFlight
from glider.simulation.refly import Motion

Color = tuple[float, float, float, float]


def flight_track(name: str, flight: FlownFlight, color: Color | None = None) -> Track:
    """Returns a flight, with the forces on wing and elevator where they are known."""
    kept = np.flatnonzero(np.append(np.diff(flight.times) > INSTANT, True))
    return Track(
        name=name,
        times=flight.times[kept],
        poses=flight.states[kept, :NUM_POSITIONS],
        color=color,
        forces=None if flight.forces is None else flight.forces[kept],
    )


def plan_track(name: str, plan: Plan, color: Color | None = None) -> Track:
    """Returns a plan, at its knots."""
    return path_track(name, plan.times, plan.states, color)


def path_track(
    name: str, times: np.ndarray, states: np.ndarray, color: Color | None = None
) -> Track:
    """Returns states (K, n) at some times [s]."""
    return Track(name=name, times=times, poses=states[:, :NUM_POSITIONS], color=color)


def motion_track(name: str, motion: Motion, color: Color | None = None) -> Track:
    """Returns a logged flight, as measured or as a model flies it."""
    return Track(
        name=name,
        times=motion.time,
        poses=motion.poses,
        color=color,
        forces=motion.forces,
    )
