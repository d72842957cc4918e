"""Elevator and command of a flight, from the servo logs that users have.

The model is driven by rates. A commanded angle becomes the rate of an ideal servo that
goes there as fast as its limit allows; an elevator without commands its own rate. What
cannot be identified of the servo then is reported.
"""

import dataclasses
import math
from typing import NamedTuple

import numpy as np
from scipy.interpolate import Akima1DInterpolator, PchipInterpolator
from scipy.optimize import brute
from scipy.signal import savgol_filter

from glider.campaign.checks.servo import calc_correlation, measure_elevators
from glider.campaign.importing.track import Stream, Track
from glider.campaign.logs import Campaign, ServoLog
from glider.compiled.actuators import elevator_path
from glider.errors import InputError
from glider.physics.held_commands import command_steps, latest_command
from glider.physics.parameters import MAX_ANGLE

_LEAST_LIMIT = 0.1  # Of a limit that is measured [rad/s].
_REACH = 1.5  # Ratio to the elevator's limits that commands reach at most.
_SLACK = 0.1  # Time of a flight that the servo's log may miss at either end [s].
_BEFORE = 0.5  # Time of a log before and after a flight that is looked at [s].
_DELAYS = np.arange(-0.05, 0.35, 0.001)  # Of elevators behind commands [s].
_TRIED = slice(-0.02, 0.1, 0.005), slice(0.003, 0.1, 0.02)  # Delays and lags [s].
_ALIGNED = 2.0  # Standard errors by which a flight's commands are shifted at most.
_SAME = 0.01  # Part of a log's step within which rows of two logs are the same.
_FEW = 0.05  # Share of commands whose logged times may be off.
_Tape = tuple[np.ndarray, np.ndarray]  # When commands begin [s], and which [rad/s].


class _Servo(NamedTuple):
    """Elevator and command at the rows of a flight."""

    elevator: np.ndarray  #: (n,) [rad]
    command: np.ndarray  #: (n,) [rad/s], held until the next row.
    log: ServoLog = ServoLog()  #: How they were made, where they were not logged so.


def make_servo(flight: Track, settings: Campaign, source: str) -> _Servo | None:
    """Elevator and command on the poses' clock; None where the elevator is fixed."""
    if settings.elevator != "servo":
        if flight.servo.given:
            raise InputError(
                f"{source}: vehicle: elevator is '{settings.elevator}', but columns of "
                "an elevator are mapped; expected one or the other."
            )
        return None
    for stream in flight.servo.given:
        _check_covered(flight, stream, source)
    elevator, rates, angles = flight.servo
    measured = None
    if elevator is not None:
        path = Akima1DInterpolator(elevator.time, elevator.values[:, 0])
        # Chords between rows of another log would cut what it travels short.
        measured = path(np.clip(flight.time, *elevator.time[[0, -1]]))
    if angles is not None:
        _check_reach(flight, angles, settings, source)
        return _from_angles(flight.time, angles, measured, settings, source)
    if elevator is None or measured is None:
        raise InputError(
            f"{source}: columns: no angle of the elevator is mapped; expected "
            "'elevator' (measured) or 'elevator_angle_command', or 'vehicle: "
            "{elevator: fixed}' where the tail does not move."
        )
    if rates is not None:
        rate, tape = _from_rates(flight.time, rates, settings.command_rate, source)
        if tape is None:
            return _Servo(measured, rate)
        measured = _between_rows(flight.time, elevator, tape)
        std = rates.step / math.sqrt(12.0)
        log = ServoLog(command="converted", command_std=std)
        return _Servo(measured, rate, log)
    rate = _row_rates(flight.time, savgol_filter(measured, 5, 2))
    return _Servo(measured, rate, ServoLog(command="reconstructed"))


def widen(log: ServoLog, track: Track) -> ServoLog:
    """A log of the servo with the errors of its shift and of stamps as well."""
    of_poses = math.hypot(log.clock_std, track.jitter)
    of_commands = log.command_std
    if track.has_measured:
        of_commands = math.hypot(of_commands, track.clock_std)
    else:
        of_poses = math.hypot(of_poses, track.clock_std)
    return dataclasses.replace(log, clock_std=of_poses, command_std=of_commands)


def _from_angles(
    time: np.ndarray,
    asked: Stream,
    measured: np.ndarray | None,
    settings: Campaign,
    source: str,
) -> _Servo:
    """Servo that goes to commanded angles within its travel, at its limit at most.

    It passes them when they are logged, as samples of a path. Those that it cannot
    reach so, and those of a log of changes, are steps: they were given at some time of
    the log's step before, half a step on the average.
    """
    limit = settings.elevator_rate_limit
    if limit is None:
        if measured is None:
            raise InputError(
                f"{source}: vehicle: elevator_rate_limit is missing; expected it where "
                "angles are commanded, to make rates of them."
            )
        rate = _row_rates(time, savgol_filter(measured, 5, 2))
        limit = max(float(np.max(np.abs(rate))), _LEAST_LIMIT)
    step = asked.step
    goals = asked.values[:, 0]
    if settings.elevator_limits is not None:
        goals = np.clip(goals, *settings.elevator_limits)
    gaps = np.diff(asked.time)
    is_step = (gaps > 1.5 * step) | (np.abs(np.diff(goals)) > limit * gaps)
    rows = np.flatnonzero(is_step)
    given = asked.time[rows + 1] - 0.5 * np.minimum(step, gaps[rows])
    begins = np.insert(asked.time, rows + 1, given)
    path = PchipInterpolator(begins, np.insert(goals, rows + 1, goals[rows]))
    angle = path(np.clip(time, begins[0], begins[-1]))
    for k, reach in enumerate(limit * np.diff(time)):
        angle[k + 1] = angle[k] + np.clip(angle[k + 1] - angle[k], -reach, reach)
    rate = _row_rates(time, angle)
    std = step / math.sqrt(12.0)
    if measured is not None:
        log = ServoLog(command="converted", command_std=std)
        return _Servo(measured, rate, log)
    log = ServoLog(angle="reconstructed", command="converted", clock_std=std)
    return _Servo(angle, rate, log)


def _from_rates(
    time: np.ndarray, rates: Stream, command_rate: float | None, source: str
) -> tuple[np.ndarray, _Tape | None]:
    """The commands (n,) at rows, and those of another log's rows: when, and which.

    Those of another log's rows become the mean rates that lead from row to row. Its
    rows leave open when a command was given: the middle of that time is taken.
    """
    step = rates.step
    held = latest_command(rates.time, time + _SAME * step)
    usual, long = np.quantile(np.diff(rates.time), [0.5, 0.9])
    if command_rate and 0.9 * usual * command_rate > 1.0 and long < 1.5 * usual:
        raise InputError(  # It is no log of changes.
            f"{source}: elevator_rate_command is logged at {1 / usual:.3g} Hz, and "
            f"field 'command_rate' is {command_rate:g}: commands are lost; expected a "
            "log of all, or the measured 'elevator' without elevator_rate_command."
        )
    if (np.abs(rates.time[held] - time) < _SAME * step).all():
        return rates.values[held, 0], None
    near = _around(rates, time)
    logged = rates.time[near]
    values = rates.values[near, 0]
    changes = np.flatnonzero(np.diff(values)) + 1
    begins, held = command_steps(logged, values, command_rate)
    if len(changes):
        later = np.quantile(logged[changes] - begins[1:], _FEW)
        sooner = np.quantile(begins[1:] - logged[changes - 1], _FEW)
        begins += np.clip(later - sooner, -step, step) / 2.0
    return _row_rates(time, elevator_path(begins, held, time)), (begins, held)


def _around(log: Stream, time: np.ndarray) -> slice:
    """Rows of a log about a flight, with one that holds before and one after."""
    first, last = np.searchsorted(log.time, [time[0] - _BEFORE, time[-1] + _BEFORE])
    return slice(max(first - 1, 0), last + 1)


def _between_rows(time: np.ndarray, elevator: Stream, tape: _Tape) -> np.ndarray:
    """Angles (n,) of an elevator between its log's rows, led by its commands [rad].

    A smooth path from row to row misses the corners where commands change. So their
    path is taken, with the delay and lag that fit best, and what it leaves is smooth.
    """
    used = _around(elevator, time)
    rows = elevator.time[used]
    angle = elevator.values[used, 0]

    def path(query: np.ndarray, late: np.ndarray) -> np.ndarray:
        lag = abs(late[1])
        return elevator_path(*tape, query, delay=late[0], time_constant=lag)

    late = brute(lambda late: np.std(np.diff(angle - path(rows, late))), _TRIED)
    left = Akima1DInterpolator(rows, angle - path(rows, late))
    return path(time, late) + left(np.clip(time, *rows[[0, -1]]))


def align_commands(campaign: Campaign) -> Campaign:
    """Shifts converted commands so that elevators follow equally late in all flights.

    Each file leaves open when a command was given, within the steps of its log.
    """
    elevators = measure_elevators(campaign, {})
    delays = [calc_correlation([elevator], _DELAYS)[1] for elevator in elevators]
    most = _ALIGNED * campaign.servo.command_std
    flights = []
    late = np.clip(np.array(delays) - np.median(delays), -most, most)
    for flight, seconds in zip(campaign.flights, late, strict=True):
        assert flight.command is not None
        path = elevator_path(flight.time, flight.command, flight.time - seconds)
        rates = _row_rates(flight.time, path)
        flights.append(dataclasses.replace(flight, command=rates))
    return dataclasses.replace(campaign, flights=tuple(flights))


def _row_rates(time: np.ndarray, angle: np.ndarray) -> np.ndarray:
    """The rates (n,) that, each held for a row, lead from angle to angle."""
    rate = np.diff(angle) / np.diff(time)
    return np.append(rate, rate[-1])


def _check_reach(
    flight: Track, angles: Stream, settings: Campaign, source: str
) -> None:
    """Refuses commanded angles that no elevator reaches: a rate, or another unit."""
    within = (angles.time >= flight.time[0]) & (angles.time <= flight.time[-1])
    largest = float(np.max(np.abs(angles.values[within]), initial=0.0))
    limits = settings.elevator_limits
    reach = MAX_ANGLE if limits is None else _REACH * max(map(abs, limits))
    if largest > reach:
        raise InputError(
            f"{source}: columns: elevator_angle_command is {largest:.3g} rad in "
            f"{flight.path.name}; expected {reach:.3g} at most: is it a rate, or in "
            "another unit?"
        )


def _check_covered(flight: Track, stream: Stream, source: str) -> None:
    """Refuses a log that does not last over the flight."""
    begin = flight.time[0]
    end = flight.time[-1]
    pause = np.max(np.diff(stream.time), initial=_SLACK)  # Of a log of changes.
    if stream.time[0] > begin + _SLACK or stream.time[-1] < end - pause:
        raise InputError(
            f"{flight.path}: the elevator is logged from {stream.time[0]:.6g} to "
            f"{stream.time[-1]:.6g} s, and the flight is from {begin:.6g} to "
            f"{end:.6g} s; expected the same clock, or 'clock: find' in {source}."
        )
