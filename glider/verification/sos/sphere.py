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
import itertools

import numpy as np
from threadpoolctl import threadpool_limits

from glider.verification.dynamics.jets import exponents_of


class Sphere:
    """Index tables of the sphere in some dimension.

    Attributes:
        n: the dimension.
        cubic, quartic: exponents of the monomials of degree 3 and 4, C₃ and C₄ tuples.
        basis: (s, n) exponents of b.
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
        self.cubic = [tuple(e) for e in exponents_of(n, 3)]
        self.quartic = [tuple(e) for e in exponents_of(n, 4)]
        place = {e: k for k, e in enumerate(self.cubic + self.quartic)}
        self.basis = np.concatenate([exponents_of(n, 1), exponents_of(n, 2)])
        mixed = (self.basis > 0).sum(axis=1) == 2
        self.scales = np.where(mixed, np.sqrt(2.0), 1.0)
        self.size = len(self.basis)
        products = self.basis[:, None] + self.basis
        self.places = np.array([[place.get(tuple(e), -1) for e in r] for r in products])
        self.lift = np.zeros((len(self.quartic), n, n))
        unit = self.basis[:n]
        for i, j, k in itertools.product(range(n), repeat=3):
            even = place[tuple(unit[i] + unit[j] + 2 * unit[k])] - len(self.cubic)
            self.lift[even, i, j] += 1.0
        self.columns, self.rows = columns, rows = np.triu_indices(self.size)
        weight = self.scales[rows] * self.scales[columns]
        weight *= np.where(rows == columns, 1.0, 2.0)
        self.map = np.zeros((len(place), len(rows)))
        own = rows < n
        entries = np.flatnonzero(~own)
        self.map[self.places[rows, columns][entries], entries] = weight[entries]
        lifted = weight[own] * self.lift[:, rows[own], columns[own]]
        self.map[len(self.cubic) :, own] = lifted

    @functools.cached_property
    def constant(self) -> np.ndarray:
        """Coefficients (C,) of 1 = |z|⁴."""
        one = np.einsum("cii->c", self.lift)
        return np.concatenate([np.zeros(len(self.cubic)), one])

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
        n = self.n
        scales = self.scales[self.n :]
        i, j = np.array([np.repeat(np.arange(n), e) for e in self.basis[n:]]).T
        both = turn[i][:, i] * turn[j][:, j] + turn[i][:, j] * turn[j][:, i]
        matrix = np.zeros((self.size, self.size))
        matrix[:n, :n] = turn
        matrix[n:, n:] = scales[:, None] * both / (scales * np.where(i == j, 2.0, 1.0))
        return matrix

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
