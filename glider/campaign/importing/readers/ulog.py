"""Logs of PX4: topics, each with its own times in microseconds.

A column is named TOPIC.FIELD, e.g. vehicle_local_position.x; of several instances of
a topic TOPIC_1.FIELD is the second. Quaternions are w, x, y, z.
"""

from pathlib import Path

import numpy as np

from glider.campaign.importing.optional import need
from glider.campaign.importing.raw import Column, Group, RawTable
from glider.errors import InputError

_TIME = "timestamp"


def read(path: Path) -> RawTable:
    """Returns the topics of a log.

    Raises:
        InputError: it is no ULog file, or pyulog is missing.
    """
    pyulog = need("pyulog", path)
    try:
        with path.open("rb") as stream:  # Which pyulog leaves open on errors.
            log = pyulog.ULog(stream)
    except Exception as error:  # Its parser raises whatever a broken file makes it.
        raise InputError(f"{path}: not readable as a PX4 ULog: {error}.") from None
    groups = []
    for topic in log.data_list:
        columns = {
            name: Column(
                values=np.asarray(values, dtype=float),
                unit="us" if name == _TIME else None,
            )
            for name, values in topic.data.items()
        }
        name = f"{topic.name}_{topic.multi_id}" if topic.multi_id else topic.name
        groups.append(Group(name=name, columns=columns, time=_TIME))
    if not groups:
        raise InputError(f"{path}: holds no topic; a log of a flight is needed.")
    return RawTable(path=path, groups=tuple(groups), rotation="wxyz")
