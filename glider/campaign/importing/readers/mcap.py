"""MCAP files: messages in JSON, protobuf, or those of ROS 1 and 2."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

from glider.campaign.importing.optional import need
from glider.campaign.importing.raw import RawTable
from glider.campaign.importing.readers.messages import Topics
from glider.errors import InputError

Decoder = Callable[[bytes], object]


def read(path: Path) -> RawTable:
    """Returns the topics of a file.

    Raises:
        InputError: it is no MCAP file, its messages are of another encoding, or a
            library is missing.
    """
    reader_module, exceptions = need("mcap.reader", path), need("mcap.exceptions", path)
    topics = Topics()
    decoders: dict[int, Decoder | None] = {}
    others: set[str] = set()
    try:
        with path.open("rb") as stream:
            for schema, channel, message in reader_module.make_reader(
                stream
            ).iter_messages():
                if channel.id not in decoders:
                    decoders[channel.id] = _make_decoder(schema, channel, path)
                decode = decoders[channel.id]
                if decode is None:
                    others.add(f"'{channel.topic}' ({channel.message_encoding})")
                else:
                    topics.add(channel.topic, message.log_time, decode(message.data))
    except (exceptions.McapError, OSError) as error:
        raise InputError(f"{path}: not readable as MCAP: {error}.") from None
    if others and not topics:
        raise InputError(
            f"{path}: the messages of {', '.join(sorted(others))} cannot be read; "
            "json, protobuf, cdr or ros1 is needed."
        )
    return topics.table(path)


def _make_decoder(schema: Any, channel: Any, path: Path) -> Decoder | None:
    """Returns what makes an object of a channel's messages; None if nothing does."""
    encoding = channel.message_encoding
    if encoding == "json":
        return json.loads
    if encoding == "protobuf":
        decoder = need("mcap_protobuf.decoder", path).DecoderFactory()
        return decoder.decoder_for(encoding, schema)
    if encoding in ("cdr", "ros1") and schema.encoding in ("ros2msg", "ros1msg"):
        return _make_ros_decoder(schema, encoding, path)
    return None


def _make_ros_decoder(schema: Any, encoding: str, path: Path) -> Decoder:
    rosbags = need("rosbags.typesys", path)
    store = rosbags.get_typestore(rosbags.Stores.EMPTY)
    name = schema.name if "/msg/" in schema.name else schema.name.replace("/", "/msg/")
    store.register(rosbags.get_types_from_msg(schema.data.decode(), name))
    decode = store.deserialize_cdr if encoding == "cdr" else store.deserialize_ros1
    return lambda data: decode(data, name)
