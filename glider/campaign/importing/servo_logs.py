"""Elevator and command of a flight, from the servo logs that users have.

The model is driven by rates. A commanded angle becomes the rate of an ideal servo that
goes there as fast as its limit allows; an elevator without commands its own rate. What
cannot be identified of the servo then is reported.
"""

from typing import NamedTuple

import numpy as np
from scipy.signal import savgol_filter

from glider.campaign.importing.selection import Stream
from glider.campaign.importing.track import Track
from glider.campaign.logs import MAX_ANGLE, Campaign, ServoLog
from glider.errors import InputError
from glider.physics.actuator_replay import latest_command

_JUMP = 2.0  # Share of its fastest rate above which a change of angle is a step.
_LEAST_LIMIT = 0.1  # Of a limit that is measured [rad/s].
_REACH = 1.5  # Ratio to the elevator's limits that commands reach at most.
_SLACK = 0.1  # Time of a flight that the servo's log may miss at either end [s].
_HIDDEN = "so a lag or a delay of the servo cannot be found"


class Servo(NamedTuple):
    """Elevator and command at the rows of a flight."""

    elevator: np.ndarray  #: (n,) [rad]
    command: np.ndarray  #: (n,) [rad/s], held until the next row.
    note: str  #: How they were made, where they were not logged so.
    log: ServoLog = ServoLog()  #: The same for the tracer.


def make_servo(flight: Track, settings: Campaign, source: str) -> Servo | None:
    """Elevator and command on the poses' clock; None where the elevator is fixed."""
    if settings.elevator != "servo":
        if flight.servo.given:
            raise InputError(
                f"{source}: vehicle: elevator is '{settings.elevator}', but columns of "
                "an elevator are mapped; expected one or the other."
            )
        return None
    elevator, rates, angles = flight.servo
    if rates is not None and angles is not None:
        raise InputError(
            f"{source}: columns: elevator_rate_command and elevator_angle_command are "
            "both mapped; expected the one that the servo was given."
        )
    measured = None
    if elevator is not None:
        _check_covered(flight, elevator, source)
        measured = np.interp(flight.time, elevator.time, elevator.values[:, 0])
    if angles is not None:
        _check_covered(flight, angles, source)
        _check_reach(flight, angles, settings, source)
        limit = settings.elevator_rate_limit
        return _from_angles(flight.time, angles, measured, limit, source)
    if measured is None:
        raise InputError(
            f"{source}: columns: no angle of the elevator is mapped; expected "
            "'elevator' (measured) or 'elevator_angle_command', or 'vehicle: "
            "{elevator: fixed}' where the tail does not move."
        )
    if rates is not None:
        return Servo(measured, _hold(flight, rates, source), "")
    note = f"no command is mapped: the elevator's own rate is used for it, {_HIDDEN}"
    rate = _rate_of(flight.time, measured)
    return Servo(measured, rate, note, ServoLog(command="reconstructed"))


def _from_angles(
    time: np.ndarray,
    angles: Stream,
    measured: np.ndarray | None,
    limit: float | None,
    source: str,
) -> Servo:
    """Servo that goes to commanded angles at its limit.

    A command shows in the first sample after it was given: half a step before on the
    average, and at any time of that step.
    """
    if limit is None:
        if measured is None:
            raise InputError(
                f"{source}: vehicle: elevator_rate_limit is missing; expected it where "
                "angles are commanded, to make rates of them."
            )
        limit = max(float(np.max(np.abs(_rate_of(time, measured)))), _LEAST_LIMIT)
    step = float(np.median(np.diff(angles.time)))
    given, std = angles.time - 0.5 * step, step / np.sqrt(12.0)
    angle, rate = _follow(time, given, angles.values[:, 0], limit)
    note = f"the commanded angle became rates of at most {limit:.3g} rad/s"
    if measured is not None:
        log = ServoLog(command="converted", command_std=std)
        return Servo(measured, rate, note, log)
    note += f"; the angle is that of an ideal servo, as it was not measured, {_HIDDEN}"
    log = ServoLog(angle="reconstructed", command="converted", clock_std=std)
    return Servo(angle, rate, note, log)


def _hold(flight: Track, stream: Stream, source: str) -> np.ndarray:
    """The command that holds at each row (n,)."""
    _check_covered(flight, stream, source)
    index = np.maximum(latest_command(stream.time, flight.time), 0)
    return stream.values[index, 0]


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
    begin, end = flight.time[0], flight.time[-1]
    if stream.time[0] > begin + _SLACK or stream.time[-1] < end - _SLACK:
        raise InputError(
            f"{flight.path}: the elevator is logged from {stream.time[0]:.6g} to "
            f"{stream.time[-1]:.6g} s, and the flight is from {begin:.6g} to "
            f"{end:.6g} s; expected the same clock, or 'clock: find' in {source}."
        )


def _rate_of(time: np.ndarray, angle: np.ndarray) -> np.ndarray:
    """The rates (n,) that, each held for a row, make an elevator's path."""
    rate = np.diff(savgol_filter(angle, 5, 2)) / np.diff(time)
    return np.append(rate, rate[-1])


def _follow(
    time: np.ndarray, given: np.ndarray, asked: np.ndarray, limit: float
) -> tuple[np.ndarray, np.ndarray]:
    """Angle and rate (n,) at rows of a servo that goes to angles at its limit.

    Each asked angle (m,) holds from the time (m,) when it was given to the next. Angles
    that no servo could follow so are steps; others are samples of a path, which passes
    them half a step later. The rates are the mean ones that lead from row to row.
    """
    steps = np.diff(given)
    if np.any(np.abs(np.diff(asked)) > _JUMP * limit * steps):
        grid = np.union1d(time, given[(given > time[0]) & (given < time[-1])])
        goal = asked[np.maximum(latest_command(given, grid), 0)]
        angle = np.full(len(grid), goal[0])
        for k, reach in enumerate(limit * np.diff(grid)):
            angle[k + 1] = angle[k] + np.clip(goal[k] - angle[k], -reach, reach)
        angle = angle[np.searchsorted(grid, time)]
    else:
        angle = np.interp(time, given + 0.5 * np.median(steps), asked)
    rate = np.diff(angle) / np.diff(time)
    return angle, np.append(rate, rate[-1])
