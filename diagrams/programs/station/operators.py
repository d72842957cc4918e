"""Kills and arms: an operator's last word reaches every servo on the bus.

A kill holds until its sender arms again. The sender repeats it as long as it holds, and
an arm for a second, since a message may be lost (see `Bus.handle`). Another operator's
arm counts only where the sender of the kill is silent, as one that has died. A servo
that is killed says so, so that a station started later knows it.
"""

import math
import time
from collections.abc import Callable, Sequence

import numpy as np

from diagrams.programs.station.bus import OPERATOR, Bus

KILL = "kill"
ARM = "arm"
_KILLED = "killed"

REPEAT = 0.2
"""Time between two repetitions of a kill, or of a station's state [s]."""

_SILENT = 1.0
"""Silence after which the sender of a kill may be gone [s]; an arm is repeated as long,
and not longer, so that it ends no kill that was first said after it."""


class Kills:
    """The kills that hold, by their senders."""

    def __init__(self) -> None:
        self._heard: dict[float, float] = {}  # When they were repeated last [s].

    def __bool__(self) -> bool:
        """Whether there are any."""
        return bool(self._heard)

    def __contains__(self, sender: float) -> bool:
        """Whether there is one by a sender."""
        return sender in self._heard

    def hear(self, values: Sequence[float], names: Sequence[str], now: float) -> None:
        """Takes a message: a sender, and for its name KILL, _KILLED or ARM."""
        for value, name in zip(values, names, strict=False):
            sender = value if math.isfinite(value) else 0.0
            if name == KILL:
                self._heard[sender] = now
            elif name == _KILLED:
                self._heard.setdefault(sender, -math.inf)
            elif name == ARM:
                self._heard = {
                    other: heard
                    for other, heard in self._heard.items()
                    if other != sender and now < heard + _SILENT
                }

    def repeat(self, bus: Bus, now: float) -> None:
        """Says as a servo that it was killed."""
        for sender in self._heard:
            bus.say(OPERATOR, now, (sender,), (_KILLED,))


class Operator:
    """An operator on the bus, who kills and arms, and hears the others.

    Args:
        bus: of the servos.
        clock: ours [s].
    """

    def __init__(self, bus: Bus, clock: Callable[[], float] = time.monotonic) -> None:
        self.id = float(np.random.default_rng().integers(1 << 48))  #: Among senders.
        self.kills = Kills()
        self._bus = bus
        self._clock = clock
        self._said = self._armed = -math.inf  # When we spoke, and armed, last [s].
        bus.listen(OPERATOR, self._hear)

    def say(self, name: str) -> None:
        """Kills or arms, here and on the bus."""
        if name == ARM:
            self._armed = self._clock()
        self._say(name)

    def repeat(self) -> None:
        """Repeats our kill, or an arm of just now; to be called again and again."""
        now = self._clock()
        if now <= self._said + REPEAT:
            return
        if self.id in self.kills:
            self._say(KILL)
        elif now < self._armed + _SILENT:
            self._say(ARM)

    def _say(self, name: str) -> None:
        now = self._said = self._clock()
        self._bus.say(OPERATOR, now, (self.id,), (name,))
        self.kills.hear((self.id,), (name,), now)

    def _hear(
        self, stamp: float, values: Sequence[float], names: Sequence[str]
    ) -> None:
        if values and values[0] != self.id:
            self.kills.hear(values, names, self._clock())
