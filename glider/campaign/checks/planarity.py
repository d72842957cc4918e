"""Flights that roll and yaw: what a planar model flies, and where it ends.

The wing's force is along its normal n. A planar glider flies like one that rolls and
yaws if its own normal is the projection of n to the plane of flight (x, z), its force
is multiplied by the square of that projection's length, and it meets a wind in place
of the motion sideways.
"""

import numpy as np

from glider.campaign.logs import Flight

_LEAST_IN_PLANE = 0.5
"""Share of the wing's normal, squared, that must be in the plane of flight: below it
more of the wing's force acts out of the plane than in it."""


def body_axes(pitch: np.ndarray, roll: np.ndarray, yaw: np.ndarray) -> np.ndarray:
    """Nose, left and top of the body in the world, the columns of (n, 3, 3).

    Args:
        pitch: (n,), the second turn, about the body's y axis [rad].
        roll: (n,), the third, about its nose [rad].
        yaw: (n,), the first, about the vertical [rad].
    """
    from scipy.spatial.transform import Rotation  # Slow to import.

    angles = np.stack([yaw, pitch, roll], axis=1)
    return Rotation.from_euler("ZYX", angles).as_matrix()


def _normal(pitch: np.ndarray, roll: np.ndarray, yaw: np.ndarray) -> np.ndarray:
    """The wing's normal in the world (n, 3); angles as of `body_axes`."""
    return body_axes(pitch, roll, yaw)[:, :, 2]


def planar_pitch(flight: Flight, rows: np.ndarray) -> np.ndarray:
    """Computes the pitch of the wing's normal in the plane.

    Args:
        flight: with an attitude.
        rows: indices or flags of k rows.

    Returns:
        (k,), without jumps by whole turns [rad].
    """
    assert flight.attitude is not None
    _, roll, yaw = flight.attitude[rows].T
    x, _, z = _normal(flight.pose[rows, 2], roll, yaw).T
    return np.unwrap(np.arctan2(x, z))


def in_plane(
    pitch: np.ndarray, roll_and_yaw: np.ndarray, sideways: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """What a planar glider that flies like a rolled one has, in n - 1 intervals.

    With the normal (x, y, z) and the velocity v sideways, the factor is x² + z², and
    the wind -v y / (x² + z²) (x, z): it has the velocity along the normal that v has.
    Both are means of the rows at either end of an interval.

    Args:
        pitch: (n,) [rad].
        roll_and_yaw: (n, 2) [rad].
        sideways: (n,) velocity along y [m/s].

    Returns:
        The factor of its wing's force (n - 1,), and the wind in x and z that its motion
        sideways is like (n - 1, 2) [m/s].
    """
    roll, yaw = roll_and_yaw.T
    normal = _normal(pitch, roll, yaw)
    x, y, z = normal.T
    square = x**2 + z**2
    wind = -(sideways * y / square)[:, None] * normal[:, [0, 2]]
    factor_between = 0.5 * (square[1:] + square[:-1])
    wind_between = 0.5 * (wind[1:] + wind[:-1])
    return factor_between, wind_between


def find_rolled(flight: Flight, usable: np.ndarray) -> np.ndarray:
    """Rows (n,) from the first on in which the wing is mostly out of the plane.

    The glider has turned off its course: no planar model predicts what follows. Rows
    that are not `usable` (n,) begin nothing.
    """
    if flight.attitude is None:
        return np.zeros_like(usable)
    _, roll, yaw = flight.attitude.T
    normal = _normal(flight.pose[:, 2], roll, yaw)
    out_of_plane = normal[:, 1] ** 2
    is_rolled = (out_of_plane > 1.0 - _LEAST_IN_PLANE) & usable
    return np.logical_or.accumulate(is_rolled)
