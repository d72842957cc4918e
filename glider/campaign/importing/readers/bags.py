"""Bags of ROS 1 (.bag) and ROS 2 (a folder, or the .db3 in it); ROS is not needed."""

from pathlib import Path

from glider.campaign.importing.optional import need
from glider.campaign.importing.raw import RawTable
from glider.campaign.importing.readers.messages import Topics
from glider.errors import InputError


def read(path: Path) -> RawTable:
    """Returns the topics of a bag whose types are known.

    Raises:
        InputError: it is no bag, or rosbags is missing.
    """
    highlevel, typesys = need("rosbags.highlevel", path), need("rosbags.typesys", path)
    bag = path.parent if path.suffix == ".db3" else path
    topics = Topics()
    try:
        store = typesys.get_typestore(typesys.Stores.LATEST)
        with highlevel.AnyReader([bag], default_typestore=store) as reader:
            known = [
                c for c in reader.connections if c.msgtype in reader.typestore.types
            ]
            for connection, recorded, data in reader.messages(connections=known):
                message = reader.deserialize(data, connection.msgtype)
                topics.add(connection.topic, recorded, message)
    except (highlevel.AnyReaderError, OSError) as error:
        raise InputError(f"{path}: not readable as a ROS bag: {error}.") from None
    return topics.table(path)
