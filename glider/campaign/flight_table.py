"""Tables of flights: columns by name, read, checked and made flights.

What cannot be in SI units, or cannot be a flight, is refused. A fault that an effect of
the library models (a wrong sign, an offset, a delay) passes.
"""

import contextlib
import csv
import dataclasses
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from glider.campaign import logs
from glider.campaign.logs import Campaign, Flight
from glider.errors import InputError, show
from glider.files import schema
from glider.physics.parameters import MAX_ANGLE

_MIN_ROWS = 20
_MIN_SPAN = 0.15  # Duration of a flight [s].
_MAX_STEP = 1.0  # Median step of a pose log [s].
_MAX_SPEED = 60.0  # Median over a flight [m/s].
_MAX_POSITION = 1000.0  # Distance from the origin along x or z [m].
_MAX_RATE = 100.0  # Of an elevator of unknown limit [rad/s].


@dataclasses.dataclass(frozen=True, kw_only=True)
class Table:
    """Columns of equal length."""

    path: Path  #: The file that they come from.
    name: str = ""  #: Of the flight; "": that of the file.
    columns: Mapping[str, Any]  #: Cells as text, or numbers (n,).
    lines: Sequence[int] | None = None  #: Of rows in the file; None: from line 2 on.
    why: str = ""  #: A flight begins and ends where it does.

    @property
    def span(self) -> tuple[float, float]:
        """Times of a flight's first and last row [s]."""
        time = self.columns["time"]
        return float(time[0]), float(time[-1])

    def numbers(self, name: str) -> np.ndarray:
        """Numbers of a column (n,); InputError where it is missing, or a cell is none.

        They are finite.
        """
        if name not in self.columns:
            raise InputError(
                f"{self.path}: column '{name}' is missing; "
                f"found {show(', '.join(self.columns))}."
            )
        values = np.array([to_float(cell) for cell in self.columns[name]])
        self.refuse(~np.isfinite(values), name, "expected a finite number.")
        return values

    def refuse(self, bad: np.ndarray, name: str, expected: str) -> None:
        """Raises InputError about the first bad cell of a column, if any."""
        for i in np.flatnonzero(bad)[:1]:
            line = i + 2 if self.lines is None else self.lines[i]
            raise InputError(
                f"{self.path}: column '{name}', row {line}: "
                f"found {show(self.columns[name][i])}; {expected}"
            )


def read_table(file: Path) -> Table:
    """Reads a CSV file with a header; blank lines are skipped."""
    lines = schema.read_text(file, "a CSV file").split("\n")
    cells = split_rows(lines, ",")
    names = cells[0]
    if all(math.isfinite(to_float(name)) for name in names):
        raise InputError(
            f"{file}: row 1 is {show(lines[0])}; "
            "expected a header with the names of the columns."
        )
    for name in names:
        if name and names.count(name) > 1:
            raise InputError(
                f"{file}: column '{name}' appears {names.count(name)} times; "
                "expected each name once."
            )
    rows = [i for i in range(1, len(lines)) if lines[i].strip()]
    for i in rows:
        if len(cells[i]) != len(names):
            raise InputError(
                f"{file}: row {i + 1} has {len(cells[i])} cells; "
                f"expected {len(names)}, as in the header."
            )
    columns = {name: [cells[i][j] for i in rows] for j, name in enumerate(names)}
    return Table(path=file, columns=columns, lines=[i + 1 for i in rows])


def split_rows(lines: Sequence[str], delimiter: str) -> list[list[str]]:
    """Cells of lines, each by itself: a lone quote must not swallow the rest."""
    if delimiter == " ":
        return [line.split() for line in lines]
    rows = []
    for line in lines:
        row = line.split(delimiter) if line else []
        if '"' in line:
            cells = csv.reader(
                [line], delimiter=delimiter, strict=True, skipinitialspace=True
            )
            with contextlib.suppress(csv.Error):
                row = next(cells)
        rows.append([cell.strip() for cell in row])
    return rows


def to_float(cell: Any) -> float:
    """Number of a cell; NaN for what is none."""
    try:
        return math.nan if isinstance(cell, str) and "_" in cell else float(cell)
    except (ValueError, TypeError):
        return math.nan


def with_flights(campaign: Campaign, tables: Sequence[Table]) -> Campaign:
    """Adds the flights of tables to a campaign."""
    for table in tables[1:]:
        unshared = tables[0].columns.keys() ^ table.columns.keys()
        for name in sorted(unshared - {logs.COMMAND_TIME}):
            has = tables[0].path.name
            lacks = table.path
            if name in table.columns:
                has = table.path.name
                lacks = tables[0].path
            raise InputError(
                f"{lacks}: column '{name}' is missing, which {has} has; "
                "expected the same columns in all flights of a campaign."
            )
    flights = tuple(_make_flight(table, campaign) for table in tables)
    campaign = dataclasses.replace(campaign, flights=flights)
    rate = campaign.row_rate
    for table, flight in zip(tables, flights, strict=True):
        step = np.median(np.diff(flight.time))
        if step >= _MAX_STEP or not 1 / 3 < step * rate < 3:
            slow = step >= _MAX_STEP or step * rate > 20
            hint = " (this looks like milliseconds or a count of rows)" if slow else ""
            raise InputError(
                f"{table.path}: column 'time' has a median step of {step:.4g}{hint}; "
                f"expected seconds, about {1 / rate:.4g} for a pose_rate of "
                f"{rate:.4g} Hz."
            )
    return campaign


def _make_flight(table: Table, campaign: Campaign) -> Flight:
    """Makes the flight of a table; InputError where the cells cannot be one in SI."""
    wanted = logs.POSE_COLUMNS
    if campaign.elevator == "servo":
        wanted += logs.SERVO_COLUMNS
        if all(name in table.columns for name in logs.POSE_COLUMNS):
            _check_servo_columns(table)
    spatial = all(name in table.columns for name in logs.ATTITUDE_COLUMNS)
    if spatial:
        wanted += logs.ATTITUDE_COLUMNS
    if logs.COMMAND_TIME in table.columns:
        wanted += (logs.COMMAND_TIME,)
    columns = {name: table.numbers(name) for name in wanted}
    time = columns["time"]
    late = np.diff(time, prepend=-math.inf) <= 0
    table.refuse(late, "time", "expected more than in the row before.")
    span = time[-1] - time[0] if len(time) else 0.0
    if len(time) < _MIN_ROWS or span < _MIN_SPAN:
        raise InputError(
            f"{table.path}: too short, {len(time)} rows over {span:.3g} s of 'time'; "
            f"expected at least {_MIN_ROWS} rows and {_MIN_SPAN} s."
        )
    if logs.COMMAND_TIME in columns:
        since = columns[logs.COMMAND_TIME]
        bad = (since > time) | (np.diff(since, prepend=-math.inf) < 0.0)
        expected = "expected a time that is not after the row's, nor before the last."
        table.refuse(bad, logs.COMMAND_TIME, expected)
    _check_units(table, columns, campaign)
    pitch = np.unwrap(columns["pitch"])
    attitude = None
    if spatial:
        roll = np.unwrap(columns["roll"])
        yaw = np.unwrap(columns["yaw"])
        attitude = np.column_stack([columns["y"], roll, yaw])
    return Flight(
        name=table.name or table.path.name,
        time=time,
        pose=np.column_stack([columns["x"], columns["z"], pitch]),
        elevator=columns.get("elevator"),
        command=columns.get("elevator_rate_command"),
        attitude=attitude,
        command_time=columns.get(logs.COMMAND_TIME),
    )


def _check_servo_columns(table: Table) -> None:
    """Says what to do where a log lacks the servo, or a part of it."""
    for name in logs.SERVO_COLUMNS:
        if name not in table.columns:
            raise InputError(
                f"{table.path}: column '{name}' is missing; found "
                f"{show(', '.join(table.columns))}; expected it, or in campaign.yaml "
                "'elevator: fixed' under 'vehicle:' (a tail that does not move), or "
                "'columns:' (commands that were not logged, or as angles)."
            )


def _check_units(
    table: Table, columns: dict[str, np.ndarray], campaign: Campaign
) -> None:
    """Refuses what cannot be SI; a fault that an effect can model passes."""
    elevator_bound = MAX_ANGLE
    rate_bound = _MAX_RATE
    if campaign.elevator_limits is not None:  # An elevator of the other sign passes.
        lower, upper = campaign.elevator_limits
        far = max(abs(lower), abs(upper)) + (upper - lower)
        elevator_bound = min(far, MAX_ANGLE)
    if campaign.elevator_rate_limit is not None:
        rate_bound = 10 * campaign.elevator_rate_limit
    tumble = "degrees; wrap a tumble into ±pi"
    for names, bound, unit, likely in (
        (("x", "z", "y"), _MAX_POSITION, "m", "millimeters"),
        (("pitch", "roll", "yaw"), MAX_ANGLE, "rad", tumble),
        (("elevator",), elevator_bound, "rad", "degrees"),
        (("elevator_rate_command",), rate_bound, "rad/s", "degrees per second"),
    ):
        expected = f"expected ±{bound:.4g} {unit} (this looks like {likely})."
        for name in names:
            if name in columns:
                table.refuse(np.abs(columns[name]) > bound, name, expected)
    step_length = np.hypot(np.diff(columns["x"]), np.diff(columns["z"]))
    speed = np.median(step_length / np.diff(columns["time"]))
    if speed > _MAX_SPEED:
        raise InputError(
            f"{table.path}: columns 'x' and 'z' move at {speed:.4g} m/s (median); "
            f"expected at most {_MAX_SPEED:g} (this looks like millimeters)."
        )
