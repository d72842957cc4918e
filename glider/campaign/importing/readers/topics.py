"""Logs of topics: PX4 ULog, MCAP, bags of ROS 1 and 2 (ROS itself is not needed).

A column is named TOPIC.FIELD, e.g. vehicle_local_position.x or
/glider/pose.pose.position.x; in a ULog TOPIC_1.FIELD is that of a second instance. In
MCAP files and bags the time of a row is the message's own stamp where it has one, and
otherwise when it was recorded. Where a message has an array of bodies with names, as in
/tf, those of each are TOPIC[NAME].FIELD.

pyulog gives the columns of a ULog at once. From MCAP files and bags messages come one
by one: dicts, or dataclasses of rosbags, nested to any depth. `_collect` flattens each
to a row of numbers, and the rows of a topic become a group. A message, or an element of
its arrays, that has a name (or a number `id`) is about a body; such rows are collected
by body as well, because the messages of a topic may be of several bodies in turn.
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
_STAMP = "\0stamp"  # Key of a message's own stamp in its row; no field is named so.
_STAMPS = ("header.stamp", "timestamp", "stamp")
_SECONDS = ("sec", "secs", "seconds")
_NANOSECONDS = ("nsec", "nsecs", "nanosec", "nanos")
_LONGEST = 16  # Numbers of an array that become columns, at most.

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
_Row = dict[str, float]  # The numbers of a message by name, with _STAMP and _TIME [s].


def read_ulog(path: Path) -> Recording:
    """Reads PX4's topics, their times in microseconds; quaternions are w, x, y, z.

    Raises:
        InputError: the log has no topic.
    """
    pyulog = need("pyulog", path)
    with path.open("rb") as stream:  # pyulog leaves a path's file open on errors.
        log = pyulog.ULog(stream)
    groups = []
    for topic in log.data_list:
        name = f"{topic.name}_{topic.multi_id}" if topic.multi_id else topic.name
        columns = {}
        for field, values in topic.data.items():
            unit = "us" if field == "timestamp" else None
            columns[field] = Column(np.asarray(values, float), unit)
        groups.append(Group(name, columns, "timestamp"))
    if not groups:
        raise InputError(f"{path}: holds no topic; expected a log of a flight.")
    recording = Recording(
        path,
        tuple(groups),
        rotation="wxyz",
        known_as="PX4's topic",
        axes="NED",
        units={
            "elevator_angle_command": "{gain: 1.0}  # ? gain: angle at a command of 1 "
            "in rad"
        },
    )
    known = _find_known(recording.names(), log.initial_parameters)
    return dataclasses.replace(recording, known=known)


def _find_known(names: list[str], parameters: dict[str, Any]) -> dict[str, str]:
    """Finds the columns of the quantities in a log of PX4.

    Args:
        names: addresses of all columns.
        parameters: of the autopilot, by name. Where they say which servo moves the
            elevator, its command counts, and not the moment about the pitch axis.

    Returns:
        Addresses by quantity: those of single columns, or of topics or arrays that
        hold a vector.
    """
    known = {}
    for quantity, topics in _PX4.items():
        for topic in reversed(topics):
            beginnings = (f"{topic}.", f"{topic}[")
            if any(f"{name}.".startswith(beginnings) for name in names):
                known[quantity] = topic

    surfaces = [parameters.get(f"CA_SV_CS{k}_TYPE") for k in range(8)]
    if _ELEVATOR in surfaces and any(n.startswith("actuator_servos.") for n in names):
        servo = f"actuator_servos.control[{surfaces.index(_ELEVATOR)}]"
        known["elevator_angle_command"] = servo
    return known


def read_bag(path: Path) -> Recording:
    """Reads the topics of a bag; files of definitions may complete it.

    They are PACKAGE/msg/NAME.msg, in the folder of the bag or beside it.

    Args:
        path: the file of ROS 1, or the folder of ROS 2 or the .db3 in it.

    Raises:
        InputError: no message can be read.
    """
    highlevel = need("rosbags.highlevel", path)
    typesys = need("rosbags.typesys", path)
    bag = path.parent if path.suffix == ".db3" else path
    store = typesys.get_typestore(typesys.Stores.LATEST)
    definitions: dict[str, Any] = {}
    for file in sorted({*bag.glob("**/msg/*.msg"), *bag.parent.glob("*/msg/*.msg")}):
        name = f"{file.parts[-3]}/msg/{file.stem}"
        definitions |= typesys.get_types_from_msg(file.read_text(), name)
    # They must not replace the types of ROS.
    store.register({n: t for n, t in definitions.items() if n not in store.fielddefs})

    with highlevel.AnyReader([bag], default_typestore=store) as reader:
        known = []
        unread = {}
        for connection in reader.connections:
            if connection.msgtype in reader.typestore.types:
                known.append(connection)
                continue
            unread[connection.topic] = (
                f"the bag lacks the definition of its type; expected a file "
                f"{connection.msgtype}.msg beside the bag, or the bag as MCAP ('ros2 "
                "bag convert', where the package is installed)"
            )
        found = reader.messages(known) if known else ()  # Of [] it would read all.
        messages = (
            (connection.topic, recorded, reader.deserialize(data, connection.msgtype))
            for connection, recorded, data in found
        )
        return _collect(path, messages, unread)


def read_mcap(path: Path) -> Recording:
    """Reads messages in JSON, or those of ROS 1 and 2.

    Raises:
        InputError: no message can be read.
    """
    reader = need("mcap.reader", path)
    unread: dict[str, str] = {}

    def messages(stream: BinaryIO) -> Iterator[_Message]:
        """Yields the messages that can be read; notes the topics of others."""
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
    """Makes the function that decodes a channel's messages; None if they are unknown.

    Definitions of ROS 1 lack the "/msg/" that rosbags expects in a type's name.
    """
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
    """Makes a recording of all messages.

    Args:
        path: of the recording.
        messages: of all topics, in the order of the file.
        unread: why topics cannot be read; may grow while messages are read.

    Raises:
        InputError: no message can be read.
    """
    # Rows by topic, and by TOPIC[NAME] for bodies.
    topics: dict[str, list[_Row]] = defaultdict(list)
    # Names of bodies by topic and place in its messages: "", or FIELD[i] of a list.
    bodies: dict[str, dict[str, set[str]]] = defaultdict(lambda: defaultdict(set))
    for topic, recorded, message in messages:
        row = _make_row(message, recorded, 0.0)
        topics[topic].append(row)

        # Bodies that the message, or an element of its lists, is about.
        parts = [("", message)]
        for field, value in _fields(message).items():
            if isinstance(value, (list, tuple)):
                parts += [(f"{field}[{i}]", part) for i, part in enumerate(value)]
        for place, body in parts:
            name = _name(body)
            if name:
                bodies[topic][place].add(name)
                own = _make_row(body, recorded, row[_STAMP])
                topics[f"{topic}[{name}]"].append(own)

    for topic, places in bodies.items():
        # Where all messages are of one body, the group of the topic is enough.
        names = places[""]
        if len(names) == 1:
            del topics[f"{topic}[{min(names)}]"]
        # Where a place has several bodies, the rows of the topic mix them.
        most = max(places.values(), key=len)
        if len(most) > 1:
            del topics[topic]
            each = ", ".join(f"{topic}[{name}]" for name in sorted(most)[:6])
            unread[topic] = (
                f"its messages are of {len(most)} bodies in turn; expected a column of "
                f"one: {each}"
            )

    groups = [_make_group(topic, rows) for topic, rows in topics.items()]
    if not groups:
        reasons = "; ".join(f"'{topic}': {why}" for topic, why in unread.items())
        raise InputError(
            f"{path}: holds no message that can be read: {reasons or 'it has none'}."
        )
    return Recording(path, tuple(groups), up="z", unread=unread)


def _make_row(message: object, recorded: int, stamp: float) -> _Row:
    """Makes a row of a message, or of a body in it.

    Args:
        message: object with fields.
        recorded: time when it was recorded [ns].
        stamp: that of the whole message, which counts where a body in it has none of
            its own; 0 where there is none [s].
    """
    row = dict(_leaves("", message))
    row[_STAMP] = _find_stamp(row, stamp)
    row[_TIME] = recorded * 1e-9
    return row


def _make_group(topic: str, rows: list[_Row]) -> Group:
    """Makes a group of rows, which need not have the same names; they lose _STAMP.

    Its times are the stamps of the messages, or, if none has a stamp, when they were
    recorded.
    """
    stamps = [row.pop(_STAMP) for row in rows]
    columns = {}
    for name in dict.fromkeys(itertools.chain(*rows)):
        columns[name] = Column(np.array([row.get(name, np.nan) for row in rows]))
    times = np.array(stamps) if any(stamps) else columns[_TIME].values
    columns[_TIME] = Column(times, "s")
    return Group(topic, columns, _TIME)


def _fields(message: object) -> dict[str, Any]:
    """The fields of a message by name; none of a number or an array.

    Names with two underscores are those of rosbags itself.
    """
    fields = message if isinstance(message, dict) else {}
    if dataclasses.is_dataclass(message):
        fields = vars(message)
    return {name: value for name, value in fields.items() if not name.startswith("__")}


def _name(message: object) -> str:
    """The name of the body that a message is about, or its number; "" if it has none.

    The name is the first text that is not empty in a field `child_frame_id` or
    `...name`, the number that in a field `id`.
    """
    fields = _fields(message)
    for field, value in fields.items():
        is_name = field == "child_frame_id" or field.endswith("name")
        if is_name and isinstance(value, str) and value:
            return value
    number = fields.get("id")
    return str(number) if isinstance(number, (int, np.integer)) else ""


def _leaves(name: str, value: Any) -> Iterator[tuple[str, float]]:
    """Yields the numbers in a message, by their names with dots.

    Of {"p": {"x": 1.0}, "q": [2.0, 3.0]} it yields p.x, q[0] and q[1].

    Args:
        name: of the value; "" for the message itself.
        value: a message, a list or an array, or a number; texts have no numbers.
    """
    if isinstance(value, (bool, int, float, np.number)):
        yield name, float(value)
    elif isinstance(value, (list, tuple, np.ndarray)) and len(value) <= _LONGEST:
        for i, part in enumerate(value):
            yield from _leaves(f"{name}[{i}]", part)
    for field, part in _fields(value).items():
        yield from _leaves(f"{name}.{field}" if name else field, part)


def _find_stamp(row: _Row, default: float) -> float:
    """The time that a message itself has, in seconds and nanoseconds [s].

    Args:
        row: numbers of the message by name.
        default: what is returned where it has none [s].
    """
    for stamp, second, fraction in itertools.product(_STAMPS, _SECONDS, _NANOSECONDS):
        seconds = row.get(f"{stamp}.{second}")
        nanoseconds = row.get(f"{stamp}.{fraction}")
        if seconds is not None and nanoseconds is not None:
            return seconds + 1e-9 * nanoseconds
    return default
