"""Recordings in the columns of a campaign, checked and made flights.

What cannot be in SI units, or cannot be a flight, is refused. A fault that an effect of
the library models (a wrong sign, an offset, a delay) passes.
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
"""What columns of a flight are at most."""


def with_flights(
    campaign: Campaign, recordings: Sequence[Recording], names: Sequence[str] = ()
) -> Campaign:
    """Adds a flight of each recording to a campaign.

    Args:
        campaign: without flights.
        recordings: of one table each, with the columns of a campaign's files.
        names: of the flights; (): those of the recordings' files.
    """
    names = names or [recording.path.name for recording in recordings]
    pairs = list(zip(recordings, names, strict=True))
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
    """Makes the flight of a recording; InputError where it cannot be one in SI."""
    given = recording.groups[0].columns.keys()
    wanted = [*logs.POSE_COLUMNS]
    if campaign.elevator == "servo":
        wanted += logs.SERVO_COLUMNS
        for lacking in sorted(set(logs.SERVO_COLUMNS) - given):
            raise InputError(
                f"{recording.path}: column '{lacking}' is missing; expected it, or in "
                "campaign.yaml 'elevator: fixed' under 'vehicle:' (a tail that does "
                "not move), or 'columns:' (other logs of commands)."
            )
    spatial = given >= set(logs.ATTITUDE_COLUMNS)
    if spatial:
        wanted += logs.ATTITUDE_COLUMNS
    if logs.COMMAND_TIME in given:
        wanted.append(logs.COMMAND_TIME)
    columns = {column: _read_column(recording, column) for column in wanted}
    time = columns["time"]
    span = np.ptp(time) if len(time) else 0.0
    if len(time) < _MIN_ROWS or span < _MIN_SPAN:
        raise InputError(
            f"{recording.path}: too short, {len(time)} rows over {span:.3g} s of "
            f"'time'; expected at least {_MIN_ROWS} rows and {_MIN_SPAN} s."
        )
    late = np.diff(time, prepend=-math.inf) <= 0.0
    recording.refuse(late, "time", "more than in the row before")
    began = columns.get(logs.COMMAND_TIME)
    if began is not None:
        bad = (began > time) | (np.diff(began, prepend=-math.inf) < 0.0)
        expected = "a time that is not after the row's, nor before the last"
        recording.refuse(bad, logs.COMMAND_TIME, expected)
    _check_units(recording, columns)
    for angle in EULER:
        if angle in columns:
            columns[angle] = np.unwrap(columns[angle])
    attitude = [columns[name] for name in logs.ATTITUDE_COLUMNS if spatial]
    return Flight(
        name=name,
        time=time,
        pose=np.column_stack([columns[name] for name in logs.POSE_COLUMNS[1:]]),
        elevator=columns.get("elevator"),
        command=columns.get("elevator_rate_command"),
        attitude=np.column_stack(attitude) if spatial else None,
        command_time=began,
    )


def _read_column(recording: Recording, name: str) -> np.ndarray:
    """Numbers of a column (n,) in SI; InputError where they are not finite."""
    _, column = recording.find(name, "flight")
    recording.refuse(~np.isfinite(column.values), name, "a finite number")
    if column.unit is None:
        return column.values
    kind = QUANTITIES.get(name, "time")
    scale = scale_of(column.unit, kind, f"{recording.path}: column '{name}'")
    return scale.gain * column.values


def _check_units(recording: Recording, columns: dict[str, np.ndarray]) -> None:
    """Refuses what cannot be SI; a fault that an effect can model passes."""
    for name, (bound, expected) in _BOUNDS.items():
        if name in columns:
            bad = np.abs(columns[name]) > bound
            recording.refuse(bad, name, f"±{bound:.4g} {expected}")
    step_length = np.hypot(np.diff(columns["x"]), np.diff(columns["z"]))
    speed = np.median(step_length / np.diff(columns["time"]))
    if speed > _MAX_SPEED:
        raise InputError(
            f"{recording.path}: columns 'x' and 'z' move at {speed:.4g} m/s (median); "
            f"expected at most {_MAX_SPEED:g} (this looks like millimeters)."
        )
