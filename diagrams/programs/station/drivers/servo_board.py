"""A servo board (Pololu Maestro's protocol), over a serial line.

    python -m diagrams.programs.station.drivers.servo_board --serial /dev/ttyACM0

It turns rates from the bus into angles, within the glider's travel and rate, and the
elevator to neutral where no command comes in time. Each packet is Maestro's Set Target:
0x84, channel, and the pulse in quarters of a microsecond, low and high seven bits.
A board that hears nothing must go to neutral itself: set its serial timeout to 0.1 s.
"""

import argparse
import contextlib
import math
import sys
import termios
import time
from collections.abc import Callable, Sequence
from typing import Any

from diagrams.programs.program import run
from diagrams.programs.station.bus import COMMAND, COMMAND_FIELDS, OPERATOR, Bus
from diagrams.programs.station.operators import REPEAT
from diagrams.programs.station.processes import Ending, hasten
from diagrams.programs.station.scenario import make_scenario
from diagrams.programs.station.wire import Wire
from glider.commands.parsing import CommandParser
from glider.errors import InputError, expect

PERIOD = 0.005
"""Time between two packets [s]: an analog servo takes one each 20 ms."""


_PULSES = 500.0, 2500.0
"""Shortest and longest pulse that servos are made for [µs]."""

_AGAIN = 1.0
"""Time after which a line that is down is opened again [s]."""


class ServoBoard:
    """Sends the angle of a wire as pulses.

    Args:
        wire: of the elevator.
        send: puts a packet on the line.
        channel: of the servo on the board.
        center: pulse at the angle 0 [µs].
        gain: pulse for an angle [µs/rad]; negative where the servo is mounted so.

    Raises:
        InputError: pulses over the elevator's travel are not those of a servo.
    """

    def __init__(
        self,
        wire: Wire,
        send: Callable[[bytes], object],
        channel: int = 0,
        center: float = 1500.0,
        gain: float = 600.0,
    ) -> None:
        self._wire = wire
        self._send = send
        self._channel = channel
        self._center = center
        self._gain = gain
        ends = [center + gain * angle for angle in (wire.servo.low, wire.servo.high)]
        low, high = _PULSES
        good = gain != 0.0 and all(low <= pulse <= high for pulse in ends)
        expected = f"{low:g} to {high:g} µs, both within (--center, --gain)"
        expect(good, "the pulse at the ends of the elevator's travel", ends, expected)

    def take(self, sender: float, rate: float, angle: float, now: float) -> None:
        """Takes a command of the bus [rad/s], and the angle of its sender [rad]."""
        self._wire.obey(sender, rate, now, angle)

    def update(self, now: float) -> None:
        """Sends the angle of this moment."""
        target = round(4.0 * (self._center + self._gain * self._wire.advance(now)))
        self._send(bytes([0x84, self._channel, target & 0x7F, target >> 7]))


class _SerialLine:
    """Writes to a serial port.

    What the port does not take is dropped, and one that was unplugged opened again.

    Args:
        port: such as /dev/ttyACM0.
    """

    def __init__(self, port: str) -> None:
        self._port = port
        self._again = 0.0
        self._line: Any = None
        self._open()

    def _open(self) -> None:
        try:
            import serial
        except ImportError:
            raise InputError(
                f"{self._port}: a serial line needs pyserial, which is not installed; "
                "pip install 'drake-glider[lab]' installs it."
            ) from None

        self._line = serial.Serial(self._port, 115200, write_timeout=0.02)

    def __call__(self, data: bytes) -> None:
        """Writes a packet, if it can."""
        import serial

        try:
            if self._line is None and time.monotonic() > self._again:
                self._open()
            if self._line is not None:
                self._line.write(data)
        except serial.SerialTimeoutException:
            # What waits there is older than the next packet.
            with contextlib.suppress(OSError, termios.error):
                self._line.reset_output_buffer()
        except (OSError, termios.error) as error:
            print(f"{self._port}: {error}; it is tried again.", file=sys.stderr)
            self._line = None
            self._again = time.monotonic() + _AGAIN


def main(arguments: Sequence[str] | None = None) -> None:
    """Drives a servo until it is ended; then it is neutral."""
    parser = CommandParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    words = "such as /dev/ttyACM0"
    parser.add_argument("--serial", metavar="PORT", required=True, help=words)
    parser.add_argument("--scenario", metavar="YAML", help="bus, servo and glider")
    parser.add_argument("--bus", help="address of LCM (default: the scenario's)")
    parser.add_number("--channel", "of the servo", 0, most=127)
    words = "pulse at the angle 0 [µs] (default: %(default)s)"
    parser.add_number("--center", words, 1500.0, kind=float)
    words = "pulse for an angle [µs/rad] (default: %(default)s)"
    parser.add_number("--gain", words, 600.0, kind=float, least=-math.inf)
    args = parser.parse_args(arguments)
    scenario = make_scenario(args.scenario, bus=args.bus)
    servo = scenario.servo
    limits = scenario.load_model().parameters.servo
    wire = Wire(limits, servo.neutral, servo.timeout, scenario.command_step)
    try:
        send = _SerialLine(args.serial)
    except OSError as error:
        raise InputError(f"{args.serial}: cannot be opened ({error}).") from None
    board = ServoBoard(wire, send, args.channel, args.center, args.gain)
    bus = Bus(scenario.address)

    def hear(stamp: float, values: Sequence[float], names: Sequence[str]) -> None:
        if len(values) == len(COMMAND_FIELDS):
            board.take(values[0], values[2], values[3], time.monotonic())

    def hear_operator(
        stamp: float, values: Sequence[float], names: Sequence[str]
    ) -> None:
        wire.operate(values, names, time.monotonic())

    bus.listen(COMMAND, hear)
    bus.listen(OPERATOR, hear_operator)
    hasten()
    print(f"Commands from {scenario.address} to the servo.", flush=True)
    due = said = time.monotonic()
    with Ending() as ending:
        try:
            while not ending:
                bus.rest_until(due)
                now = time.monotonic()
                if now >= due:
                    board.update(now)
                    due = max(due + PERIOD, now)
                if now > said + REPEAT:
                    wire.kills.repeat(bus, now)
                    said = now
        finally:
            wire.reset()
            board.update(time.monotonic())


if __name__ == "__main__":
    sys.exit(run(main))
