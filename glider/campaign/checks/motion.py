"""Velocity and acceleration of a log without a model: local cubics."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

SPAN = 0.1
"""Duration that a cubic is fitted over [s]: at 120 Hz and 0.4 mm of noise it leaves
0.3 m/s² in an acceleration."""

_ALIKE = 0.2
"""Share of the variance of velocities that is between flights, below which they are
alike: less than 0.05 of throws of one plan, 0.56 to 0.87 of campaigns."""

_LONGEST = 1.5  # Duration of a window with missing rows over that of one without.


def robust_std(values: np.ndarray) -> np.ndarray:
    """Standard deviation about zero along axis 0; scipy.stats takes 0.3 s to import."""
    return 1.4826 * np.median(np.abs(values), axis=0)


class Motion(NamedTuple):
    """Motion at k rows of a log; x, z, pitch in the columns."""

    time: np.ndarray  #: (k,) [s]
    pose: np.ndarray  #: (k, 3) [m, m, rad]
    velocity: np.ndarray  #: (k, 3)
    acceleration: np.ndarray  #: (k, 3)

    @property
    def speed(self) -> np.ndarray:
        """Speed along the path (k,) [m/s]."""
        return np.hypot(self.velocity[:, 0], self.velocity[:, 1])


def calc_motion(time: np.ndarray, pose: np.ndarray, *, stride: int = 1) -> Motion:
    """Fits a cubic about every `stride`-th row, except where many rows are missing.

    Times are (n,) [s], poses (n, 3): x, z [m], pitch [rad], or any other columns.
    """
    if len(time) < 7:
        return Motion(np.empty(0), *(np.empty((0, 3)) for _ in range(3)))
    step = float(np.median(np.diff(time)))
    half = min(max(round(SPAN / step / 2), 3), (len(time) - 1) // 2)
    rows = np.arange(half, len(time) - half, stride)[:, None]
    window = rows + np.arange(-half, half + 1)
    since = time[window] - time[rows]
    whole = since[:, -1] - since[:, 0] < _LONGEST * 2 * half * step
    window = window[whole]
    since = since[whole]
    rows = rows[whole, 0]
    scale = half * step
    powers = (since / scale)[..., None] ** np.arange(4)
    # Centered pose: the offset of a position must not cost digits. Normal equations of
    # four powers of at most 1 cost few, and a tenth of the time of an SVD a window.
    turned = powers.swapaxes(1, 2)
    target = turned @ (pose[window] - pose[rows][:, None])
    ridge = 1e-12 * np.eye(4)  # Of a window of the same times.
    coefficients = np.linalg.solve(turned @ powers + ridge, target)
    return Motion(
        time=time[rows],
        pose=pose[rows] + coefficients[:, 0],
        velocity=coefficients[:, 1] / scale,
        acceleration=2 * coefficients[:, 2] / scale**2,
    )


def are_alike(motions: Sequence[Motion]) -> bool:
    """Whether flights repeat each other, as throws of one plan do: they are as one."""
    rows = min(len(motion.time) for motion in motions)
    velocity = np.array([motion.velocity[:rows, :2] for motion in motions])
    total = np.var(velocity, axis=(0, 1)).sum()
    return bool(np.var(velocity, axis=0).mean(axis=0).sum() < _ALIKE * total)
