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


def straight_line(model: GliderModel, problem: PerchingProblem) -> Guess:
    """Straight lines from launch to goal at 5/8 of the speed, the elevator at rest."""
    launch = model.initial_state(problem.launch)
    goal = model.initial_state(problem.goal)
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
