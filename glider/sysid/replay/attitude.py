"""Throws that roll and yaw, as a planar glider sees them.

The wing's force is along its normal n, which a rolled glider holds out of the plane of
flight. In the plane it acts along (n_x, n_z), a shorter vector: the pitch that a planar
glider would have is atan(n_x / n_z), and the force, which grows with v·n too, is
smaller by n_x² + n_z². What the sideways velocity adds to v·n is like air that moves
along the normal.
"""

import numpy as np

from glider.campaign.checks.planarity import normal
from glider.campaign.logs import Flight


def planar_pitch(flight: Flight, rows: np.ndarray) -> np.ndarray:
    """Returns the pitch of the wing's normal in the plane, at some rows [rad]."""
    assert flight.attitude is not None
    _, roll, yaw = flight.attitude[rows].T
    n = normal(flight.pose[rows, 2], roll, yaw)
    return np.unwrap(np.arctan2(n[:, 0], n[:, 2]))


def in_plane(
    pitch: np.ndarray, roll_and_yaw: np.ndarray, sideways: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Returns what a planar glider makes of a rolled one.

    Args:
        pitch: (n,) smoothed [rad].
        roll_and_yaw: (n, 2) smoothed [rad].
        sideways: (n,) smoothed velocity along y [m/s].

    Returns:
        the factor of the wing's force in each interval (n - 1,), and the air velocity
        (x, z) there that the sideways motion is like (n - 1, 2) [m/s].
    """
    n = normal(pitch, *roll_and_yaw.T)
    square = n[:, 0] ** 2 + n[:, 2] ** 2
    air = -(sideways * n[:, 1] / square)[:, None] * n[:, [0, 2]]
    return _middle(square), _middle(air)


def _middle(values: np.ndarray) -> np.ndarray:
    return 0.5 * (values[1:] + values[:-1])
