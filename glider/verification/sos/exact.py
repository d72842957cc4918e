"""Exact arithmetic on arrays: integers times powers of two.

Every double is such a number, so that nothing needs rounding. Values that are not
finite are refused.
"""

import math
from fractions import Fraction
from typing import Any

import numpy as np
from flint import fmpz_mat


class Exact:
    """An array of integers times 2^exponent, with NumPy's operators + - * @ and [].

    Attributes:
        numbers: array of Python's int: in `np.tensordot` twice as fast as FLINT's.
        exponent: of 2, common to all.
    """

    def __init__(self, numbers: Any, exponent: int):
        """Takes the integers and their common exponent."""
        self.numbers = np.asarray(numbers, dtype=object)  # A sum of two is an int.
        self.exponent = exponent

    def __add__(self, other: "Exact") -> "Exact":
        if not isinstance(other, Exact):
            return NotImplemented
        low = min(self.exponent, other.exponent)
        return Exact(self.at(low) + other.at(low), low)

    def __neg__(self) -> "Exact":
        return Exact(-self.numbers, self.exponent)

    def __sub__(self, other: "Exact") -> "Exact":
        return self + -other if isinstance(other, Exact) else NotImplemented

    def __mul__(self, other: "Exact | int") -> "Exact":
        """Multiplies entry by entry."""
        if isinstance(other, int):
            return Exact(self.numbers * other, self.exponent)
        if not isinstance(other, Exact):
            return NotImplemented
        return Exact(self.numbers * other.numbers, self.exponent + other.exponent)

    def __matmul__(self, other: "Exact") -> "Exact":
        if not isinstance(other, Exact):
            return NotImplemented
        product = np.dot(self.numbers, other.numbers)
        return Exact(product, self.exponent + other.exponent)

    def __getitem__(self, index: Any) -> "Exact":
        return Exact(self.numbers[index], self.exponent)

    def __len__(self) -> int:
        return len(self.numbers)

    @property
    def T(self) -> "Exact":
        """Transpose."""
        return Exact(self.numbers.T, self.exponent)

    def sum(self) -> "Exact":
        """Returns the sum of all entries."""
        return Exact(self.numbers.sum(), self.exponent)

    def at(self, exponent: int) -> np.ndarray:
        """Returns the integers for a lower common exponent."""
        return self.numbers * (1 << (self.exponent - exponent))

    def to_float(self) -> np.ndarray:
        """Returns the nearest doubles."""
        shift = self.exponent
        values = [
            float(v << shift) if shift >= 0 else v / (1 << -shift)
            for v in self.numbers.ravel()
        ]
        return np.array(values).reshape(self.numbers.shape)


def exact(values: np.ndarray | float) -> Exact:
    """Converts doubles without rounding; ValueError where they are not finite."""
    array = _finite(values)
    mantissas, exponents = np.frexp(array)
    whole = np.ldexp(mantissas, 53).astype(np.int64).astype(object)
    used = exponents[mantissas != 0.0]
    low = int(used.min()) if used.size else 0
    shifts = np.where(mantissas != 0.0, exponents - low, 0).astype(object)
    return Exact(whole * (2**shifts), low - 53)


def rounded(values: np.ndarray, bits: int) -> Exact:
    """Rounds doubles to so many binary places.

    Raises:
        ValueError: where they are not finite, or overflow.
    """
    with np.errstate(over="ignore"):
        whole = np.rint(_finite(np.ldexp(np.asarray(values, dtype=float), bits)))
    return Exact(np.vectorize(int, otypes=[object])(whole), -bits)


def fractions(values: np.ndarray | float) -> np.ndarray:
    """Converts doubles to an array of fractions, without rounding."""
    return np.vectorize(Fraction, otypes=[object])(_finite(values))


def dyadic(values: Any) -> Exact:
    """Converts fractions whose denominators are powers of 2, without rounding."""
    array = np.asarray(values, dtype=object)
    common = max(value.denominator for value in array.ravel())
    numbers = np.vectorize(lambda value: int(value * common), otypes=[object])(array)
    return Exact(numbers, 1 - common.bit_length())


def at_least(value: Fraction, bits: int = 60) -> Exact:
    """Rounds a fraction up to a number of so many bits, or one more."""
    size = value.numerator.bit_length() - value.denominator.bit_length()
    return Exact(math.ceil(value * Fraction(2) ** (bits - size)), size - bits)


def _finite(values):
    array = np.asarray(values, dtype=float)
    if not np.all(np.isfinite(array)):
        raise ValueError("exact arithmetic needs finite numbers")
    return array


def is_positive_definite(matrix: Exact) -> bool:
    """Determines whether a symmetric matrix is, by its characteristic polynomial.

    All roots of that are real. They are positive exactly if its coefficients alternate
    in sign and none is zero (Descartes).
    """
    numbers = matrix.numbers
    if not np.array_equal(numbers, numbers.T):
        return False
    coefficients = fmpz_mat(numbers.tolist()).charpoly().coeffs()
    return all((-1) ** k * c > 0 for k, c in enumerate(reversed(coefficients)))


def leaves_definite(gram: Exact, change: Exact) -> tuple[bool, float]:
    """Determines whether gram + change is positive definite for certain.

    A symmetric matrix whose rows sum to at most μ in absolute values changes no
    eigenvalue by more than μ (Gershgorin), so that gram - μ I is checked.

    Args:
        gram: symmetric, of few digits.
        change: symmetric, small, of any digits.

    Returns:
        the answer and μ.
    """
    sums = np.abs(change.numbers).sum(axis=1) if change.numbers.size else np.zeros(1)
    shift = gram.exponent - change.exponent
    largest = int(max(sums))
    units = -(-largest // (1 << shift)) if shift >= 0 else largest << -shift
    lowered = gram.numbers.copy()
    lowered[np.diag_indices(len(lowered))] -= units
    slack = float(units) * 2.0**gram.exponent
    return is_positive_definite(Exact(lowered, gram.exponent)), slack
