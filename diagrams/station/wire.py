"""The last step before the wire: whatever is asked, the elevator stays within limits.

The station sends through a Wire, and a servo's driver receives through another: should
the station fall silent, the driver's brings the elevator to neutral.
"""

import math

from glider.physics.servo import Servo, rate_bounds

JITTER = 0.01  # Angle that commands are off by as they come early or late [rad].
ANOTHER = 1.0
"""Silence after which a servo listens to another sender [s]."""


class Wire:
    """Rate and angle of an elevator under commands that may be anything.

    A rate is clipped to the servo's, and the angle to its travel. Without a command
    for a time the elevator turns to neutral and rests there.

    Args:
        servo: travel and rate limit.
        neutral: safe angle [rad].
        timeout: silence after which it turns there [s].
        hold: time that a command is expected to last [s].
    """

    def __init__(
        self, servo: Servo, neutral: float, timeout: float, hold: float = 0.02
    ) -> None:
        self.servo, self.timeout, self.hold = servo, timeout, hold
        self.neutral = min(max(neutral, servo.low), servo.high)
        self.angle = self.neutral  #: Now [rad].
        self.rate = 0.0  #: Now [rad/s].
        self._time = self._heard = -math.inf
        self._sender: float | None = None

    def command(self, rate: float, now: float) -> float:
        """Takes a rate [rad/s]; returns what becomes of it. NaN is none."""
        self.advance(now)
        if math.isfinite(rate):
            self._heard = now
            low, high = rate_bounds(self.angle, self.servo, self.hold)
            self.rate = min(max(rate, low), high)
        return self.rate

    def to_neutral(self, now: float) -> float:
        """Turns to neutral; returns the rate [rad/s]."""
        self.advance(now)
        return self.command((self.neutral - self.angle) / self.hold, now)

    def obey(
        self, sender: float, rate: float, now: float, angle: float = math.nan
    ) -> bool:
        """Takes a rate from one sender at a time; returns whether it was heard.

        With the sender's angle [rad]: one that is off, as after lost commands, is made
        up for within `hold`.
        """
        if self._sender not in (None, sender) and now - self._heard < ANOTHER:
            return False
        self._sender = sender
        away = angle - self.advance(now)
        self.command(rate + away / self.hold if abs(away) > JITTER else rate, now)
        return True

    def advance(self, now: float) -> float:
        """Returns the angle now [rad]; time does not run backwards."""
        span = now - self._time
        self._time = max(now, self._time)
        if 0.0 < span < math.inf:
            silent = self._heard + self.timeout
            if now <= silent:
                self._turn(span)
            else:
                self._turn(max(silent - (now - span), 0.0))
                away, span = self.neutral - self.angle, min(now - silent, span)
                least = abs(away) / self.servo.rate
                self.rate = math.copysign(self.servo.rate, away) if away else 0.0
                self._turn(min(span, least))
                if span >= least:
                    self.angle, self.rate = self.neutral, 0.0
        return self.angle

    def _turn(self, span: float) -> None:
        angle = self.angle + self.rate * span
        self.angle = min(max(angle, self.servo.low), self.servo.high)
