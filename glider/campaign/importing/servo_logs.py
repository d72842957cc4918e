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
from glider.campaign.logs import Campaign
from glider.errors import InputError
from glider.physics.actuator_replay import latest_command

_FASTEST = 99.0  # Percentile of measured rates taken for the servo's limit [%].
_LEAST_LIMIT = 0.1  # Of a limit that is measured [rad/s].
_SLACK = 0.1  # Time of a flight that the servo's log may miss at either end [s].
_HIDDEN = "so a lag or a delay of the servo cannot be found"


class Servo(NamedTuple):
    """Elevator and command at the rows of a flight."""

    elevator: np.ndarray  # (n,) [rad]
    command: np.ndarray  # (n,) [rad/s], held until the next row.
    note: str  # How they were made, where they were not logged so.


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
        asked, limit = _hold(flight, angles, source), settings.elevator_rate_limit
        return _from_angles(flight.time, asked, measured, limit, source)
    if measured is None:
        raise InputError(
            f"{source}: columns: no angle of the elevator is mapped; expected "
            "'elevator' (measured) or 'elevator_angle_command', or 'vehicle: "
            "{elevator: fixed}' where the tail does not move."
        )
    if rates is not None:
        return Servo(measured, _hold(flight, rates, source), "")
    note = f"no command is mapped: the elevator's own rate is used for it, {_HIDDEN}"
    return Servo(measured, _rate_of(flight.time, measured), note)


def _from_angles(
    time: np.ndarray,
    asked: np.ndarray,
    measured: np.ndarray | None,
    limit: float | None,
    source: str,
) -> Servo:
    """Servo that goes to commanded angles (n,) at its limit."""
    if limit is None:
        if measured is None:
            raise InputError(
                f"{source}: vehicle: elevator_rate_limit is missing; expected it where "
                "angles are commanded, to make rates of them."
            )
        rates = np.abs(_rate_of(time, measured))
        limit = max(float(np.percentile(rates, _FASTEST)), _LEAST_LIMIT)
    start = asked[0] if measured is None else measured[0]
    angle, rate = _chase(time, asked, float(start), limit)
    note = f"the commanded angle became rates of at most {limit:.3g} rad/s"
    if measured is not None:
        return Servo(measured, rate, note)
    note += f"; the angle is that of an ideal servo, as it was not measured, {_HIDDEN}"
    return Servo(angle, rate, note)


def _hold(flight: Track, stream: Stream, source: str) -> np.ndarray:
    """The command that holds at each row (n,)."""
    _check_covered(flight, stream, source)
    index = np.maximum(latest_command(stream.time, flight.time), 0)
    return stream.values[index, 0]


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


def _chase(
    time: np.ndarray, asked: np.ndarray, start: float, limit: float
) -> tuple[np.ndarray, np.ndarray]:
    """Angle and rate (n,) of a servo that goes to asked angles at its limit."""
    angle, rate = np.empty(len(time)), np.zeros(len(time))
    angle[0] = start
    for k, step in enumerate(np.diff(time)):
        rate[k] = np.clip((asked[k] - angle[k]) / step, -limit, limit)
        angle[k + 1] = angle[k] + rate[k] * step
    rate[-1] = rate[-2]
    return angle, rate
