"""Where a flight passes the wire, and how it comes there."""

import dataclasses

import numpy as np
from scipy.interpolate import CubicHermiteSpline

from glider.physics.state import POSITION, VELOCITY

REFINEMENT = 16
"""Segments that each step of a simulator's log is divided into."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Pass:
    """The moment at which a flight is nearest to the wire."""

    time: float
    """Time of the flight [s]."""

    miss: float
    """Distance of the center of mass from the wire [m]."""

    arrival: np.ndarray
    """(n,) state."""


def closest_pass(times: np.ndarray, states: np.ndarray, wire: np.ndarray) -> Pass:
    """Returns where a logged flight is nearest to the wire.

    A simulator's steps are long; between them the path is the cubic of the
    positions and velocities at both ends, followed by short segments; what else the
    state holds lies on a straight line.

    Args:
        times: (K,) increasing, or now and then equal [s].
        states: (K, n).
        wire: (2,).
    """
    kept = np.flatnonzero(np.append(np.diff(times) > 0.0, True))
    times, states = times[kept], states[kept]
    fine, path = times, states[:, POSITION]
    if len(times) > 1:
        steps = np.diff(times)[:, None] * np.arange(REFINEMENT) / REFINEMENT
        fine = np.append((times[:-1, None] + steps).ravel(), times[-1])
        path = CubicHermiteSpline(times, path, states[:, VELOCITY])(fine)
    start, along = path[:-1] - wire, np.diff(path, axis=0)
    square = np.sum(along**2, axis=1)
    share = -np.sum(start * along, axis=1) / np.where(square > 0.0, square, 1.0)
    share = np.append(np.clip(share, 0.0, 1.0), 0.0)
    along = np.vstack([along, np.zeros(2)])
    places = path + share[:, None] * along
    distances = np.linalg.norm(places - wire, axis=1)
    k = int(np.argmin(distances))
    time = float(fine[k] + share[k] * (fine[min(k + 1, len(fine) - 1)] - fine[k]))
    arrival = np.array([np.interp(time, times, column) for column in states.T])
    arrival[POSITION] = places[k]
    return Pass(time=time, miss=float(distances[k]), arrival=arrival)
