"""Logs of topics: PX4 ULog, MCAP, bags of ROS 1 and 2 (ROS itself is not needed).

A column is named TOPIC.FIELD, e.g. vehicle_local_position.x or
/glider/pose.pose.position.x; in a ULog TOPIC_1.FIELD is that of a second instance. In
MCAP files and bags the time of a row is the message's own stamp where it has one, and
otherwise when it was recorded.
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

_TIME, _STAMP = "time", "\0stamp"
_STAMPS = ("header.stamp", "timestamp", "stamp")
_SECONDS = ("sec", "secs", "seconds")
_NANOSECONDS = ("nsec", "nsecs", "nanosec", "nanos")
_LONGEST = 16  # Numbers of an array that become columns.

_PX4 = {
    "position": "vehicle_local_position",
    "attitude": "vehicle_attitude.q",
    "elevator_angle_command": "actuator_controls_0.control[1] "
    "vehicle_torque_setpoint.xyz[1]",
    "throttle": "actuator_motors.control[0] actuator_controls_0.control[3] "
    "vehicle_thrust_setpoint.xyz[0]",
    "airspeed": "airspeed_validated.true_airspeed_m_s",
    "angular_velocity": "vehicle_angular_velocity.xyz",
    "acceleration": "vehicle_acceleration.xyz",
}
"""Topics by quantity, the first that a log has."""
_ULOG_UNITS = {"timestamp": "us"}
_ELEVATOR = 3  # Type of a control surface, in PX4's parameters CA_SV_CS0_TYPE, ...

Decoder = Callable[[bytes], object]


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
    """Reads the topics of a bag whose types are known."""
    highlevel, typesys = need("rosbags.highlevel", path), need("rosbags.typesys", path)
    bag = path.parent if path.suffix == ".db3" else path
    store = typesys.get_typestore(typesys.Stores.LATEST)
    topics = _Topics()
    with highlevel.AnyReader([bag], default_typestore=store) as reader:
        known = [c for c in reader.connections if c.msgtype in reader.typestore.types]
        for connection, recorded, data in reader.messages(connections=known):
            message = reader.deserialize(data, connection.msgtype)
            topics.add(connection.topic, recorded, message)
    return topics.recording(path)


def read_mcap(path: Path) -> Recording:
    """Reads messages in JSON, protobuf, or those of ROS 1 and 2."""
    reader = need("mcap.reader", path)
    topics = _Topics()
    decoders: dict[int, Decoder | None] = {}
    others: set[str] = set()
    with path.open("rb") as stream:
        for schema, channel, message in reader.make_reader(stream).iter_messages():
            if channel.id not in decoders:
                decoders[channel.id] = _make_decoder(schema, channel, path)
            decode = decoders[channel.id]
            if decode is None:
                others.add(f"'{channel.topic}' ({channel.message_encoding})")
            else:
                topics.add(channel.topic, message.log_time, decode(message.data))
    if others and not topics.rows:
        raise InputError(
            f"{path}: the messages of {', '.join(sorted(others))} cannot be read; "
            "expected json, protobuf, cdr or ros1."
        )
    return topics.recording(path)


def _make_decoder(schema: Any, channel: Any, path: Path) -> Decoder | None:
    """What makes an object of a channel's messages; None if nothing does."""
    encoding = channel.message_encoding
    if encoding == "json":
        return json.loads
    if encoding == "protobuf":
        decoder = need("mcap_protobuf.decoder", path).DecoderFactory()
        return decoder.decoder_for(encoding, schema)
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
        self.rows: dict[str, list[dict[str, float]]] = defaultdict(list)

    def add(self, topic: str, recorded: int, message: object) -> None:
        """Adds a message, and when it was recorded [ns]."""
        row = dict(_leaves("", message))
        times = {_STAMP: next(_stamps(row), 0.0), _TIME: recorded * 1e-9}
        self.rows[topic].append(row | times)

    def recording(self, path: Path) -> Recording:
        """All topics, each in the order of its times, from restart to restart."""
        groups = []
        for topic, rows in self.rows.items():
            own = [row.pop(_STAMP) for row in rows]
            times = np.array(own if any(own) else [row[_TIME] for row in rows])
            part = np.searchsorted(find_restarts(times), range(len(times)), "right")
            order = np.lexsort([times, part])
            names = dict.fromkeys(name for row in rows for name in row)
            columns = {
                n: Column(np.array([rows[i].get(n, np.nan) for i in order]))
                for n in names
            }
            columns[_TIME] = Column(times[order], "s")
            groups.append(Group(topic, columns, _TIME))
        if not groups:
            raise InputError(f"{path}: holds no message that can be read.")
        return Recording(path, tuple(groups), up="z")


def _leaves(name: str, value: Any) -> Iterator[tuple[str, float]]:
    """Yields the numbers in a message, by their names with dots."""
    fields: dict[str, object] = {}
    if isinstance(value, (bool, int, float, np.number)):
        yield name, float(value)
    elif isinstance(value, dict):
        fields = value
    elif dataclasses.is_dataclass(value) or hasattr(value, "DESCRIPTOR"):
        protobuf = getattr(value, "DESCRIPTOR", None)
        known = protobuf.fields if protobuf else dataclasses.fields(value)
        names = [field.name for field in known if not field.name.startswith("__")]
        fields = {name: getattr(value, name) for name in names}
    elif isinstance(value, (list, tuple, np.ndarray)) and len(value) <= _LONGEST:
        for i, part in enumerate(value):
            yield from _leaves(f"{name}[{i}]", part)
    for field, part in fields.items():
        yield from _leaves(f"{name}.{field}" if name else str(field), part)


def _stamps(row: dict[str, float]) -> Iterator[float]:
    """Yields the times [s] that a message itself has."""
    for stamp, second, fraction in itertools.product(_STAMPS, _SECONDS, _NANOSECONDS):
        names = f"{stamp}.{second}", f"{stamp}.{fraction}"
        if all(name in row for name in names):
            yield row[names[0]] + 1e-9 * row[names[1]]
