"""The record of a throw: appended to as it happens, and a flight of a campaign.

A throw is a file throw_NNN.mcap of JSON messages, each written to the system at once:
a process that dies loses none. It is the only record; flight_NNN.csv, which
close-the-loop reads, is computed from it.
"""

import errno
import os
import time
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from mcap.records import Channel, Message, Metadata
from mcap.stream_reader import StreamReader
from mcap.writer import IndexType, Writer

from diagrams.programs.station.scenario import Scenario
from glider.campaign.logs import Flight
from glider.errors import InputError
from glider.files import schema
from glider.physics.model import parse_model
from glider.physics.servo import Servo, held_angle

_TOPICS = ("/pose", "/command", "/estimate", "/event")

_RESERVE = 1 << 20
"""Space on the disk that is kept for the throw that runs [bytes]; one takes 0.3 MB."""

RESERVES = ".throw_*.mcap.reserve"
"""Names of the files that keep it."""

_FEWEST = 20
"""Rows of a flight, as the campaign's reader wants them."""

_SCHEMA = b'{"type": "object"}'
_encode = msgspec.json.Encoder().encode


class _Appended:
    """A file that is only appended to, with a reserve for a full disk."""

    def __init__(self, path: Path) -> None:
        self._size = 0
        self._reserve = path.with_name(f".{path.name}.reserve")
        flags = os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_APPEND
        self._file = os.open(path, flags, 0o644)
        try:
            self._reserve.write_bytes(b"\1" * _RESERVE)
        except OSError:
            os.close(self._file)
            path.unlink()
            self._reserve.unlink(missing_ok=True)
            raise

    def write(self, data: bytes) -> int:
        """Writes all of it; a full disk gets the reserve's room."""
        left = memoryview(data)
        while left:
            try:
                left = left[os.write(self._file, left) :]
            except OSError as error:
                full = error.errno in (errno.ENOSPC, errno.EDQUOT)
                if not (full and self._reserve.exists()):
                    raise
                self._reserve.unlink()
        self._size += len(data)
        return len(data)

    def tell(self) -> int:
        """Size so far [bytes]."""
        return self._size

    def flush(self) -> None:
        """Nothing is held back."""

    def close(self) -> None:
        """Closes the file and frees the reserve."""
        os.close(self._file)
        self._reserve.unlink(missing_ok=True)


class ThrowLog:
    """Writes the record of one throw.

    Args:
        path: of a new file.
        facts: texts by name: scenario, model, plan, versions.

    Raises:
        OSError: it cannot be written, as on a full disk.
    """

    def __init__(self, path: Path, facts: Mapping[str, str]) -> None:
        self.path = path
        self._file = _Appended(path)
        self._epoch: float | None = None  # When our clock was zero, since 1970 [s].
        # Without chunks a message is in the file as soon as it is written.
        self._writer = Writer(
            self._file,  # type: ignore[arg-type]
            use_chunking=False,
            index_types=IndexType.METADATA,
        )
        self._writer.start("", "drake-glider")
        self._writer.add_metadata("facts", dict(facts))
        schema = self._writer.register_schema("glider", "jsonschema", _SCHEMA)
        self._channels = {
            topic: self._writer.register_channel(topic, "json", schema)
            for topic in _TOPICS
        }

    def add(self, topic: str, when: float, **values: object) -> None:
        """Appends a message of a time by our clock [s], now or just before.

        Its time in the file is that of the calendar, for programs that show both.
        """
        if self._epoch is None:
            self._epoch = time.time() - when
        stamp = max(int(1e9 * (when + self._epoch)), 0)
        self._writer.add_message(self._channels[topic], stamp, _encode(values), stamp)

    def close(self) -> None:
        """Ends the file with its summary."""
        self._writer.finish()
        self.abandon()

    def abandon(self) -> None:
        """Leaves the file as it is, as when the process dies."""
        self._file.close()


def read_throw(path: Path) -> tuple[dict[str, str], dict[str, list[dict[str, Any]]]]:
    """Facts and messages, by topic, of a throw; one cut off is read to its end.

    Raises:
        InputError: it is damaged, or no record.
    """
    try:
        return _read(path)
    except OSError:
        raise
    except Exception as error:
        # Of damaged records mcap and struct raise whatever they meet.
        name = type(error).__name__
        raise InputError(
            f"{path}: is damaged ({name}); expected a record of the station."
        ) from None


def _read(path: Path) -> tuple[dict[str, str], dict[str, list[dict[str, Any]]]]:
    facts: dict[str, str] = {}
    topics: dict[str, list[dict[str, Any]]] = {topic: [] for topic in _TOPICS}
    channels: dict[int, str] = {}
    for record in _records(path):
        if isinstance(record, Metadata) and record.name == "facts":
            facts = record.metadata
        elif isinstance(record, Channel):
            channels[record.id] = record.topic
        elif isinstance(record, Message):
            topics[channels[record.channel_id]].append(msgspec.json.decode(record.data))
    return facts, topics


def _records(path: Path) -> Iterator[object]:
    with path.open("rb") as stream:
        records = StreamReader(stream).records
        while True:
            try:
                yield next(records)
            except StopIteration:
                return
            except Exception as error:
                # Of a record that is cut off mcap raises whatever it meets there.
                if stream.read(1):
                    raise error
                return


def flight_of(path: Path) -> Flight | None:
    """The free flight of a throw, by the cameras' clock; None if it is too short.

    The command of a row is the one that acts on the servo then, with the time at which
    it began to: a late one does when it does. The flight ends where it was stopped:
    what is commanded then no row shows, as poses are missing. A pose without its
    elevator is no row, if the elevator is measured.

    Raises:
        InputError: the record is damaged.
    """
    facts, topics = read_throw(path)
    if not topics["/pose"]:
        return None
    try:
        scenario = schema.parse_yaml(facts["scenario"], str(path))
        scenario = schema.convert(scenario, Scenario, str(path))
        model, _ = parse_model(facts["model"], str(path))
        return _flight_of(path, topics, scenario, model.parameters.servo)
    except (KeyError, TypeError) as error:
        raise InputError(
            f"{path}: field {error} is missing; expected a record of the station."
        ) from None


def _flight_of(
    path: Path,
    topics: Mapping[str, list[dict[str, Any]]],
    scenario: Scenario,
    servo: Servo,
) -> Flight | None:
    """Returns the flight of a record's messages."""
    measured = scenario.sensors.elevator
    poses = [pose for pose in topics["/pose"] if pose["free"] and not pose["fault"]]
    if measured:
        poses = [pose for pose in poses if pose["shows_elevator"]]
    if len(poses) < _FEWEST or not topics["/command"]:
        return None
    table = np.array(
        [
            [p[name] for name in ("stamp", "time", "x", "z", "pitch", "elevator")]
            for p in poses
        ],
        dtype=float,
    )
    acts = np.array([command["acts"] for command in topics["/command"]])
    rates = np.array([0.0, *(command["rate"] for command in topics["/command"])])
    known = [command["angle"] for command in topics["/command"]]
    spans = np.maximum(np.diff(acts), 1e-9)
    # Where a command was late, the servo went to neutral.
    is_late = spans > scenario.servo.timeout
    rates[1:-1][is_late] = (np.diff(known) / spans)[is_late]
    angles = np.array([*known[:1], *known])  # Before the first the elevator rests.
    when = table[:, 1]
    latest = np.searchsorted(acts, when, side="right")
    begins = np.append(when[0], acts)[latest]
    command = rates[latest]
    held = zip(command, angles[latest], when - begins, strict=True)
    commanded = np.array([held_angle(u, angle, servo, t) for u, angle, t in held])
    # Between two rows more than one command may have begun: their mean is held.
    hides = np.flatnonzero(np.diff(latest) > 1)
    is_old = hides[np.diff(latest, prepend=-1)[hides] == 0]
    start = angles[latest]
    begins[is_old] = when[is_old]
    start[is_old] = commanded[is_old]
    turned = start[hides + 1] - start[hides]
    span = begins[hides + 1] - begins[hides]
    command[hides] = turned / span
    time = table[:, 0] - table[0, 0]
    return Flight(
        name=path.with_suffix(".csv").name.replace("throw", "flight"),
        time=time,
        pose=table[:, 2:5].copy(),
        elevator=table[:, 5].copy() if measured else commanded,
        command=command,
        command_time=np.maximum.accumulate(np.minimum(time - when + begins, time)),
    )
