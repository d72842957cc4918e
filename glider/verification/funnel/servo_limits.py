"""The servo's limits as bounds |aᵀ e| <= b on deviations; a feedback within them.

The servo follows its command (`glider.physics.servo`) while u = u₀ - K e and its
demanded angle ψ, which is linear in the states, keep
    |u| <= rate limit  and  low <= ψ + τ u <= high,  τ the stopping time.
Inside the funnel both hold, so that its dynamics need no saturation.

The feedback is the steepest descent of V that the servo can follow, with B = ∂f/∂u:
    u = u₀ - κ Bᵀ S e,  κ √(Bᵀ S B) = a share of the rate that u₀ leaves.
"""

import numpy as np

from glider.errors import InputError
from glider.physics.servo import STOPPING_TIME
from glider.physics.state import ELEVATOR
from glider.verification.dynamics.moving_center import MovingCenter
from glider.verification.dynamics.nominal import Nominal
from glider.verification.funnel.settings import FunnelSettings

_SHRINK = 0.995
"""Factor on the bounds, to keep them between the times too; shipped funnels reach
0.9942 of them there."""


def servo_bounds(
    nominal: Nominal,
    settings: FunnelSettings,
    center: MovingCenter,
    shrink: float = _SHRINK,
) -> tuple[np.ndarray, np.ndarray]:
    """Returns a (T, 2, n) and b (T, 2): of the servo's rate and of its travel.

    A center that moves by X δ under U δ leaves less of both. A command that is held
    keeps the rate's limit if it does when it is computed: elsewhere that b is infinite.
    """
    low, high, rate = nominal.model.parameters.servo
    demanded = nominal.demanded
    ahead = nominal.states @ demanded + STOPPING_TIME * nominal.inputs
    travel = demanded - STOPPING_TIME * nominal.gains
    directions = np.stack([nominal.gains, travel], axis=1)
    rate_left = rate - np.abs(nominal.inputs)
    bounds = np.stack([rate_left, np.minimum(high - ahead, ahead - low)], axis=1)
    bounds = shrink * bounds
    shifts = np.einsum("i,kij->kj", demanded, center.shifts)
    travel_of = shifts + STOPPING_TIME * center.commands
    of_both = np.stack([center.commands, travel_of], axis=1)
    bounds -= center.confidence.reach(of_both)
    if settings.period:
        bounds[nominal.starts != np.arange(len(bounds)), 0] = np.inf
    return directions, bounds


def error_reach(errors: np.ndarray) -> np.ndarray:
    """Returns what errors (K,) of the command take of both bounds, (K, 2)."""
    return np.multiply.outer(errors, [1.0, STOPPING_TIME])


def goal_about(axes: np.ndarray, center: MovingCenter) -> np.ndarray:
    """Returns S (n, n) of the goal's part that each glider's last set may fill.

    Where no center ends farther than s < 1, the goal's half-axes (n,) being 1, a set
    1 - s times as large stays in it.

    Raises:
        InputError: the gliders' centers alone leave the goal.
    """
    scaled = center.shifts[-1] @ center.confidence.factor / axes[:, None]
    left = 1.0 - center.confidence.farthest(scaled)
    if left <= 0.0:
        raise InputError(
            f"The gliders of the confidence set end up to {1.0 - left:.3g} times as "
            "far from the nominal's end as the goal reaches; expected more flights, or "
            "a wider goal."
        )
    return np.diag(1.0 / (left * axes) ** 2)


def keep_bounds(
    S: np.ndarray, directions: np.ndarray, bounds: np.ndarray
) -> np.ndarray:
    """Returns S (n, n) of a set that is cut down until it keeps K bounds: S grows.

    It is S + a aᵀ (1 / b² - 1 / (aᵀ S⁻¹ a)) where aᵀ S⁻¹ a > b².
    """
    for a, bound in zip(directions, bounds, strict=True):
        reach = a @ np.linalg.solve(S, a)
        if reach > bound**2:
            S = S + np.outer(a, a) * (1.0 / bound**2 - 1.0 / reach)
    return S


def margin_to_limits(
    S: np.ndarray, directions: np.ndarray, bounds: np.ndarray
) -> np.ndarray:
    """Returns the largest ρ (T,) for which {eᵀ S e <= ρ} keeps K bounds each."""
    reach = np.einsum("tki,tij,tkj->tk", directions, np.linalg.inv(S), directions)
    with np.errstate(divide="ignore"):  # Without feedback, no deviation reaches them.
        return np.min(bounds**2 / reach, axis=1)


SHARE = 0.97
"""Share of the servo's rate that the feedback uses on the boundary: the gains are used
one time earlier, for another set."""


def steepest_gains(
    S: np.ndarray, slopes: np.ndarray, rate: float, largest: float
) -> np.ndarray:
    """Returns the gains K (n,) along Bᵀ S that the servo can follow on the set.

    Given are B (n,), the rate that the nominal's command leaves [rad/s], and the
    largest gain on the elevator's own deviation [1/s].
    """
    along = slopes @ S
    reach = np.sqrt(along @ slopes)
    return min(SHARE * rate / reach, largest / abs(along[ELEVATOR])) * along
