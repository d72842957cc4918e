"""Velocity and acceleration of a log without a model, and what drives the body.

A cubic is fitted to the poses within `SPAN` about a row; its derivatives at the row are
the velocity and the acceleration. Rows at either end of the log, and rows beside gaps,
have no window and so no motion. `Drive` fills them by interpolation.
"""

from typing import NamedTuple

import numpy as np

SPAN = 0.1
"""Duration that a cubic is fitted over [s]: at 120 Hz and 0.4 mm of noise it leaves
0.3 m/s² in an acceleration."""

_FEWEST_ROWS = 7  # Of a cubic.
PUSH = 6.0
"""Force per mass along the path that only a hand exerts [m/s²]; wind, drag and a thrust
of half the weight stay below."""
_LONGEST = 1.5  # Duration of a window with missing rows over that of one without.


def robust_std(values: np.ndarray) -> np.ndarray:
    """Standard deviation about zero along axis 0, 1.4826 median |values|.

    `scipy.stats.median_abs_deviation` has it, too, but takes 0.3 s to import.
    """
    return 1.4826 * np.median(np.abs(values), axis=0)


class Motion(NamedTuple):
    """Motion at k rows of a log, x, z and pitch in the columns.

    Attributes:
        time: (k,) [s].
        pose: (k, 3), smoothed [m, m, rad].
        velocity: (k, 3) [m/s, m/s, rad/s].
        acceleration: (k, 3) [m/s², m/s², rad/s²].
    """

    time: np.ndarray
    pose: np.ndarray
    velocity: np.ndarray
    acceleration: np.ndarray

    @property
    def speed(self) -> np.ndarray:
        """Speed along the path (k,) [m/s]."""
        return np.linalg.norm(self.velocity[:, :2], axis=1)

    @property
    def axes(self) -> tuple[np.ndarray, np.ndarray]:
        """Body axis and wing normal in x and z, unit vectors (k, 2) each."""
        pitch = self.pose[:, 2]
        cos = np.cos(pitch)
        sin = np.sin(pitch)
        body = np.stack([cos, -sin], axis=1)
        normal = np.stack([sin, cos], axis=1)
        return body, normal

    def with_pitch(self, sign: int) -> "Motion":
        """The motion whose pitch is `sign` times the logged one."""
        signs = np.array([1.0, 1.0, sign])
        time, *others = self
        return Motion(time, *(values * signs for values in others))


def half_window(time: np.ndarray) -> int:
    """Number of rows that a cubic has on either side of its own, of times (n,) [s]."""
    step = np.median(np.diff(time))
    half = max(round(SPAN / step / 2), 3)
    available = (len(time) - 1) // 2
    return min(half, available)


def calc_motion(time: np.ndarray, pose: np.ndarray, *, stride: int = 1) -> Motion:
    """Fits a cubic about every `stride`-th row, except where many rows are missing.

    Args:
        time: (n,), increasing [s].
        pose: (n, 3) x, z [m] and pitch [rad], or any other columns (n, c).
        stride: rows from one cubic to the next.

    Returns:
        The motion at the rows that have a cubic; at none of less than `_FEWEST_ROWS`.
    """
    if len(time) < _FEWEST_ROWS:
        none = np.empty((0, 3))
        return Motion(np.empty(0), none, none, none)

    # Windows (k, 2 half + 1) of rows, without those that hold a long gap.
    half = half_window(time)
    scale = half * np.median(np.diff(time))
    rows = np.arange(half, len(time) - half, stride)
    duration = time[rows + half] - time[rows - half]
    rows = rows[duration < _LONGEST * 2 * scale]
    window = rows[:, None] + np.arange(-half, half + 1)

    # Powers 0 to 3 of a time that goes from about -1 to 1 in each window.
    since = (time[window] - time[rows, None]) / scale
    powers = since[..., None] ** np.arange(4)

    # Centered pose: the offset of a position must not cost digits. Normal equations of
    # four powers of at most 1 cost few, and a tenth of the time of an SVD a window.
    center = pose[rows]
    transposed = powers.swapaxes(1, 2)
    target = transposed @ (pose[window] - center[:, None])
    ridge = 1e-12 * np.eye(4)  # Of a window of the same times.
    coefficients = np.linalg.solve(transposed @ powers + ridge, target)
    return Motion(
        time=time[rows],
        pose=center + coefficients[:, 0],
        velocity=coefficients[:, 1] / scale,
        acceleration=2 * coefficients[:, 2] / scale**2,
    )


class Drive(NamedTuple):
    """What drives a body, at all n rows of a log.

    It is interpolated between the rows that have a cubic, and constant beyond them.

    Attributes:
        time: (n,) [s].
        speed: (n,) [m/s].
        way: (n,) length of the path since the first cubic [m].
        energy: (n,) g z + V²/2, of height and speed [J/kg].
        push: (n,) force per mass along the path, gravity apart [m/s²].
    """

    time: np.ndarray
    speed: np.ndarray
    way: np.ndarray
    energy: np.ndarray
    push: np.ndarray

    def take(self, rows: np.ndarray | slice) -> "Drive":
        """Some of the rows."""
        return Drive(*(values[rows] for values in self))


def calc_drive(time: np.ndarray, position: np.ndarray, gravity: float) -> Drive:
    """Computes what drives a body, zero where no row has a cubic.

    Args:
        time: (n,), increasing [s].
        position: (n, k), the last column is the height [m].
        gravity: [m/s²].
    """
    motion = calc_motion(time, position)
    if len(motion.time) == 0:
        return Drive(time, *np.zeros((4, len(time))))
    height = motion.pose[:, -1]
    speed = np.linalg.norm(motion.velocity, axis=1)
    steps = np.diff(motion.time, prepend=motion.time[:1])
    force = motion.acceleration.copy()
    force[:, -1] += gravity
    power = np.sum(force * motion.velocity, axis=1)
    at_cubics = (
        speed,
        np.cumsum(speed * steps),
        gravity * height + 0.5 * speed**2,
        power / np.maximum(speed, 1e-3),
    )
    return Drive(time, *(np.interp(time, motion.time, own) for own in at_cubics))
