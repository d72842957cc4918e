"""The same launches of one glider under feedback of the state and of a filter."""

import dataclasses

import numpy as np

from diagrams import closed_loop, estimated_loop, simulate_flights
from glider import (
    ExtendedKalmanFilter,
    GliderModel,
    Perches,
    Plan,
    perching_filter,
    tracking_regulator,
)

AFTER = 0.1
"""Time that a flight goes on after the plan's end [s]."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class EstimatedPerches:
    """Flights of the same launches under TVLQR."""

    on_state: Perches
    """The regulator gets the true state."""

    on_estimate: Perches
    """It gets a filter's estimate from motion capture."""


def fly_on_estimate(
    model: GliderModel, plan: Plan, starts: np.ndarray, rng: np.random.Generator
) -> EstimatedPerches:
    """Flies launches under TVLQR, on the state and on the estimate.

    Args:
        model: of plan, feedback and filter, and the glider that flies.
        plan: to track.
        starts: (B, 7) launches.
        rng: draws the noise of motion capture, as the filter is given it.
    """
    estimator = ExtendedKalmanFilter(*perching_filter(model, plan.states[0]))
    filtering = estimated_loop(model, tracking_regulator(model, plan), estimator)
    seeing = closed_loop(model, tracking_regulator(model, plan), all_states=True)
    duration = plan.duration + AFTER
    return EstimatedPerches(
        on_state=simulate_flights(seeing, starts, duration),
        on_estimate=simulate_flights(filtering, starts, duration, capture_noise=rng),
    )
