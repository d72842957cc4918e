"""The last step before the wire: whatever is asked, the elevator stays within limits.

The station sends through a Wire, and a servo's driver receives through another: should
the station fall silent, the driver's brings the elevator to neutral.
"""

import math
from collections.abc import Sequence

from diagrams.programs.station.operators import Kills
from glider.physics.servo import Servo, held_angle

_JITTER = 0.01  # Angle that commands are off by as they come early or late [rad].
_ANOTHER = 1.0
"""Silence after which a servo listens to another sender [s]."""


class Wire:
    """Rate and angle of an elevator under commands that may be anything.

    A rate is clipped to the servo's, and turns the angle by the law of
    `glider.physics.servo`. Without a command for a time, or where it is no number, the
    elevator turns to neutral and rests there.

    Args:
        servo: travel and rate limit.
        neutral: safe angle [rad].
        timeout: silence after which it turns there [s].
        hold: time that a command is expected to last [s].
    """

    def __init__(
        self, servo: Servo, neutral: float, timeout: float, hold: float = 0.02
    ) -> None:
        self.servo = servo
        self.timeout = timeout
        self.hold = hold
        self.neutral = min(max(neutral, servo.low), servo.high)
        self.angle = self.neutral  #: Now [rad].
        self.rate = 0.0  #: Now [rad/s].
        self.kills = Kills()
        self._time = self._heard = -math.inf
        self._until = -math.inf  # When the rate ends and the way to neutral begins.
        self._sender: float | None = None

    def command(self, rate: float, now: float) -> float:
        """Takes a rate [rad/s], or NaN: to neutral; returns the rate that is held.

        To neutral the servo turns at its rate limit and stops there; the mean rate of
        the time `hold` is returned.
        """
        self.advance(now)
        if math.isfinite(rate):
            self._until = now + self.timeout
        else:
            rate = (self.neutral - self.angle) / self.hold
            self._until = now
        self.rate = min(max(rate, -self.servo.rate), self.servo.rate)
        return self.rate

    def holds(self, now: float) -> bool:
        """Whether the last command is held until a time [s]."""
        return now <= self._until

    def to_neutral(self, now: float) -> float:
        """Turns to neutral; returns the mean rate of the time `hold` [rad/s]."""
        return self.command(math.nan, now)

    def reset(self) -> None:
        """Is neutral, as at the end of a session."""
        self.angle = self.neutral
        self.rate = 0.0
        self._until = -math.inf

    def obey(
        self, sender: float, rate: float, now: float, angle: float = math.nan
    ) -> bool:
        """Takes a rate from one sender at a time; returns whether it was heard.

        With the sender's angle [rad]: one that is off, as after lost commands, is made
        up for within `hold`. While a kill holds, nobody is obeyed.
        """
        if self.kills:
            return False
        if self._sender not in (None, sender) and now - self._heard < _ANOTHER:
            return False
        self._sender = sender
        self._heard = now
        away = angle - self.advance(now)
        self.command(rate + away / self.hold if abs(away) > _JITTER else rate, now)
        return True

    def operate(
        self, values: Sequence[float], names: Sequence[str], now: float
    ) -> None:
        """Takes an operator's message; a kill turns to neutral at once."""
        self.kills.hear(values, names, now)
        if self.kills:
            self.to_neutral(now)

    def advance(self, now: float) -> float:
        """Returns the angle now [rad]; time does not run backwards."""
        span = now - self._time
        self._time = max(now, self._time)
        if 0.0 < span < math.inf:
            if self.holds(now):
                self._turn(span)
            else:
                self._turn(max(self._until - (now - span), 0.0))
                away = self.neutral - self.angle
                span = min(now - self._until, span)
                least = abs(away) / self.servo.rate
                self.rate = math.copysign(self.servo.rate, away) if away else 0.0
                self._turn(min(span, least))
                if span >= least:
                    self.angle = self.neutral
                    self.rate = 0.0
        return self.angle

    def _turn(self, span: float) -> None:
        turned = held_angle(self.rate, self.angle, self.servo, span)
        self.angle = float(turned)
