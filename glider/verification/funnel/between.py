"""The flight and the sets between the times of a funnel: cubic Hermite polynomials."""

import dataclasses

import numpy as np
from scipy.interpolate import CubicHermiteSpline, CubicSpline

from glider.verification.dynamics.error_dynamics import (
    closed_loop_rates,
    expand,
)
from glider.verification.dynamics.nominal import Nominal
from glider.verification.funnel.ascent import largest_values
from glider.verification.funnel.descent import boundary_forms
from glider.verification.funnel.remainder import remainder_form

SHARES = (0.25, 0.5, 0.75)
"""Where between two times V̇ is looked at."""

ROUNDS = 40
"""Of the ascent."""


def nominal_slopes(nominal: Nominal) -> np.ndarray:
    """Returns ẋ₀ (T, n) by the dynamics."""
    x = list(nominal.states.T)
    rates = closed_loop_rates(nominal.model, x, nominal.gains.T, x, nominal.inputs)
    return np.array([np.broadcast_to(rate, len(nominal.times)) for rate in rates]).T


def drift(nominal: Nominal) -> float:
    """Returns how far the nominal is from a flight over one step, by Simpson's rule."""
    slopes, step = nominal_slopes(nominal), np.diff(nominal.times)[:, None]
    x = nominal.states
    middle = nominal_slopes(nominal_between(nominal, 0.5))
    rise = step / 6.0 * (slopes[1:] + 4.0 * middle + slopes[:-1])
    return float(np.abs(x[1:] - x[:-1] - rise).max())


def nominal_between(nominal: Nominal, share: float) -> Nominal:
    """Returns the flight at one point of each interval, (T - 1) times."""
    times = nominal.times[:-1] + share * np.diff(nominal.times)
    path = CubicHermiteSpline(nominal.times, nominal.states, nominal_slopes(nominal))
    return dataclasses.replace(
        nominal,
        times=times,
        states=path(times),
        inputs=np.interp(times, nominal.times, nominal.inputs),
        gains=CubicSpline(nominal.times, nominal.gains)(times),
    )


class Between:
    """V̇/V on the boundary at one point of each interval."""

    def __init__(self, nominal: Nominal, share: float, every: int = 1):
        """Expands the dynamics there, in every so many intervals."""
        self._share, self._every = share, every
        self._times = nominal.times
        here = nominal_between(nominal, share)
        parts = {
            name: getattr(here, name)[::every]
            for name in ("times", "states", "inputs", "gains")
        }
        here = dataclasses.replace(here, **parts)
        self._at = here.times
        self._coefficients = expand(here)

    def growth(
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
            weights: (T, n) of `remainder_form`.
            starts: (B, n) where the ascent starts, besides the axes.
        """
        curve = CubicHermiteSpline(self._times, S, slopes)
        here = curve(self._at)
        disturbance = remainder_form(here, self._mix(beta), self._mix(weights))
        forms = boundary_forms(
            here, curve(self._at, 1), self._coefficients, disturbance
        )
        return growth_of(forms, starts)[0]

    def _mix(self, values):
        mixed = (1.0 - self._share) * values[:-1] + self._share * values[1:]
        return mixed[:: self._every]


def growth_of(
    forms: tuple[np.ndarray, np.ndarray, np.ndarray], starts: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Returns the largest values (T,) of forms on the sphere and where they are.

    Args:
        forms: of `boundary_forms`.
        starts: (B, n) of the ascent; the axes of the quadratic part are added.
    """
    axes = np.swapaxes(np.linalg.eigh(forms[0])[1], 1, 2)
    seeds = np.broadcast_to(starts, (len(axes), *starts.shape))
    quadratic, cubic, quartic = forms
    starts = np.concatenate([seeds, axes], axis=1)
    return largest_values(quadratic, cubic, quartic, starts, ROUNDS)
