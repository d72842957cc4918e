"""The record of a throw: appended to as it happens, and a flight of a campaign.

A throw is a file throw_NNN.mcap of JSON messages, each written to the system at once:
a process that dies loses none. It is the only record; flight_NNN.csv, which
close-the-loop reads, is computed from it.
"""

import contextlib
import errno
import operator
import os
import shutil
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

_ROOM = 1 << 20
"""Space on the disk without which no throw begins [bytes]; one takes 0.3 MB."""

_FEWEST = 20
"""Rows of a flight, as the campaign's reader wants them."""

_SCHEMA = b'{"type": "object"}'
_encode = msgspec.json.Encoder().encode


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
        if shutil.disk_usage(path.parent).free < _ROOM:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(path))
        self._file = open(path, "xb")  # noqa: SIM115
        self._epoch: float | None = None  # When our clock was zero, since 1970 [s].
        # Without chunks a message is in the file as soon as it is written.
        self._writer = Writer(
            self._file, use_chunking=False, index_types=IndexType.METADATA
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
        self._file.flush()

    def close(self) -> None:
        """Ends the file with its summary."""
        self._writer.finish()
        self.abandon()

    def abandon(self) -> None:
        """Leaves the file as it is, as when the process dies."""
        with contextlib.suppress(OSError):  # As much as there is room for.
            self._file.close()


def read_throw(path: Path) -> tuple[dict[str, str], dict[str, list[dict[str, Any]]]]:
    """Facts and messages, by topic, of a throw; one cut off is read to its end.

    Raises:
        InputError: it is damaged, or no record.
    """
    facts: dict[str, str] = {}
    topics: dict[str, list[dict[str, Any]]] = {topic: [] for topic in _TOPICS}
    channels: dict[int, str] = {}
    try:
        for record in _records(path):
            if isinstance(record, Metadata) and record.name == "facts":
                facts = record.metadata
            elif isinstance(record, Channel):
                channels[record.id] = record.topic
            elif isinstance(record, Message):
                message = msgspec.json.decode(record.data)
                topics[channels[record.channel_id]].append(message)
    except OSError:
        raise
    except Exception as error:
        # Of damaged records mcap and struct raise whatever they meet.
        name = type(error).__name__
        raise InputError(
            f"{path}: is damaged ({name}); expected a record of the station."
        ) from None
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


def scenario_of(facts: Mapping[str, str], path: Path) -> Scenario:
    """The scenario by the facts of a record; InputError where it cannot be read."""
    known = schema.parse_yaml(facts.get("scenario", "{}"), str(path))
    return schema.convert(known, Scenario, str(path))


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
        scenario = scenario_of(facts, path)
        model = parse_model(facts["model"], str(path))
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
    poses = []
    for pose in topics["/pose"]:
        is_usable = pose["free"] and not pose["fault"]
        if is_usable and (not measured or pose["shows_elevator"]):
            poses.append(pose)
    if len(poses) < _FEWEST or not topics["/command"]:
        return None
    fields = operator.itemgetter("stamp", "time", "x", "z", "pitch", "elevator")
    table = np.array([fields(pose) for pose in poses], dtype=float)
    commands = topics["/command"]
    acts = np.array([command["acts"] for command in commands])
    known = [command["angle"] for command in commands]
    rates = np.zeros(len(commands) + 1)
    rates[1:] = [command["rate"] for command in commands]
    spans = np.maximum(np.diff(acts), 1e-9)
    # Where a command was late, the servo went to neutral.
    is_late = spans > scenario.servo.timeout
    rates[1:-1][is_late] = (np.diff(known) / spans)[is_late]
    # Before the first the elevator rests.
    angles = np.array([known[0], *known])
    when = table[:, 1]
    latest = np.searchsorted(acts, when, side="right")
    begins = np.append(when[0], acts)[latest]
    command = rates[latest]
    start = angles[latest]
    commanded = np.zeros(len(when))
    for k, span in enumerate(when - begins):
        commanded[k] = held_angle(command[k], start[k], servo, span)
    # Between two rows more than one command may have begun: their mean is held.
    hides = np.flatnonzero(np.diff(latest) > 1)
    is_new = np.diff(latest, prepend=-1)
    is_old = hides[is_new[hides] == 0]
    begins[is_old] = when[is_old]
    start[is_old] = commanded[is_old]
    turned = start[hides + 1] - start[hides]
    command[hides] = turned / (begins[hides + 1] - begins[hides])
    time = table[:, 0] - table[0, 0]
    command_time = np.minimum(time - when + begins, time)
    elevator = commanded
    if measured:
        elevator = table[:, 5].copy()
    return Flight(
        name=path.with_suffix(".csv").name.replace("throw", "flight"),
        time=time,
        pose=table[:, 2:5].copy(),
        elevator=elevator,
        command=command,
        command_time=np.maximum.accumulate(command_time),
    )
