"""The information of flights on coefficients, one small matrix for each flight.

With the launch state eliminated, the squares of a flight's errors are a quadratic form
[δθ; -1]' R [δθ; -1] of changes of coefficients; R is the flight's information.
"""

import dataclasses
from collections.abc import Sequence
from itertools import chain

import numpy as np

from glider.compiled.evidence import extended


def solve_scaled(
    matrix: np.ndarray, right: np.ndarray, ridge: float = 1e-10
) -> np.ndarray:
    """Solves A x = b for coefficients of any units, (..., m); of one A for many b.

    Rows and columns are scaled to a diagonal of one, where `ridge` is added.
    """
    scale = 1.0 / np.sqrt(np.maximum(np.diagonal(matrix, axis1=-2, axis2=-1), 1e-300))
    scaled = matrix * scale[..., :, None] * scale[..., None, :]
    scaled = scaled + ridge * np.eye(matrix.shape[-1])
    right = scale * right
    if matrix.ndim == 2:
        return scale * np.linalg.solve(scaled, right.T).T
    return scale * np.linalg.solve(scaled, right[..., None])[..., 0]


def solve(information: np.ndarray) -> np.ndarray:
    """Returns the minimiser δθ of [δθ; -1]' R [δθ; -1]."""
    return solve_scaled(information[:-1, :-1], information[:-1, -1])


def bounded_step(
    information: np.ndarray, lower: np.ndarray, upper: np.ndarray
) -> np.ndarray:
    """Returns the minimiser of `solve`; coefficients that leave bounds stay on them."""
    hessian, right = information[:-1, :-1], information[:-1, -1]
    step, fixed = np.zeros(len(lower)), np.zeros(len(lower), dtype=bool)
    while True:
        loose, others = np.flatnonzero(~fixed), np.flatnonzero(fixed)
        rest = right[loose] - hessian[np.ix_(loose, others)] @ step[others]
        step[loose] = solve_scaled(hessian[np.ix_(loose, loose)], rest)
        outside = ~fixed & ((step < lower) | (step > upper))
        if not outside.any():
            return step
        step[outside] = np.clip(step, lower, upper)[outside]
        fixed |= outside


@dataclasses.dataclass(frozen=True, kw_only=True)
class Evidence:
    """Squares of columns summed over flights, those that always act eliminated."""

    gram: np.ndarray  #: (M + 1, M + 1) of columns and, last, the error.
    at: np.ndarray  #: (m,) columns of the candidates, which may share one.
    precision: np.ndarray  #: (m,) of the prior of the candidates' coefficients.
    lower: np.ndarray  #: (m,) least changes that are physical.
    upper: np.ndarray  #: (m,) largest.

    def extended(
        self, columns: Sequence[int], more: Sequence[Sequence[int]]
    ) -> list[float]:
        """Returns what columns with each of several others gain over none [nats].

        In log marginal likelihood: ½ b' A⁻¹ b - ½ log |A| + ½ log |Λ|, A = G + Λ; minus
        infinity where a coefficient is not physical, to two standard errors.
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

    Their changes have a prior of such precisions and means (len(always),); their own
    rows mean nothing afterwards.
    """
    side, corner = gram[:, list(always)], gram[np.ix_(always, always)]
    side[-1] += precision * mean
    return gram - side @ solve_scaled(corner + np.diag(precision), side, 1e-11).T
