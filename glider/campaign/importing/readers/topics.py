"""Logs of topics: PX4 ULog, MCAP, bags of ROS 1 and 2 (ROS itself is not needed).

A column is named TOPIC.FIELD, e.g. vehicle_local_position.x or
/glider/pose.pose.position.x; in a ULog TOPIC_1.FIELD is that of a second instance. In
MCAP files and bags the time of a row is the message's own stamp where it has one, and
otherwise when it was recorded. Where a message has an array of bodies with names, as in
/tf, those of each are TOPIC[NAME].FIELD.
"""

import dataclasses
import itertools
import json
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from glider.campaign.importing.recording import Column, Group, Recording, need
from glider.errors import InputError

_TIME = "time"
_STAMP = "\0stamp"
_STAMPS = ("header.stamp", "timestamp", "stamp")
_SECONDS = ("sec", "secs", "seconds")
_NANOSECONDS = ("nsec", "nsecs", "nanosec", "nanos")
_LONGEST = 16  # Numbers of an array that become columns.

_PX4 = {
    "position": ["vehicle_local_position"],
    "attitude": ["vehicle_attitude.q"],
    "elevator_angle_command": [
        "actuator_controls_0.control[1]",
        "vehicle_torque_setpoint.xyz[1]",
    ],
}
"""Topics by quantity, the first that a log has."""
_ELEVATOR = 3  # Type of a control surface, in PX4's parameters CA_SV_CS0_TYPE, ...

_Decoder = Callable[[bytes], object]
_Message = tuple[str, int, object]  # Topic, when it was recorded [ns], content.


def read_ulog(path: Path) -> Recording:
    """Reads PX4's topics, their times in microseconds; quaternions are w, x, y, z."""
    pyulog = need("pyulog", path)
    with path.open("rb") as stream:  # pyulog leaves a path's file open on errors.
        log = pyulog.ULog(stream)
    groups = []
    for topic in log.data_list:
        name = f"{topic.name}_{topic.multi_id}" if topic.multi_id else topic.name
        columns = {n: Column(np.asarray(v, float)) for n, v in topic.data.items()}
        if "timestamp" in columns:
            columns["timestamp"] = dataclasses.replace(columns["timestamp"], unit="us")
        groups.append(Group(name, columns, "timestamp"))
    if not groups:
        raise InputError(f"{path}: holds no topic; expected a log of a flight.")
    recording = Recording(path, tuple(groups), rotation="wxyz")
    names = recording.names()
    known = {}
    for quantity, topics in _PX4.items():
        for topic in reversed(topics):
            starts = (f"{topic}.", f"{topic}[")
            if any(f"{name}.".startswith(starts) for name in names):
                known[quantity] = topic
    surfaces = [log.initial_parameters.get(f"CA_SV_CS{k}_TYPE") for k in range(8)]
    if _ELEVATOR in surfaces and any(g.name == "actuator_servos" for g in groups):
        servo = f"actuator_servos.control[{surfaces.index(_ELEVATOR)}]"
        known["elevator_angle_command"] = servo
    return dataclasses.replace(recording, known=known)


def read_bag(path: Path) -> Recording:
    """Reads the topics of a bag; files of definitions may complete it.

    They are PACKAGE/msg/NAME.msg, in the folder of the bag or beside it.
    """
    highlevel = need("rosbags.highlevel", path)
    typesys = need("rosbags.typesys", path)
    bag = path.parent if path.suffix == ".db3" else path
    store = typesys.get_typestore(typesys.Stores.LATEST)
    types: dict[str, Any] = {}
    for file in sorted({*bag.glob("**/msg/*.msg"), *bag.parent.glob("*/msg/*.msg")}):
        name = f"{file.parts[-3]}/msg/{file.stem}"
        types |= typesys.get_types_from_msg(file.read_text(), name)
    store.register({n: t for n, t in types.items() if n not in store.fielddefs})
    with highlevel.AnyReader([bag], default_typestore=store) as reader:
        types = reader.typestore.types
        known = [c for c in reader.connections if c.msgtype in types]
        unread = {
            other.topic: (
                f"the bag lacks the definition of its type; expected a file "
                f"{other.msgtype}.msg beside the bag, or the bag as MCAP ('ros2 bag "
                "convert', where the package is installed)"
            )
            for other in reader.connections
            if other.msgtype not in types
        }
        messages = (
            (connection.topic, recorded, reader.deserialize(data, connection.msgtype))
            for connection, recorded, data in (reader.messages(known) if known else ())
        )
        return _collect(path, messages, unread)


def read_mcap(path: Path) -> Recording:
    """Reads messages in JSON, or those of ROS 1 and 2."""
    reader = need("mcap.reader", path)
    unread: dict[str, str] = {}

    def messages(stream: BinaryIO) -> Iterator[_Message]:
        decoders: dict[int, _Decoder | None] = {}
        for schema, channel, message in reader.make_reader(stream).iter_messages():
            if channel.id not in decoders:
                decoders[channel.id] = _make_decoder(schema, channel, path)
            decode = decoders[channel.id]
            if decode is not None:
                yield channel.topic, message.log_time, decode(message.data)
                continue
            unread[channel.topic] = (
                f"its messages, in {channel.message_encoding}, cannot be read; "
                "expected json, cdr or ros1"
            )

    with path.open("rb") as stream:
        return _collect(path, messages(stream), unread)


def _make_decoder(schema: Any, channel: Any, path: Path) -> _Decoder | None:
    """What makes an object of a channel's messages; None if nothing does."""
    encoding = channel.message_encoding
    if encoding == "json":
        return json.loads
    if encoding not in ("cdr", "ros1") or schema.encoding not in ("ros2msg", "ros1msg"):
        return None
    typesys = need("rosbags.typesys", path)
    store = typesys.get_typestore(typesys.Stores.EMPTY)
    name = schema.name if "/msg/" in schema.name else schema.name.replace("/", "/msg/")
    store.register(typesys.get_types_from_msg(schema.data.decode(), name))
    deserialize = store.deserialize_cdr if encoding == "cdr" else store.deserialize_ros1
    return lambda data: deserialize(data, name)


def _collect(
    path: Path, messages: Iterable[_Message], unread: dict[str, str]
) -> Recording:
    """All topics."""
    topics: dict[str, list[dict[str, float]]] = defaultdict(list)
    bodies: dict[str, dict[str, set[str]]] = defaultdict(lambda: defaultdict(set))
    """By topic and place in its messages, which bodies stand there."""
    for topic, recorded, message in messages:
        row = dict(_leaves("", message))
        times = {_STAMP: _find_stamp(row, 0.0), _TIME: recorded * 1e-9}
        topics[topic].append(row | times)
        parts = [("", message)]
        for field, value in _fields(message).items():
            if isinstance(value, (list, tuple)):
                parts += [(f"{field}[{i}]", part) for i, part in enumerate(value)]
        for place, body in parts:
            if name := _name(body):
                bodies[topic][place].add(name)
                own = dict(_leaves("", body))
                stamp = _find_stamp(own, times[_STAMP])
                topics[f"{topic}[{name}]"].append(own | times | {_STAMP: stamp})
    for topic, places in bodies.items():
        if len(names := places[""]) == 1:  # It need not be named.
            del topics[f"{topic}[{min(names)}]"]
        if len(most := max(places.values(), key=len)) > 1:
            del topics[topic]
            each = ", ".join(f"{topic}[{own}]" for own in sorted(most)[:6])
            unread[topic] = (
                f"its messages are of {len(most)} bodies in turn; expected a column of "
                f"one: {each}"
            )
    groups = [_make_group(topic, rows) for topic, rows in topics.items()]
    if not groups:
        words = "; ".join(f"'{topic}': {why}" for topic, why in unread.items())
        why = words or "it has none"
        raise InputError(f"{path}: holds no message that can be read: {why}.")
    return Recording(path, tuple(groups), up="z", unread=unread)


def _make_group(topic: str, rows: list[dict[str, float]]) -> Group:
    stamps = [row.pop(_STAMP) for row in rows]
    recorded = [row[_TIME] for row in rows]
    times = np.array(stamps if any(stamps) else recorded)
    names = dict.fromkeys(name for row in rows for name in row)
    columns = {
        name: Column(np.array([row.get(name, np.nan) for row in rows]))
        for name in names
    }
    columns[_TIME] = Column(times, "s")
    return Group(topic, columns, _TIME)


def _fields(message: object) -> dict[str, Any]:
    """The fields of a message by name; none of a number or an array."""
    fields = message if isinstance(message, dict) else {}
    if dataclasses.is_dataclass(message):
        fields = vars(message)
    return {name: own for name, own in fields.items() if not name.startswith("__")}


def _name(message: object) -> str:
    """The name, or the number, of the body that a message is about; "": of none."""
    fields = _fields(message)
    for field, value in fields.items():
        is_name = field == "child_frame_id" or field.endswith("name")
        if is_name and isinstance(value, str) and value:
            return value
    number = fields.get("id")
    return str(number) if isinstance(number, (int, np.integer)) else ""


def _leaves(name: str, value: Any) -> Iterator[tuple[str, float]]:
    """Yields the numbers in a message, by their names with dots."""
    if isinstance(value, (bool, int, float, np.number)):
        yield name, float(value)
    elif isinstance(value, (list, tuple, np.ndarray)) and len(value) <= _LONGEST:
        for i, part in enumerate(value):
            yield from _leaves(f"{name}[{i}]", part)
    for field, part in _fields(value).items():
        yield from _leaves(f"{name}.{field}" if name else field, part)


def _find_stamp(row: dict[str, float], default: float) -> float:
    """The time [s] that a message itself has."""
    for stamp, second, fraction in itertools.product(_STAMPS, _SECONDS, _NANOSECONDS):
        seconds = row.get(f"{stamp}.{second}")
        rest = row.get(f"{stamp}.{fraction}")
        if seconds is not None and rest is not None:
            return seconds + 1e-9 * rest
    return default
