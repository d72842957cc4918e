"""The splitting step: a table of several flights becomes a recording of each.

Its flights are known by a column `flight`, or by a time that starts again.
"""

import dataclasses
import itertools
from collections.abc import Mapping
from typing import Any

import numpy as np

from glider.campaign.importing.recording import Group, Recording
from glider.errors import InputError

FLIGHT = "flight"  #: Column that separates flights where it is not mapped.
FEWEST_ROWS = 20  #: Of a flight: a clock behind for fewer has not started again.

_PERIODS = (2.0**16, 2.0**32, 2.0**16 / 1e3, 2.0**32 / 1e3, 2.0**32 / 1e6)
"""Counts, of ms or of µs, that a counter of 16 or 32 bits has; the same in seconds."""

Columns = Mapping[str, Any]  # Of a mapping, by quantity.


def find_restarts(time: np.ndarray) -> list[int]:
    """Rows at which times (n,) start again: they fall back, and stay behind."""
    known = np.flatnonzero(np.isfinite(time))
    values = time[known]
    starts = []
    begin = 0
    for row in (np.flatnonzero(np.diff(values) < 0.0) + 1).tolist():
        following = values[row : row + FEWEST_ROWS]
        behind = np.max(following) < np.max(values[begin:row])
        if len(following) == FEWEST_ROWS and behind:
            starts.append(int(known[row]))
            begin = row
    return starts


def _unwound(recording: Recording, group: Group, columns: Columns) -> Group:
    """A group whose times go on where a counter of 16 or 32 bits begins at 0 again.

    The step there is then a usual one, which no end of a flight is by chance.
    """
    rows = max((len(column.values) for column in group.columns.values()), default=0)
    found = recording.find_times(group, columns.get("time", "time"), rows)
    steps = np.diff(found.values) if found is not None else np.zeros(0)
    usual = np.median(steps[steps > 0.0]) if np.any(steps > 0.0) else np.inf
    for period in _PERIODS:
        wraps = np.abs(steps + period - usual) < usual
        if found is not None and np.any(wraps & (steps < 0.0)):
            turns = np.concatenate([[0], np.cumsum(wraps & (steps < 0.0))])
            whole = dataclasses.replace(found, values=found.values + period * turns)
            named = {n: whole if c is found else c for n, c in group.columns.items()}
            return dataclasses.replace(group, columns=named)
    return group


def split_flights(recording: Recording, columns: Columns) -> list[Recording]:
    """Splits a recording where its column of flights changes or its time restarts.

    A group in which neither happens, such as a servo log whose time goes on, belongs to
    all flights.

    Args:
        recording: of any number of flights.
        columns: those of a mapping; `flight` and `time` by default have these names.

    Raises:
        InputError: the mapped column of flights is missing or changes all the time.
    """
    if FLIGHT in columns:
        recording.find(columns[FLIGHT], "columns: flight")
    groups = tuple(_unwound(recording, group, columns) for group in recording.groups)
    recording = dataclasses.replace(recording, groups=groups)
    spans = [_spans(recording, group, columns) for group in recording.groups]
    longest = max(spans, key=len, default=[])
    if len(longest) < 2 and not any(name for name, _ in longest):
        return [recording]
    parts = []
    for k, (name, _) in enumerate(longest):
        groups = tuple(
            _take(group, own[k][1]) if len(own) == len(longest) else group
            for group, own in zip(recording.groups, spans, strict=True)
        )
        path = recording.path / name
        parts.append(dataclasses.replace(recording, path=path, groups=groups))
    return parts


def _spans(
    recording: Recording, group: Group, columns: Columns
) -> list[tuple[str, slice]]:
    """A name for each flight of a group, and its rows."""
    rows = max((len(column.values) for column in group.columns.values()), default=0)
    name = columns.get(FLIGHT, FLIGHT)
    cells = [""] * rows
    column = group.columns.get(name.removeprefix(f"{group.name}."))
    if column is not None:
        numbers = (f"{v:g}" if np.isfinite(v) else "" for v in column.values)
        cells = column.labels or list(numbers)
    changes = [i for i in range(1, rows) if cells[i] != cells[i - 1]]
    labels = [cells[i] for i in (0, *changes) if cells and cells[i]]
    is_short = rows < FEWEST_ROWS * len(labels)
    if is_short and FLIGHT in columns:
        raise InputError(
            f"{recording.path}: columns: flight: '{name}' has {len(set(labels))} "
            f"values but changes {len(changes)} times in {rows} rows; expected the "
            f"rows of a flight together, {FEWEST_ROWS} or more of each."
        )
    is_flag = len(set(labels)) < min(len(labels), 3) and FLIGHT not in columns
    if is_short or is_flag:  # It says something else, such as whether it flies.
        changes = []
        labels = []
    time = recording.find_times(group, columns.get("time", "time"), rows)
    starts = sorted({0, *changes, *(find_restarts(time.values) if time else [])})
    pairs = list(itertools.pairwise((*starts, rows)))
    if labels:
        spans = [slice(a, b) for a, b in pairs if cells[a]]
        names = [f"{FLIGHT} {cells[span.start]}" for span in spans]
        earlier = [names[:k].count(name) for k, name in enumerate(names)]
        each = zip(names, earlier, spans, strict=True)
        return [(f"{n} ({k + 1})" if k else n, span) for n, k, span in each]
    if len(pairs) < 2:
        return [("", slice(0, rows))]
    return [(f"part {k}", slice(a, b)) for k, (a, b) in enumerate(pairs, 1)]


def _take(group: Group, rows: slice) -> Group:
    """Some rows of a group."""
    columns = {}
    for name, column in group.columns.items():
        values = column.values[rows]
        labels = column.labels and column.labels[rows]
        columns[name] = dataclasses.replace(column, values=values, labels=labels)
    return dataclasses.replace(group, columns=columns)
