"""Throws that roll and yaw, as a planar glider sees them.

The wing's force is along its normal n, which a rolled glider holds out of the plane of
flight. In the plane it acts along (n_x, n_z), a shorter vector: the pitch that a planar
glider would have is atan(n_x / n_z), and the force, which grows with v·n too, is smaller
by n_x² + n_z². What the sideways velocity adds to v·n is like air that moves along the
normal.
"""

import dataclasses

import numpy as np

from glider.campaign.logs import Flight


def in_plane(
    flight: Flight, sideways: np.ndarray
) -> tuple[Flight, np.ndarray, np.ndarray]:
    """Returns a flight with the pitch of its wing's normal in the plane.

    Args:
        flight: with attitude.
        sideways: (n,) smoothed velocity along y [m/s].

    Returns:
        the flight; the factor of the wing's force in each interval (n - 1,); the air
        velocity (x, z) there that the sideways motion is like (n - 1, 2) [m/s].
    """
    assert flight.attitude is not None
    roll, yaw = flight.attitude[:, 1], flight.attitude[:, 2]
    pitch = flight.pose[:, 2]
    x = np.cos(yaw) * np.sin(pitch) * np.cos(roll) + np.sin(yaw) * np.sin(roll)
    y = np.sin(yaw) * np.sin(pitch) * np.cos(roll) - np.cos(yaw) * np.sin(roll)
    z = np.cos(pitch) * np.cos(roll)
    length = np.hypot(x, z)
    planar = np.unwrap(np.arctan2(x, z))
    air = -(sideways * y / length)[:, None] * np.stack([x, z], axis=1) / length[:, None]
    pose = np.column_stack([flight.pose[:, :2], planar])
    return (
        dataclasses.replace(flight, pose=pose, attitude=None),
        _middle(length**2),
        _middle(air),
    )


def _middle(values: np.ndarray) -> np.ndarray:
    return 0.5 * (values[1:] + values[:-1])
