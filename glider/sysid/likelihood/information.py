"""The information of flights on coefficients, one small matrix for each flight.

With the launch state eliminated, the squares of a flight's errors are a quadratic form
[δθ; -1]' R [δθ; -1] of changes of coefficients; R is the flight's information. Its
last row and column are those of the error. Flights are independent, so that the
information of several is the sum of theirs; a prior is added like one more flight.
`Evidence` compares sets of columns on such a sum, without a look at the flights.
"""

import dataclasses
from collections.abc import Sequence
from itertools import chain

import numpy as np
from scipy.optimize import lsq_linear

from glider.compiled.evidence import extended

_RIDGE = 1e-10  # Added to matrices with a diagonal of one, which may be singular.
_MOST_RELEASES = 10  # Of each coefficient from a bound; most steps need none.


def _scaled(matrix: np.ndarray, ridge: float) -> tuple[np.ndarray, np.ndarray]:
    """Returns D A D + ridge I, with a diagonal of one, and diagonal D as (..., m)."""
    diagonal = np.diagonal(matrix, axis1=-2, axis2=-1)
    scale = 1.0 / np.sqrt(np.maximum(diagonal, 1e-300))
    scaled = matrix * scale[..., :, None] * scale[..., None, :]
    return scaled + ridge * np.eye(matrix.shape[-1]), scale


def solve_scaled(
    matrix: np.ndarray, right: np.ndarray, ridge: float = _RIDGE
) -> np.ndarray:
    """Solves A x = b for coefficients of any units.

    Rows and columns are scaled to a diagonal of one, where `ridge` is added.

    Args:
        matrix: A, (m, m) for all of b, or (..., m, m) with one for each.
        right: b, (..., m).
        ridge: zero for matrices that are certainly far from singular.

    Returns:
        x, (..., m).
    """
    scaled, scale = _scaled(matrix, ridge)
    right = scale * right
    if matrix.ndim == 2:
        return scale * np.linalg.solve(scaled, right.T).T
    return scale * np.linalg.solve(scaled, right[..., None])[..., 0]


def solve(information: np.ndarray) -> np.ndarray:
    """Returns the minimiser δθ (m,) of [δθ; -1]' R [δθ; -1]."""
    return solve_scaled(information[:-1, :-1], information[:-1, -1])


def bounded_step(
    information: np.ndarray, lower: np.ndarray, upper: np.ndarray
) -> np.ndarray:
    """Returns the minimiser δθ (m,) of [δθ; -1]' R [δθ; -1] between bounds.

    Where the minimiser of `solve` is within them it is that one. Coefficients that end
    on a bound equal it exactly.

    Args:
        information: R, (m + 1, m + 1).
        lower: least changes, (m,).
        upper: largest changes, (m,).
    """
    step = solve(information)
    outside = (step < lower) | (step > upper)
    if not outside.any() or not np.all(np.isfinite(step)):  # Or it diverges.
        return step

    # With H = L L', the quadratic is |L' δθ - L⁻¹ b|²: bounded least squares.
    scaled, scale = _scaled(information[:-1, :-1], _RIDGE)
    root = np.linalg.cholesky(scaled)
    found = lsq_linear(
        root.T,
        np.linalg.solve(root, scale * information[:-1, -1]),
        (lower / scale, upper / scale),
        method="bvls",
        max_iter=_MOST_RELEASES * len(lower),
    )

    # Scaling back rounds: what is on a bound is set to it.
    step = np.clip(scale * found.x, lower, upper)
    step = np.where(found.active_mask < 0, lower, step)
    return np.where(found.active_mask > 0, upper, step)


@dataclasses.dataclass(frozen=True, kw_only=True)
class Prior:
    """Normal prior of changes of coefficients: of slots of theta, then of functions.

    Attributes:
        mean: μ, (m,) expected changes, in the coefficients' units.
        precision: Λ, (m,) inverse variances of the changes.
        lower: (m,) least changes that are physical.
        upper: (m,) largest changes that are physical.
    """

    mean: np.ndarray
    precision: np.ndarray
    lower: np.ndarray
    upper: np.ndarray

    def among(self, columns: Sequence[int]) -> "Prior":
        """Returns the prior of some of the columns."""
        return Prior(**{name: own[columns] for name, own in vars(self).items()})

    def added_to(self, gram: np.ndarray) -> np.ndarray:
        """Returns a Gram matrix with the prior added as one more flight.

        Its own information is [Λ, Λμ; μ'Λ, μ'Λμ].

        Args:
            gram: (m + 1, m + 1), that of the error last.
        """
        total = gram.copy()
        total[:-1, :-1] += np.diag(self.precision)
        total[:-1, -1] += self.precision * self.mean
        total[-1, :-1] = total[:-1, -1]
        total[-1, -1] += float(self.precision @ self.mean**2)
        return total

    def best_step(self, gram: np.ndarray) -> np.ndarray:
        """Returns the most probable physical change (m,), given flights' information.

        This is the step of a Gauss-Newton iteration.
        """
        return bounded_step(self.added_to(gram), self.lower, self.upper)

    def gain(self, gram: np.ndarray, step: np.ndarray) -> float:
        """Returns by how much a change (m,) is more probable than none [nats].

        With the prior's information in R, ½ (e'e - [δθ; -1]' R [δθ; -1]).
        """
        total = self.added_to(gram)
        left = np.append(-step, 1.0)  # The error that is left, as a mix of columns.
        return 0.5 * float(total[-1, -1] - left @ total @ left)


@dataclasses.dataclass(frozen=True, kw_only=True)
class Evidence:
    """Squares of columns summed over flights, those that always act eliminated.

    Attributes:
        gram: (M + 1, M + 1) of the columns and, last, of the error.
        at: (m,) column of each candidate; several candidates may share one.
        prior: of the candidates' coefficients.
    """

    gram: np.ndarray
    at: np.ndarray
    prior: Prior

    def extended(
        self, columns: Sequence[int], more: Sequence[Sequence[int]]
    ) -> list[float]:
        """Returns what columns with each of several others gain over none [nats].

        In log marginal likelihood: ½ b' A⁻¹ b - ½ log |A| + ½ log |Λ|, A = G + Λ; minus
        infinity where a coefficient is not physical, to two standard errors.

        Args:
            columns: candidates that are in all sets.
            more: the other candidates of each set.
        """
        prior = self.prior
        slack = 1e-9 + 2.0 / np.sqrt(self.gram.diagonal()[self.at] + prior.precision)
        gains = np.empty(len(more))

        # The other candidates of all sets follow as one array, with each set's end.
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
    """Returns Gram matrices of the model whose coefficients are less by some values.

    Its error is e + Σ_j values_j column_j; the columns stay.

    Args:
        gram: (..., m + 1, m + 1), one for each flight or their sum.
        values: (m,).
    """
    mix = np.append(values, 1.0)
    whole = gram.copy()
    of_error = whole[..., -1]  # A view, so that the matrices change with it.
    of_error[:] = gram @ mix
    of_error[..., -1] = of_error @ mix
    whole[..., -1, :-1] = of_error[..., :-1]
    return whole


def eliminate(
    gram: np.ndarray, always: Sequence[int], precision: np.ndarray
) -> np.ndarray:
    """Returns a Gram matrix with columns solved for and eliminated.

    That is the Schur complement G - B (C + Λ)⁻¹ B', with B the columns' products with
    all others and C those with one another. Their own rows mean nothing afterwards.

    Args:
        gram: G, (M + 1, M + 1).
        always: the columns to eliminate.
        precision: Λ, (len(always),) of the prior of their changes, about zero.
    """
    side = gram[:, list(always)]
    corner = gram[np.ix_(always, always)] + np.diag(precision)
    return gram - side @ solve_scaled(corner, side, 1e-11).T
