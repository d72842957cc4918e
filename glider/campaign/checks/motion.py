"""Velocity and acceleration of a log without a model, and what drives it: cubics."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

SPAN = 0.1
"""Duration that a cubic is fitted over [s]: at 120 Hz and 0.4 mm of noise it leaves
0.3 m/s² in an acceleration."""

FEWEST_ROWS = 7  # Of a cubic.
PUSH = 6.0
"""Force per mass along the path that only a hand exerts [m/s²]; wind, drag and a thrust
of half the weight stay below."""
_LONGEST = 1.5  # Duration of a window with missing rows over that of one without.


def robust_std(values: np.ndarray) -> np.ndarray:
    """Standard deviation about zero along axis 0; scipy.stats takes 0.3 s to import."""
    return 1.4826 * np.median(np.abs(values), axis=0)


def jackknife_error(estimates: Sequence[float] | np.ndarray) -> float:
    """Standard error of an estimate, from those without one part each (k,)."""
    return float(np.std(estimates) * np.sqrt(len(estimates) - 1.0))


class Motion(NamedTuple):
    """Motion at k rows of a log; x, z, pitch in the columns."""

    time: np.ndarray  #: (k,) [s]
    pose: np.ndarray  #: (k, 3) [m, m, rad]
    velocity: np.ndarray  #: (k, 3)
    acceleration: np.ndarray  #: (k, 3)

    @property
    def speed(self) -> np.ndarray:
        """Speed along the path (k,) [m/s]."""
        return np.linalg.norm(self.velocity[:, :2], axis=1)

    @property
    def axes(self) -> tuple[np.ndarray, np.ndarray]:
        """Body axis and wing normal, (k, 2) each, in x and z."""
        cos = np.cos(self.pose[:, 2])
        sin = np.sin(self.pose[:, 2])
        return np.stack([cos, -sin], axis=1), np.stack([sin, cos], axis=1)

    def with_pitch(self, sign: int) -> "Motion":
        """The motion with a pitch of this sign, +1 as logged."""
        signs = np.array([1.0, 1.0, sign])
        return Motion(self.time, *(values * signs for values in self[1:]))


def half_window(time: np.ndarray) -> int:
    """Returns how many rows a cubic has on either side of its own, of times (n,)."""
    step = float(np.median(np.diff(time)))
    return min(max(round(SPAN / step / 2), 3), (len(time) - 1) // 2)


def calc_motion(time: np.ndarray, pose: np.ndarray, *, stride: int = 1) -> Motion:
    """Fits a cubic about every `stride`-th row, except where many rows are missing.

    Times are (n,) [s], poses (n, 3): x, z [m], pitch [rad], or any other columns.
    """
    if len(time) < FEWEST_ROWS:
        none = np.empty((0, 3))
        return Motion(np.empty(0), none, none, none)
    half = half_window(time)
    scale = half * float(np.median(np.diff(time)))
    rows = np.arange(half, len(time) - half, stride)
    duration = time[rows + half] - time[rows - half]
    rows = rows[duration < _LONGEST * 2 * scale]
    window = rows[:, None] + np.arange(-half, half + 1)
    since = (time[window] - time[rows, None]) / scale
    powers = since[..., None] ** np.arange(4)
    # Centered pose: the offset of a position must not cost digits. Normal equations of
    # four powers of at most 1 cost few, and a tenth of the time of an SVD a window.
    center = pose[rows]
    turned = powers.swapaxes(1, 2)
    target = turned @ (pose[window] - center[:, None])
    ridge = 1e-12 * np.eye(4)  # Of a window of the same times.
    coefficients = np.linalg.solve(turned @ powers + ridge, target)
    return Motion(
        time=time[rows],
        pose=center + coefficients[:, 0],
        velocity=coefficients[:, 1] / scale,
        acceleration=2 * coefficients[:, 2] / scale**2,
    )


class Drive(NamedTuple):
    """What drives a body, at n rows.

    It is interpolated between the rows that have a cubic, and constant beyond them.
    """

    time: np.ndarray  #: (n,) [s]
    speed: np.ndarray  #: (n,) [m/s]
    way: np.ndarray  #: (n,) since the first row [m].
    energy: np.ndarray  #: (n,) of height and speed [J/kg].
    push: np.ndarray  #: (n,) force along the path, without gravity [m/s²].

    def take(self, rows: np.ndarray | slice) -> "Drive":
        """Some of the rows."""
        return Drive(*(values[rows] for values in self))


def calc_drive(time: np.ndarray, position: np.ndarray, gravity: float) -> Drive:
    """What drives a body, by its positions (n, k), the last column its height [m]."""
    motion = calc_motion(time, position)
    speed = np.linalg.norm(motion.velocity, axis=1)
    force = motion.acceleration.copy()
    force[:, -1] += gravity
    steps = np.diff(motion.time, prepend=motion.time[:1])
    each = (
        speed,
        np.cumsum(speed * steps),
        gravity * motion.pose[:, -1] + 0.5 * speed**2,
        np.sum(force * motion.velocity, axis=1) / np.maximum(speed, 1e-3),
    )
    if not len(speed):
        return Drive(time, *np.zeros((4, len(time))))
    own = (np.interp(time, motion.time, values) for values in each)
    return Drive(time, *own)
