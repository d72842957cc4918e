"""Elevator and command of a flight, from the servo logs that users have.

The model is driven by rates of the elevator's angle, each held from row to row. They
are made of what was logged:

- commanded rates in the rows of the poses are used as they are; those of a log of its
  own become the mean rates from row to row;
- a commanded angle becomes the rate of an ideal servo that goes there as fast as its
  limit allows;
- without commands, the measured elevator gives its own rate.

Where no angle was measured, that of the ideal servo stands for it. `ServoLog` reports
which of these was done: what cannot be identified of the servo then is reported.
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
    """Elevator and command at the n rows of a flight.

    Attributes:
        elevator: angle (n,) [rad].
        command: rate (n,) that is held until the next row [rad/s].
        log: how they were made, where they were not logged so.
    """

    elevator: np.ndarray
    command: np.ndarray
    log: ServoLog = ServoLog()


def make_servo(flight: Track, settings: Campaign, source: str) -> _Servo | None:
    """Makes elevator and command of a flight from the servo's logs.

    Args:
        flight: the poses of one flight, with the logs of the servo on their clock.
        settings: what is known of the vehicle and its servo.
        source: name of the MAP file, for messages.

    Returns:
        Elevator and command at the flight's rows; None where the elevator is fixed.

    Raises:
        InputError: the logs do not cover the flight, contradict the settings, or do
            not suffice.
    """
    if settings.elevator != "servo":
        if flight.servo.given:
            raise InputError(
                f"{source}: vehicle: elevator is '{settings.elevator}', but columns of "
                "an elevator are mapped; expected one or the other."
            )
        return None
    for stream in flight.servo.given:
        _check_covered(flight, stream, source)

    time = flight.time
    elevator, rates, angles = flight.servo
    measured = None
    if elevator is not None:
        path = Akima1DInterpolator(elevator.time, elevator.values[:, 0])
        # Chords between rows of another log would cut what it travels short.
        measured = path(np.clip(time, *elevator.time[[0, -1]]))

    if angles is not None:
        _check_reach(flight, angles, settings, source)
        return _from_angles(time, angles, measured, settings, source)
    if elevator is None or measured is None:
        raise InputError(
            f"{source}: columns: no angle of the elevator is mapped; expected "
            "'elevator' (measured) or 'elevator_angle_command', or 'vehicle: "
            "{elevator: fixed}' where the tail does not move."
        )
    if rates is None:
        rate = _smooth_rates(time, measured)
        return _Servo(measured, rate, ServoLog(command="reconstructed"))

    _check_complete(rates, settings.command_rate, source)
    held = latest_command(rates.time, time + _SAME * rates.step)
    late = np.abs(rates.time[held] - time)
    if np.max(late) < _SAME * rates.step:
        return _Servo(measured, rates.values[held, 0])
    tape = _make_tape(rates, time, settings.command_rate)
    rate = _row_rates(time, elevator_path(*tape, time))
    std = rates.step / math.sqrt(12.0)
    log = ServoLog(command="converted", command_std=std)
    return _Servo(_between_rows(time, elevator, tape), rate, log)


def widen(log: ServoLog, track: Track) -> ServoLog:
    """Adds the errors of stamps and of the shift of clocks to those of a servo's log.

    The shift of the clocks moves commands alone where the elevator was measured on the
    clock of the poses, else elevator and commands together.
    """
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
    """Follows commanded angles by a servo within its travel, at its limit at most.

    Args:
        time: of the flight's rows (n,) [s].
        asked: the commanded angles [rad].
        measured: the elevator's angle at the rows (n,), if it was measured [rad].
        settings: for the limits of the servo's travel and rate; a rate limit that is
            not given is the highest rate of the measured angle.
        source: name of the MAP file, for messages.

    Returns:
        The measured angle, or that of the ideal servo, with the rates of the latter.

    Raises:
        InputError: neither a rate limit nor a measured angle is known.
    """
    limit = settings.elevator_rate_limit
    if limit is None:
        if measured is None:
            raise InputError(
                f"{source}: vehicle: elevator_rate_limit is missing; expected it where "
                "angles are commanded, to make rates of them."
            )
        fastest = np.max(np.abs(_smooth_rates(time, measured)))
        limit = max(fastest, _LEAST_LIMIT)

    goals = asked.values[:, 0]
    if settings.elevator_limits is not None:
        goals = np.clip(goals, *settings.elevator_limits)
    angle = _commanded_path(time, asked, goals, limit)
    for k, reach in enumerate(limit * np.diff(time)):
        angle[k + 1] = angle[k] + np.clip(angle[k + 1] - angle[k], -reach, reach)

    rate = _row_rates(time, angle)
    std = asked.step / math.sqrt(12.0)
    if measured is None:
        log = ServoLog(angle="reconstructed", command="converted", clock_std=std)
        return _Servo(angle, rate, log)
    return _Servo(measured, rate, ServoLog(command="converted", command_std=std))


def _commanded_path(
    time: np.ndarray, asked: Stream, goals: np.ndarray, limit: float
) -> np.ndarray:
    """Interpolates commanded angles between the rows of their log.

    A servo passes them when they are logged, as samples of a path. Those that it cannot
    reach so at its limit, and those of a log of changes, are steps: they were given at
    some time of the log's step before, half a step on the average.

    Args:
        time: of the flight's rows (n,) [s].
        asked: the log of the commands, k rows.
        goals: its angles (k,) within the servo's travel [rad].
        limit: of the servo's rate [rad/s].

    Returns:
        The angle that is commanded at each row of the flight (n,) [rad].
    """
    step = asked.step
    gaps = np.diff(asked.time)
    is_late = gaps > 1.5 * step
    is_too_fast = np.abs(np.diff(goals)) > limit * gaps
    before = np.flatnonzero(is_late | is_too_fast)  # Rows after which a step comes.
    given = asked.time[before + 1] - 0.5 * np.minimum(step, gaps[before])

    # The last angle is held until the step was given.
    begins = np.insert(asked.time, before + 1, given)
    path = PchipInterpolator(begins, np.insert(goals, before + 1, goals[before]))
    return path(np.clip(time, begins[0], begins[-1]))


def _make_tape(rates: Stream, time: np.ndarray, command_rate: float | None) -> _Tape:
    """Finds when the commanded rates about a flight began, and which they were.

    Rows of a log leave open when in the time between them a command was given: the
    middle of that time is taken.

    Args:
        rates: the log of the commands [rad/s].
        time: of the flight's rows (n,) [s].
        command_rate: of the clock that gives commands, if it is known [Hz].
    """
    logged, values = _around(rates, time)
    begins, held = command_steps(logged, values, command_rate)
    changes = np.flatnonzero(np.diff(values)) + 1
    if len(changes):
        # A command began after the last row before it and before the first row with
        # it; a few logged times may be off. All are shifted to the middle of that.
        later = np.quantile(logged[changes] - begins[1:], _FEW)
        sooner = np.quantile(begins[1:] - logged[changes - 1], _FEW)
        begins += np.clip(later - sooner, -rates.step, rates.step) / 2.0
    return begins, held


def _around(log: Stream, time: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Times and values (k,) of a log about a flight with rows at times (n,) [s].

    The first row holds at the beginning, and the last one comes after the end.
    """
    first, last = np.searchsorted(log.time, time[[0, -1]] + [-_BEFORE, _BEFORE])
    rows = slice(max(first - 1, 0), last + 1)
    return log.time[rows], log.values[rows, 0]


def _between_rows(time: np.ndarray, elevator: Stream, tape: _Tape) -> np.ndarray:
    """Angles (n,) of an elevator between its log's rows, led by its commands [rad].

    A smooth path from row to row misses the corners where commands change. So their
    path is taken, with the delay and lag that fit best, and what it leaves is smooth.
    """
    rows, angle = _around(elevator, time)

    def path(query: np.ndarray, delay_and_lag: np.ndarray) -> np.ndarray:
        delay, lag = delay_and_lag
        return elevator_path(*tape, query, delay=delay, time_constant=abs(lag))

    # The best path leaves the least of the changes from row to row.
    best = brute(lambda late: np.std(np.diff(angle - path(rows, late))), _TRIED)
    left = Akima1DInterpolator(rows, angle - path(rows, best))
    return path(time, best) + left(np.clip(time, *rows[[0, -1]]))


def align_commands(campaign: Campaign) -> Campaign:
    """Shifts converted commands so that elevators follow equally late in all flights.

    Each file leaves open when a command was given, within the steps of its log: so the
    shifts are limited to what the standard error of the commands' times explains.
    """
    elevators = measure_elevators(campaign, {})
    delays = [calc_correlation([elevator], _DELAYS)[1] for elevator in elevators]
    most = _ALIGNED * campaign.servo.command_std
    shifts = np.clip(np.array(delays) - np.median(delays), -most, most)

    flights = []
    for flight, shift in zip(campaign.flights, shifts, strict=True):
        assert flight.command is not None
        path = elevator_path(flight.time, flight.command, flight.time - shift)
        rates = _row_rates(flight.time, path)
        flights.append(dataclasses.replace(flight, command=rates))
    return dataclasses.replace(campaign, flights=tuple(flights))


def _row_rates(time: np.ndarray, angle: np.ndarray) -> np.ndarray:
    """The rates (n,) that, each held for a row, lead from angle to angle [rad/s]."""
    rate = np.diff(angle) / np.diff(time)
    return np.append(rate, rate[-1])


def _smooth_rates(time: np.ndarray, angle: np.ndarray) -> np.ndarray:
    """Rates (n,) of measured angles, whose noise is smoothed first [rad/s]."""
    return _row_rates(time, savgol_filter(angle, 5, 2))


def _check_reach(
    flight: Track, angles: Stream, settings: Campaign, source: str
) -> None:
    """Refuses commanded angles that no elevator reaches: a rate, or another unit."""
    begin, end = flight.span
    is_within = (angles.time >= begin) & (angles.time <= end)
    largest = np.max(np.abs(angles.values[is_within]), initial=0.0)
    reach = MAX_ANGLE
    if settings.elevator_limits is not None:
        reach = _REACH * max(map(abs, settings.elevator_limits))
    if largest > reach:
        raise InputError(
            f"{source}: columns: elevator_angle_command is {largest:.3g} rad in "
            f"{flight.path.name}; expected {reach:.3g} at most: is it a rate, or in "
            "another unit?"
        )


def _check_complete(rates: Stream, command_rate: float | None, source: str) -> None:
    """Refuses commanded rates that are logged in even steps, but not all of them.

    Args:
        rates: the log of the commands.
        command_rate: of the clock that gives commands, if it is known [Hz].
        source: name of the MAP file, for messages.
    """
    usual, long = np.quantile(np.diff(rates.time), [0.5, 0.9])
    is_regular = long < 1.5 * usual  # It is no log of changes.
    if command_rate and 0.9 * usual * command_rate > 1.0 and is_regular:
        raise InputError(
            f"{source}: elevator_rate_command is logged at {1 / usual:.3g} Hz, and "
            f"field 'command_rate' is {command_rate:g}: commands are lost; expected a "
            "log of all, or the measured 'elevator' without elevator_rate_command."
        )


def _check_covered(flight: Track, stream: Stream, source: str) -> None:
    """Refuses a log that does not last over the flight."""
    begin, end = flight.span
    first, last = stream.time[[0, -1]]
    pause = np.max(np.diff(stream.time), initial=_SLACK)  # Of a log of changes.
    if first > begin + _SLACK or last < end - pause:
        raise InputError(
            f"{flight.path}: the elevator is logged from {first:.6g} to "
            f"{last:.6g} s, and the flight is from {begin:.6g} to "
            f"{end:.6g} s; expected the same clock, or 'clock: find' in {source}."
        )
