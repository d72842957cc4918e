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
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from glider.campaign.importing.recording import Column, Group, Recording, need
from glider.campaign.importing.splitting import find_restarts
from glider.errors import InputError

_TIME = "time"
_STAMP = "\0stamp"
_STAMPS = ("header.stamp", "timestamp", "stamp")
_SECONDS = ("sec", "secs", "seconds")
_NANOSECONDS = ("nsec", "nsecs", "nanosec", "nanos")
_LONGEST = 16  # Numbers of an array that become columns.

_PX4 = {
    "position": "vehicle_local_position",
    "attitude": "vehicle_attitude.q",
    "elevator_angle_command": "actuator_controls_0.control[1] "
    "vehicle_torque_setpoint.xyz[1]",
}
"""Topics by quantity, the first that a log has."""
_ULOG_UNITS = {"timestamp": "us"}
_ELEVATOR = 3  # Type of a control surface, in PX4's parameters CA_SV_CS0_TYPE, ...

_Decoder = Callable[[bytes], object]


def read_ulog(path: Path) -> Recording:
    """Reads PX4's topics, their times in microseconds; quaternions are w, x, y, z."""
    pyulog = need("pyulog", path)
    with path.open("rb") as stream:  # pyulog leaves a path's file open on errors.
        log = pyulog.ULog(stream)
    groups = []
    for topic in log.data_list:
        data = {n: np.asarray(v, dtype=float) for n, v in topic.data.items()}
        columns = {n: Column(v, _ULOG_UNITS.get(n)) for n, v in data.items()}
        name = f"{topic.name}_{topic.multi_id}" if topic.multi_id else topic.name
        groups.append(Group(name, columns, "timestamp"))
    if not groups:
        raise InputError(f"{path}: holds no topic; expected a log of a flight.")
    names = {f"{group.name}.{name}" for group in groups for name in group.columns}
    names |= {name.partition("[")[0] for name in names} | {g.name for g in groups}
    known = {q: t for q, ts in _PX4.items() for t in reversed(ts.split()) if t in names}
    surfaces = [log.initial_parameters.get(f"CA_SV_CS{k}_TYPE") for k in range(8)]
    if _ELEVATOR in surfaces and "actuator_servos" in names:
        servo = f"actuator_servos.control[{surfaces.index(_ELEVATOR)}]"
        known["elevator_angle_command"] = servo
    return Recording(path, tuple(groups), rotation="wxyz", known=known)


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
    topics = _Topics()
    with highlevel.AnyReader([bag], default_typestore=store) as reader:
        known = [c for c in reader.connections if c.msgtype in reader.typestore.types]
        for other in (c for c in reader.connections if c not in known):
            topics.unread[other.topic] = (
                f"the bag lacks the definition of its type; expected a file "
                f"{other.msgtype}.msg beside the bag, or the bag as MCAP ('ros2 bag "
                "convert', where the package is installed)"
            )
        for connection, recorded, data in reader.messages(known) if known else ():
            message = reader.deserialize(data, connection.msgtype)
            topics.add(connection.topic, recorded, message)
    return topics.recording(path)


def read_mcap(path: Path) -> Recording:
    """Reads messages in JSON, or those of ROS 1 and 2."""
    reader = need("mcap.reader", path)
    topics = _Topics()
    decoders: dict[int, _Decoder | None] = {}
    with path.open("rb") as stream:
        for schema, channel, message in reader.make_reader(stream).iter_messages():
            if channel.id not in decoders:
                decoders[channel.id] = _make_decoder(schema, channel, path)
            decode = decoders[channel.id]
            if decode is None:
                topics.unread[channel.topic] = (
                    f"its messages, in {channel.message_encoding}, cannot be read; "
                    "expected json, cdr or ros1"
                )
            else:
                topics.add(channel.topic, message.log_time, decode(message.data))
    return topics.recording(path)


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


class _Topics:
    """Collects messages, topic by topic."""

    def __init__(self) -> None:
        self.unread: dict[str, str] = {}  # Why, by topic.
        self._rows: dict[str, list[dict[str, float]]] = defaultdict(list)
        self._bodies: dict[str, dict[str, set[str]]] = defaultdict(dict)
        # By topic and place in its messages, which bodies stand there.

    def add(self, topic: str, recorded: int, message: object) -> None:
        """Adds a message, and when it was recorded [ns]."""
        stamp = next(_stamps(dict(_leaves("", message))), 0.0)
        self._add(topic, recorded, message, stamp)
        bodies = [("", message)]
        for field, value in _fields(message).items():
            if isinstance(value, (list, tuple)):
                bodies += [(f"{field}[{i}]", part) for i, part in enumerate(value)]
        for place, body in bodies:
            if name := _name(body):
                self._bodies[topic].setdefault(place, set()).add(name)
                self._add(f"{topic}[{name}]", recorded, body, stamp)

    def _add(self, group: str, recorded: int, message: object, stamp: float) -> None:
        row = dict(_leaves("", message))
        times = {_STAMP: next(_stamps(row), stamp), _TIME: recorded * 1e-9}
        self._rows[group].append(row | times)

    def recording(self, path: Path) -> Recording:
        """All topics, each in the order of its times, from restart to restart."""
        groups = []
        for topic, bodies in self._bodies.items():
            if len(names := bodies.get("", ())) == 1:  # It need not be named.
                del self._rows[f"{topic}[{min(names)}]"]
        for topic, rows in self._rows.items():
            own = [row.pop(_STAMP) for row in rows]
            times = np.array(own if any(own) else [row[_TIME] for row in rows])
            part = np.searchsorted(find_restarts(times), range(len(times)), "right")
            order = np.lexsort([times, part])
            columns = {}
            for name in dict.fromkeys(name for row in rows for name in row):
                values = np.array([rows[i].get(name, np.nan) for i in order])
                columns[name] = Column(values, fault=self._fault(topic, name))
            columns[_TIME] = Column(times[order], "s")
            groups.append(Group(topic, columns, _TIME))
        if not groups:
            words = "; ".join(f"'{t}': {why}" for t, why in self.unread.items())
            why = words or "it has none"
            raise InputError(f"{path}: holds no message that can be read: {why}.")
        return Recording(path, tuple(groups), up="z", unread=self.unread)

    def _fault(self, topic: str, name: str) -> str | None:
        """What is wrong with a column in which bodies take turns."""
        for place, names in self._bodies.get(topic, {}).items():
            if len(names) > 1 and name.startswith(place):
                each = ", ".join(f"{topic}[{own}]" for own in sorted(names)[:6])
                return (
                    f"'{topic}.{name}' is that of {len(names)} bodies in turn; "
                    f"expected a column of one: {each}."
                )
        return None


def _fields(message: object) -> dict[str, Any]:
    """The fields of a message by name; none of a number or an array."""
    if isinstance(message, dict):
        return message
    if dataclasses.is_dataclass(message):
        names = [field.name for field in dataclasses.fields(message)]
        return {n: getattr(message, n) for n in names if not n.startswith("__")}
    return {}


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
        yield from _leaves(f"{name}.{field}" if name else str(field), part)


def _stamps(row: dict[str, float]) -> Iterator[float]:
    """Yields the times [s] that a message itself has."""
    for stamp, second, fraction in itertools.product(_STAMPS, _SECONDS, _NANOSECONDS):
        names = f"{stamp}.{second}", f"{stamp}.{fraction}"
        if all(name in row for name in names):
            yield row[names[0]] + 1e-9 * row[names[1]]
