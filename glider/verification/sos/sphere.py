"""Polynomials of degree 2 to 4 on the unit sphere, and their Gram matrices.

On |z| = 1 such a polynomial is the sum of an even form of degree 4, its quadratic part
times |z|² included, and an odd form of degree 3. It is a sum of squares there if
    p(z) = b(z)ᵀ Q b(z),  b = (z, √w z⊗z),  Q ⪰ 0,
with w = 1 for squares and 2 for mixed products, so that |z⊗z| = |z|². With 7 variables,
Q has 35 rows.

From one time of a flight to the next, Q barely changes. Douglas-Rachford splitting
between the matrices that represent the polynomial and those with all eigenvalues above
a margin finds the next one in a few steps of 1 ms, without a solver.
"""

import functools

import numpy as np
from scipy.linalg import block_diag
from threadpoolctl import threadpool_limits

from glider.verification.dynamics.numbers import exponents_of
from glider.verification.sos.exact import Exact, Sampled, leaves_definite
from glider.verification.sos.forms import places_of_products, substituted


class Sphere:
    """Index tables of the sphere in some dimension.

    Attributes:
        n: the dimension.
        scales: (s,) factors of b, 1 or √2.
        size: s, rows of a Gram matrix, n + n (n + 1) / 2.
        rows, columns: of the entries of a Gram matrix's lower triangle, column by
            column as Drake stacks them, (E,).
        places: (s, s) which of the C coefficients, odd then even, each product of two
            entries of b has; -1 in the block of z.
        map: (C, E) from Gram matrices' entries to coefficients.
        lift: (C₄, n, n) coefficients of (zᵀ N z) |z|² from N.
    """

    def __init__(self, n: int):
        """Makes the tables."""
        self.n = n
        squares = exponents_of(n, 2)
        is_mixed = squares.max(axis=1) == 1
        self.scales = np.append(np.ones(n), np.where(is_mixed, np.sqrt(2.0), 1.0))
        self.size = len(self.scales)
        odd = places_of_products(n, 1, 2)
        even = places_of_products(n, 2, 2)
        first_even = odd.max() + 1
        self.places = np.full((self.size, self.size), -1)
        self.places[:n, n:] = odd
        self.places[n:, :n] = odd.T
        self.places[n:, n:] = first_even + even
        pairs = places_of_products(n, 1, 1)
        i, j = np.indices((n, n))
        self.lift = np.zeros((even.max() + 1, n, n))
        for square in np.diagonal(pairs):
            self.lift[even[pairs, square], i, j] += 1.0
        self.columns, self.rows = columns, rows = np.triu_indices(self.size)
        weight = self.scales[rows] * self.scales[columns]
        weight *= np.where(rows == columns, 1.0, 2.0)
        self.map = np.zeros((first_even + len(self.lift), len(rows)))
        own = rows < n
        entries = np.flatnonzero(~own)
        self.map[self.places[rows, columns][entries], entries] = weight[entries]
        lifted = weight[own] * self.lift[:, rows[own], columns[own]]
        self.map[first_even:, own] = lifted

    @functools.cached_property
    def constant(self) -> np.ndarray:
        """Coefficients (C,) of 1 = |z|⁴."""
        one = np.einsum("cii->c", self.lift)
        return np.append(np.zeros(len(self.map) - len(one)), one)

    @functools.cached_property
    def whole(self) -> tuple[np.ndarray, np.ndarray]:
        """The map, and (E, C) from coefficients to the least such Gram matrix."""
        return self._with_least(self.map)

    @functools.cached_property
    def rest(self) -> tuple[np.ndarray, np.ndarray]:
        """The same without the block of z, which they leave as it is."""
        return self._with_least(np.where(self.rows < self.n, 0.0, self.map))

    @threadpool_limits.wrap(limits=1, user_api="blas")  # The same whatever ran before.
    def _with_least(self, linear):
        scaled = linear / np.where(self.rows == self.columns, 1.0, 2.0)
        return linear, scaled.T @ np.linalg.inv(scaled @ linear.T)

    def matrix(self, entries: np.ndarray) -> np.ndarray:
        """Returns the symmetric matrices (..., s, s) of lower triangles (..., E)."""
        full = np.zeros((*entries.shape[:-1], self.size, self.size))
        full[..., self.rows, self.columns] = entries
        full[..., self.columns, self.rows] = entries
        return full

    def entries(self, matrix: np.ndarray) -> np.ndarray:
        """Returns the lower triangles (..., E) of symmetric matrices (..., s, s)."""
        return matrix[..., self.rows, self.columns]

    def substitution(self, turn: np.ndarray) -> np.ndarray:
        """Returns the matrix (s, s) of b(turn z) = matrix b(z)."""
        scales = self.scales[self.n :]
        squares = Sampled(np.eye(len(scales))[None])
        moved = substituted(squares, 2, Sampled(turn[None])).numbers[0]
        return block_diag(turn, scales[:, None] * moved / scales)

    def coefficients(
        self, quadratic: np.ndarray, cubic: np.ndarray, quartic: np.ndarray
    ) -> np.ndarray:
        """Returns coefficients (..., C), odd then even, of zᵀ N z + cubic + quartic."""
        even = quartic + np.einsum("cij,...ij->...c", self.lift, quadratic)
        return np.concatenate([cubic, even], axis=-1)


def normalized(points: np.ndarray) -> np.ndarray:
    """Returns points (..., n) moved to the unit sphere, along their rays."""
    return points / np.linalg.norm(points, axis=-1, keepdims=True)


@functools.lru_cache(maxsize=8)
def sphere(n: int) -> Sphere:
    """Returns the tables of a dimension, made once."""
    return Sphere(n)


_ROUNDS = 300
"""Steps, of 1 ms, after which a program is solved again."""


def represent(
    tables: Sphere,
    entries: np.ndarray,
    coefficients: np.ndarray,
    block: np.ndarray | None = None,
) -> np.ndarray:
    """Returns the closest Gram matrix (E,) that has exactly these coefficients (C,).

    Where the block (n, n) of z is given, the coefficients are of the other blocks.
    """
    linear, least = tables.whole if block is None else tables.rest
    if block is not None:
        entries = entries.copy()
        own = tables.rows < tables.n
        entries[own] = block[tables.rows[own], tables.columns[own]]
    return entries + least @ (coefficients - linear @ entries)


def least_eigenvalue(tables: Sphere, entries: np.ndarray) -> float:
    """Returns the least eigenvalue of a Gram matrix."""
    return float(np.linalg.eigvalsh(tables.matrix(entries))[0])


def nearby_gram(
    tables: Sphere,
    entries: np.ndarray,
    coefficients: np.ndarray,
    margin: float,
    aim: float | None = None,
    rounds: int = _ROUNDS,
    block: np.ndarray | None = None,
) -> np.ndarray | None:
    """Returns a Gram matrix (E,) of a polynomial near another's; None if none is found.

    Args:
        entries: (E,) to start from.
        margin: least eigenvalue.
        aim: least eigenvalue that the search aims at; twice the margin if None.
        block: as for `represent`.
    """
    aim = 2.0 * margin if aim is None else aim
    state = entries
    for _ in range(rounds):
        candidate = represent(tables, state, coefficients, block)
        if least_eigenvalue(tables, candidate) >= margin:
            return candidate
        values, vectors = np.linalg.eigh(tables.matrix(2.0 * candidate - state))
        raised = (vectors * np.maximum(values, aim)) @ vectors.T
        state = state + tables.entries(raised) - candidate
    return None


def has_definite_gram(
    tables: Sphere, gram: Exact, corner: Exact, others: Exact
) -> bool:
    """Determines whether a polynomial has a positive definite Gram matrix near one.

    It is zᵀ A z, A the corner (n, n), plus one with the other coefficients (C,). What
    these differ by from those of the Gram matrix (s, s) is added to it, each in the
    first place that has its monomial.
    """
    places = tables.places
    mixed = tables.places >= 0
    known = np.zeros(len(tables.map), dtype=object)
    np.add.at(known, places[mixed], gram.numbers[0, mixed])
    left_over = others - Exact([known], gram.exponent)
    _, first = np.unique(places, return_index=True)
    rows, columns = np.unravel_index(first[1:], places.shape)  # The first is -1.
    numbers, own = np.zeros((2, 1, *places.shape), dtype=object)
    # Half of each goes to either side of the diagonal: one binary place more.
    numbers[:, rows, columns] += left_over.numbers
    numbers[:, columns, rows] += left_over.numbers
    block = corner - gram[: tables.n, : tables.n]
    own[:, : tables.n, : tables.n] = block.numbers
    change = Exact(numbers, left_over.exponent - 1) + Exact(own, block.exponent)
    return leaves_definite(gram, change)
