"""A feedback that is made with a funnel's shape: the steepest descent of V.

Of a command u - u₀ that the servo can follow, V̇ has the part 2 eᵀ S B (u - u₀),
B = ∂f/∂u. It is least where the command is as large as it may be and against BᵀS e;
the linear feedback along that,
    u = u₀ - κ Bᵀ S e,  κ √(Bᵀ S B) = a share of what the servo's rate leaves,
meets the limit nowhere on eᵀ S e <= 1, however wide the set.
"""

import numpy as np

from glider.physics.state import ELEVATOR
from glider.verification.dynamics.error_dynamics import expand_rates
from glider.verification.dynamics.nominal import Nominal

SHARE = 0.97
"""Share of the servo's rate that the feedback takes on the boundary: the set changes
until the gains are used, one time earlier."""


def command_slopes(nominal: Nominal) -> np.ndarray:
    """Returns B = ∂f/∂u (T, n) along a flight."""
    return expand_rates(nominal)[:, :, 1 + nominal.states.shape[1]]


def steepest_gains(
    S: np.ndarray, slopes: np.ndarray, rate: float, largest: float
) -> np.ndarray:
    """Returns the gains K (n,) along Bᵀ S that the servo can follow on the set.

    Args:
        S: (n, n) of the set.
        slopes: (n,) B.
        rate: what the nominal's command leaves of the servo's rate [rad/s].
        largest: gain on the elevator's own deviation that is not exceeded [1/s].
    """
    along = slopes @ S
    reach = np.sqrt(along @ slopes)
    return min(SHARE * rate / reach, largest / abs(along[ELEVATOR])) * along
