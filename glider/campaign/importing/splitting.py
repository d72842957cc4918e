"""The splitting step: a table of several flights becomes a recording of each.

Its flights are known by a column `flight`, or by a time that starts again. Each group
is divided by itself; that with the most flights names them, and a group with another
number of flights, such as a servo log whose time goes on, belongs to all.
"""

import dataclasses
import itertools
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from glider.campaign.importing.recording import Group, Recording
from glider.errors import InputError

_FLIGHT = "flight"  # Column that separates flights where none is mapped.
FEWEST_ROWS = 20  #: Of a flight: a clock behind for fewer has not started again.

_Columns = Mapping[str, Any]  # Of a mapping, by quantity.


def find_restarts(time: np.ndarray) -> list[int]:
    """Rows at which times (n,) start again: they fall back, and stay behind.

    They stay behind if for `FEWEST_ROWS` rows none reaches the latest time since the
    start before.
    """
    known = np.flatnonzero(np.isfinite(time))
    values = time[known]
    falls = np.flatnonzero(np.diff(values) < 0.0) + 1
    starts = []
    begin = 0
    for row in falls.tolist():
        following = values[row : row + FEWEST_ROWS]
        stays_behind = np.max(following) < np.max(values[begin:row])
        if len(following) == FEWEST_ROWS and stays_behind:
            starts.append(int(known[row]))
            begin = row
    return starts


def split_flights(recording: Recording, columns: _Columns) -> list[Recording]:
    """Splits a recording where its column of flights changes or its time restarts.

    Args:
        recording: of any number of flights.
        columns: those of a mapping; `flight` and `time` by default have these names.

    Returns:
        A recording of each flight, whose path ends in the flight's name; the recording
        itself where nothing divides it.

    Raises:
        InputError: the mapped column of flights is missing or changes all the time.
    """
    if _FLIGHT in columns:
        recording.find(columns[_FLIGHT], "columns: flight")
    spans = [_find_spans(recording, group, columns) for group in recording.groups]
    longest = max(spans, key=len, default={})
    if len(longest) < 2 and not any(longest):
        return [recording]

    flights = []
    for k, name in enumerate(longest):
        groups = []
        for group, own in zip(recording.groups, spans, strict=True):
            if len(own) == len(longest):
                rows = list(own.values())[k]
                groups.append(_take(group, rows))
            else:
                groups.append(group)
        path = recording.path / name
        flights.append(dataclasses.replace(recording, path=path, groups=tuple(groups)))
    return flights


def _find_spans(
    recording: Recording, group: Group, columns: _Columns
) -> dict[str, slice]:
    """Finds the rows of each flight of a group.

    Returns:
        The rows by the flight's name: its label, where a column of flights has one, or
        its number. A name that is taken gets a number. {"": all rows} where nothing
        divides the group; rows without a label are of no flight.
    """
    labels = _find_labels(recording, group, columns)
    starts = {0, *_find_changes(labels)}
    time = recording.find_times(group, columns.get("time", "time"))
    if time is not None:
        starts.update(find_restarts(time.values))
    if not labels and len(starts) == 1:
        return {"": slice(0, group.rows)}

    spans: dict[str, slice] = {}
    bounds = itertools.pairwise([*sorted(starts), group.rows])
    for k, (start, end) in enumerate(bounds, 1):
        name = f"part {k}"
        if labels:
            if not labels[start]:
                continue
            name = f"{_FLIGHT} {labels[start]}"
        unique = name
        again = 1
        while unique in spans:
            again += 1
            unique = f"{name} ({again})"
        spans[unique] = slice(start, end)
    return spans


def _find_labels(
    recording: Recording, group: Group, columns: _Columns
) -> Sequence[str]:
    """Finds the flight of each row (n,) as text, "" for none.

    A column that is named `flight`, but whose labels change too often for flights, may
    say something else.

    Returns:
        The cells of the column of flights; () where there is none.

    Raises:
        InputError: the labels of the column that is mapped change too often.
    """
    name = columns.get(_FLIGHT, _FLIGHT)
    column = group.columns.get(name.removeprefix(f"{group.name}."))
    if column is None:
        return ()
    cells = column.labels
    if cells is None:
        cells = [f"{v:g}" if np.isfinite(v) else "" for v in column.values]

    changes = _find_changes(cells)
    found = [cells[row] for row in (0, *changes) if cells and cells[row]]
    if len(cells) >= FEWEST_ROWS * len(found):
        return cells
    if _FLIGHT in columns:
        raise InputError(
            f"{recording.path}: columns: flight: '{name}' has {len(set(found))} "
            f"values but changes {len(changes)} times in {len(cells)} rows; expected "
            f"the rows of a flight together, {FEWEST_ROWS} or more of each."
        )
    return ()


def _find_changes(labels: Sequence[str]) -> list[int]:
    """Rows whose label is another than that of the row before."""
    return [row for row in range(1, len(labels)) if labels[row] != labels[row - 1]]


def _take(group: Group, rows: slice) -> Group:
    """Some rows of a group."""
    columns = {}
    for name, column in group.columns.items():
        values = column.values[rows]
        labels = column.labels and column.labels[rows]
        columns[name] = dataclasses.replace(column, values=values, labels=labels)
    lines = group.lines and group.lines[rows]
    return dataclasses.replace(group, columns=columns, lines=lines)
