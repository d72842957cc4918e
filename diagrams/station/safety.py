"""Poses that can be, and why the station stops trusting the others."""

import math

import numpy as np

from diagrams.station.scenario import Limits

REGAIN = 0.2
"""Time without a usable pose after which any pose may be the next [s]."""

RIVAL = 1.0
"""Time for which another operator is remembered [s]."""

LOST = 3
"""Poses in a row that are far from the prediction: the filter has lost the glider."""


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


class Watch:
    """Knows why commands would not be safe now.

    Args:
        limits: of time, place and prediction.
    """

    def __init__(self, limits: Limits) -> None:
        self.check = PoseCheck(limits)
        self.locked = ""  #: Why the operator lets no throw begin.
        self.seen = -math.inf  #: When the last usable pose came [s].
        self.rival = -math.inf  #: When another operator sent a command [s].
        self._limits = limits
        self._late = self._far = 0

    def reset(self) -> None:
        """Forgets what a throw did wrong."""
        self._late = self._far = 0

    def count_pose(self, distance: float, turned: float) -> None:
        """Counts poses in a row that are far from the prediction [m, rad]."""
        limits = self._limits
        near = distance <= limits.distance and turned <= limits.angle  # NaN is not.
        self._far = 0 if near else self._far + 1

    def count_command(self, delay: float) -> bool:
        """Counts commands in a row that are late [s]; returns whether this one is."""
        late = delay > self._limits.deadline
        self._late = self._late + 1 if late else 0
        return late

    def find_fault(self, now: float) -> str:
        """Why commands would not be safe now; "" where they are."""
        if self.locked:
            return self.locked
        if now < self.rival + RIVAL:
            return "another operator sends commands on the bus"
        gap = now - self.seen
        if gap > self._limits.stale:
            why = f" ({self.check.reason})" if self.check.reason else ""
            since = f"for {1e3 * gap:.0f} ms" if math.isfinite(gap) else "yet"
            return f"no usable pose {since}{why}"
        if self._far >= LOST:
            return "the filter has lost the glider"
        if self._late >= 2:
            return "two commands in a row were late"
        return ""
