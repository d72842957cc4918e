"""The travel of an elevator over that of its commands.

An elevator in another unit, or behind a gear that is not known, turns all commands into
other forces. Its gain is fitted beside a delay and a lag, so that a slow servo keeps
its gain; limits of a servo may be an excuse for one that is off.
"""

import math
from collections.abc import Sequence

import numpy as np

from glider.campaign.checks.rates import claim_scale
from glider.campaign.checks.servo import (
    WINDOW,
    Elevator,
    LateServo,
    are_still,
    calc_correlation,
    windows_of,
)
from glider.campaign.checks.servo_forms import LEAST_EVIDENCE, Fit, fit_servo
from glider.campaign.logs import CLOCK_STD, Campaign
from glider.physics.servo import NO_LIMITS, Servo

_FEW = 20  # Flights that show a gain, about.
_LONGEST_LAG = 0.36  # Lag above which the gain of a servo is unknown [s].
_TRAVEL = (0.06, 0.2)
"""Share by which the travel may be off; calibrated by bench_travel."""
_SURELY = 5.0  # Standard errors of the gain that must be in it (bench_travel).
_FEWEST_ROWS = 8  # Of a flight that shows a gain.
_SCATTER = 0.065
"""Standard deviation of the gain of one flight, as logs show commands a row late or not
[-]: measured by bench_travel."""


def check_travel(campaign: Campaign, elevators: Sequence[Elevator]) -> tuple[str, ...]:
    """Warns of an elevator that turns farther or less than commanded, or refuses it.

    One that never turns may be a fixed tail, or a log that was forgotten.

    Raises:
        InputError: the travel is off by more than the second share of _TRAVEL.
    """
    if campaign.elevator == "servo" and are_still(elevators):
        return (
            "The logged 'elevator' does not move in any flight, so that no effect of "
            "the servo or the elevator can show; if it did move, its effect is "
            "attributed to others. Log its angle, or, of a tail that does not move, "
            "set 'elevator: fixed' under 'vehicle:' in campaign.yaml.",
        )
    gain, error = _calc_travel(elevators, campaign.limits, campaign.servo.command_std)
    words = (
        f"the elevator turns {gain:.3g} times as far as commanded: expected one scale "
        "of 'elevator' and its command ('units:', or the servo's gearing as a gain)"
    )
    gain = max(gain, 1e-9)
    return claim_scale(campaign, gain, _SURELY * error / gain, _TRAVEL, words)


def _calc_travel(
    elevators: Sequence[Elevator],
    limits: Servo = NO_LIMITS,
    command_std: float = CLOCK_STD,
) -> tuple[float, float]:
    """Returns measured over commanded travel without its sign, and its standard error.

    The gain is fitted without limits first: those of commands in another unit are
    others. The specified limits, and those that elevators reach, excuse a gain that is
    not one, if they fit clearly better. The error is what flights scatter by; it is
    infinite if the lag is too long.
    """
    shown = [elevator for elevator in elevators if len(elevator.rows) > _FEWEST_ROWS]
    if not shown:
        return 0.0, math.inf
    few = shown[:: max(1, len(shown) // _FEW)]
    _, delay = calc_correlation(few)
    late = max(0.0, delay)  # Not nan.

    def fit_gain(limits: Servo) -> Fit:
        return fit_servo(few, LateServo(*limits, late), command_std, ("gain",))

    best = fit_gain(NO_LIMITS)
    off = _calc_error(best)
    if off >= _TRAVEL[0]:  # Else it needs no excuse.
        least = best.likelihood + LEAST_EVIDENCE
        for others in (limits, _reached(few)):
            excuse = fit_gain(others)
            if _calc_error(excuse) < off and excuse.likelihood > least:
                best = excuse
                least = excuse.likelihood

    gain = abs(best.servo.gain)
    if best.servo.lag > _LONGEST_LAG and gain <= 1.0:
        return gain, math.inf
    return gain, _SCATTER / math.sqrt(len(few))


def _calc_error(fit: Fit) -> float:
    """Returns by how much the gain of a servo, without its sign, is off from one."""
    return abs(abs(fit.servo.gain) - 1.0)


def _reached(elevators: Sequence[Elevator]) -> Servo:
    """Returns limits that elevators reach: where they end, and how fast they turn."""
    angles = np.concatenate([each.angle for each in elevators])
    changes = []
    for each in elevators:
        _, (begin, end) = windows_of(each)
        changes.append(end - begin)
    fastest = np.abs(np.concatenate(changes)).max() / WINDOW
    return Servo(angles.min(), angles.max(), fastest)
