"""Messages of topics, as MCAP files and ROS bags hold them, made columns.

A column is named TOPIC.FIELD, e.g. /glider/pose.pose.position.x. The time of a row is
the message's own stamp where it has one, and else when it was recorded.
"""

import dataclasses
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from glider.campaign.importing.raw import Column, Group, RawTable
from glider.errors import InputError

_TIME = "time"
_STAMPS = ("header.stamp", "timestamp", "stamp")
_SECONDS = ("sec", "secs", "seconds")
_NANOSECONDS = ("nsec", "nsecs", "nanosec", "nanos")
_LONGEST = 16  # Numbers of an array that become columns.


class Topics:
    """Collects messages, topic by topic."""

    def __init__(self) -> None:
        self._rows: dict[str, list[dict[str, float]]] = defaultdict(list)

    def add(self, topic: str, recorded: int, message: object) -> None:
        """Adds a message, and when it was recorded [ns]."""
        row = dict(_leaves("", message))
        row[_TIME] = next(_own_times(row), recorded * 1e-9)
        self._rows[topic].append(row)

    def table(self, path: Path) -> RawTable:
        """Returns all topics, each in the order of its times.

        Raises:
            InputError: there is none with numbers.
        """
        groups = []
        for topic, rows in self._rows.items():
            rows.sort(key=lambda row: row[_TIME])
            names = {name: None for row in rows for name in row}
            columns = {
                name: Column(
                    values=np.array([row.get(name, np.nan) for row in rows]),
                    unit="s" if name == _TIME else None,
                )
                for name in names
            }
            groups.append(Group(name=topic, columns=columns, time=_TIME))
        if not groups:
            raise InputError(f"{path}: holds no message that can be read.")
        return RawTable(path=path, groups=tuple(groups), rotation=None)


def _leaves(name: str, value: object) -> Iterator[tuple[str, float]]:
    """Yields the numbers in a message, by their names with dots."""
    prefix = f"{name}." if name else ""
    if isinstance(value, (bool, int, float, np.number)):
        yield name, float(value)
    elif isinstance(value, dict):
        for key, part in value.items():
            yield from _leaves(f"{prefix}{key}", part)
    elif dataclasses.is_dataclass(value):
        for field in dataclasses.fields(value):
            if not field.name.startswith("__"):
                yield from _leaves(f"{prefix}{field.name}", getattr(value, field.name))
    elif hasattr(value, "DESCRIPTOR"):  # Of protobuf.
        for field in value.DESCRIPTOR.fields:
            yield from _leaves(f"{prefix}{field.name}", getattr(value, field.name))
    elif isinstance(value, (list, tuple, np.ndarray)) and len(value) <= _LONGEST:
        for i, part in enumerate(value):
            yield from _leaves(f"{name}[{i}]", part)


def _own_times(row: dict[str, float]) -> Iterator[float]:
    """Yields the times [s] that a message itself tells; those of zero are none."""
    for stamp in _STAMPS:
        for second in _SECONDS:
            for fraction in _NANOSECONDS:
                names = f"{stamp}.{second}", f"{stamp}.{fraction}"
                if all(name in row for name in names):
                    time = row[names[0]] + 1e-9 * row[names[1]]
                    if time > 0.0:
                        yield time
