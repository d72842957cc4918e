"""The size of a funnel of given shape: the comparison equation.

On the boundary of {eᵀ S e <= ρ}, V̇/V <= h(t); the set stays one that nothing leaves as
long as
    d(log ρ)/dt >= h(t),
integrated backward from ρ(T) = 1. Here h is found by ascent, and the set S/ρ is what is
then certified, with a margin.
"""

import numpy as np
from scipy.interpolate import CubicSpline

from glider.verification.dynamics.defect import defect_bounds, defect_growth
from glider.verification.dynamics.moving_center import MovingCenter
from glider.verification.dynamics.nominal import Nominal
from glider.verification.funnel.growth import (
    SHARES,
    BoundaryForms,
    BoundarySets,
    boundary_forms,
    growth_between,
    largest_growth,
    remainder_form,
)
from glider.verification.funnel.remainder import (
    inflate,
    remainder_weights,
    sample_remainder,
)
from glider.verification.funnel.servo_limits import margin_to_limits, servo_bounds
from glider.verification.funnel.settings import FunnelSettings
from glider.verification.funnel.shape_flow import size_matrices
from glider.verification.sos.programs import SolverError
from glider.verification.sos.sphere import normalized

ROUNDS = 10
"""Rounds of scaling and looking again; it converges in four or five."""

MARGIN_SHARE = 0.6
"""Share of the margin that is enough, everywhere, to end the rounds."""

STARTS = 60
"""Points where the ascent to the largest growth starts, besides the axes of its
quadratic part. With 12, and none from neighbors in time, it missed so much that one
funnel was not certified, and another not proven between two times."""


class Gauge:
    """A gauge of sets S (T, n, n) along a flight: their growth, the servo's margin."""

    def __init__(
        self,
        nominal: Nominal,
        settings: FunnelSettings,
        directions: np.ndarray,
        center: MovingCenter | None,
    ):
        """Expands the dynamics between the times; see `ShapeFlow` for the arguments."""
        self._nominal, self._settings = nominal, settings
        self._directions = directions
        self._center, n = center, nominal.states.shape[1]
        self._sizes = size_matrices(nominal, settings)
        self._starts = directions[:STARTS]
        if center is not None:
            self._starts = normalized(self._starts[:, :n])
        self._between = {share: nominal.between(share) for share in SHARES}
        self._defect = defect_bounds(nominal)

    def scaled(self, S: np.ndarray) -> tuple[BoundarySets, BoundaryForms]:
        """Returns sets of shapes S, scaled so that V̇/V < 0 on their boundary, and V̇/V.

        Raises:
            SolverError: the sets cannot be evaluated between their times.
        """
        if not np.all(np.isfinite(self._defect)):
            raise SolverError(
                "The plan's flight cannot be enclosed; a shorter step may help."
            )
        try:
            return self._sets(self._scale(S))
        except np.linalg.LinAlgError:
            raise SolverError(
                "The funnel changes too fast between its times; a shorter step may "
                "help."
            ) from None

    def _scale(self, S):
        times, margin = self._nominal.times, self._settings.margin
        for turn in range(ROUNDS):
            growth, largest = self.growth(S), self.servo_margin(S)
            if growth.max() <= -MARGIN_SHARE * margin and largest.min() >= 1.0 - 1e-9:
                break
            excess = growth + margin
            # At first as the equation says; then only what is still missing.
            excess = excess if turn == 0 else np.maximum(excess, 0.0)
            S = S / _levels(times, excess, largest)
        return S

    def _sets(self, S):
        """Returns sets with slopes of a cubic spline, and V̇/V on their boundaries."""
        times, beta = self._nominal.times, self._beta(S)
        weights = remainder_weights(S, beta, self._sizes)
        slopes = CubicSpline(times, S)(times, 1)
        disturbance = remainder_form(S, beta, weights)
        disturbance += self._drift(S)[:, None, None] * np.eye(S.shape[1])
        forms = boundary_forms(S, slopes, self._nominal.closed_loop, disturbance)
        sets = BoundarySets(
            nominal=self._nominal, S=S, slopes=slopes, beta=beta, weights=weights
        )
        return sets, forms

    def growth(self, S: np.ndarray) -> np.ndarray:
        """Returns the largest V̇/V (T,) at and around each time [1/s]."""
        (sets, forms), starts = self._sets(S), self._starts
        growth = largest_growth(forms, starts)
        drift = self._drift(S)
        drift = np.maximum(drift[:-1], drift[1:])
        # Between the times it is looked for only where it is good at them.
        for share, here in self._between.items() if growth.max() < 0.0 else ():
            found = growth_between(sets, share, here, starts) + drift
            growth[1:] = np.maximum(growth[1:], found)
            growth[:-1] = np.maximum(growth[:-1], found)
        return growth

    def servo_margin(self, S: np.ndarray) -> np.ndarray:
        """Returns the largest ρ (T,) that the servo allows."""
        return margin_to_limits(S, *servo_bounds(self._nominal, self._center))

    def _drift(self, S):
        return defect_growth(S, self._defect)

    def _beta(self, S):
        if self._settings.remainder == 0.0:
            return np.zeros(self._nominal.states.shape)
        sampled = sample_remainder(
            self._nominal, S, self._directions, np.arange(len(S)), self._center
        )
        return inflate(sampled, self._settings.remainder)


def _levels(times, rate, largest):
    """Returns ρ (T, 1, 1), backward from 1 and within the servo's margin."""
    log = np.zeros(len(times))
    cap = np.log(largest)
    log[-1] = min(0.0, cap[-1])
    for k in range(len(times) - 2, -1, -1):
        mean = 0.5 * (rate[k] + rate[k + 1])
        log[k] = min(log[k + 1] - mean * (times[k + 1] - times[k]), cap[k])
    return np.exp(log)[:, None, None]
