"""The nominal flight of a funnel: the feedback's own flight along its plan.

A plan by collocation is not an exact flight between its knots, so the deviation from
it would never settle at zero. The nominal is what the glider flies under the plan's
feedback from the plan's launch: a flight, up to the error of fine Runge-Kutta steps.
Between its times x₀ is the cubic Hermite polynomial through states and slopes; u₀ and
the gains are straight lines. That is how it is flown, checked and proven.
"""

import dataclasses

import numpy as np
from scipy.interpolate import CubicHermiteSpline

from glider.control.policy import TrackingPolicy, aligned_count, check_plan
from glider.errors import InputError
from glider.physics.model import GliderModel
from glider.physics.servo import limited_rate
from glider.physics.state import ELEVATOR
from glider.simulation.fly import fly

FLIGHT_STEP = 0.0005
"""Longest step of the integration [s]."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Nominal:
    """A flight of a glider under u = u₀ - K (x - x₀), at some times.

    The names of the arrays are keys in a funnel's file.

    Attributes:
        model: glider that flies.
        state_names: names of the n states: STATE_NAMES, then the effects' own.
        times: times (T,) from 0 [s].
        states: states x₀ (T, n).
        inputs: elevator rates u₀ (T,) [rad/s].
        gains: gains K (T, n).
    """

    model: GliderModel
    state_names: tuple[str, ...]
    times: np.ndarray
    states: np.ndarray
    inputs: np.ndarray
    gains: np.ndarray


ARRAYS = ("times", "states", "inputs", "gains")
"""Names of the arrays of a nominal, one entry a time."""


def make_nominal(model: GliderModel, policy: TrackingPolicy, step: float) -> Nominal:
    """Flies the feedback from its plan's launch.

    Args:
        model: the glider that the plan is for.
        step: longest step between the times [s].

    Raises:
        InputError: the plan is for another glider, the flight needs its servo at a
            limit, or the glider's dynamics vary with time.
    """
    plan = policy.plan
    check_plan(model, plan)
    if model.is_time_varying:
        raise InputError("A funnel needs a glider whose dynamics do not vary in time.")
    count = aligned_count(plan, step)
    fine = aligned_count(plan, min(FLIGHT_STEP, plan.duration / count))
    fine = count * -(-fine // count)
    flight = fly(
        model,
        policy,
        plan.states[:1],
        step=plan.duration / fine * (1.0 + 1e-9),
        after=0.0,
        keep_paths=True,
    )
    assert flight.paths is not None
    states = flight.paths[0][:: fine // count]
    times = np.linspace(0.0, plan.duration, count + 1)
    offset, gains = policy.sample(times)
    inputs = offset - np.sum(gains * states, axis=1)
    servo = model.parameters.servo
    for u, x in zip(inputs, states, strict=True):
        if limited_rate(u, x[ELEVATOR], servo) != u:
            raise InputError("The plan needs its servo at a limit: no funnel about it.")
    return Nominal(
        model=model,
        state_names=model.state_names,
        times=times,
        states=states,
        inputs=inputs,
        gains=gains,
    )


def nominal_slopes(nominal: Nominal) -> np.ndarray:
    """Returns ẋ₀ (T, n) by the dynamics."""
    x = list(nominal.states.T)
    rates = closed_loop_rates(nominal.model, x, nominal.gains.T, x, nominal.inputs)
    return np.array([np.broadcast_to(rate, len(nominal.times)) for rate in rates]).T


def nominal_path(nominal: Nominal) -> CubicHermiteSpline:
    """Returns x₀ as a function of time."""
    return CubicHermiteSpline(nominal.times, nominal.states, nominal_slopes(nominal))


def nominal_between(nominal: Nominal, share: float) -> Nominal:
    """Returns the flight at one point of each interval, (T - 1) times.

    Args:
        share: of an interval, where the point is; from 0 to 1.
    """
    times = nominal.times[:-1] + share * np.diff(nominal.times)
    return dataclasses.replace(
        nominal,
        times=times,
        states=nominal_path(nominal)(times),
        inputs=_between(nominal.inputs, share),
        gains=_between(nominal.gains, share),
    )


def _between(values, share):
    return (1.0 - share) * values[:-1] + share * values[1:]


def open_loop_rates(model, states, command, theta=None):
    """Returns ẋ for any kind of number, without the servo limits.

    Args:
        states: n numbers x.
        command: u, a number [rad/s].
        theta: the numbers of a glider that deviates from it; None for its own.
    """
    theta = model.numbers if theta is None else theta
    return model.chain.derivatives(0.0, states, command, 0.0, 0.0, theta)


def closed_loop_rates(model, states, gains, x0, u0, theta=None):
    """Returns ẋ of the closed loop for any kind of number, without the servo limits.

    Args:
        states: n numbers, jets or arrays x.
        gains: n numbers or arrays K.
        x0: n numbers or arrays x₀.
        u0: u₀, a number or an array.
    """
    command = u0
    for gain, x, center in zip(gains, states, x0, strict=True):
        command = command - gain * (x - center)
    return open_loop_rates(model, states, command, theta)
