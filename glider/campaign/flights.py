"""Recordings in the columns of a campaign, checked and made flights.

What cannot be in SI units, or cannot be a flight, is refused. A fault that an effect of
the library models (a wrong sign, an offset, a delay) passes. Columns are checked one by
one for numbers, then the times for their order, then all for their units; the first
fault is reported, with the row of the file. The angles of the pose are unwrapped.
"""

import dataclasses
import math
from collections.abc import Sequence

import numpy as np

from glider.campaign import logs
from glider.campaign.importing.recording import Recording, scale_of
from glider.campaign.logs import Campaign, Flight
from glider.campaign.settings import EULER, QUANTITIES
from glider.errors import InputError
from glider.physics.parameters import MAX_ANGLE

_MIN_ROWS = 20
_MIN_SPAN = 0.15  # Duration of a flight [s].
_MAX_STEP = 1.0  # Median step of a pose log [s].
_MAX_SPEED = 60.0  # Median over a flight [m/s].
_BOUNDS = dict.fromkeys("xzy", (1000.0, "m, not millimeters"))
_BOUNDS |= dict.fromkeys(EULER, (MAX_ANGLE, "rad, not degrees; a tumble within ±pi"))
_BOUNDS["elevator"] = (MAX_ANGLE, "rad, not degrees")
_BOUNDS["elevator_rate_command"] = (100.0, "rad/s, not degrees per second")
"""What columns of a flight are at most, and what is expected of one that is more."""


def with_flights(
    campaign: Campaign, recordings: Sequence[Recording], names: Sequence[str] = ()
) -> Campaign:
    """Adds a flight of each recording to a campaign.

    Args:
        campaign: without flights.
        recordings: of one table each, with the columns of a campaign's files.
        names: of the flights; (): those of the recordings' files.

    Raises:
        InputError: a recording cannot be a flight, or its times are not in seconds.
    """
    names = names or [recording.path.name for recording in recordings]
    pairs = zip(recordings, names, strict=True)
    flights = tuple(_make_flight(own, name, campaign) for own, name in pairs)
    campaign = dataclasses.replace(campaign, flights=flights)
    rate = campaign.row_rate
    for recording, flight in zip(recordings, flights, strict=True):
        step = np.median(np.diff(flight.time))
        if step >= _MAX_STEP or not 1 / 3 < step * rate < 3:
            raise InputError(
                f"{recording.path}: column 'time' has a median step of {step:.4g}; "
                f"expected seconds (not milliseconds, or a count of rows), about "
                f"{1 / rate:.4g} for a pose_rate of {rate:.4g} Hz."
            )
    return campaign


def _make_flight(recording: Recording, name: str, campaign: Campaign) -> Flight:
    """Makes the flight of a recording; InputError where it cannot be one in SI.

    Args:
        recording: of one table.
        name: of the flight.
        campaign: says whether the elevator has a servo.
    """
    columns = _read_columns(recording, campaign)
    _check_times(recording, columns)
    _check_units(recording, columns)
    for angle in EULER:
        if angle in columns:
            columns[angle] = np.unwrap(columns[angle])

    attitude = None
    if "roll" in columns:
        attitude = np.column_stack([columns["y"], columns["roll"], columns["yaw"]])
    return Flight(
        name=name,
        time=columns["time"],
        pose=np.column_stack([columns["x"], columns["z"], columns["pitch"]]),
        elevator=columns.get("elevator"),
        command=columns.get("elevator_rate_command"),
        attitude=attitude,
        command_time=columns.get(logs.COMMAND_TIME),
    )


def _read_columns(recording: Recording, campaign: Campaign) -> dict[str, np.ndarray]:
    """Reads the columns (n,) that a flight has, in SI units.

    The pose is always there, the servo unless the campaign's elevator is fixed, the
    attitude where all of y, roll and yaw were logged.
    """
    given = recording.groups[0].columns.keys()
    wanted = [*logs.POSE_COLUMNS]
    if campaign.elevator == "servo":
        wanted += logs.SERVO_COLUMNS
        for lacking in sorted(set(logs.SERVO_COLUMNS) - given):
            raise InputError(
                f"{recording.path}: column '{lacking}' is missing"
                f"{recording.hint(lacking)}; expected it, or in campaign.yaml "
                "'elevator: fixed' under 'vehicle:' (a tail that does not move), or "
                "'columns:' (other logs of commands)."
            )
    if given >= set(logs.ATTITUDE_COLUMNS):
        wanted += logs.ATTITUDE_COLUMNS
    if logs.COMMAND_TIME in given:
        wanted.append(logs.COMMAND_TIME)
    return {name: _read_column(recording, name) for name in wanted}


def _read_column(recording: Recording, name: str) -> np.ndarray:
    """Numbers of a column (n,) in SI; InputError where they are not finite.

    A column has a unit where the file has one for it, otherwise it is in SI.
    """
    _, column = recording.find(name, "header")
    recording.refuse(
        ~np.isfinite(column.values), name, "a finite number, and no empty cell"
    )
    if column.unit is None:
        return column.values
    kind = QUANTITIES.get(name, "time")
    scale = scale_of(column.unit, kind, f"{recording.path}: column '{name}'")
    return scale.gain * column.values


def _check_times(recording: Recording, columns: dict[str, np.ndarray]) -> None:
    """Refuses flights that are too short, and times in another order than the rows."""
    time = columns["time"]
    span = np.ptp(time) if len(time) else 0.0
    if len(time) < _MIN_ROWS or span < _MIN_SPAN:
        raise InputError(
            f"{recording.path}: too short, {len(time)} rows over {span:.3g} s of "
            f"'time'; expected at least {_MIN_ROWS} rows and {_MIN_SPAN} s."
        )
    is_late = np.diff(time, prepend=-math.inf) <= 0.0
    recording.refuse(is_late, "time", "more than in the row before")
    if logs.COMMAND_TIME in columns:
        began = columns[logs.COMMAND_TIME]
        falls_back = np.diff(began, prepend=-math.inf) < 0.0
        recording.refuse(
            (began > time) | falls_back,
            logs.COMMAND_TIME,
            "a time that is not after the row's, nor before the last",
        )


def _check_units(recording: Recording, columns: dict[str, np.ndarray]) -> None:
    """Refuses what cannot be SI: lengths, angles and speeds that are too large."""
    for name, (bound, expected) in _BOUNDS.items():
        if name in columns:
            is_beyond = np.abs(columns[name]) > bound
            recording.refuse(is_beyond, name, f"less than ±{bound:.4g} {expected}")
    steps = np.hypot(np.diff(columns["x"]), np.diff(columns["z"]))
    speed = np.median(steps / np.diff(columns["time"]))
    if speed > _MAX_SPEED:
        raise InputError(
            f"{recording.path}: columns 'x' and 'z' move at {speed:.4g} m/s (median); "
            f"expected at most {_MAX_SPEED:g} (this looks like millimeters)."
        )
