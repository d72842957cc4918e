"""Distance of a collocated path from a flight, between its knots too."""

import numpy as np
from pydrake.trajectories import PiecewisePolynomial

from glider.planning.point_dynamics import Dynamics

POINTS = 20
"""Points in each segment at which the path is looked at."""

STEPS = 8
"""Runge-Kutta steps in which a segment is flown afresh."""


def path_defect(
    dynamics: Dynamics, states: PiecewisePolynomial, inputs: PiecewisePolynomial
) -> np.ndarray:
    """Returns the largest |ẋ - f(x, u)| of each state along a path, shape (n,).

    Args:
        dynamics: of the glider.
        states: (n, 1); its breaks are the knots.
        inputs: (1, 1).
    """
    breaks = np.asarray(states.get_segment_times())
    within = np.linspace(0.0, 1.0, POINTS + 1)[:-1]
    times = (breaks[:-1, None] + np.diff(breaks)[:, None] * within).ravel()
    slope = states.MakeDerivative()
    worst = np.zeros(dynamics.num_states)
    for t in times:
        rate = dynamics.evaluate(states.value(t)[:, 0], inputs.value(t)[0, 0])
        worst = np.maximum(worst, np.abs(slope.value(t)[:, 0] - rate))
    return worst


def segment_drift(
    dynamics: Dynamics, times: np.ndarray, states: np.ndarray, inputs: np.ndarray
) -> np.ndarray:
    """Returns how far flights from each knot end from the next, shape (n,).

    The largest over the segments, for each state.

    Args:
        dynamics: of the glider.
        times: (N,) of the knots [s].
        states: (N, n) at the knots.
        inputs: (N,) at the knots, straight lines between.
    """
    phase = np.linspace(0.0, 1.0, 2 * STEPS + 1)
    worst = np.zeros(dynamics.num_states)
    for k in range(len(times) - 1):
        tape = inputs[k] + (inputs[k + 1] - inputs[k]) * phase
        thirds = np.stack([tape[:-1:2], tape[1::2], tape[2::2]], axis=1)
        step = (times[k + 1] - times[k]) / STEPS
        end = dynamics.fly(states[k], thirds, step)
        worst = np.maximum(worst, np.abs(end - states[k + 1]))
    return worst
