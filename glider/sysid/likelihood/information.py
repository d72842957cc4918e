"""The information of flights on coefficients, one small matrix for each flight.

With the launch state eliminated, the squares of a flight's errors are a quadratic form
[δθ; -1]' R [δθ; -1] of changes of coefficients; R is the flight's information.
"""

import dataclasses
from collections.abc import Sequence
from itertools import chain

import numpy as np
from scipy.optimize import lsq_linear

from glider.compiled.evidence import extended

_RIDGE = 1e-10  # Added to matrices with a diagonal of one, which may be singular.
_MOST_RELEASES = 10  # Of each coefficient from a bound; most steps need none.


def solve_scaled(
    matrix: np.ndarray, right: np.ndarray, ridge: float = _RIDGE
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
    """Returns the minimiser of [δθ; -1]' R [δθ; -1] between bounds.

    Where the minimiser of `solve` is within them it is that one. Coefficients that end
    on a bound equal it exactly.
    """
    step = solve(information)
    outside = (step < lower) | (step > upper)
    if not outside.any() or not np.all(np.isfinite(step)):  # Or it diverges.
        return step
    hessian = information[:-1, :-1]
    right = information[:-1, -1]
    scale = 1.0 / np.sqrt(np.maximum(np.diagonal(hessian), 1e-300))
    scaled = hessian * scale[:, None] * scale + _RIDGE * np.eye(len(hessian))
    root = np.linalg.cholesky(scaled)
    found = lsq_linear(
        root.T,
        np.linalg.solve(root, scale * right),
        (lower / scale, upper / scale),
        method="bvls",
        max_iter=_MOST_RELEASES * len(lower),
    )

    step = np.clip(scale * found.x, lower, upper)
    step = np.where(found.active_mask < 0, lower, step)
    return np.where(found.active_mask > 0, upper, step)


@dataclasses.dataclass(frozen=True, kw_only=True)
class Prior:
    """Prior of changes of coefficients: of slots of theta, then of functions."""

    mean: np.ndarray  #: (m,) expected changes.
    precision: np.ndarray  #: (m,)
    lower: np.ndarray  #: (m,) least changes that are physical.
    upper: np.ndarray  #: (m,) largest.

    def among(self, columns: Sequence[int]) -> "Prior":
        """Returns the prior of some of the columns."""
        return Prior(**{name: own[columns] for name, own in vars(self).items()})

    def added_to(self, gram: np.ndarray) -> np.ndarray:
        """Returns a Gram matrix with the prior added as one more flight."""
        total = gram.copy()
        total[:-1, :-1] += np.diag(self.precision)
        total[:-1, -1] += self.precision * self.mean
        total[-1, :-1] = total[:-1, -1]
        total[-1, -1] += float(self.precision @ self.mean**2)
        return total

    def best_step(self, gram: np.ndarray) -> np.ndarray:
        """Returns the most probable physical change (m,)."""
        return bounded_step(self.added_to(gram), self.lower, self.upper)

    def gain(self, gram: np.ndarray, step: np.ndarray) -> float:
        """Returns by how much a change (m,) is more probable than none [nats]."""
        total = self.added_to(gram)
        left = np.append(-step, 1.0)
        return 0.5 * float(total[-1, -1] - left @ total @ left)


@dataclasses.dataclass(frozen=True, kw_only=True)
class Evidence:
    """Squares of columns summed over flights, those that always act eliminated."""

    gram: np.ndarray  #: (M + 1, M + 1) of columns and, last, the error.
    at: np.ndarray  #: (m,) columns of the candidates, which may share one.
    prior: Prior  #: Of the candidates' coefficients.

    def extended(
        self, columns: Sequence[int], more: Sequence[Sequence[int]]
    ) -> list[float]:
        """Returns what columns with each of several others gain over none [nats].

        In log marginal likelihood: ½ b' A⁻¹ b - ½ log |A| + ½ log |Λ|, A = G + Λ; minus
        infinity where a coefficient is not physical, to two standard errors.
        """
        prior = self.prior
        slack = 1e-9 + 2.0 / np.sqrt(self.gram.diagonal()[self.at] + prior.precision)
        gains = np.empty(len(more))
        extended(
            np.ascontiguousarray(self.gram),
            self.at,
            prior.precision,
            prior.lower - slack,
            prior.upper + slack,
            np.array(columns, dtype=int),
            np.array([*chain.from_iterable(more)], dtype=int),
            np.cumsum([len(variant) for variant in more], dtype=int),
            gains,
        )

        return gains.tolist()

    def step(self, columns: Sequence[int]) -> np.ndarray:
        """Returns the likeliest physical coefficients of columns, counted from zero."""
        own = list(columns)
        at = [*self.at[own], -1]
        return self.prior.among(own).best_step(self.gram[np.ix_(at, at)])


def counted_from(gram: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Returns Gram matrices of the model whose coefficients are less by values (m,)."""
    mix = np.append(values, 1.0)
    whole = gram.copy()
    whole[..., :, -1] = gram @ mix
    whole[..., -1, -1] = whole[..., :, -1] @ mix
    whole[..., -1, :-1] = whole[..., :-1, -1]
    return whole


def eliminate(
    gram: np.ndarray, always: Sequence[int], precision: np.ndarray
) -> np.ndarray:
    """Returns a Gram matrix (M + 1, M + 1) with columns solved for and eliminated.

    Their changes have a prior of such precisions (len(always),) about zero; their own
    rows mean nothing afterwards.
    """
    side = gram[:, list(always)]
    corner = gram[np.ix_(always, always)]
    return gram - side @ solve_scaled(corner + np.diag(precision), side, 1e-11).T
