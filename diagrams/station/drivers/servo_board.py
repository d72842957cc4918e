"""A servo board (Pololu Maestro's protocol), over a serial line or UDP.

    python -m diagrams.station.drivers.servo_board --serial /dev/ttyACM0
    python -m diagrams.station.drivers.servo_board --udp 192.168.1.40:5005

It turns rates from the bus into angles, within the glider's travel and rate, and the
elevator to neutral where no command comes in time. Each packet is Maestro's Set Target:
0x84, channel, and the pulse in quarters of a microsecond, low and high seven bits.
A board that hears nothing must go to neutral itself: set its serial timeout to 0.1 s.
"""

import argparse
import socket
import sys
import time
from collections.abc import Callable, Sequence

from diagrams.program import run
from diagrams.station.bus import COMMAND, COMMAND_FIELDS, Bus
from diagrams.station.clocks import hasten
from diagrams.station.scenario import Scenario, load_scenario
from diagrams.station.wire import Wire
from glider.errors import InputError, expect

PERIOD = 0.005
"""Time between two packets [s]: an analog servo takes one each 20 ms."""


class ServoBoard:
    """Sends the angle of a wire as pulses.

    Args:
        wire: of the elevator.
        send: puts a packet on the line.
        channel: of the servo on the board.
        center: pulse at the angle 0 [µs].
        gain: pulse for an angle [µs/rad]; negative where the servo is mounted so.
    """

    def __init__(
        self,
        wire: Wire,
        send: Callable[[bytes], object],
        channel: int = 0,
        center: float = 1500.0,
        gain: float = 600.0,
    ) -> None:
        self._wire, self._send, self._channel = wire, send, channel
        self._center, self._gain = center, gain

    def take(self, sender: float, rate: float, angle: float, now: float) -> None:
        """Takes a command of the bus [rad/s], and the angle of its sender [rad]."""
        self._wire.obey(sender, rate, now, angle)

    def update(self, now: float) -> None:
        """Sends the angle of this moment."""
        pulse = self._center + self._gain * self._wire.advance(now)
        target = min(max(round(4.0 * pulse), 0), (1 << 14) - 1)
        self._send(bytes([0x84, self._channel, target & 0x7F, target >> 7]))


def open_line(serial_port: str | None, udp: str | None) -> Callable[[bytes], object]:
    """What sends packets over a serial port or to host:port."""
    if serial_port is not None:
        import serial

        return serial.Serial(serial_port, 115200, write_timeout=0.02).write
    host, _, port = (udp or "").rpartition(":")
    expect(host and port.isdecimal(), "--udp", udp, "host:port")
    sender = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    sender.connect((host, int(port)))

    def send(data: bytes) -> None:
        try:
            sender.send(data)
        except OSError:  # The board is not there (yet), or the line is down.
            return

    return send


def main(arguments: Sequence[str] | None = None) -> None:
    """Drives a servo until it is ended; then it is neutral."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    line = parser.add_mutually_exclusive_group(required=True)
    line.add_argument("--serial", metavar="PORT", help="such as /dev/ttyACM0")
    line.add_argument("--udp", metavar="HOST:PORT", help="address of the board")
    parser.add_argument("--scenario", metavar="YAML", help="bus, servo and glider")
    parser.add_argument("--bus", help="address of LCM (default: the scenario's)")
    parser.add_argument("--channel", type=int, default=0, help="of the servo")
    words = "pulse at the angle 0 [µs] (default: %(default)s)"
    parser.add_argument("--center", type=float, default=1500.0, help=words)
    words = "pulse for an angle [µs/rad] (default: %(default)s)"
    parser.add_argument("--gain", type=float, default=600.0, help=words)
    args = parser.parse_args(arguments)
    expect(0 <= args.channel < 128, "--channel", args.channel, "a number from 0 to 127")
    scenario = load_scenario(args.scenario) if args.scenario else Scenario()
    servo = scenario.servo
    limits = scenario.load_model().parameters.servo
    wire = Wire(limits, servo.neutral, servo.timeout)
    try:
        send = open_line(args.serial, args.udp)
    except OSError as error:
        raise InputError(
            f"{args.serial or args.udp}: cannot be opened ({error})."
        ) from None
    board = ServoBoard(wire, send, args.channel, args.center, args.gain)
    bus = Bus(args.bus or scenario.bus)

    def hear(stamp: float, values: Sequence[float], names: Sequence[str]) -> None:
        if len(values) == len(COMMAND_FIELDS):
            board.take(values[0], values[2], values[3], time.monotonic())

    bus.listen(COMMAND, hear)
    hasten()
    print(f"Commands from {args.bus or scenario.bus} to the servo.", flush=True)
    due = now = time.monotonic()
    try:
        while True:
            bus.rest_until(due)
            now = time.monotonic()
            if now >= due:
                board.update(now)
                due = max(due + PERIOD, now)
    finally:
        wire.angle = wire.neutral
        board.update(now)


if __name__ == "__main__":
    sys.exit(run(main))
