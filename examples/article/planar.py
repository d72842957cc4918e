"""Polynomials of two variables, and sums of squares of them through Drake.

A polynomial is an array of coefficients c[i, j] of x₁ⁱ x₂ʲ. All here are even,
p(-x) = p(x), as Lyapunov functions of odd systems may be; then the monomials of even
and of odd degree need not be mixed in a square, and a Gram matrix has two blocks.
"""

import dataclasses
import functools

import numpy as np
from pydrake.solvers import ClarabelSolver, MathematicalProgram


@dataclasses.dataclass(frozen=True)
class Squares:
    """Sums of squares Σ_b m_bᵀ G_b m_b of monomials, of degree 1 to `half` each."""

    half: int
    """Highest degree of a monomial."""

    @property
    def blocks(self) -> tuple[list[tuple[int, int]], ...]:
        """Exponents (i, j) of the odd, then of the even monomials."""
        degrees = range(1, self.half + 1)
        every = [(d - j, j) for d in degrees for j in range(d + 1)]
        odd = [e for e in every if sum(e) % 2 == 1]
        even = [e for e in every if sum(e) % 2 == 0]
        return (odd, even) if even else (odd,)

    @property
    def sizes(self) -> list[int]:
        """Rows of each block."""
        return [len(block) for block in self.blocks]

    @functools.cached_property
    def pairs(self) -> list[tuple[tuple[int, int], tuple[int, int], int]]:
        """Two monomials and a factor for each entry of the lower triangles."""
        return [
            (block[r], block[c], 1 if r == c else 2)
            for block in self.blocks
            for r in range(len(block))
            for c in range(r + 1)
        ]

    def terms(self) -> list[np.ndarray]:
        """Returns the polynomial that each entry of the lower triangles stands for."""
        return [self.polynomial(unit) for unit in np.eye(len(self.pairs))]

    def identity(self) -> np.ndarray:
        """Returns the entries (E,) of unit matrices."""
        return np.array([float(first == second) for first, second, _ in self.pairs])

    def polynomial(self, entries: np.ndarray) -> np.ndarray:
        """Returns the polynomial of Gram matrices, given their entries (E,)."""
        total = np.zeros((2 * self.half + 1,) * 2, dtype=entries.dtype)
        for entry, (first, second, factor) in zip(entries, self.pairs, strict=True):
            total[first[0] + second[0], first[1] + second[1]] += factor * entry
        return total

    def matrices(self, entries: np.ndarray) -> list[np.ndarray]:
        """Returns the Gram matrices of entries (E,), of any type of number."""
        found, first = [], 0
        for size in self.sizes:
            rows, columns = np.tril_indices(size)
            matrix = np.zeros((size, size), dtype=entries.dtype)
            matrix[rows, columns] = entries[first : first + len(rows)]
            matrix[columns, rows] = matrix[rows, columns]
            found.append(matrix)
            first += len(rows)
        return found


def product(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Returns the product of two polynomials, of floats or of whole numbers."""
    size = len(a) + len(b) - 1
    total = np.zeros((size, size), dtype=np.result_type(a, b))
    for i, j in np.argwhere(a != 0):
        total[i : i + len(b), j : j + len(b)] += a[i, j] * b
    return total


def gradient(a: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Returns the derivatives by x₁ and by x₂."""
    powers = np.arange(len(a)).astype(a.dtype)
    by_first, by_second = np.zeros_like(a), np.zeros_like(a)
    by_first[:-1] = (powers[:, None] * a)[1:]
    by_second[:, :-1] = (powers * a)[:, 1:]
    return by_first, by_second


def padded(a: np.ndarray, size: int) -> np.ndarray:
    """Returns a polynomial as an array (size, size); what is cut off must be zero."""
    total = np.zeros((size, size), dtype=a.dtype)
    kept = min(size, len(a))
    total[:kept, :kept] = a[:kept, :kept]
    return total


def values(a: np.ndarray, x: np.ndarray) -> np.ndarray:
    """Returns the values (K,) at points (2, K)."""
    return np.polynomial.polynomial.polyval2d(x[0], x[1], a)


def solve(
    sizes: list[int], rows: np.ndarray, targets: np.ndarray, gain: np.ndarray
) -> tuple[bool, np.ndarray]:
    """Maximizes gainᵀ v so that rows v = targets and the matrices in v are positive.

    Args:
        sizes: of the matrices, whose lower triangles, row by row, begin v; what
            follows them is free.
        rows: (R, len(v)).
        targets: (R,).
        gain: (len(v),).

    Returns:
        whether the solver succeeded, and v.
    """
    program = MathematicalProgram()
    pieces = []
    for size in sizes:
        matrix = program.NewSymmetricContinuousVariables(size)
        program.AddPositiveSemidefiniteConstraint(matrix)
        pieces.append(matrix[np.tril_indices(size)])
    free = len(gain) - sum(len(piece) for piece in pieces)
    pieces.append(program.NewContinuousVariables(free))
    v = np.concatenate(pieces)
    used = np.any(rows != 0.0, axis=1) | (targets != 0.0)
    program.AddLinearEqualityConstraint(rows[used], targets[used], v)
    program.AddLinearCost(-gain, 0.0, v)
    result = ClarabelSolver().Solve(program)
    return result.is_success(), np.asarray(result.GetSolution(v), dtype=float)
