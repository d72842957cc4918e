"""Feedback along a plan: finite-horizon LQR through Drake.

u = u₀(t) - K(t) (x - x₀(t)) - k₀(t). The plan's Hermite path is no exact flight
between its knots; k₀ is what corrects that. After the plan's end the regulator
goes on with its last values: the reference stands at the wire, and with the
article's final weights the last gain is small, so that the glider flies on
through the wire with its elevator almost at rest.
"""

from typing import Any

import numpy as np
from pydrake.systems.controllers import (
    FiniteHorizonLinearQuadraticRegulatorOptions,
    MakeFiniteHorizonLinearQuadraticRegulator,
)
from pydrake.systems.framework import System
from pydrake.systems.primitives import TrajectoryAffineSystem
from pydrake.trajectories import PiecewisePolynomial

from glider.control.tvlqr import (
    TrackingPolicy,
    TrackingWeights,
    check_plan,
    weight_matrix,
)
from glider.errors import expect
from glider.physics.model import GliderModel
from glider.planning.plan import Plan
from glider.systems.plant import GliderPlant

_SCHEME, _ACCURACY = "runge_kutta5", 1e-6
"""Scheme and accuracy of Drake's backward pass: gains to 1e-6 of their largest. The
default scheme, of order three, takes over twice the time to be as good."""

_TABLE = 441
"""Number of times that the gains of a policy are given at."""


def tracking_regulator(
    model: GliderModel, plan: Plan, weights: TrackingWeights | None = None
) -> System:
    """Computes the feedback along a plan by Drake, as a System.

    Input ports:
        plant_state (n): state of the glider, with the effects' own.

    Output ports:
        command (1): rate of the elevator [rad/s].

    Args:
        model: the glider that the plan is for.
        plan: what to follow.
        weights: of the feedback; None for the article's.

    Raises:
        InputError: the plan is for another glider.
    """
    regulator = MakeFiniteHorizonLinearQuadraticRegulator(
        **regulator_arguments(model, plan, weights)
    )
    regulator.set_name("regulator")
    return regulator


def regulator_arguments(
    model: GliderModel, plan: Plan, weights: TrackingWeights | None = None
) -> dict[str, Any]:
    """Arguments of Drake's finite-horizon LQR along a plan, of function or System."""
    check_plan(model, plan)
    plant = GliderPlant(model)
    weights = TrackingWeights() if weights is None else weights
    n = model.num_states
    options = FiniteHorizonLinearQuadraticRegulatorOptions()
    options.Qf = weight_matrix(weights.final, n)
    options.x0 = plan.state_trajectory
    options.u0 = plan.input_trajectory
    options.simulator_config.integration_scheme = _SCHEME
    options.simulator_config.accuracy = _ACCURACY
    options.input_port_index = plant.GetInputPort("elevator_rate").get_index()
    return {
        "system": plant,
        "context": plant.CreateDefaultContext(),
        "t0": 0.0,
        "tf": plan.state_trajectory.end_time(),
        "Q": weight_matrix(weights.state, n),
        "R": [weights.rate],
        "options": options,
    }


def policy_regulator(policy: TrackingPolicy) -> TrajectoryAffineSystem:
    """Returns a policy as a Drake System, in straight lines between 441 times.

    Input ports:
        u0 (n): state x that the policy measures.

    Output ports:
        y0 (1): rate of the elevator, offset - gain x [rad/s].

    Raises:
        InputError: the policy holds its commands, which this system does not.
    """
    expect(policy.period == 0.0, "the policy's period", policy.period, "0: no hold")
    times = np.linspace(0.0, policy.duration, _TABLE)
    offset, gain = policy.sample(times)

    def over_time(values: np.ndarray) -> PiecewisePolynomial:
        return PiecewisePolynomial.FirstOrderHold(times, list(values))

    zero = over_time(np.zeros((_TABLE, 1, 1)))
    return TrajectoryAffineSystem(  # One state that rests: Drake asks for it.
        A=zero,
        B=over_time(np.zeros((_TABLE, 1, gain.shape[1]))),
        f0=zero,
        C=zero,
        D=over_time(-gain[:, None, :]),
        y0=over_time(offset[:, None, None]),
    )
