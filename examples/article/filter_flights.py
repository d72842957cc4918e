"""The flights that the filter study compares: the article's cruise, and a perch."""

from collections.abc import Callable

import numpy as np

from filter_study import (
    CONSTANTS,
    ParameterTrack,
    StudyNoise,
    watch_cruise,
    watch_perch,
)
from glider.control.policy import TrackingPolicy
from glider.paths import models_path
from glider.physics.model import GliderModel
from glider.physics.parameters import load_parameters

FLIGHTS = 20
"""Number of flights that the NEES of constants is taken over."""


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
        progress: told that it is done.

    Returns:
        What the article's filter sees, which lets the numbers drift, and FLIGHTS times,
        with other noise, what one sees that takes them for CONSTANTS.
    """
    if progress:
        progress("filter (compiles once)")
    drifting = watch_all(policy, rng)
    return drifting, [watch_all(policy, rng, CONSTANTS) for _ in range(FLIGHTS)]
