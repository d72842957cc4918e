"""Which poses are possible, and why the station stops trusting the others."""

import math
import re

import numpy as np

from diagrams.programs.station.clocks import AHEAD
from diagrams.programs.station.operators import Operator
from diagrams.programs.station.scenario import Limits
from glider.physics.servo import Servo
from glider.physics.state import ELEVATOR

_REGAIN = 0.2
"""Time without a usable pose after which any pose may be the next [s]."""

_RIVAL = 1.0
"""Time for which another operator is remembered [s]."""

_LOST = 3
"""Poses in a row that are far from the prediction: the filter has lost the glider."""

SLACK = 0.15
"""Angle by which a measured elevator may exceed its travel, or what its servo's rate
allows [rad]: a wrong zero, a horn that bends, and noise."""


_PATIENCE = 2.0
"""Time of waiting for one reason after which the operator is shown it [s]."""

_NUMBERS = re.compile(r"[-+\d.]+")


class WaitReasons:
    """Tells when the operator is to be shown why the station waits.

    Each reason is shown once, when `_PATIENCE` has passed since it was first given:
    poses that are refused for two reasons by turns show both. Reasons that differ in
    their numbers are the same.
    """

    def __init__(self) -> None:
        self._begun: dict[str, float] = {}  # When each was first given [s].
        self._shown: set[str] = set()

    def is_to_be_shown(self, reason: str, now: float) -> bool:
        """Takes the reason that holds now [s]; returns whether to show it."""
        kind = _NUMBERS.sub("", reason)
        begun = self._begun.setdefault(kind, now)
        is_due = kind not in self._shown and now >= begun + _PATIENCE
        if is_due:
            self._shown.add(kind)
        return is_due


class Watch:
    """Passes poses that can follow each other, and knows why commands are not safe.

    Args:
        limits: of time, place, speed, turn rate and prediction.
        servo: travel and rate of the elevator.
        operator: of the station.
    """

    def __init__(self, limits: Limits, servo: Servo, operator: Operator) -> None:
        self.seen = -math.inf  #: When the last usable pose was exposed [s].
        self.rival = -math.inf  #: When another operator sent a command [s].
        self.reason = ""  #: Why the last pose was refused.
        self._limits = limits
        self._servo = servo
        self._operator = operator
        self._last = np.full(4, math.nan)
        self._angle = math.nan  # Of the elevator.
        self._angle_time = -math.inf
        self._late = self._far = 0

    def check_pose(self, time: float, pose: np.ndarray, lead: float) -> str:
        """Takes a pose (4,); returns why it cannot be used, "" if it can.

        An elevator that cannot be is no fault of the pose: `pose` then has NaN for it.

        Args:
            time: of the exposure, by our clock [s].
            pose: x, z, pitch, elevator.
            lead: time by which it came sooner than possible [s].
        """
        self.reason = self._find_pose_fault(time, pose, lead)
        if not self.reason:
            self._check_elevator(time, pose)
            self._last = pose
            self.seen = time
        return self.reason

    def _find_pose_fault(self, time: float, pose: np.ndarray, lead: float) -> str:
        limits = self._limits
        span = time - self.seen
        x, z, pitch = pose[:3].tolist()
        if not (math.isfinite(x) and math.isfinite(z) and math.isfinite(pitch)):
            return "a pose that is no number"
        if not (limits.x[0] < x < limits.x[1] and limits.z[0] < z < limits.z[1]):
            return f"a pose at x {x:.2f} m, z {z:.2f} m, outside the room"
        if lead > AHEAD:
            return f"a frame stamped {1e3 * lead:.0f} ms ahead of the cameras' clock"
        if span <= 0.0:
            return "a frame that comes late or twice"
        if span > _REGAIN:
            return ""
        last_x, last_z, last_pitch = self._last[:3].tolist()
        if (x, z, pitch) == (last_x, last_z, last_pitch):
            return "the same pose again"
        if math.hypot(x - last_x, z - last_z) > limits.speed * span:
            return "a jump of the position"
        if abs(pitch - last_pitch) > limits.turn_rate * span:
            return f"a jump of the pitch by {pitch - last_pitch:.1f} rad"
        return ""

    def _check_elevator(self, time: float, pose: np.ndarray) -> None:
        """Takes an angle out of a pose (4,) that the elevator cannot have."""
        angle = float(pose[ELEVATOR])
        servo = self._servo
        turns = SLACK + servo.rate * (time - self._angle_time)
        inside = servo.low - SLACK < angle < servo.high + SLACK
        if inside and not abs(angle - self._angle) > turns:  # NaN: none before.
            self._angle = angle
            self._angle_time = time
        else:
            pose[ELEVATOR] = math.nan

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
        """Why commands would not be safe now; "" if they are."""
        kills = self._operator.kills
        if kills:
            is_ours = self._operator.id in kills
            return f"{'the' if is_ours else 'another'} operator stopped it"
        if now < self.rival + _RIVAL:
            return "another operator sends commands on the bus"
        age = now - self.seen
        if age > self._limits.stale:
            why = f" ({self.reason})" if self.reason else ""
            since = f"for {1e3 * age:.0f} ms" if math.isfinite(age) else "yet"
            return f"no usable pose {since}{why}"
        if self._far >= _LOST:
            return "the filter has lost the glider"
        if self._late >= 2:
            return "two commands in a row were late"
        return ""
