"""Knowledge that a flight could give of slow states, by Fisher information.

Without process noise a flight is a function of its start and its slow states, and
the inverse of prior plus Fisher information, J₀ + Σ Gᵀ R⁻¹ G with the sensitivities
G = ∂y/∂x̄₀, bounds every estimator's covariance (Van Trees). A Kalman filter along the
true flight computes just that inverse, moved along with the flight.
"""

import dataclasses

import numpy as np

from glider.estimation.ekf import Ekf
from glider.estimation.flights import fly_watched
from glider.estimation.running import Belief, run_ekf


def information_bound(ekf: Ekf, prior: Belief, inputs: np.ndarray) -> np.ndarray:
    """Returns the least covariances that a flight allows, (K + 1, N, N) of x̄.

    Args:
        ekf: the filter; its process noise is left out.
        prior: about the true x̄ at launch.
        inputs: (K, 1 + known) of the flight.
    """
    quiet = dataclasses.replace(ekf, process=np.zeros(len(ekf.names)))
    flight = fly_watched(quiet, prior.mean, inputs)
    return run_ekf(quiet, prior, flight.inputs, flight.measured).covariances[0]
