"""Poses that can be, and why the station stops trusting the others."""

import math

import numpy as np

from diagrams.station.scenario import Limits

REGAIN = 0.2
"""Time without a usable pose after which any pose may be the next [s]."""


class PoseCheck:
    """Passes poses that can follow each other.

    Args:
        limits: of places, speed and turn rate.
    """

    def __init__(self, limits: Limits) -> None:
        self._limits = limits
        self._last = np.full(4, math.nan)
        self._time = -math.inf
        self.reason = ""  #: Why the last pose was refused.

    def find_fault(self, time: float, pose: np.ndarray) -> str:
        """Why a pose (4,) cannot be used, "" where it can; times are ours [s]."""
        self.reason = self._find(time, pose)
        if not self.reason:
            self._last, self._time = pose, time
        return self.reason

    def _find(self, time: float, pose: np.ndarray) -> str:
        limits, span = self._limits, time - self._time
        x, z, pitch = pose[:3].tolist()
        if not (math.isfinite(x) and math.isfinite(z) and math.isfinite(pitch)):
            return "a pose that is no number"
        if not (limits.x[0] < x < limits.x[1] and limits.z[0] < z < limits.z[1]):
            return f"a pose at x {x:.2f} m, z {z:.2f} m, outside the room"
        if span <= 0.0:
            return "a frame that comes late or twice"
        if span > REGAIN:
            return ""
        last_x, last_z, last_pitch = self._last[:3].tolist()
        if (x, z, pitch) == (last_x, last_z, last_pitch):
            return "the same pose again"
        if math.hypot(x - last_x, z - last_z) > limits.speed * span:
            return "a jump of the position"
        if abs(pitch - last_pitch) > limits.turn_rate * span:
            return f"a jump of the pitch by {pitch - last_pitch:.1f} rad"
        return ""
