"""V̇/V on the boundary of a funnel, at its times and between them.

Between the times the flight and the sets are cubic Hermite polynomials.
"""

import dataclasses
from typing import NamedTuple

import numpy as np
from scipy.interpolate import CubicHermiteSpline

from glider.verification.dynamics.error_dynamics import expand
from glider.verification.dynamics.nominal import ARRAYS, Nominal, nominal_between
from glider.verification.funnel.ascent import largest_values
from glider.verification.funnel.remainder import remainder_form
from glider.verification.sos.forms import higher_forms, quadratic_form, to_ball

SHARES = (0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9)
"""Points of each interval between two times where V̇ is examined. With three, and with
five, a funnel was made whose V̇ rises between two of them, where a servo limit cuts it
down; it could not be proven."""


NEIGHBORS = 2
"""Rounds of ascent from where the neighbors in time reached their largest value."""


class BoundaryForms(NamedTuple):
    """V̇/V = zᵀ N z + c₃(z) + c₄(z) on the boundary |z| = 1, at each of T times.

    Attributes:
        quadratic: matrices N (T, n, n) [1/s].
        cubic: coefficients of c₃ (T, C₃) [1/s].
        quartic: coefficients of c₄ (T, C₄) [1/s].
    """

    quadratic: np.ndarray
    cubic: np.ndarray
    quartic: np.ndarray


def boundary_forms(
    S: np.ndarray, slopes: np.ndarray, coefficients: np.ndarray, disturbance: np.ndarray
) -> BoundaryForms:
    """Returns V̇/V on the boundary, the disturbance included.

    Args:
        S: (T, n, n).
        slopes: (T, n, n) Ṡ.
        coefficients: (T, n, M) of `expand`.
        disturbance: (T, n, n) D.
    """
    cubic, quartic = higher_forms(S, coefficients)
    _, L_inv_T = to_ball(S)
    quadratic = quadratic_form(S, slopes, coefficients)
    quadratic = np.swapaxes(L_inv_T, 1, 2) @ quadratic @ L_inv_T + disturbance
    return BoundaryForms(quadratic, cubic, quartic)


def largest_growth(forms: BoundaryForms, starts: np.ndarray) -> np.ndarray:
    """Returns the largest V̇/V (T,) found by ascent [1/s].

    One ascent misses the truth at some time or other, by up to 0.08 1/s with 12 starts.
    The worst point moves steadily, so that what a neighbor in time found leads there.

    Args:
        forms: V̇/V on the boundary, at times in order.
        starts: (B, n) where the ascent starts, besides the axes of the quadratic part.
    """
    axes = np.swapaxes(np.linalg.eigh(forms.quadratic)[1], 1, 2)
    seeds = np.broadcast_to(starts, (len(axes), *starts.shape))
    points = np.concatenate([seeds, axes], axis=1)
    value, worst = largest_values(*forms, points)
    for _ in range(NEIGHBORS):
        around = np.concatenate([worst[:1], worst, worst[-1:]])
        points = np.stack([around[:-2], worst, around[2:]], axis=1)
        value, worst = largest_values(*forms, points)
    return value


class GrowthBetween:
    """V̇/V on the boundary at one point of each interval between two times."""

    def __init__(self, nominal: Nominal, share: float, every: int = 1):
        """Expands the dynamics there.

        Args:
            share: of an interval, where the point is; from 0 to 1.
            every: take every so many intervals only.
        """
        self._share, self._every = share, every
        self._times = nominal.times
        here = nominal_between(nominal, share)
        parts = {name: getattr(here, name)[::every] for name in ARRAYS}
        here = dataclasses.replace(here, **parts)
        self._at = here.times
        self._coefficients = expand(here)

    def largest(
        self,
        S: np.ndarray,
        slopes: np.ndarray,
        beta: np.ndarray,
        weights: np.ndarray,
        starts: np.ndarray,
    ) -> np.ndarray:
        """Returns the largest V̇/V found by ascent, one an interval [1/s].

        Args:
            S: (T, n, n).
            slopes: (T, n, n) Ṡ.
            beta: (T, n) bounds of the remainder.
            weights: (T, n) λ of `remainder_form`.
            starts: (B, n) where the ascent starts, besides the axes.
        """
        curve = CubicHermiteSpline(self._times, S, slopes)
        here = curve(self._at)
        disturbance = remainder_form(here, self._mix(beta), self._mix(weights))
        forms = boundary_forms(
            here, curve(self._at, 1), self._coefficients, disturbance
        )
        return largest_growth(forms, starts)

    def _mix(self, values):
        mixed = (1.0 - self._share) * values[:-1] + self._share * values[1:]
        return mixed[:: self._every]
