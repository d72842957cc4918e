"""The tracking feedback by compiled code, in milliseconds."""

import numpy as np

from glider.compiled.jacobian import stacked
from glider.compiled.riccati import LOOPS
from glider.control.policy import (
    TrackingPolicy,
    TrackingWeights,
    aligned_count,
    check_plan,
    sample_plan,
    weight_matrix,
)
from glider.physics.model import GliderModel
from glider.planning.plan import Plan

STEP = 0.003
"""Longest step of the pass [s]: gains to about 1e-7 of their largest."""


def tracking_policy(
    model: GliderModel,
    plan: Plan,
    weights: TrackingWeights | None = None,
    step: float = STEP,
) -> TrackingPolicy:
    """Computes the tracking feedback of `glider.control.tvlqr_drake` in milliseconds.

    Jacobians along the plan by complex steps, then one Runge-Kutta pass of the
    Riccati equations on a fixed grid (`compiled.riccati`).

    Args:
        model: the glider that the plan is for.
        plan: what to follow.
        weights: of the feedback; None for the article's.
        step: longest step of the pass [s]; shorter where the effects' own states ask
            for it.

    Raises:
        InputError: the plan is for another glider.
    """
    check_plan(model, plan)
    weights = TrackingWeights() if weights is None else weights
    # The cost-to-go settles at twice the rate of a state.
    step = min(step, 0.5 * model.longest_step())
    n, count = model.num_states, aligned_count(plan, step)
    times, theta = np.linspace(0.0, plan.duration, 2 * count + 1), model.numbers
    gains, corrections = np.empty((count + 1, n)), np.empty(count + 1)
    cost = np.empty((count + 1, n, n + 1))  # S and, as its last column, s.
    LOOPS.over(model.kinds, model.has_field).riccati(
        times,
        *sample_plan(plan, times),
        weight_matrix(weights.state, n),
        weights.rate,
        weight_matrix(weights.final, n),
        stacked(n, theta),
        theta.field,
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
