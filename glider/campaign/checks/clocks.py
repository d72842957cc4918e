"""Do clocks run at the rates that the campaign has, and do elevators follow commands?

A clock that runs 5 % slow makes gravity and every force 10 % less: other effects
explain that well. Only the rates of rows (the cameras') and commands show it.

The rate of the elevator is compared with the commands, over delays of up to 0.35 s and
with either sign (a turned sign is traced later). A delay, a lag or stops of the servo
lower the correlation; another clock or another flight's commands remove it.
"""

import math
from collections.abc import Mapping, Sequence

import numpy as np

from glider.campaign.checks.elevators import (
    Elevator,
    mean_rates,
    measure_elevators,
    travel_of,
)
from glider.campaign.checks.masks import Masks
from glider.campaign.logs import Campaign
from glider.errors import InputError
from glider.physics.servo import NO_LIMITS, STOPPING_TIME, Servo

_DELAYS = np.arange(-0.02, 0.355, 0.01)
"""Delays of the elevator that are tried [s]: command_delay and servo_lag are < 0.3."""
_SHIFTS = np.arange(-1.5, 1.51, 0.01)  # Between clocks, for the message [s].
_BOTH_WAYS = np.arange(-0.35, 0.3525, 0.005)  # Delays, to find which comes first [s].
_LEADS = 0.015
"""Lead above which an elevator moves before its commands [s]: no servo does. Measured:
-0.025 to 0.005 in 20 campaigns: half a row, as a command is held until the next."""
_AS_GOOD = 2.0
"""Ratio of what two signs leave unexplained below which either may be the servo's: 1.0
under feedback where a slow servo swings, 9 and more in 20 campaigns without it."""
_FOLLOWS = 0.4
"""Correlation of rates below which an elevator does not follow. Measured: 0.96 and more
for a servo without lag, 0.89 and 0.75 with lags of 0.1 and 0.3 s; 0.24 at most for
commands of another flight (20 campaigns, the best of all delays)."""
_MOVES = 0.03  # Least travel of an elevator that moves in any flight [rad].
_MIN_RATES = 15  # Rates that a correlation is of, at least: fewer show nothing.
_FOLLOWS_ALONE = 0.6
"""Share of the campaign's correlation that a flight alone must reach at its delay.
Measured: 0.93 at least for 600 flights; nine in ten with commands of another flight
fall below, as few rates correlate by chance."""
_WIDE = 0.15  # Travel above which one flight alone can be judged [rad].
_BEYOND = 0.15  # Angle beyond its limits that no zero of an elevator explains [rad].
NOISES = 6.0  # Noise beyond its limits above which an elevator passes them [-].
SCALE = "Scale:"
"""How warnings begin that make findings doubtful."""

_OFF = 0.02
"""Share by which a rate may be off: times are rounded, commands show a row later."""
_FEWEST = 30  # Intervals that a rate is taken from, at least.
_MOST_TICKS = 3  # Ticks in an interval: beyond, a rate that is off has lost count.


def check_clocks(campaign: Campaign, elevators: Sequence[Elevator]) -> None:
    """Refuses an elevator that does not follow its commands, or precedes them."""
    if not elevators:
        return
    commanded = max(elevator.ordered_travel for elevator in elevators)
    moved = max(travel_of(elevator.angle) for elevator in elevators)
    if commanded < _MOVES and moved < _MOVES:
        return
    if min(moved, commanded) < _MOVES:
        raise InputError(
            f"{campaign.path}: column 'elevator' moves by {moved:.2g} rad at most, and "
            f"'elevator_rate_command' would move it by {commanded:.2g} rad; expected "
            "its measured angle, and the commands that were given."
        )
    servo = campaign.limits
    correlation, _ = calc_correlation(elevators, servo=servo)
    follows = abs(correlation)
    if follows < _FOLLOWS:
        shifted, shift = calc_correlation(elevators, _SHIFTS)
        hint = ""
        if abs(shifted) > 2 * _FOLLOWS:
            hint = f"; shifted by {shift:.2f} s they do"
        raise InputError(
            f"{campaign.path}: column 'elevator' does not follow "
            f"'elevator_rate_command' (their rates correlate by {follows:.2f} at any "
            f"delay up to {_DELAYS[-1]:.2g} s{hint}); expected both on the clock of "
            "'time'."
        )
    # Under feedback a slow servo swings: half a period before, it turns the other way,
    # and either sign may be the servo's.
    unexplained = []
    leads = []
    for sign in (1.0, -1.0):
        own, delay = calc_correlation(elevators, _BOTH_WAYS, sign, servo)
        unexplained.append(1.0 - max(sign * own, 0.0) ** 2)
        leads.append(-delay)
    is_as_good = np.array(unexplained) < _AS_GOOD * min(unexplained)
    lead = min(np.array(leads)[is_as_good], default=0.0)
    if lead > _LEADS:
        raise InputError(
            f"{campaign.path}: column 'elevator' moves {lead:.3f} s before "
            "'elevator_rate_command'; expected both on the clock of 'time'."
        )


def claim_scale(
    campaign: Campaign,
    ratio: float,
    least: float,
    parts: tuple[float, float],
    words: str,
) -> tuple[str, ...]:
    """Warns of a ratio that is off by one of two parts, and refuses the other."""
    if abs(math.log(ratio)) < least or abs(ratio - 1.0) < parts[0]:
        return ()
    if abs(ratio - 1.0) > parts[1]:
        raise InputError(f"{campaign.path}: {words}.")
    return (f"{SCALE} {words}.",)


def check_rates(campaign: Campaign) -> tuple[str, ...]:
    """Warns where rows do not come at the campaign's pose_rate.

    Refuses commands that are off by the same share: the clock of the log is wrong.
    """
    if campaign.pose_rate is None:
        return ()
    rows = _pace([flight.time for flight in campaign.flights], campaign.pose_rate)
    if abs(rows - 1.0) < _OFF:
        return ()
    words = (
        f"rows come at {campaign.pose_rate / rows:.4g} Hz where field 'pose_rate' "
        f"says {campaign.pose_rate:.4g}"
    )
    rate = campaign.command_rate
    if rate is not None and campaign.elevator == "servo":
        begins = []
        for flight in campaign.flights:
            is_new = np.diff(np.asarray(flight.command)) != 0.0
            begins.append(flight.time[1:][is_new])
        commands = _pace(begins, rate)
        if abs(commands - rows) < _OFF:
            raise InputError(
                f"{campaign.path}: {words}, and commands at {rate / commands:.4g} Hz "
                f"where field 'command_rate' says {rate:.4g}; expected column 'time' "
                f"in seconds (it runs {rows:.3g} times too fast), or the true rates."
            )
    return (f"The {words}: is the clock of 'time' right?",)


def _pace(clocks: Sequence[np.ndarray], rate: float) -> float:
    """How much longer ticks last than at a rate [Hz]; 1 where few are seen."""
    steps = np.concatenate([np.diff(clock) for clock in clocks]) * rate
    ticks = np.round(steps)
    counted = (ticks >= 1) & (ticks <= _MOST_TICKS)
    if np.sum(counted) < max(_FEWEST, 0.8 * len(steps)):
        return 1.0
    return float(np.sum(steps[counted]) / np.sum(ticks[counted]))


def check_limits(campaign: Campaign, masks: Mapping[str, Masks]) -> None:
    """Refuses limits that an elevator passes by far, and turned ones by much less."""
    if campaign.elevator != "servo" or campaign.elevator_limits is None:
        return
    lowest, highest = np.percentile(_angles(campaign, masks), [1.0, 99.0])
    lower, upper = campaign.elevator_limits
    beyond = max(lower - lowest, highest - upper)
    beyond_turned = max(-upper - lowest, highest + lower)
    if beyond > _BEYOND and beyond_turned < 0.5 * beyond:
        raise InputError(
            f"{campaign.path}: column 'elevator' goes from {lowest:.3g} to "
            f"{highest:.3g} rad and field 'elevator_limits' is [{lower:g}, {upper:g}]; "
            "expected the travel that the servo has (trailing edge down, up)."
        )


def find_limits(campaign: Campaign, masks: Mapping[str, Masks], noise: float) -> Servo:
    """Returns the servo's limits: its stops are farther out if the elevator was."""
    low, high, rate = campaign.limits
    angles = _angles(campaign, masks)
    lowest = float(np.min(angles))
    highest = float(np.max(angles))
    if lowest < low - NOISES * noise:
        low = lowest
    if highest > high + NOISES * noise:
        high = highest
    return Servo(low, high, rate)


def _angles(campaign: Campaign, masks: Mapping[str, Masks]) -> np.ndarray:
    """All angles (k,) of the elevator that are not masked [rad]."""
    elevators = measure_elevators(campaign, masks)
    return np.concatenate([elevator.angle for elevator in elevators])


def find_unrelated(elevators: Sequence[Elevator]) -> tuple[str, ...]:
    """Names of flights whose elevator does not follow, at the delay of the others."""
    usual, delay = calc_correlation(elevators)
    near = delay + np.array([-0.02, -0.01, 0.0, 0.01, 0.02])
    least = _FOLLOWS_ALONE * abs(usual)
    unrelated = []
    for elevator in elevators:
        if elevator.ordered_travel > _WIDE:
            own, _ = calc_correlation([elevator], near)
            if abs(own) < least:
                unrelated.append(elevator.name)
    return tuple(unrelated)


def calc_correlation(
    elevators: Sequence[Elevator],
    delays: np.ndarray = _DELAYS,
    sign: float = 0.0,
    servo: Servo = NO_LIMITS,
) -> tuple[float, float]:
    """Best correlation of elevators with commands, -1 to 1, and its delay [s].

    With a `sign`, of 1 or -1, the best of that sign. Where an elevator slows down
    before a stop of the servo, it follows no command. Both are nan where too few rates
    are known to judge: no comparison with them holds.
    """
    sums = np.zeros((4, len(delays)))
    for elevator in elevators:
        if len(elevator.time) < 2:
            continue
        turned, ordered = _changes(elevator, delays, servo)
        is_known = np.isfinite(ordered)
        ordered = np.where(is_known, ordered, 0.0)
        power = np.sum(ordered**2, axis=1)
        sums += [is_known.sum(axis=1), is_known @ turned**2, power, ordered @ turned]
    count, turned, ordered, together = sums
    correlation = together / np.sqrt(np.maximum(turned * ordered, 1e-30))
    rank = sign * correlation if sign else np.abs(correlation)
    best = int(np.argmax(np.where(count < _MIN_RATES, -np.inf, rank)))
    if count[best] < _MIN_RATES:
        return math.nan, math.nan
    return float(correlation[best]), float(delays[best])


def follow_sign(elevators: Sequence[Elevator]) -> int:
    """-1 where elevators clearly turn against their commands, else +1."""
    return -1 if calc_correlation(elevators)[0] < -_FOLLOWS else 1


def _changes(
    elevator: Elevator, delays: np.ndarray, servo: Servo
) -> tuple[np.ndarray, np.ndarray]:
    """Changes (k,) of the elevator and (delays, k) by earlier commands [rad].

    Those by commands are nan near a stop, and where commands are not known.
    """
    time = elevator.time
    ends, turned = mean_rates(time, elevator.angle)
    path = elevator.follow(ends - delays[:, None, None])
    ordered = path[:, 1] - path[:, 0]
    first, last = elevator.command_time[[0, -1]]
    begin, end = ends
    late = delays[:, None]
    ordered[(begin - late < first) | (end - late > last)] = np.nan
    slowing = STOPPING_TIME * servo.rate if math.isfinite(servo.rate) else 0.0
    shown = np.interp(ends, time, elevator.angle)
    is_near = (shown < servo.low + slowing) | (shown > servo.high - slowing)
    ordered[:, is_near.any(axis=0)] = np.nan
    return turned, ordered
