"""The servo: held command -> demanded rate -> elevator, in one law and two forms.

The servo turns its demanded angle ψ at the commanded rate u. It keeps its rate limit,
and slows down before a stop, which ψ approaches as exp(-t / STOPPING_TIME):
    ψ' = u, clipped to ± the rate limit and to [(low - ψ) / τ, (high - ψ) / τ].
So a ψ within the travel stays there. The elevator's angle φ follows ψ through the
actuators of `glider.physics.effects.signals`: a delay T, a lag and those of a user.

`limited_rate` is the law in state-space form, for integrators. A simulated glider
knows ψ by its states: `demanded_angle` of `glider.physics.chain`. `held_angle` and
`elevator_path` are its exact solution for held commands, from an angle within the
travel.
"""

import math
from typing import NamedTuple

import numpy as np

from glider.physics.formulas import exp, scalar

STOPPING_TIME = 0.005
"""Time constant of slowing down before a stop [s]. At 13 rad/s the servo does so
over the last 0.065 rad; at the 3.4 rad/s of the article's plan over 0.017 rad, and
that plan stays 0.3 rad away from its stops."""

_SHORTEST = 1e-9
"""Time constant below which a lag is none [s]."""


class Servo(NamedTuple):
    """Limits of a servo."""

    low: float  #: Stop of the trailing edge down [rad].
    high: float  #: Stop of the trailing edge up [rad].
    rate: float  #: Largest rate either way [rad/s].


NO_LIMITS = Servo(-math.inf, math.inf, math.inf)
"""A servo that follows every command."""


@scalar
def rate_bounds(angle, servo, hold):
    """Returns the least and the largest command that a servo follows for a time.

    Args:
        angle: ψ [rad].
        servo: its limits.
        hold: how long the command is held [s]; 0 for the bounds at this moment.
    """
    slowing = hold + STOPPING_TIME
    top = max(min((servo.high - angle) / slowing, servo.rate), -servo.rate)
    bottom = max((servo.low - angle) / slowing, -servo.rate)
    return min(bottom, top), top


@scalar
def limited_rate(command, angle, servo):
    """Returns the rate ψ' of a command [rad/s] at the demanded angle ψ [rad].

    It is a Lipschitz function of ψ, which integrators need. A servo beyond a stop
    returns. Takes floats and AutoDiffXd.
    """
    low, high = rate_bounds(angle, servo, 0.0)
    return min(max(command, low), high)


@scalar
def _held_rate(command, angle, servo):
    """Returns ψ' while a command is held [rad/s], and how long it stays so [s].

    After that time the servo slows down before its stop.
    """
    rate = limited_rate(command, angle, servo)
    if abs(rate) < 1e-200:  # The quotient would overflow.
        return rate, math.inf
    stop = servo.high if rate > 0.0 else servo.low
    return rate, max((stop - angle) / rate - STOPPING_TIME, 0.0)


@scalar
def _turned_angle(angle, rate, steady, time):
    """Returns ψ after a time [s]: a straight line, then an exponential to the stop."""
    if steady < time:
        slowing = (time - steady) / STOPPING_TIME
        time = steady + STOPPING_TIME * (1.0 - exp(-slowing))
    return angle + rate * time


@scalar
def held_angle(command, angle, servo, time):
    """Returns ψ after a command [rad/s] was held for a time [s], exactly."""
    angle = min(max(angle, servo.low), servo.high)
    rate, steady = _held_rate(command, angle, servo)
    return _turned_angle(angle, rate, steady, time)


def elevator_path(
    switch_times: np.ndarray,
    commands: np.ndarray,
    query: np.ndarray,
    servo: Servo = NO_LIMITS,
    *,
    delay: float = 0.0,
    time_constant: float = 0.0,
    start: float = 0.0,
) -> np.ndarray:
    """Returns the elevator's angle φ at some times, exactly [rad].

    The servo rests before the first command. A lag τ turns ψ' into the elevator's
    rate, τ r' = ψ' - r, so that φ = ψ - τ r.

    Args:
        switch_times: (k,) when each command begins [s], increasing.
        commands: (k,) elevator rates, each held until the next [rad/s].
        query: (m,) times, increasing or not [s].
        servo: its limits.
        delay: T, between a command and its action [s].
        time_constant: τ [s]; 0 for none.
        start: angle before the first command [rad]; clipped into the travel.
    """
    begin = switch_times + delay
    spans = np.diff(begin)
    start = min(max(start, servo.low), servo.high)
    # Of each command: the angle where it begins, the rate, and how long that is steady.
    rates = np.clip(commands, -servo.rate, servo.rate)
    turns = np.cumsum(rates[:-1] * spans)
    angles = start + np.append(0.0, turns)
    steady_times = np.full(len(rates), np.inf)
    # Sums are right until a command meets a stop. The last command has no end.
    ahead = angles[1:] + STOPPING_TIME * rates[:-1]
    meets_stop = (ahead < servo.low) | (ahead > servo.high)
    first = int(np.argmax(np.append(meets_stop, True)))
    angle = float(angles[first])
    left = [*spans[first:].tolist(), 0.0]
    for k, span in enumerate(left, first):
        rate, steady = _held_rate(float(commands[k]), angle, servo)
        angles[k] = angle
        rates[k] = rate
        steady_times[k] = steady
        angle = float(_turned_angle(angle, rate, steady, span))
    index = np.searchsorted(begin, query, side="right") - 1
    is_before = index < 0
    index = np.maximum(index, 0)
    since = np.maximum(query - begin[index], 0.0)
    steady = np.minimum(steady_times[index], since)
    slowing = since - steady
    slowed = -np.expm1(-slowing / STOPPING_TIME)
    turning = steady + STOPPING_TIME * slowed
    path = angles[index] + rates[index] * turning
    if time_constant > _SHORTEST:
        until = np.minimum(steady_times[:-1], spans)
        gained = _lagged(rates[:-1], until, spans - until, time_constant)
        kept = np.exp(-spans / time_constant)
        # The elevator's own rate where each command begins.
        lagged = [0.0]
        shares = zip(gained.tolist(), kept.tolist(), strict=True)
        for gain, share in shares:
            lagged.append(lagged[-1] * share + gain)
        fading = np.exp(-since / time_constant)
        own = np.array(lagged)[index] * fading
        own += _lagged(rates[index], steady, slowing, time_constant)
        path -= time_constant * own
    return np.where(is_before, start, path)


def _lagged(
    rate: np.ndarray, steady: np.ndarray, slowing: np.ndarray, time_constant: float
) -> np.ndarray:
    """Returns the rate behind a lag at rest [rad/s], where ψ' was steady, then slowed.

    Behind a steady time s and a slowing time t, it is with T the stopping time
        rate ((1 - exp(-s / τ)) exp(-t / τ) + (exp(-t / T) - exp(-t / τ)) T / (T - τ)).
    """
    slow = max(time_constant, STOPPING_TIME)
    quick = min(time_constant, STOPPING_TIME)
    gap = 1.0 / quick - 1.0 / slow
    apart = np.maximum(slowing * gap, 1e-12)
    faded = np.exp(-slowing / time_constant)
    of_steady = -np.expm1(-steady / time_constant) * faded
    # (exp(-t / T) - exp(-t / τ)) T / (T - τ), also where both are equal.
    grown = slowing / time_constant * np.exp(-slowing / slow)
    of_slowing = -np.expm1(-apart) / apart * grown
    return rate * (of_steady + of_slowing)
