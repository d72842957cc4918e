"""Checks a table and makes a flight of it.

What cannot be in SI units, or cannot be a flight, is refused. A fault that an effect of
the library models (a wrong sign, an offset, a delay) passes.
"""

import dataclasses
import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from glider.campaign.flight_table import Table
from glider.campaign.logs import (
    ATTITUDE_COLUMNS,
    MAX_ANGLE,
    POSE_COLUMNS,
    SERVO_COLUMNS,
    Campaign,
    Flight,
)
from glider.errors import InputError, show

_MIN_ROWS = 20
_MIN_SPAN = 0.15  # Duration of a flight [s].
_MAX_STEP = 1.0  # Median step of a pose log [s].
_MAX_SPEED = 60.0  # Median over a flight [m/s].
_MAX_POSITION = 1000.0  # Distance from the origin along x or z [m].
_MAX_ELEVATOR_RATE = 100.0  # Rate where the limit is unknown [rad/s].


def with_flights(campaign: Campaign, tables: Sequence[Table]) -> Campaign:
    """Adds the flights of tables to a campaign; finds its pose rate if not given."""
    flights = tuple(make_flight(table, campaign) for table in tables)
    rate = campaign.pose_rate
    if math.isnan(rate):
        steps = np.concatenate([np.diff(flight.time) for flight in flights])
        rate = float(1 / np.median(steps))
    for table, flight in zip(tables, flights, strict=True):
        check_step(table.path, flight.time, rate)
    return dataclasses.replace(campaign, pose_rate=rate, flights=flights)


def make_flight(table: Table, campaign: Campaign) -> Flight:
    """Makes the flight of a table; InputError where the cells cannot be one in SI."""
    wanted = POSE_COLUMNS
    if campaign.elevator == "servo":
        wanted += SERVO_COLUMNS
        if all(name in table.columns for name in POSE_COLUMNS):
            _check_servo_columns(table)
    spatial = all(name in table.columns for name in ATTITUDE_COLUMNS)
    if spatial:
        wanted += ATTITUDE_COLUMNS
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
    _check_units(table, columns, campaign)
    pitch = np.unwrap(columns["pitch"])
    attitude = None
    if spatial:
        roll, yaw = np.unwrap(columns["roll"]), np.unwrap(columns["yaw"])
        attitude = np.column_stack([columns["y"], roll, yaw])
    return Flight(
        name=table.name or table.path.name,
        time=time,
        pose=np.column_stack([columns["x"], columns["z"], pitch]),
        elevator=columns.get("elevator"),
        command=columns.get("elevator_rate_command"),
        attitude=attitude,
    )


def _check_servo_columns(table: Table) -> None:
    """Says what to do where a log lacks the servo, or a part of it."""
    missing = [name for name in SERVO_COLUMNS if name not in table.columns]
    if missing == ["elevator_rate_command"]:
        raise InputError(
            f"{table.path}: column 'elevator_rate_command' is missing; a log without "
            "it, or of commanded angles, is read where campaign.yaml has 'columns:' "
            "(see docs/import.md)."
        )
    if missing:
        raise InputError(
            f"{table.path}: column '{missing[0]}' is missing; found "
            f"{show(', '.join(table.columns))}; for a tail that does not move write "
            "'elevator: fixed' under 'vehicle:' in campaign.yaml."
        )


def _check_units(
    table: Table, columns: dict[str, np.ndarray], campaign: Campaign
) -> None:
    """Refuses what cannot be SI; a fault that an effect can model passes."""
    elevator_bound, rate_bound = MAX_ANGLE, _MAX_ELEVATOR_RATE
    if campaign.elevator_limits is not None:  # An elevator of the other sign passes.
        lower, upper = campaign.elevator_limits
        far = max(abs(lower), abs(upper)) + (upper - lower)
        elevator_bound = min(far, MAX_ANGLE)
    if campaign.elevator_rate_limit is not None:
        rate_bound = 10 * campaign.elevator_rate_limit
    tumble = "degrees; wrap a tumble into ±pi"
    for name, bound, unit, likely in (
        ("x", _MAX_POSITION, "m", "millimeters"),
        ("z", _MAX_POSITION, "m", "millimeters"),
        ("y", _MAX_POSITION, "m", "millimeters"),
        ("pitch", MAX_ANGLE, "rad", tumble),
        ("roll", MAX_ANGLE, "rad", tumble),
        ("yaw", MAX_ANGLE, "rad", tumble),
        ("elevator", elevator_bound, "rad", "degrees"),
        ("elevator_rate_command", rate_bound, "rad/s", "degrees per second"),
    ):
        expected = f"expected ±{bound:.4g} {unit} (this looks like {likely})."
        if name in columns:
            table.refuse(np.abs(columns[name]) > bound, name, expected)
    step_length = np.hypot(np.diff(columns["x"]), np.diff(columns["z"]))
    speed = np.median(step_length / np.diff(columns["time"]))
    if speed > _MAX_SPEED:
        raise InputError(
            f"{table.path}: columns 'x' and 'z' move at {speed:.4g} m/s (median); "
            f"expected at most {_MAX_SPEED:g} (this looks like millimeters)."
        )


def check_step(file: Path, time: np.ndarray, rate: float) -> None:
    """Raises InputError unless times (n,) [s] step about at a pose rate [Hz]."""
    step = np.median(np.diff(time))
    if step >= _MAX_STEP or not 1 / 3 < step * rate < 3:
        slow = step >= _MAX_STEP or step * rate > 20
        hint = " (this looks like milliseconds or a count of rows)" if slow else ""
        raise InputError(
            f"{file}: column 'time' has a median step of {step:.4g}{hint}; expected "
            f"seconds, about {1 / rate:.4g} for a pose_rate of {rate:.4g} Hz."
        )
