"""Elevator and command of a flight, from servo logs as people have them.

The model is driven by rates. A commanded angle becomes the rate of an ideal servo that
goes there as fast as its limit lets it; an elevator that was only measured becomes its
own rate. What then cannot be seen of the servo is told.
"""

from typing import NamedTuple

import numpy as np
from scipy.signal import savgol_filter

from glider.campaign.importing.selection import Stream
from glider.campaign.importing.track import Track
from glider.campaign.logs import Campaign
from glider.errors import InputError
from glider.physics.actuator_replay import latest_command

_FASTEST = 99.0
"""Percentile of the measured rates that is taken for the servo's limit [%]."""


class Servo(NamedTuple):
    """Elevator and command at the rows of a flight."""

    elevator: np.ndarray  # (n,) [rad]
    command: np.ndarray  # (n,) [rad/s], held until the next row.
    told: str  # How they came about, where they were not logged so.


def make_servo(flight: Track, settings: Campaign, source: str) -> Servo | None:
    """Returns elevator and command of a flight; None where the elevator is fixed.

    Args:
        flight: with all logs on the clock of its poses.
        settings: what is known of the vehicle.
        source: the file of the mapping.

    Raises:
        InputError: what was logged does not tell what the elevator did.
    """
    logged = (flight.elevator, flight.rate_command, flight.angle_command)
    if settings.elevator != "servo":
        if any(stream is not None for stream in logged):
            raise InputError(
                f"{source}: vehicle: elevator is '{settings.elevator}', but columns of "
                "an elevator are mapped; one or the other is needed."
            )
        return None
    if flight.rate_command is not None and flight.angle_command is not None:
        raise InputError(
            f"{source}: columns: elevator_rate_command and elevator_angle_command are "
            "both mapped; the one that the servo was given is needed."
        )
    if flight.elevator is None and flight.angle_command is None:
        raise InputError(
            f"{source}: columns: no angle of the elevator is mapped; 'elevator' "
            "(measured) or 'elevator_angle_command' is needed, or 'vehicle: {elevator: "
            "fixed}' where the tail does not move."
        )
    measured = None
    if flight.elevator is not None:
        _check_covered(flight, flight.elevator, source)
        measured = np.interp(
            flight.time, flight.elevator.time, flight.elevator.values[:, 0]
        )
    if flight.rate_command is not None:
        assert measured is not None
        return Servo(measured, _hold(flight, flight.rate_command, source), "")
    if flight.angle_command is None:
        assert measured is not None
        told = (
            "no command is mapped: the elevator's own rate stands for it, so a lag or "
            "a delay of the servo cannot be found"
        )
        return Servo(measured, _rate_of(flight.time, measured), told)
    asked = _hold(flight, flight.angle_command, source)
    limit = settings.elevator_rate_limit or _measure_limit(flight, measured, source)
    start = asked[0] if measured is None else measured[0]
    angle, rate = _chase(flight.time, asked, float(start), limit)
    told = f"the commanded angle became rates of at most {limit:.3g} rad/s"
    if measured is None:
        told += (
            "; the elevator was not measured: the angle of an ideal servo stands for "
            "it, so a lag or a delay of the servo cannot be found"
        )
        return Servo(angle, rate, told)
    return Servo(measured, rate, told)


def _hold(flight: Track, stream: Stream, source: str) -> np.ndarray:
    """Returns the command that holds at each row (n,)."""
    _check_covered(flight, stream, source)
    index = np.maximum(latest_command(stream.time, flight.time), 0)
    return stream.values[index, 0]


def _check_covered(flight: Track, stream: Stream, source: str) -> None:
    """Refuses a log that does not last over the flight."""
    slack = 0.1  # Commands are held, and clocks start one after the other [s].
    late = stream.time[0] > flight.time[0] + slack
    if len(stream.time) < 2 or late or stream.time[-1] < flight.time[-1] - slack:
        raise InputError(
            f"{flight.path}: the elevator is logged from {stream.time[0]:.6g} to "
            f"{stream.time[-1]:.6g} s, and the flight is from {flight.time[0]:.6g} to "
            f"{flight.time[-1]:.6g} s; the same clock is needed, or 'clock: find' in "
            f"{source}."
        )


def _rate_of(time: np.ndarray, angle: np.ndarray) -> np.ndarray:
    """Returns the rates (n,) that, each held for a row, make an elevator's path."""
    smooth = savgol_filter(angle, 5, 2)
    rate = np.diff(smooth) / np.diff(time)
    return np.append(rate, rate[-1])


def _measure_limit(flight: Track, measured: np.ndarray | None, source: str) -> float:
    """Returns the fastest rate that the elevator was seen to turn with [rad/s]."""
    if measured is None:
        raise InputError(
            f"{source}: vehicle: elevator_rate_limit is missing; a commanded angle "
            "becomes rates only where it is known how fast the servo turns."
        )
    rates = np.abs(_rate_of(flight.time, measured))
    return max(float(np.percentile(rates, _FASTEST)), 0.1)


def _chase(
    time: np.ndarray, asked: np.ndarray, start: float, limit: float
) -> tuple[np.ndarray, np.ndarray]:
    """Returns angle and rate (n,) of a servo that chases what is asked at its limit."""
    angle, rate = np.empty(len(time)), np.zeros(len(time))
    angle[0] = start
    for k, step in enumerate(np.diff(time)):
        rate[k] = np.clip((asked[k] - angle[k]) / step, -limit, limit)
        angle[k + 1] = angle[k] + rate[k] * step
    rate[-1] = rate[-2]
    return angle, rate
