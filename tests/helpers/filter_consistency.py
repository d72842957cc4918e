"""NEES and NIS of a filter against their chi-square bands, and those on perches.

Over flights whose x̄ starts and moves as the filter assumes, the
estimate's error e and the innovation ν of a consistent filter are normal with
covariances P and S, so that eᵀ P⁻¹ e and νᵀ S⁻¹ ν are chi-square with N and M degrees
of freedom (Bar-Shalom, Li and Kirubarajan 2001, 5.4). Here both are divided by
these, so that 1 is right, more is overconfident and less too cautious.
"""

import dataclasses
import math

import numpy as np
from scipy.stats import chi2

from glider.control.tvlqr import TrackingPolicy
from glider.errors import InputError
from glider.estimation.ekf import SlowState
from glider.estimation.perching import CAPTURE, perching_filter
from glider.estimation.running import Estimates, run_ekf
from glider.physics.model import GliderModel
from tests.helpers.noisy_flights import draw_starts, fly_watched

UNCERTAIN = (
    SlowState(name="wing_offset", std=0.005, walk=1e-6),
    SlowState(name="elevator_area", std=0.0015, walk=1e-7),
)
"""Parameters that are estimated, and their prior standard deviations: 5 mm, and
a tenth of the elevator."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Consistency:
    """Means over flights, one a sample; 1 is right."""

    nees: np.ndarray
    """(K + 1,) normalized estimation error squared."""

    nis: np.ndarray
    """(K,) normalized innovation squared; NaN where no flight was measured."""

    nees_band: tuple[float, float]
    """Band in which 95 % of `nees` would lie."""

    nis_bands: np.ndarray
    """(K, 2) the same of `nis`, of as many flights as were measured."""

    @property
    def nees_inside(self) -> float:
        """Share of samples whose NEES is in its band."""
        return _share_inside(self.nees, np.array([self.nees_band]))

    @property
    def nis_inside(self) -> float:
        """Share of the measured samples whose NIS is in its band."""
        return _share_inside(self.nis, self.nis_bands)


@dataclasses.dataclass(frozen=True, kw_only=True)
class WatchedPerches:
    """Consistency of a filter on some perches, and how it ended."""

    consistency: Consistency
    """Consistency over all flights."""

    std: np.ndarray
    """(N,) last standard deviations of x̄, mean over the flights."""


def squared_errors(estimates: Estimates, states: np.ndarray) -> np.ndarray:
    """Returns eᵀ P⁻¹ e, shape (B, K + 1), given the true x̄ (B, K + 1, N).

    Raises:
        InputError: a covariance is singular.
    """
    error = states - estimates.means
    try:
        solved = np.linalg.solve(estimates.covariances, error[..., None])[..., 0]
    except np.linalg.LinAlgError:
        raise InputError(
            "A filter that is certain of a number, as of one with neither a standard "
            "deviation nor noise, has a singular covariance, and so no NEES; each "
            "needs a positive deviation."
        ) from None
    return np.sum(error * solved, axis=-1)


def assess(estimates: Estimates, states: np.ndarray) -> Consistency:
    """Compares the errors of some flights with the filter's covariances.

    Lost measurements do not count.

    Args:
        estimates: of `run_ekf`.
        states: (B, K + 1, N) the true x̄.

    Raises:
        InputError: a covariance is singular.
    """
    flights, samples, rows = estimates.innovations.shape
    size = states.shape[2]
    counts = np.sum(~np.isnan(estimates.nis), axis=0)
    seen = counts > 0
    nis, bands = np.full(samples, np.nan), np.full((samples, 2), np.nan)
    nis[seen] = np.nansum(estimates.nis, axis=0)[seen] / (counts[seen] * rows)
    bands[seen] = [chi_square_band(count * rows) for count in counts[seen]]
    return Consistency(
        nees=np.mean(squared_errors(estimates, states), axis=0) / size,
        nis=nis,
        nees_band=chi_square_band(flights * size),
        nis_bands=bands,
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
    ekf, prior = perching_filter(model, policy.plan.states[0], slow=UNCERTAIN)
    samples = round(policy.duration * CAPTURE.rate)
    offset, gain = policy.sample(np.arange(samples) / CAPTURE.rate)
    starts = draw_starts(prior, flights, rng)
    flown = fly_watched(ekf, starts, offset[:, None], rng, gain=gain[:, None, :])
    found = run_ekf(ekf, prior, flown.inputs, flown.measured)
    last = np.sqrt(np.diagonal(found.covariances[:, -1], axis1=1, axis2=2))
    return WatchedPerches(
        consistency=assess(found, flown.states), std=np.mean(last, axis=0)
    )


def chi_square_band(freedom: int, probability: float = 0.95) -> tuple[float, float]:
    """Returns where a chi-square over its degrees of freedom lies, with what odds."""
    tail = 0.5 * (1.0 - probability)
    low, high = chi2.ppf([tail, 1.0 - tail], freedom) / freedom
    return float(low), float(high)


def _share_inside(values: np.ndarray, bands: np.ndarray) -> float:
    known = ~np.isnan(values)
    inside = (values > bands[:, 0]) & (values < bands[:, 1])
    return float(np.mean(inside[known])) if np.any(known) else math.nan
