"""Campaigns that are exactly linear in their coefficients, drawn in no time."""

import dataclasses

import numpy as np

from glider.sysid.likelihood.information import counted_from, solve


@dataclasses.dataclass(frozen=True, kw_only=True)
class LinearCampaigns:
    """Flights of random columns and unit noise, some coefficients varying over them.

    Attributes:
        flights: of each campaign.
        coefficients: that are fitted.
        correlation: of their columns.
        variation: of each coefficient from flight to flight, as the variance that it
            adds to the estimate over the one by noise.
        leverage: log standard deviation of the flights' columns.
        rows: of each flight.
    """

    flights: int
    coefficients: int
    correlation: float = 0.0
    variation: float = 0.0
    leverage: float = 0.15
    rows: int = 30

    def draw(self, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
        """Returns the estimate's error (m,), and the flights' information about it."""
        n, m = self.flights, self.coefficients
        ones = np.ones((m, m))
        mixed = (1.0 - self.correlation) * np.eye(m) + self.correlation * ones
        x = rng.normal(size=(n, self.rows, m)) @ np.linalg.cholesky(mixed).T
        x *= np.exp(self.leverage * rng.normal(size=(n, 1, 1)))
        return estimate(np.einsum("fni,fnj->fij", x, x), self.variation, rng)


def estimate(
    hessians: np.ndarray, variation: float, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """Draws scores of flights with such information, and fits their coefficients.

    Returns:
        the estimate's error (m,) and the flights' information about the estimate.
    """
    n, m = hessians.shape[:2]
    variances = np.diag(np.linalg.inv(hessians.sum(axis=0)))
    own = np.sqrt(n * variation * variances) * rng.normal(size=(n, m))
    values, axes = np.linalg.eigh(hessians)
    noise = np.sqrt(np.maximum(values, 0.0)) * rng.normal(size=(n, m))
    scores = np.einsum("fij,fj->fi", axes, noise)
    scores += np.einsum("fij,fj->fi", hessians, own)
    grams = np.zeros((n, m + 1, m + 1))
    grams[:, :m, :m] = hessians
    grams[:, :m, m] = grams[:, m, :m] = scores
    error = solve(grams.sum(axis=0))
    return error, counted_from(grams, -error)
