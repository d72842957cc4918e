"""Linear regression that says how well its data determine it, and best subsets."""

import dataclasses
from collections.abc import Sequence

import numpy as np
from threadpoolctl import threadpool_limits

from glider.errors import InputError, show

RANK_TOLERANCE = 1e-10
"""Singular values of columns of unit length below this count as zero, relative to the
largest."""

PIVOT_TOLERANCE = 1e-10
"""Pivots of G = ΦᵀΦ, of columns of unit length, below this count as zero. A pivot is
the square of a length, that of a column's part beyond the columns before it: parts
shorter than 1e-5 count as zero. RANK_TOLERANCE squared would lie below rounding."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Regression:
    """A solution of min ‖Φ β - y‖² + γ ‖β‖².

    Attributes:
        coefficients: β, (p,) or (p, k).
        squared_error: ‖Φ β - y‖² without the ridge's term, a number or (k,).
        rank: of Φ.
        singular_values: (p,) of Φ with its columns scaled to unit length.
    """

    coefficients: np.ndarray
    squared_error: np.ndarray
    rank: int
    singular_values: np.ndarray

    @property
    def has_full_rank(self) -> bool:
        """Whether the data determine every coefficient."""
        return self.rank == len(self.singular_values)

    @property
    def condition(self) -> float:
        """The largest singular value over the smallest; infinite without full rank."""
        if not self.has_full_rank:
            return np.inf
        return float(self.singular_values[0] / self.singular_values[-1])


def least_squares(
    columns: np.ndarray, targets: np.ndarray, ridge: float = 0.0
) -> Regression:
    """Solves min ‖Φ β - y‖² + γ ‖β‖² by the singular values of Φ.

    Φ itself is decomposed, not ΦᵀΦ, whose condition is the square. Without a
    ridge the columns are scaled to unit length first, and directions whose
    singular value is below RANK_TOLERANCE of the largest stay at zero; `rank`
    is how many were kept. With a ridge the columns keep their own scales,
    which γ refers to.

    Args:
        columns: Φ, (n, p).
        targets: y, (n,) or (n, k).
        ridge: γ ≥ 0.

    Raises:
        InputError: a number is not finite, the rows do not match, there is no row
            or no column, or the ridge is negative or infinite.
    """
    _check(columns, targets, "least_squares")
    if not 0.0 <= ridge < np.inf:
        raise InputError(
            f"least_squares: the ridge is {show(ridge)}; expected a finite ridge >= 0."
        )
    lengths = _lengths(columns)
    left, values, right = np.linalg.svd(columns / lengths, full_matrices=False)
    values = np.pad(values, (0, columns.shape[1] - len(values)))
    rank = int(np.count_nonzero(values > RANK_TOLERANCE * values[0]))
    if ridge > 0.0:
        own_left, own_values, own_right = np.linalg.svd(columns, full_matrices=False)
        factors = own_values / (own_values**2 + ridge)
        coefficients = (own_right.T * factors) @ (own_left.T @ targets)
    else:
        scaled = (right[:rank].T / values[:rank]) @ (left[:, :rank].T @ targets)
        coefficients = (scaled.T / lengths).T
    return Regression(
        coefficients=coefficients,
        squared_error=np.sum((targets - columns @ coefficients) ** 2, axis=0),
        rank=rank,
        singular_values=values,
    )


def _check(columns: np.ndarray, targets: np.ndarray, source: str) -> None:
    if (
        columns.ndim != 2
        or targets.ndim not in (1, 2)
        or len(columns) != len(targets)
        or columns.size == 0
    ):
        raise InputError(
            f"{source}: columns are {columns.shape} and targets {targets.shape}; "
            "(n, p) with n, p > 0 and (n,) or (n, k) are needed."
        )
    if not (np.all(np.isfinite(columns)) and np.all(np.isfinite(targets))):
        raise InputError(
            f"{source}: a column or target holds a number that is not finite; finite "
            "numbers are needed."
        )


def _lengths(columns: np.ndarray) -> np.ndarray:
    lengths = np.linalg.norm(columns, axis=0)
    return np.where(lengths > 0.0, lengths, 1.0)


@dataclasses.dataclass(frozen=True, kw_only=True)
class Subset:
    """The best few columns for one target: their indices and their regression."""

    columns: tuple[int, ...]
    regression: Regression


SOLVED_AGAIN = 4
"""Subsets whose errors are computed again for each target."""


def best_subsets(
    columns: np.ndarray, targets: np.ndarray, most: int = 3
) -> tuple[Subset, ...]:
    """Finds, among all subsets of up to three columns, the best for each target.

    A QR decomposition, then elimination for all at once (the sweep of Furnival and
    Wilson 1974): with columns of unit length, G = ΦᵀΦ and c = Φᵀy, the error falls by
    c_i² for column i, by c²_(j|i) / G_(jj|i) more for column j, where ·|i has no part
    along i, and likewise for a third. Where G_(jj|i) is below PIVOT_TOLERANCE, the
    columns depend on each other and the subset does not count. All this squares the
    condition of Φ, so the best SOLVED_AGAIN are compared by `least_squares`, and the
    winners' regressions report their rank.

    Args:
        columns: Φ, (n, p).
        targets: (n, k).
        most: size of the largest subset, 1 to 3.

    Returns:
        One subset a target, as large as `most` and the columns' rank allow.

    Raises:
        InputError: `most` is out of range, no column is of any use, or as
            `least_squares`.
    """
    if most not in (1, 2, 3):
        raise InputError(f"best_subsets: most is {most}; expected 1, 2 or 3.")
    if targets.ndim != 2:
        raise InputError(f"best_subsets: targets are {targets.shape}; expected (n, k).")
    _check(columns, targets, "best_subsets")
    with threadpool_limits(limits=1, user_api="blas"):  # Small matrices.
        return _best_subsets(columns, targets, most)


def _best_subsets(
    columns: np.ndarray, targets: np.ndarray, most: int
) -> tuple[Subset, ...]:
    # One rotation of all columns leaves the problem as it is, with p + k rows.
    both = np.linalg.qr(np.column_stack([columns, targets]), mode="r")
    turned, aims = np.split(both, [columns.shape[1]], axis=1)
    scaled = turned / _lengths(turned)
    gains = _gains(scaled.T @ scaled, aims.T @ scaled, min(most, columns.shape[1]))
    chosen = [_best(turned, aim, [g[k] for g in gains]) for k, aim in enumerate(aims.T)]
    return tuple(
        Subset(columns=few, regression=least_squares(columns[:, few], target))
        for few, target in zip(chosen, targets.T, strict=True)
    )


def _gains(gram: np.ndarray, along: np.ndarray, most: int) -> list[np.ndarray]:
    """Computes the decrease of the squared errors, for one column, two and three.

    The gain of columns i < j < m for target k stands at [k, i, j, m]; it is
    -infinite for other orders and for columns that nearly depend on each other.

    Args:
        gram: (p, p).
        along: (k, p).
        most: as in `best_subsets`.
    """
    targets, count = along.shape
    second, third = np.triu_indices(count, 1)
    gains = [
        np.full((targets, *[count] * size), -np.inf) for size in range(1, most + 1)
    ]
    gains[0][:] = _gain(along, np.diagonal(gram))
    for i in range(count - 1 if most > 1 else 0):
        if not gram[i, i] > PIVOT_TOLERANCE:
            continue
        # Of the columns after i, and of the targets, what has no part along i.
        share = gram[i, i + 1 :] / gram[i, i]
        left = gram[i + 1 :, i + 1 :] - share[:, None] * gram[i, i + 1 :]
        rest = along[:, i + 1 :] - along[:, i, None] * share
        pivots = np.diagonal(left)
        pairs = gains[0][:, i, None] + _gain(rest, pivots)
        gains[1][:, i, i + 1 :] = pairs
        if most > 2:
            # Those among the columns after i are the last of all pairs j < m.
            first = len(second) - len(left) * (len(left) - 1) // 2
            j, m = second[first:] - i - 1, third[first:] - i - 1
            between = left[j, m]
            share = between / np.maximum(pivots[j], PIVOT_TOLERANCE)
            last = _gain(rest[:, m] - share * rest[:, j], pivots[m] - share * between)
            gains[2][:, i, second[first:], third[first:]] = pairs[:, j] + last
    return gains


def _gain(along: np.ndarray, pivots: np.ndarray) -> np.ndarray:
    usable = pivots > PIVOT_TOLERANCE
    return np.where(usable, along**2 / np.where(usable, pivots, 1.0), -np.inf)


def _best(
    columns: np.ndarray, target: np.ndarray, gains: Sequence[np.ndarray]
) -> tuple[int, ...]:
    for own in reversed(gains):  # A further column never makes the error larger.
        errors = [
            (least_squares(columns[:, few], target).squared_error, few)
            for few in _largest(own)
        ]
        if errors:
            return min(errors)[1]
    raise InputError("best_subsets: every column is zero; expected at least one other.")


def _largest(gains: np.ndarray) -> list[tuple[int, ...]]:
    flat = gains.ravel()
    few = min(SOLVED_AGAIN, flat.size)
    order = np.argpartition(-flat, few - 1)[:few]
    order = order[np.isfinite(flat[order])]
    order = order[np.argsort(-flat[order], kind="stable")]
    return [tuple(map(int, np.unravel_index(i, gains.shape))) for i in order]
