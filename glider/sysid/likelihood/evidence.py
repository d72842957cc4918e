"""Which columns explain the flights: marginal likelihoods of sets, in closed form."""

import dataclasses
from collections.abc import Sequence

import numpy as np
from scipy.linalg import cho_factor, cho_solve, lapack


@dataclasses.dataclass(frozen=True, kw_only=True)
class Evidence:
    """Squares of columns summed over flights, those that always act eliminated.

    Attributes:
        gram: (m + 1, m + 1) of the candidates' columns and, last, the error.
        precision: (m,) of the candidates' coefficients beforehand.
        lower: (m,) least changes that are physical.
        upper: (m,) largest.
    """

    gram: np.ndarray
    precision: np.ndarray
    lower: np.ndarray
    upper: np.ndarray

    def log_marginal(self, columns: Sequence[int]) -> float:
        """Returns the log marginal likelihood that columns gain over none [nats].

        ½ b' A⁻¹ b - ½ log |A| + ½ log |Λ|, A = G + Λ; minus infinity where a
        coefficient would not be physical.
        """
        if not columns:
            return 0.0
        # Asked for by the ten thousand: LAPACK itself, whose wrappers take ten times
        # as long as it does.
        index = np.array(columns)
        a, b = self.gram[index[:, None], index], self.gram[index, -1]
        precision = self.precision[index]
        diagonal = a.ravel()[:: len(index) + 1]
        diagonal += precision
        factor, failed = lapack.dpotrf(a, lower=1)
        if failed:
            return -np.inf
        half, _ = lapack.dtrtrs(factor, b, lower=1)
        step, _ = lapack.dtrtrs(factor, half, lower=1, trans=1)
        slack = 1e-9 + 2.0 / np.sqrt(diagonal)
        if (step < self.lower[index] - slack).any() or (
            step > self.upper[index] + slack
        ).any():
            return -np.inf
        ratio = precision / np.square(factor.diagonal())
        return float(0.5 * (half @ half + np.log(ratio).sum()))

    def step(self, columns: Sequence[int]) -> np.ndarray:
        """Returns the coefficients of columns, counted from nothing."""
        index = list(columns)
        if not index:
            return np.zeros(0)
        a = self.gram[np.ix_(index, index)] + np.diag(self.precision[index])
        return np.linalg.solve(a, self.gram[index, -1])


def eliminate(
    gram: np.ndarray, always: Sequence[int], precision: np.ndarray, mean: np.ndarray
) -> np.ndarray:
    """Returns a Gram matrix with columns solved for and left out.

    Args:
        gram: (M + 1, M + 1), the error last.
        always: indices of the columns.
        precision: (len(always),) beforehand.
        mean: (len(always),) of their changes beforehand.
    """
    always = list(always)
    keep = [j for j in range(len(gram)) if j not in set(always)]
    if not always:
        return gram
    corner = gram[np.ix_(always, always)] + np.diag(precision)
    side = gram[np.ix_(always, keep)].copy()
    side[:, -1] += precision * mean
    scale = 1.0 / np.sqrt(np.diag(corner))
    corner = corner * scale[:, None] * scale + 1e-11 * np.eye(len(always))
    side = side * scale[:, None]
    return gram[np.ix_(keep, keep)] - side.T @ cho_solve(cho_factor(corner), side)
