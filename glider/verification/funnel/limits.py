"""The limits of the servo, as bounds on the deviation: |aᵀ e| <= b.

The servo does exactly what it is told (`glider.physics.servo`) while the command
u = u₀ - K e and the elevator φ = φ₀ + e_φ keep
    |u| <= rate limit  and  low <= φ + τ u <= high,  τ the stopping time.
Inside the funnel both hold, so that its dynamics need no saturation.
"""

from collections.abc import Callable

import numpy as np

from glider.physics.servo import STOPPING_TIME
from glider.physics.state import ELEVATOR
from glider.verification.dynamics.nominal import Nominal

SHRINK = 0.995
"""Factor on the bounds, for what happens between the times where they are kept:
the shipped funnels come to 0.9942 of the bounds there."""


def servo_bounds(
    nominal: Nominal,
    shrink: float = SHRINK,
    number: Callable[..., np.ndarray] = np.asarray,
) -> tuple[np.ndarray, np.ndarray]:
    """Returns a (T, 2, n) and b (T, 2): of the servo's rate and of its travel.

    Args:
        nominal: the flight.
        shrink: factor on b.
        number: makes arrays of what is computed with: of doubles, or by
            `glider.verification.sos.exact.fractions` without rounding.
    """
    servo = nominal.model.parameters.servo
    low, high, rate, ahead_by, factor = number([*servo, STOPPING_TIME, shrink])
    inputs, gains = number(nominal.inputs), number(nominal.gains)
    ahead = number(nominal.states[:, ELEVATOR]) + ahead_by * inputs
    travel = -ahead_by * gains
    travel[:, ELEVATOR] += 1
    directions = np.stack([gains, travel], axis=1)
    bounds = np.stack(
        [rate - np.abs(inputs), np.minimum(high - ahead, ahead - low)], axis=1
    )
    return directions, factor * bounds


def keep_bounds(
    S: np.ndarray, directions: np.ndarray, bounds: np.ndarray
) -> np.ndarray:
    """Returns S (n, n) of a set that is cut down until it keeps some bounds: S grows.

    S + a aᵀ (1 / b² - 1 / (aᵀ S⁻¹ a)) where aᵀ S⁻¹ a > b². Going backward in time a
    smaller set is a valid one.

    Args:
        S: (n, n) of the set.
        directions: (K, n) a.
        bounds: (K,) b.
    """
    for a, bound in zip(directions, bounds, strict=True):
        reach = a @ np.linalg.solve(S, a)
        if reach > bound**2:
            S = S + np.outer(a, a) * (1.0 / bound**2 - 1.0 / reach)
    return S


def room(S: np.ndarray, directions: np.ndarray, bounds: np.ndarray) -> np.ndarray:
    """Returns the largest ρ (T,) for which {eᵀ S e <= ρ} keeps some bounds.

    Args:
        S: (T, n, n).
        directions: (T, K, n) a.
        bounds: (T, K) b.
    """
    reach = np.einsum("tki,tij,tkj->tk", directions, np.linalg.inv(S), directions)
    return np.min(bounds**2 / reach, axis=1)
