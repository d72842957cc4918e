"""Paths for a solver to start from."""

import dataclasses

import numpy as np
from pydrake.trajectories import PiecewisePolynomial

from glider.physics.model import GliderModel
from glider.planning.problem import PerchingProblem


@dataclasses.dataclass(frozen=True, kw_only=True)
class Guess:
    """Trajectories to start a solver from, over the same time."""

    name: str
    states: PiecewisePolynomial
    inputs: PiecewisePolynomial


def straight_line(
    model: GliderModel, problem: PerchingProblem, duration: float | None = None
) -> Guess:
    """Returns straight lines from launch to goal with the elevator at rest.

    Args:
        model: the glider.
        problem: what to fly.
        duration: [s]; by default at 5/8 of the launch speed.
    """
    launch = model.initial_state(problem.launch)
    goal = model.initial_state(problem.goal)
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
    model: GliderModel, problem: PerchingProblem, dip: float, duration: float
) -> Guess:
    """Returns a path that first dips below the line, then pulls up to the wire.

    Args:
        model: the glider.
        problem: what to fly.
        dip: depth below the straight line [m].
        duration: [s].
    """
    line = straight_line(model, problem, duration)
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
