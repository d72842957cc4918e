"""A filter for perches as motion capture sees them, and its consistency on them."""

import dataclasses

import numpy as np

from glider.campaign.motion_capture import MotionCapture
from glider.control.policy import TrackingPolicy
from glider.estimation.consistency import Consistency, assess
from glider.estimation.ekf import Ekf, SlowState, make_ekf
from glider.estimation.noisy_flights import draw_starts, fly_watched
from glider.estimation.running import Belief, make_prior, run_ekf
from glider.physics.model import GliderModel

CAPTURE = MotionCapture(position=0.001)
"""Motion capture that the filter assumes."""

PROCESS = (1e-6, 1e-6, 1e-6, 1e-6, 1e-3, 1e-3, 1e-2)
"""Variances that the states gain per second: gusts of some cm/s, no more."""

LAUNCH_STD = (0.005, 0.04, 0.02, 0.01, 0.1, 0.05, 0.05)
"""Standard deviations of a launch about the planned one, in the order of
STATE_NAMES."""

UNCERTAIN = (
    SlowState(name="wing_offset", std=0.005, walk=1e-6),
    SlowState(name="elevator_area", std=0.0015, walk=1e-7),
)
"""Parameters that are estimated, and their prior standard deviations: 5 mm, and
a tenth of the elevator."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class WatchedPerches:
    """Consistency of a filter on some perches, and how it ended."""

    consistency: Consistency
    """Consistency over all flights."""

    std: np.ndarray
    """(N,) last standard deviations of x̄, mean over the flights."""


def perching_ekf(
    model: GliderModel, slow: tuple[SlowState, ...] = (), elevator: bool = True
) -> Ekf:
    """Makes a filter of CAPTURE.

    Args:
        model: the glider.
        slow: what else to estimate.
        elevator: whether its angle is measured too.
    """
    variances = np.square(CAPTURE.std[: 4 if elevator else 3])
    return make_ekf(
        model, rate=CAPTURE.rate, process=PROCESS, noise=variances, slow=slow
    )


def watch_perches(
    model: GliderModel, policy: TrackingPolicy, flights: int, rng: np.random.Generator
) -> WatchedPerches:
    """Filters perches whose launches, gusts and parameters are as it assumes.

    Args:
        model: the glider of the filter; each flight's has its own UNCERTAIN.
        policy: that tracks the plan with the true state.
        flights: their number.
        rng: draws everything.

    Raises:
        InputError: the effects' own states, of which a launch is certain, leave the
            filter none of its errors to compare; or the policy is another glider's.
    """
    ekf = perching_ekf(model, UNCERTAIN)
    prior = launch_prior(ekf, policy.plan.states[0])
    samples = round(policy.duration * CAPTURE.rate)
    offset, gain = policy.sample(np.arange(samples) / CAPTURE.rate)
    starts = draw_starts(prior, flights, rng)
    flown = fly_watched(ekf, starts, offset[:, None], rng, gain=gain[:, None, :])
    found = run_ekf(ekf, prior, flown.inputs, flown.measured)
    last = np.sqrt(np.diagonal(found.covariances[:, -1], axis1=1, axis2=2))
    return WatchedPerches(
        consistency=assess(found, flown.states), std=np.mean(last, axis=0)
    )


def perching_filter(
    model: GliderModel, launch: np.ndarray, unsure: float = 1.0
) -> tuple[Ekf, Belief]:
    """Makes a filter of CAPTURE, and what it believes of a launch.

    Args:
        model: the glider.
        launch: (n,) planned state.
        unsure: standard deviation of the launch error, in LAUNCH_STD.
    """
    ekf = perching_ekf(model)
    return ekf, make_prior(ekf, launch, unsure * np.array(LAUNCH_STD))


def launch_prior(ekf: Ekf, launch: np.ndarray) -> Belief:
    """Prior of a launch with errors of LAUNCH_STD."""
    return make_prior(ekf, launch, LAUNCH_STD)
