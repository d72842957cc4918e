"""Flights that roll and yaw: what a planar model flies, and where it ends."""

import numpy as np

from glider.campaign.logs import Flight

_LEAST_IN_PLANE = 0.5
"""Share of the wing's normal, squared, that must be in the plane of flight: below it
more of the wing's force acts out of the plane than in it."""


def body_axes(pitch: np.ndarray, roll: np.ndarray, yaw: np.ndarray) -> np.ndarray:
    """Nose, left and top of the body in the world, columns of (n, 3, 3).

    It is turned by yaw, pitch, roll.
    """
    from scipy.spatial.transform import Rotation  # Slow to import.

    angles = np.stack([yaw, pitch, roll], axis=1)
    return Rotation.from_euler("ZYX", angles).as_matrix()


def _normal(pitch: np.ndarray, roll: np.ndarray, yaw: np.ndarray) -> np.ndarray:
    """The wing's normal in the world (n, 3), turned by yaw, pitch, roll."""
    return body_axes(pitch, roll, yaw)[:, :, 2]


def planar_pitch(flight: Flight, rows: np.ndarray) -> np.ndarray:
    """Computes the pitch of the wing's normal in the plane, at some rows [rad]."""
    assert flight.attitude is not None
    _, roll, yaw = flight.attitude[rows].T
    n = _normal(flight.pose[rows, 2], roll, yaw)
    return np.unwrap(np.arctan2(n[:, 0], n[:, 2]))


def in_plane(
    pitch: np.ndarray, roll_and_yaw: np.ndarray, sideways: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """What a planar glider that flies like a rolled one has, in n - 1 intervals.

    Args:
        pitch: (n,) [rad].
        roll_and_yaw: (n, 2) [rad].
        sideways: (n,) velocity along y [m/s].

    Returns:
        the factor of its wing's force (n - 1,), and the wind in x and z that its motion
        sideways is like (n - 1, 2) [m/s].
    """
    n = _normal(pitch, *roll_and_yaw.T)
    square = n[:, 0] ** 2 + n[:, 2] ** 2
    air = -(sideways * n[:, 1] / square)[:, None] * n[:, [0, 2]]
    return 0.5 * (square[1:] + square[:-1]), 0.5 * (air[1:] + air[:-1])


def find_rolled(flight: Flight, usable: np.ndarray) -> np.ndarray:
    """Rows (n,) from the first on in which the wing is mostly out of the plane.

    The glider has turned off its course: no planar model predicts what follows.
    """
    if flight.attitude is None:
        return np.zeros(len(flight.time), dtype=bool)
    _, roll, yaw = flight.attitude.T
    out = _normal(flight.pose[:, 2], roll, yaw)[:, 1] ** 2
    return np.logical_or.accumulate((out > 1.0 - _LEAST_IN_PLANE) & usable)
