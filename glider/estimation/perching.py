"""A filter for perches as motion capture sees them."""

import numpy as np

from glider.campaign.motion_capture import MotionCapture
from glider.estimation.ekf import Ekf, SlowState, make_ekf
from glider.estimation.running import Belief, make_prior
from glider.physics.model import GliderModel

CAPTURE = MotionCapture(position=0.001)
"""Motion capture that the filter assumes."""

PROCESS = (1e-6, 1e-6, 1e-6, 1e-6, 1e-3, 1e-3, 1e-2)
"""Variances that the states gain per second: gusts of some cm/s, no more."""

LAUNCH_STD = (0.005, 0.04, 0.02, 0.01, 0.1, 0.05, 0.05)
"""Standard deviations of a launch about the planned one, in the order of
STATE_NAMES."""


def perching_filter(
    model: GliderModel,
    launch: np.ndarray,
    unsure: float = 1.0,
    *,
    slow: tuple[SlowState, ...] = (),
    elevator: bool = True,
    capture: MotionCapture = CAPTURE,
) -> tuple[Ekf, Belief]:
    """Makes a filter of motion capture, and what it believes of a launch.

    Args:
        model: the glider.
        launch: (n,) planned state.
        unsure: standard deviation of the launch error, in LAUNCH_STD.
        slow: what else to estimate.
        elevator: whether its angle is measured too.
        capture: rate and noise of the measurements.
    """
    noise = np.square(capture.std[: 4 if elevator else 3])
    ekf = make_ekf(model, rate=capture.rate, process=PROCESS, noise=noise, slow=slow)
    return ekf, make_prior(ekf, launch, unsure * np.array(LAUNCH_STD))
