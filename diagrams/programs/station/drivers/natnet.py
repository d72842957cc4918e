"""OptiTrack: frames that Motive streams over UDP (NatNet 3.0 to 4.x), put on the bus.

    python -m diagrams.programs.station.drivers.natnet --body 1 --wire 4.0,1.2,0.0

In Motive: stream rigid bodies, multicast, up axis as given here. Nothing is installed:
the packets are read here, by NatNet's documentation; they were not yet tried against a
real Motive.
"""

import argparse
import dataclasses
import math
import socket
import struct
import sys
from collections.abc import Sequence

from diagrams.programs.program import run
from diagrams.programs.station.drivers.poses import PosePublisher, Room
from diagrams.programs.station.processes import hasten
from diagrams.programs.station.scenario import BUS
from glider.errors import InputError

GROUP, PORT = "239.255.42.99", 1511
"""Motive's defaults."""

_FRAME = 7  # Identifier of a frame of motion capture.
_SIZED = (4, 1)  # Version in which each section begins with its size in bytes.
_MOST = 10_000  # Bodies or markers in a frame.
_LARGEST = 1 << 20  # Size of a section [bytes].
_LONGEST = 1e9  # Time since Motive was started [s].


@dataclasses.dataclass(frozen=True, kw_only=True)
class Body:
    """A rigid body in a frame."""

    position: tuple[float, ...]  #: (3,) [m].
    quaternion: tuple[float, ...]  #: (4,) x, y, z, w.
    tracked: bool  #: Whether Motive says that it is seen in this frame.

    @property
    def is_seen(self) -> bool:
        """Whether it has an attitude in this frame."""
        return self.tracked and any(self.quaternion)


@dataclasses.dataclass(frozen=True, kw_only=True)
class _MocapFrame:
    """A frame of Motive."""

    number: int
    time: float  #: Since Motive was started [s].
    bodies: dict[int, Body]  #: By streaming ID.


_SIGNED = ("--up", "--forward", "--nose", "--wire", "--point")
"""Options with values that may begin with a minus."""


class _Reader:
    """Reads little-endian numbers one after the other."""

    def __init__(self, data: bytes) -> None:
        self._data = data
        self._place = 0

    def take(self, form: str) -> tuple:
        values = struct.unpack_from(f"<{form}", self._data, self._place)
        self.skip(struct.calcsize(f"<{form}"))
        return values

    def skip(self, size: int) -> None:
        self._place += size

    def skip_text(self) -> None:
        self._place = self._data.index(b"\0", self._place) + 1

    def section(self, sized: bool) -> tuple[int, int | None]:
        """Number of entries of a section, and its size, where that is there."""
        size = None
        (count,) = self.take("i")
        if sized:
            (size,) = self.take("i")
        if not 0 <= count <= _MOST:
            raise ValueError("a section of an impossible size")
        if size is not None and not 0 <= size <= _LARGEST:
            raise ValueError("a section of an impossible size")
        return count, size


def _parse_frame(data: bytes, version: tuple[int, int] = (4, 1)) -> _MocapFrame | None:
    """Reads a packet; None if it is of another kind.

    Args:
        data: the packet.
        version: of NatNet, major and minor.

    Raises:
        ValueError: it is damaged.
    """
    try:
        identifier, size = struct.unpack_from("<HH", data)
        if identifier != _FRAME:
            return None
        reader = _Reader(data[4 : 4 + size])
        sized = version >= _SIZED
        (number,) = reader.take("i")
        count, length = reader.section(sized)
        if length is not None:
            reader.skip(length)
            count = 0
        for _ in range(count):  # Sets of markers.
            reader.skip_text()
            markers, _ = reader.section(False)
            reader.skip(12 * markers)
        count, _ = reader.section(sized)
        reader.skip(12 * count)  # Markers without a name.
        bodies = {}
        for _ in range(reader.section(sized)[0]):
            body, *numbers, _, flags = reader.take("i7ffh")
            is_finite = all(map(math.isfinite, numbers))
            bodies[body] = Body(
                position=tuple(numbers[:3]),
                quaternion=tuple(numbers[3:]),
                tracked=bool(flags & 1) and is_finite,
            )
        # Skeletons, markers and devices follow; the time stands before the end.
        behind = "dQQQIIhi" if sized else "dQQQhi"
        end = 4 + min(size, len(data) - 4)
        begin = end - struct.calcsize(f"<{behind}")
        (time, *_) = struct.unpack_from(f"<{behind}", data, begin)
    except struct.error:
        raise ValueError("a packet that is cut off") from None
    if not 0.0 <= time < _LONGEST:
        raise ValueError(f"a frame at {time:.3g} s")
    return _MocapFrame(number=number, time=time, bodies=bodies)


def _open_socket(group: str, port: int, interface: str) -> socket.socket:
    """Opens a UDP socket that receives a multicast group, or, for "", unicast."""
    receiver = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    receiver.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    receiver.bind(("", port))
    if group:
        member = socket.inet_aton(group) + socket.inet_aton(interface)
        receiver.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, member)
    return receiver


def publish(
    frame: _MocapFrame, publisher: PosePublisher, body: int, elevator: int | None
) -> bool:
    """Publishes the glider of a frame; returns whether it was tracked."""
    glider = frame.bodies.get(body)
    if glider is None or not glider.is_seen:
        return False
    flap = None if elevator is None else frame.bodies.get(elevator)
    angle = None
    if flap is not None and flap.is_seen:
        angle = flap.quaternion
    publisher.send(frame.number, frame.time, glider.position, glider.quaternion, angle)
    return True


def numbers(text: str) -> list[float]:
    """Reads numbers between commas."""
    return [float(part) for part in text.split(",")]


def _join_signed(arguments: Sequence[str]) -> list[str]:
    """Joins a value such as -z to its option by "=", as argparse expects it."""
    found: list[str] = []
    for argument in arguments:
        is_value = argument[:1] == "-" and argument[:2] != "--"
        if is_value and found and found[-1] in _SIGNED:
            found[-1] += f"={argument}"
        else:
            found.append(argument)
    return found


def receive(
    receiver: socket.socket,
    version: tuple[int, int],
    publisher: PosePublisher,
    body: int,
    elevator: int | None,
) -> None:
    """Publishes what comes, for ever; says once what it ignores, or misses."""
    refused = missed = False
    while True:
        data = receiver.recv(65536)
        try:
            frame = _parse_frame(data, version)
        except ValueError as error:
            if not refused:
                words = (
                    f"ignored {error} ({len(data)} bytes), and others like it without "
                    "a word from here on; if no poses come, give --version as Motive's "
                    "streaming settings show it"
                )
                print(words, file=sys.stderr, flush=True)
            refused = True
            continue
        if frame is None:
            continue
        publish(frame, publisher, body, elevator)
        if body not in frame.bodies and not missed:
            missed = True
            known = ", ".join(map(str, sorted(frame.bodies))) or "none"
            words = f"no rigid body {body} in a frame (--body); there are: {known}"
            print(words, file=sys.stderr, flush=True)


def main(arguments: Sequence[str] | None = None) -> None:
    """Receives until it is ended."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--body", type=int, default=1, help="streaming ID of the glider"
    )
    parser.add_argument("--elevator", type=int, help="that of the elevator, if tracked")
    parser.add_argument("--bus", default=BUS, help="address of LCM")
    words = "multicast group; '' for unicast (default: %(default)s)"
    parser.add_argument("--group", default=GROUP, help=words)
    parser.add_argument("--port", type=int, default=PORT, help="(default: %(default)s)")
    words = "own address in the cameras' network"
    parser.add_argument("--interface", default="0.0.0.0", help=words)
    parser.add_argument("--version", default="4.1", help="of NatNet (default: 4.1)")
    for name in ("up", "forward", "nose"):
        default = getattr(Room(), name)
        words = f"axis, such as {default} or -{default} (default: {default})"
        parser.add_argument(f"--{name}", default=default, help=words)
    words = "its place in Motive [m] (default: 0,0,0)"
    parser.add_argument("--wire", type=numbers, default=[0.0] * 3, help=words)
    words = "rigid body's origin ahead of and above the center of mass [m]"
    parser.add_argument("--point", type=numbers, default=[0.0] * 2, help=words)
    args = parser.parse_args(
        _join_signed(sys.argv[1:] if arguments is None else arguments)
    )
    room = Room(
        up=args.up,
        forward=args.forward,
        nose=args.nose,
        wire=args.wire,
        tracked_point=args.point,
    )
    publisher = PosePublisher(args.bus, room)
    try:
        major, minor = (int(part) for part in args.version.split(".")[:2])
        receiver = _open_socket(args.group, args.port, args.interface)
    except ValueError:
        raise InputError(
            f"--version is '{args.version}'; expected such as 4.1."
        ) from None
    hasten()
    print(f"Motive on port {args.port}, poses to {args.bus}.", flush=True)
    receive(receiver, (major, minor), publisher, args.body, args.elevator)


if __name__ == "__main__":
    sys.exit(run(main))
