"""Distance of a collocated path from a flight, between its knots too."""

import numpy as np

from glider.physics.stiffness import count_laps
from glider.planning.point_dynamics import Dynamics

POINTS = 20
"""Points in each segment at which the path is looked at."""

STEPS = 8
"""Runge-Kutta steps in which a segment is flown again, at least."""


def path_defect(
    dynamics: Dynamics,
    times: np.ndarray,
    states: np.ndarray,
    slopes: np.ndarray,
    inputs: np.ndarray,
    phases: np.ndarray | None = None,
) -> np.ndarray:
    """Returns the largest |ẋ - f(x, u)| of each state along a path, shape (n,).

    Args:
        dynamics: of the glider.
        times: (N,) of the knots [s].
        states: (N, n) at the knots, cubics between.
        slopes: (N, n) of the cubics at the knots.
        inputs: (N,) at the knots, straight lines between.
        phases: where to look in each segment, in (0, 1); by default at POINTS places.
    """
    if phases is None:
        phases = np.linspace(0.0, 1.0, POINTS + 1)[:-1]
    s = np.asarray(phases)[:, None, None]  # (phases, segments, states) below.
    h = np.diff(times)[:, None]
    rise, start, end = np.diff(states, axis=0), h * slopes[:-1], h * slopes[1:]
    bend, twist = 3.0 * rise - 2.0 * start - end, start + end - 2.0 * rise
    path = states[:-1] + s * (start + s * (bend + s * twist))
    slope = (start + s * (2.0 * bend + 3.0 * s * twist)) / h
    commands = inputs[:-1, None] + s * np.diff(inputs)[:, None]
    points = np.concatenate([path, commands], axis=2)
    n = dynamics.num_states
    rates = dynamics.rates(points.reshape(-1, n + 1)).reshape(path.shape)
    return np.abs(slope - rates).reshape(-1, n).max(axis=0)


def segment_drift(
    dynamics: Dynamics, times: np.ndarray, states: np.ndarray, inputs: np.ndarray
) -> np.ndarray:
    """Largest distances of flights from each knot to the next, shape (n,).

    The largest over the segments, for each state.

    Args:
        dynamics: of the glider.
        times: (N,) of the knots [s].
        states: (N, n) at the knots.
        inputs: (N,) at the knots, straight lines between.
    """
    steps = max(STEPS, count_laps(dynamics.model, float(np.max(np.diff(times)))))
    phase = np.linspace(0.0, 1.0, 2 * steps + 1)[:, None]
    tape = inputs[:-1] + np.diff(inputs) * phase
    thirds = np.stack([tape[:-1:2], tape[1::2], tape[2::2]], axis=1)
    ends = dynamics.fly(states[:-1], thirds, np.diff(times) / steps)
    return np.abs(ends - states[1:]).max(axis=0)
