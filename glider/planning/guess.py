"""Paths for a solver to start from."""

import dataclasses

import numpy as np
from pydrake.systems.framework import LeafSystem
from pydrake.trajectories import PiecewisePolynomial

from glider.planning.problem import PerchingProblem
from glider.systems.plant import initial_state


@dataclasses.dataclass(frozen=True, kw_only=True)
class Guess:
    """Trajectories to start a solver from, over the same time."""

    name: str
    states: PiecewisePolynomial
    inputs: PiecewisePolynomial


def straight_line(
    plant: LeafSystem, problem: PerchingProblem, duration: float | None = None
) -> Guess:
    """Returns straight lines from launch to goal with the elevator at rest.

    Args:
        plant: a GliderPlant.
        problem: what to fly.
        duration: [s]; by default at 5/8 of the launch speed.
    """
    launch = initial_state(plant, problem.launch)
    goal = initial_state(plant, problem.goal)
    if duration is None:
        x, z = np.subtract(problem.wire, problem.launch[:2])
        xdot, zdot = problem.launch[4:6]
        duration = 1.6 * np.hypot(x, z) / np.hypot(xdot, zdot)
    low, high = problem.duration_limits
    ends = [0.0, float(np.clip(duration, low, high))]
    return Guess(
        name=f"a straight line over {ends[1]:.2f} s",
        states=PiecewisePolynomial.FirstOrderHold(
            ends, np.column_stack([launch, goal])
        ),
        inputs=PiecewisePolynomial.FirstOrderHold(ends, np.zeros((1, 2))),
    )


def swoop(
    plant: LeafSystem, problem: PerchingProblem, dip: float, duration: float
) -> Guess:
    """Returns a path that first dips below the line, then pulls up to the wire.

    Args:
        plant: a GliderPlant.
        problem: what to fly.
        dip: depth below the straight line [m].
        duration: [s].
    """
    line = straight_line(plant, problem, duration)
    times = np.linspace(0.0, line.states.end_time(), 9)
    phase = times / times[-1]
    states = np.hstack([line.states.value(t) for t in times])
    states[1] -= dip * np.sin(np.pi * phase)
    states[5] -= dip * np.pi / times[-1] * np.cos(np.pi * phase)
    states[2] = problem.goal[2] * phase**3
    return Guess(
        name=f"a dip of {dip:.2f} m over {times[-1]:.2f} s",
        states=PiecewisePolynomial.FirstOrderHold(times, states),
        inputs=PiecewisePolynomial.FirstOrderHold(times, np.zeros((1, len(times)))),
    )
