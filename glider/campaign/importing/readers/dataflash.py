"""ArduPilot's DataFlash logs, .bin and .log.

A column is named MESSAGE.FIELD, such as ATT.Pitch, XKF1.PN or RCOU.C2, as ArduPilot
lists them; MESSAGE_1.FIELD is that of a second instance, such as another EKF core.
"""

import contextlib
import io
import math
from collections import defaultdict
from pathlib import Path
from typing import Any

import numpy as np

from glider.campaign.importing.recording import Column, Group, Recording, need
from glider.errors import InputError

_BEGINNINGS = (b"\xa3\x95", b"FMT,")  # Of the binary form, and of the text.
_TIMES = {"TimeUS": "us", "TimeMS": "ms"}


def is_one(path: Path) -> bool:
    """Whether a file begins as a log of ArduPilot does."""
    try:
        with path.open("rb") as stream:
            return stream.read(4).startswith(_BEGINNINGS)
    except OSError:
        return False  # Whoever reads it says why.


def read(path: Path) -> Recording:
    """Reads the messages that have times, each type and instance a group.

    A field without a number in any message, as of texts, is no column.

    Raises:
        InputError: no message has a time.
    """
    library = need("pymavlink.DFReader", path)
    is_text = path.read_bytes()[:4] == _BEGINNINGS[1]
    kind = library.DFReader_text if is_text else library.DFReader_binary
    rows: dict[str, list[list[float]]] = defaultdict(list)
    fields_of: dict[str, list[str]] = {}  # Of the rows; those of the first message.
    with (
        contextlib.redirect_stderr(io.StringIO()),  # It reports damaged messages.
        contextlib.closing(kind(str(path))) as log,
    ):
        for message in iter(log.recv_msg, None):
            fields = message.get_fieldnames()
            if _TIMES.keys() & fields:
                name = message.get_type()
                instance = message.fmt.instance_field
                number = _number(message, instance) if instance else 0.0
                if number > 0.0:
                    name = f"{name}_{number:.0f}"
                known = fields_of.setdefault(name, fields)
                rows[name].append([_number(message, field) for field in known])

    groups = []
    for name, values in rows.items():
        columns = {}
        for field, column in zip(fields_of[name], np.array(values).T, strict=True):
            if np.isfinite(column).any():
                columns[field] = Column(column, _TIMES.get(field))
        time = next(field for field in _TIMES if field in columns)
        groups.append(Group(name, columns, time))
    if not groups:
        raise InputError(f"{path}: holds no message with a time; expected some.")
    return Recording(path, tuple(groups))


def _number(message: Any, field: str) -> float:
    """Number in a message; NaN for a text, and where its format is too short."""
    try:
        value = getattr(message, field)
    except (AttributeError, IndexError, ValueError):
        return math.nan
    return float(value) if isinstance(value, (int, float)) else math.nan
