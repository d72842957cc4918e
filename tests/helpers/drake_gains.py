"""Drake's finite-horizon LQR along a plan as numbers, to compare with."""

import numpy as np
from pydrake.systems.controllers import (
    FiniteHorizonLinearQuadraticRegulator,
    FiniteHorizonLinearQuadraticRegulatorResult,
)

from glider.control.tvlqr import TrackingPolicy, TrackingWeights, aligned_count
from glider.physics.model import GliderModel
from glider.planning.plan import Plan
from glider.systems.regulator import regulator_arguments

TABLE_STEP = 0.001
"""Time between the rows of a table made of Drake's gains [s]."""


def tracking_gains(
    model: GliderModel, plan: Plan, weights: TrackingWeights | None = None
) -> FiniteHorizonLinearQuadraticRegulatorResult:
    """Computes the feedback along a plan by Drake.

    Returns:
        The trajectories x0, u0, K, k0 and the cost-to-go x̃ᵀ S x̃ + 2 x̃ᵀ sx + s0.
    """
    return FiniteHorizonLinearQuadraticRegulator(
        **regulator_arguments(model, plan, weights)
    )


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
