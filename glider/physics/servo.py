"""The rate of a servo for a command, with its rate limit and stops.

One formula for the diagram's ElevatorServo, the compiled closed loop and the planners
that hold a command for a step.
"""

import math
from typing import NamedTuple

import numpy as np

from glider.physics.formulas import scalar

STOPPING_TIME = 0.005
"""Time constant τ of slowing down before a stop [s]. At 13 rad/s the servo does so
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
def rate_bounds(elevator, servo, time):
    """Returns the least and the largest rate that keep a servo's limits [rad/s].

    The rate limit, and [(low - φ) / T, (high - φ) / T]: what takes the elevator φ to
    a stop in the time T [s]: STOPPING_TIME, or how long a command is held. An elevator
    beyond a stop returns.
    """
    top = max(min((servo.high - elevator) / time, servo.rate), -servo.rate)
    return min(max((servo.low - elevator) / time, -servo.rate), top), top


@scalar
def limited_rate(command, elevator, servo):
    """Returns the elevator rate that a servo makes of a command [rad/s].

    The command, clipped to `rate_bounds` over STOPPING_TIME. So the elevator φ [rad]
    comes to a stop as exp(-t / τ), and the rate is a Lipschitz function of φ, which
    integrators and the compiled loop need. Takes floats and AutoDiffXd.
    """
    low, high = rate_bounds(elevator, servo, STOPPING_TIME)
    return min(max(command, low), high)


def limited_rates(
    commands: np.ndarray, elevators: np.ndarray, servo: Servo
) -> np.ndarray:
    """Returns `limited_rate` of commands (...) [rad/s] at elevators (...) [rad]."""
    top = np.clip((servo.high - elevators) / STOPPING_TIME, -servo.rate, servo.rate)
    low = np.maximum((servo.low - elevators) / STOPPING_TIME, -servo.rate)
    return np.clip(commands, np.minimum(low, top), top)
