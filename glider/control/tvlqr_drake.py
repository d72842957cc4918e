"""Feedback along a plan: finite-horizon LQR through Drake.

u = u₀(t) - K(t) (x - x₀(t)) - k₀(t). The plan's Hermite path is no exact flight
between its knots; k₀ is what corrects that. After the plan's end the regulator
goes on with its last values: the reference stands at the wire, and with the
article's final weights the last gain is small, so that the glider flies on
through the wire with its elevator almost at rest.
"""

import numpy as np
from pydrake.systems.controllers import (
    FiniteHorizonLinearQuadraticRegulator,
    FiniteHorizonLinearQuadraticRegulatorOptions,
    FiniteHorizonLinearQuadraticRegulatorResult,
    MakeFiniteHorizonLinearQuadraticRegulator,
)
from pydrake.systems.framework import System

from glider.control.policy import (
    TrackingPolicy,
    TrackingWeights,
    aligned_count,
    check_plan,
    weight_matrix,
)
from glider.physics.model import GliderModel
from glider.planning.plan import Plan
from glider.systems.plant import GliderPlant

SCHEME, ACCURACY = "runge_kutta5", 1e-6
"""Scheme and accuracy of Drake's backward pass: gains to 1e-6 of their largest. The
default scheme, of order three, takes over twice the time to be as good."""

TABLE_STEP = 0.001
"""Time between the rows of a table made of Drake's gains [s]."""


def tracking_gains(
    model: GliderModel, plan: Plan, weights: TrackingWeights | None = None
) -> FiniteHorizonLinearQuadraticRegulatorResult:
    """Computes the feedback along a plan by Drake.

    Args:
        model: the glider that the plan is for.
        plan: what to follow.
        weights: of the feedback; None for the article's.

    Returns:
        The trajectories x0, u0, K, k0 and the cost-to-go
        x̃ᵀ S x̃ + 2 x̃ᵀ sx + s0, which certificates start from.

    Raises:
        InputError: the plan is for another glider.
    """
    return FiniteHorizonLinearQuadraticRegulator(**_arguments(model, plan, weights))


def tracking_regulator(
    model: GliderModel, plan: Plan, weights: TrackingWeights | None = None
) -> System:
    """Makes the System of `tracking_gains`.

    plant_state -> [ regulator ] -> command

    It runs Drake's pass again, and a System fits into one Diagram only.
    """
    regulator = MakeFiniteHorizonLinearQuadraticRegulator(
        **_arguments(model, plan, weights)
    )
    regulator.set_name("regulator")
    return regulator


def policy_of(
    result: FiniteHorizonLinearQuadraticRegulatorResult,
    plan: Plan,
    step: float = TABLE_STEP,
) -> TrackingPolicy:
    """Returns Drake's gains as a policy, which `glider.simulation.fly` takes.

    Args:
        result: of `tracking_gains`.
        plan: that it was made for.
        step: longest step between rows [s].
    """
    times = np.linspace(0.0, plan.duration, aligned_count(plan, step) + 1)

    def table(trajectory):
        return np.array([trajectory.value(t) for t in times])

    return TrackingPolicy(
        plan=plan,
        times=times,
        gains=table(result.K)[:, 0],
        corrections=table(result.k0)[:, 0, 0],
        cost=table(result.S),
        cost_slope=table(result.sx)[:, :, 0],
    )


def _arguments(model: GliderModel, plan: Plan, weights: TrackingWeights | None) -> dict:
    check_plan(model, plan)
    plant = GliderPlant(model)
    weights = TrackingWeights() if weights is None else weights
    n = model.num_states
    options = FiniteHorizonLinearQuadraticRegulatorOptions()
    options.Qf = weight_matrix(weights.final, n)
    options.x0 = plan.state_trajectory
    options.u0 = plan.input_trajectory
    options.simulator_config.integration_scheme = SCHEME
    options.simulator_config.accuracy = ACCURACY
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
