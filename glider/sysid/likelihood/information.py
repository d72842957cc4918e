"""The information of flights on coefficients, one small matrix for each flight.

With the launch state eliminated, the squares of a flight's errors are a quadratic form
[δθ; -1]' R [δθ; -1] of changes of coefficients; R is the flight's information.
"""

import dataclasses
from collections.abc import Sequence
from itertools import chain

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from glider.compiled.evidence import extended


def solve_scaled(
    matrix: np.ndarray, right: np.ndarray, ridge: float = 1e-10
) -> np.ndarray:
    """Solves A x = b for coefficients of any units, (..., m).

    Rows and columns are scaled to a diagonal of one, where `ridge` is added.
    """
    scale = 1.0 / np.sqrt(np.maximum(np.diagonal(matrix, axis1=-2, axis2=-1), 1e-300))
    scaled = matrix * scale[..., :, None] * scale[..., None, :]
    scaled = scaled + ridge * np.eye(matrix.shape[-1])
    return scale * np.linalg.solve(scaled, (scale * right)[..., None])[..., 0]


def inverse(matrix: np.ndarray) -> np.ndarray:
    """Returns the inverse of a matrix (m, m) of coefficients of any units."""
    scale = 1.0 / np.sqrt(np.maximum(np.diag(matrix), 1e-300))
    scaled = matrix * scale[:, None] * scale + 1e-12 * np.eye(len(matrix))
    return np.linalg.inv(scaled) * scale[:, None] * scale


def solve(information: np.ndarray, ridge: np.ndarray | float = 0.0) -> np.ndarray:
    """Returns the minimiser δθ of [δθ; -1]' R [δθ; -1] + Σ ridge δθ²."""
    m = information.shape[0] - 1
    hessian = information[:m, :m] + np.diag(np.broadcast_to(ridge, m))
    return solve_scaled(hessian, information[:m, m])


def bounded_step(
    information: np.ndarray, lower: np.ndarray, upper: np.ndarray
) -> np.ndarray:
    """Returns the minimiser of `solve`; coefficients that leave bounds stay on them."""
    m = len(lower)
    fixed = np.zeros(m, dtype=bool)
    step = np.zeros(m)
    for _ in range(m + 1):
        loose = np.flatnonzero(~fixed)
        keep = np.append(loose, m)
        reduced = information[np.ix_(keep, keep)].copy()
        reduced[:-1, -1] -= (
            information[np.ix_(loose, np.flatnonzero(fixed))] @ step[fixed]
        )
        step[loose] = solve(reduced)
        outside = ~fixed & ((step < lower) | (step > upper))
        if not outside.any():
            break
        step[outside] = np.clip(step, lower, upper)[outside]
        fixed |= outside
    return step


@dataclasses.dataclass(frozen=True, kw_only=True)
class Evidence:
    """Squares of columns summed over flights, those that always act eliminated."""

    gram: np.ndarray  #: (M + 1, M + 1) of columns and, last, the error.
    at: np.ndarray  #: (m,) columns of the candidates, which may share one.
    precision: np.ndarray  #: (m,) of the prior of the candidates' coefficients.
    lower: np.ndarray  #: (m,) least changes that are physical.
    upper: np.ndarray  #: (m,) largest.

    def log_marginal(self, columns: Sequence[int]) -> float:
        """Returns the log marginal likelihood that columns gain over none [nats].

        ½ b' A⁻¹ b - ½ log |A| + ½ log |Λ|, A = G + Λ; minus infinity where a
        coefficient would not be physical.
        """
        return self.extended(columns, [()])[0]

    def extended(
        self, columns: Sequence[int], more: Sequence[Sequence[int]]
    ) -> list[float]:
        """Returns `log_marginal` of columns with each of several others [nats].

        A coefficient is physical within two standard errors of its bounds.
        """
        slack = 1e-9 + 2.0 / np.sqrt(self.gram.diagonal()[self.at] + self.precision)
        gains = np.empty(len(more))
        extended(
            np.ascontiguousarray(self.gram),
            self.at,
            self.precision,
            self.lower - slack,
            self.upper + slack,
            np.array(columns, dtype=int),
            np.array([*chain.from_iterable(more)], dtype=int),
            np.cumsum([len(variant) for variant in more], dtype=int),
            gains,
        )
        return gains.tolist()

    def step(self, columns: Sequence[int]) -> np.ndarray:
        """Returns the coefficients of columns, counted from zero."""
        at = self.at[list(columns)]
        a = self.gram[np.ix_(at, at)] + np.diag(self.precision[list(columns)])
        return solve_scaled(a, self.gram[at, -1], 0.0)


def counted_from(gram: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Returns Gram matrices of the model whose coefficients are less by values (m,)."""
    mix = np.append(values, 1.0)
    whole = gram.copy()
    whole[..., :, -1] = gram @ mix
    whole[..., -1, -1] = whole[..., :, -1] @ mix
    whole[..., -1, :-1] = whole[..., :-1, -1]
    return whole


def eliminate(
    gram: np.ndarray, always: Sequence[int], precision: np.ndarray, mean: np.ndarray
) -> np.ndarray:
    """Returns a Gram matrix (M + 1, M + 1) with columns solved for and eliminated.

    Their changes have a prior of such precisions and means (len(always),).
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
