"""Plans and simulated flights as tracks for Meshcat."""

import numpy as np

from diagrams.playback import Track
from diagrams.scene import NUM_POSITIONS
from glider.planning.plan import Plan
from glider.simulation.flights import FlownFlight

Color = tuple[float, float, float, float]


def flight_track(name: str, flight: FlownFlight, color: Color | None = None) -> Track:
    """Returns a flight, with the forces on wing and elevator where they are known."""
    kept = np.flatnonzero(np.append(np.diff(flight.times) > 0.0, True))
    return Track(
        name=name,
        times=flight.times[kept],
        poses=flight.states[kept, :NUM_POSITIONS],
        color=color,
        forces=None if flight.forces is None else flight.forces[kept],
    )


def plan_track(name: str, plan: Plan, color: Color | None = None) -> Track:
    """Returns a plan, at its knots."""
    poses = plan.states[:, :NUM_POSITIONS]
    return Track(name=name, times=plan.times, poses=poses, color=color)
