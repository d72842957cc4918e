"""The splitting step: a table of several flights becomes a recording of each.

Its flights are known by a column `flight`, or by a time that starts again.
"""

import dataclasses
import itertools
from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

import numpy as np

from glider.campaign.importing.recording import Group, Recording
from glider.errors import InputError

FLIGHT = "flight"
"""Column that separates flights where it is not mapped."""

FEWEST_ROWS = 20
"""Of a flight: a clock that is behind for fewer rows has not started again."""

Columns = Mapping[str, Any]  # Of a mapping, by quantity.


class _Span(NamedTuple):
    """Consecutive rows of a group that are of one flight."""

    name: str
    rows: slice


def find_restarts(time: np.ndarray) -> list[int]:
    """Rows at which times (n,) start again: they fall back, and stay behind."""
    known = np.flatnonzero(np.isfinite(time))
    values = time[known]
    starts, begin = [], 0
    for row in (np.flatnonzero(np.diff(values) < 0.0) + 1).tolist():
        following = values[row : row + FEWEST_ROWS]
        behind = np.max(following) < np.max(values[begin:row])
        if len(following) == FEWEST_ROWS and behind:
            starts.append(int(known[row]))
            begin = row
    return starts


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
    spans = [list(_spans(recording, group, columns)) for group in recording.groups]
    longest = max(spans, key=len, default=[])
    if len(longest) < 2 and not any(span.name for span in longest):
        return [recording]
    parts = []
    for k, span in enumerate(longest):
        groups = tuple(
            _take(group, own[k].rows) if len(own) == len(longest) else group
            for group, own in zip(recording.groups, spans, strict=True)
        )
        path = recording.path / span.name
        parts.append(dataclasses.replace(recording, path=path, groups=groups))
    return parts


def _spans(recording: Recording, group: Group, columns: Columns) -> Iterator[_Span]:
    """Yields the rows of each flight of a group."""
    rows = max((len(column.values) for column in group.columns.values()), default=0)
    time = recording.find_times(group, columns.get("time", "time"), rows)
    for label, run in _runs(recording, group, columns, rows):
        starts = find_restarts(time.values[run]) if time else []
        bounds = [run.start, *(run.start + start for start in starts), run.stop]
        for k, (first, end) in enumerate(itertools.pairwise(bounds), 1):
            count = f"part {k}" if len(bounds) > 2 else ""
            name = " ".join(filter(None, (label, count)))
            yield _Span(name, slice(first, end))


def _runs(
    recording: Recording, group: Group, columns: Columns, rows: int
) -> list[tuple[str, slice]]:
    """Rows with the same cell in the column of flights, and what it says."""
    name = columns.get(FLIGHT, FLIGHT)
    column = group.columns.get(name.removeprefix(f"{group.name}."))
    whole = [("", slice(0, rows))]
    if column is None:
        return whole
    cells = column.labels or [f"{v:g}" if np.isfinite(v) else "" for v in column.values]
    changes = [i for i in range(1, rows) if cells[i] != cells[i - 1]]
    bounds = [0, *changes, rows]
    runs = [
        (f"{FLIGHT} {cells[a]}", slice(a, b))
        for a, b in itertools.pairwise(bounds)
        if cells[a]
    ]
    names = {label for label, _ in runs}
    if len(names) == len(runs) and rows >= FEWEST_ROWS * len(runs):
        return runs
    if FLIGHT not in columns:  # It says something else, such as whether it flies.
        return whole
    raise InputError(
        f"{recording.path}: columns: flight: '{name}' has {len(names)} values but "
        f"changes {len(changes)} times in {rows} rows; expected the rows of a flight "
        f"together, {FEWEST_ROWS} or more of each."
    )


def _take(group: Group, rows: slice) -> Group:
    """Some rows of a group."""
    columns = {
        name: dataclasses.replace(
            column,
            values=column.values[rows],
            labels=column.labels and column.labels[rows],
        )
        for name, column in group.columns.items()
    }
    return dataclasses.replace(group, columns=columns)
