"""What deviations matter alike along a flight: Σ, which shapes a funnel.

A program that makes tr(Σ S) grow least trades directions against each other by what is
large at its time. What is wanted is a wide inlet. With
    Φ̇ = F₁ Φ,  Φ(0) = I,
F₁ of the closed loop, tr(Σ₀ S(0)) is tr(Φ Σ₀ Φᵀ S(t)) and what else makes S grow
before t. So Σ is Φ Σ₀ Φᵀ, what errors of the launch have become, and a share of
deviations that matter alike at all times, without which it is flat.
"""

import numpy as np
from scipy.linalg import expm

from glider.verification.dynamics.nominal import Nominal
from glider.verification.funnel.settings import FunnelSettings
from glider.verification.sos.forms import linear_part

SHARE = 0.1
"""Share of the sizes that is added to the errors of a launch. Of the drawn glider's
funnel for the hook, 0.32, 0.17, 0.1 and 0.05 leave 14.4, 15.4, 15.9 and 15.3 cm of
height, in steps twice as long."""


def size_matrices(
    nominal: Nominal, coefficients: np.ndarray, settings: FunnelSettings
) -> np.ndarray:
    """Returns Σ (T, n, n), in squared units of the states.

    Args:
        nominal: the flight.
        coefficients: (T, n, M) of `expand`.
        settings: sizes, and those of the launch.
    """
    count, n = nominal.states.shape
    steady = np.diag(np.square(settings.size_axes(n)))
    if settings.launch_sizes is None:
        return np.broadcast_to(steady, (count, n, n))
    slopes = linear_part(coefficients)
    means = 0.5 * (slopes[:-1] + slopes[1:])
    errors = [np.diag(settings.launch_axes(n))]
    for step in expm(np.diff(nominal.times)[:, None, None] * means):
        errors.append(step @ errors[-1])
    spread = np.array(errors)
    return spread @ np.swapaxes(spread, 1, 2) + SHARE**2 * steady
