"""The flights that the filter study compares: the article's cruise, and a perch."""

import dataclasses
from collections.abc import Callable

import numpy as np

from diagrams import closed_loop, estimated_loop, simulate_flights
from filter_study import (
    CONSTANTS,
    ParameterTrack,
    StudyNoise,
    watch_cruise,
    watch_perch,
)
from glider import (
    ExtendedKalmanFilter,
    Perches,
    Plan,
    perching_filter,
    tracking_regulator,
)
from glider.control.tvlqr import TrackingPolicy
from glider.paths import models_path
from glider.physics.model import GliderModel
from glider.physics.parameters import load_parameters

FLIGHTS = 20
"""Number of flights that the NEES of constants is taken over."""


AFTER = 0.1
"""Time that a flight goes on after the plan's end [s]."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class EstimatedPerches:
    """The same launches of one glider under feedback of the state and of a filter."""

    on_state: Perches
    """The regulator gets the true state."""

    on_estimate: Perches
    """It gets a filter's estimate from motion capture."""


def fly_on_estimate(
    model: GliderModel,
    plan: Plan,
    starts: np.ndarray,
    rng: np.random.Generator,
    progress: Callable[[str], None] | None = None,
) -> EstimatedPerches:
    """Flies launches under TVLQR, on the state and on the estimate.

    Args:
        model: of plan, feedback and filter, and the glider that flies.
        plan: to track.
        starts: (B, 7) launches.
        rng: draws the noise of motion capture, as the filter is given it.
        progress: called with the launch that is flown.
    """
    estimator = ExtendedKalmanFilter(*perching_filter(model, plan.states[0]))
    filtering = estimated_loop(model, tracking_regulator(model, plan), estimator)
    seeing = closed_loop(model, tracking_regulator(model, plan), all_states=True)
    duration = plan.duration + AFTER
    return EstimatedPerches(
        on_state=simulate_flights(seeing, starts, duration, progress=progress),
        on_estimate=simulate_flights(
            filtering, starts, duration, capture_noise=rng, progress=progress
        ),
    )


def perching_glider() -> GliderModel:
    """Loads the glider of the perch; the cruise's has its wing further back."""
    return GliderModel(
        parameters=load_parameters(models_path("vehicles", "heavy.yaml"))
    )


def watch_all(
    policy: TrackingPolicy, rng: np.random.Generator, noise: StudyNoise | None = None
) -> dict[str, ParameterTrack]:
    """Returns the article's cruise and a perch, by name.

    Args:
        policy: as in `watch_perch`, of `perching_glider`.
        rng: draws winds and measurements.
        noise: of the filters; None for the article's.
    """
    cruising = load_parameters(models_path("vehicles", "heavy_ekf.yaml"))
    return {
        "cruise": watch_cruise(cruising, rng, noise),
        "perch": watch_perch(perching_glider().parameters, policy, rng, noise),
    }


def watch_twice(
    policy: TrackingPolicy,
    rng: np.random.Generator,
    progress: Callable[[str], None] | None = None,
) -> tuple[dict[str, ParameterTrack], list[dict[str, ParameterTrack]]]:
    """Watches cruise and perch by two filters.

    Args:
        policy: as in `watch_all`.
        rng: as in `watch_all`.
        progress: called with a line of text as the work goes on.

    Returns:
        What the article's filter sees, which lets the numbers drift, and FLIGHTS times,
        with other noise, what one sees that takes them for CONSTANTS.
    """
    if progress:
        progress("filter (compiles once)")
    drifting = watch_all(policy, rng)
    return drifting, [watch_all(policy, rng, CONSTANTS) for _ in range(FLIGHTS)]
