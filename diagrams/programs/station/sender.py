"""Commands: through the wire's limits to the bus, the filter and the record."""

import math
import time
from collections.abc import Callable

from diagrams.programs.station.bus import COMMAND, COMMAND_FIELDS, Bus
from diagrams.programs.station.scenario import Scenario
from diagrams.programs.station.tracker import CommandTape
from diagrams.programs.station.wire import Wire
from glider.physics.servo import Servo


class Sender:
    """Sends commands, and knows when the next is due.

    Args:
        scenario: rates, and the servo.
        limits: of the servo.
        sender: our number among senders.
        bus: to send on.
        tape: of the filter.
        clock: ours [s].
        wait: waits until a time of this clock; None: sleeps.
    """

    def __init__(
        self,
        scenario: Scenario,
        limits: Servo,
        sender: float,
        bus: Bus,
        tape: CommandTape,
        clock: Callable[[], float],
        wait: Callable[[float], object] | None = None,
    ) -> None:
        servo = scenario.servo
        self.step = scenario.command_step
        self._wire = Wire(limits, servo.neutral, servo.timeout, hold=self.step)
        self._latency = servo.latency
        tape.rest_at(self._wire.angle)
        self._bus = bus
        self._tape = tape
        self._clock = clock
        self._wait = wait
        self.id = sender
        self.due = 0.0  #: When the next command is due [s].
        self._number = 0  # Of the last command.

    @property
    def angle(self) -> float:
        """Angle that was commanded so far [rad]."""
        return self._wire.angle

    def wait_until_due(self) -> None:
        """Waits for the turn of a command that is ready."""
        if self._wait is not None:
            self._wait(self.due)
        else:
            time.sleep(max(self.due - self._clock(), 0.0))

    def send(self, rate: float) -> dict[str, float]:
        """Sends a rate [rad/s], or NaN: to neutral; returns what is to be recorded."""
        now = self._clock()
        self._number += 1
        held = self._wire.command(rate, now)
        angle = self._wire.angle
        acts = now + self._latency
        asked = held if math.isfinite(rate) else math.nan
        values = (self.id, self._number, asked, angle)
        self._bus.say(COMMAND, now, values, COMMAND_FIELDS)
        sent = self._clock()
        self._tape.add(acts, angle, held)
        on_time = self.due + self.step > now
        self.due = (self.due if on_time else now) + self.step
        return {"sent": now, "given": sent, "acts": acts, "rate": held, "angle": angle}
