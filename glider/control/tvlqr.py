"""The tracking feedback by compiled code, where many are needed."""

from typing import Any

import numpy as np

from glider.compiled.kernel import compiled
from glider.control.policy import (
    TrackingPolicy,
    TrackingWeights,
    aligned_count,
    check_plan,
    sample_plan,
    weight_matrix,
)
from glider.physics.parameters import parameter_vector
from glider.planning.plan import Plan

STEP = 0.003
"""Longest step of the pass [s]: gains to about 1e-7 of their largest."""


def compiled_policy(
    plant: Any,
    plan: Plan,
    weights: TrackingWeights | None = None,
    step: float = STEP,
) -> TrackingPolicy:
    """Computes a tracking feedback as `glider.control.tvlqr_drake.tracking_gains` does.

    Jacobians along the plan by complex steps, then one Runge-Kutta pass of the
    Riccati equations on a fixed grid (`glider.compiled.riccati`).

    Args:
        plant: the GliderPlant that the plan is for.
        plan: what to follow.
        weights: of the feedback; None for the article's.
        step: longest step of the pass [s].

    Raises:
        InputError: the plan is for another plant.
    """
    check_plan(plant, plan)
    weights = TrackingWeights() if weights is None else weights
    n, count = len(plant.state_names), aligned_count(plan, step)
    times = np.linspace(0.0, plan.duration, 2 * count + 1)
    gains, corrections = np.empty((count + 1, n)), np.empty(count + 1)
    cost = np.empty((count + 1, n, n + 1))
    model = plant.model
    compiled(plant.kinds, model.field is not None).riccati(
        times,
        *sample_plan(plan, times),
        weight_matrix(weights.state, n),
        weights.rate,
        weight_matrix(weights.final, n),
        parameter_vector(model.parameters),
        model.coefficients,
        model.residual_field,
        gains,
        corrections,
        cost,
    )
    return TrackingPolicy(
        plan=plan,
        times=times[::2],
        gains=gains,
        corrections=corrections,
        cost=cost[:, :, :n].copy(),
        cost_slope=cost[:, :, n].copy(),
    )
