"""The servo: held command -> demanded rate -> elevator, in one law and two forms.

The servo turns its demanded angle ψ at the commanded rate u. It keeps its rate limit,
and slows down before a stop, which ψ approaches as exp(-t / STOPPING_TIME):
    ψ' = u, clipped to ± the rate limit and to [(low - ψ) / τ, (high - ψ) / τ].
So a ψ within the travel stays there. The elevator's angle φ follows ψ through the
actuators of `glider.physics.effects.signals`: a delay T, a lag and those of a user.

`limited_rate` is the law in state-space form, for integrators. A simulated glider
knows ψ by its states: `demanded_angle` of `glider.physics.chain`. `held_angle` is its
exact solution for a held command, from an angle within the travel;
`elevator_path` of `glider.compiled.actuators` is that of a tape of commands.
"""

import math
from typing import NamedTuple

from glider.physics.formulas import exp, scalar

STOPPING_TIME = 0.005
"""Time constant of slowing down before a stop [s]. At 13 rad/s the servo does so
over the last 0.065 rad; at the 3.4 rad/s of the article's plan over 0.017 rad, and
that plan stays 0.3 rad away from its stops."""


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
def held_rate(command, angle, servo):
    """Returns ψ' while a command is held [rad/s], and how long it stays so [s].

    After that time the servo slows down before its stop.
    """
    rate = limited_rate(command, angle, servo)
    if abs(rate) < 1e-200:  # The quotient would overflow.
        return rate, math.inf
    stop = servo.high if rate > 0.0 else servo.low
    return rate, max((stop - angle) / rate - STOPPING_TIME, 0.0)


@scalar
def turned_angle(angle, rate, steady, time):
    """Returns ψ after a time [s]: a straight line, then an exponential to the stop."""
    if steady < time:
        slowing = (time - steady) / STOPPING_TIME
        time = steady + STOPPING_TIME * (1.0 - exp(-slowing))
    return angle + rate * time


@scalar
def held_angle(command, angle, servo, time):
    """Returns ψ after a command [rad/s] was held for a time [s], exactly."""
    angle = min(max(angle, servo.low), servo.high)
    rate, steady = held_rate(command, angle, servo)
    return turned_angle(angle, rate, steady, time)


@scalar
def lagged_rate(before, rate, steady, time, lag):
    """Returns the elevator's rate r after a time [s] behind a lag: τ r' = ψ' - r.

    ψ' is steady for a time s, then fades with the stopping time T for a time t, so that
        r = rate ((1 - exp(-s / τ)) exp(-t / τ)
                  + (exp(-t / T) - exp(-t / τ)) T / (T - τ)) + before exp(-(s + t) / τ).

    Args:
        before: r where the command begins [rad/s].
        rate: ψ' as the command begins [rad/s].
        steady: how long it stays so [s].
        time: since the command began [s].
        lag: τ [s], positive.
    """
    slowing = max(time - steady, 0.0)
    turning = time - slowing
    slow = max(lag, STOPPING_TIME)
    quick = min(lag, STOPPING_TIME)
    apart = max(slowing * (1.0 / quick - 1.0 / slow), 1e-12)
    of_steady = -math.expm1(-turning / lag) * exp(-slowing / lag)
    # (exp(-t / T) - exp(-t / τ)) T / (T - τ), also where both are equal.
    grown = slowing / lag * exp(-slowing / slow)
    of_slowing = -math.expm1(-apart) / apart * grown
    return before * exp(-time / lag) + rate * (of_steady + of_slowing)
