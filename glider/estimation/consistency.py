"""Is a filter as uncertain as it says? NEES and NIS against their chi-square bands.

Over flights whose x̄ starts as the prior says and moves as the filter believes, the
estimate's error e and the innovation ν of a consistent filter are normal with
covariances P and S, so that eᵀ P⁻¹ e and νᵀ S⁻¹ ν are chi-square with N and M degrees
of freedom (Bar-Shalom, Li and Kirubarajan 2001, 5.4). Here both are divided by
these, so that 1 is right, more is too sure and less is too modest.
"""

import dataclasses

import numpy as np
from scipy.stats import chi2

from glider.estimation.running import Estimates


@dataclasses.dataclass(frozen=True, kw_only=True)
class Consistency:
    """Means over flights, one a sample; 1 is right."""

    nees: np.ndarray
    """(K + 1,) normalized estimation error squared."""

    nis: np.ndarray
    """(K,) normalized innovation squared."""

    nees_band: tuple[float, float]
    """Where 95 % of `nees` would lie."""

    nis_band: tuple[float, float]
    """The same of `nis`."""

    @property
    def nees_inside(self) -> float:
        """Share of samples whose NEES is in its band."""
        return _share_inside(self.nees, self.nees_band)

    @property
    def nis_inside(self) -> float:
        """Share of samples whose NIS is in its band."""
        return _share_inside(self.nis, self.nis_band)


def squared_errors(estimates: Estimates, states: np.ndarray) -> np.ndarray:
    """Returns eᵀ P⁻¹ e, shape (B, K + 1), given the true x̄ (B, K + 1, N)."""
    error = states - estimates.means
    solved = np.linalg.solve(estimates.covariances, error[..., None])[..., 0]
    return np.sum(error * solved, axis=-1)


def assess(estimates: Estimates, states: np.ndarray) -> Consistency:
    """Compares the errors of some flights with what the filter says of them.

    Args:
        estimates: of `run_ekf`.
        states: (B, K + 1, N) the true x̄.
    """
    flights, _, rows = estimates.innovations.shape
    size = states.shape[2]
    return Consistency(
        nees=np.mean(squared_errors(estimates, states), axis=0) / size,
        nis=np.mean(estimates.nis, axis=0) / rows,
        nees_band=chi_square_band(flights * size),
        nis_band=chi_square_band(flights * rows),
    )


def chi_square_band(freedom: int, probability: float = 0.95) -> tuple[float, float]:
    """Returns where a chi-square over its degrees of freedom lies, with what odds."""
    tail = 0.5 * (1.0 - probability)
    low, high = chi2.ppf([tail, 1.0 - tail], freedom) / freedom
    return float(low), float(high)


def _share_inside(values: np.ndarray, band: tuple[float, float]) -> float:
    return float(np.mean((values > band[0]) & (values < band[1])))
