"""Distance at which a flight passes the wire."""

import numpy as np
from scipy.interpolate import CubicHermiteSpline

from glider.physics.state import POSITION, VELOCITY

PERCH_RADIUS = 0.05
"""Distance from the wire within which a center of mass that passes has perched [m]."""

REFINEMENT = 16
"""Segments that each step of a simulator's log is divided into."""


def least_distance(points: np.ndarray, wire: np.ndarray) -> float:
    """Returns the distance of a polyline from a point.

    Args:
        points: (K, 2), K at least 1.
        wire: (2,).
    """
    start = points[:-1] - wire
    along = np.diff(points, axis=0)
    square = np.sum(along**2, axis=1)
    share = -np.sum(start * along, axis=1) / np.where(square > 0.0, square, 1.0)
    nearest = start + np.clip(share, 0.0, 1.0)[:, None] * along
    distances = np.linalg.norm(np.vstack([nearest, points[-1:] - wire]), axis=1)
    return float(np.min(distances))


def path_miss(times: np.ndarray, states: np.ndarray, wire: np.ndarray) -> float:
    """Returns the least distance of a logged flight from the wire [m].

    A simulator's steps are long; between them the path is the cubic of the
    positions and velocities at both ends, followed by short segments.

    Args:
        times: (K,) increasing, or now and then equal [s].
        states: (K, n).
        wire: (2,).
    """
    kept = np.flatnonzero(np.append(np.diff(times) > 0.0, True))
    times, states = times[kept], states[kept]
    if len(times) < 2:
        return least_distance(states[:, POSITION], wire)
    path = CubicHermiteSpline(times, states[:, POSITION], states[:, VELOCITY])
    steps = np.diff(times)[:, None] * np.arange(REFINEMENT) / REFINEMENT
    fine = np.append((times[:-1, None] + steps).ravel(), times[-1])
    return least_distance(path(fine), wire)
