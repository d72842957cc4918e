"""Exact arithmetic on arrays: whole numbers times powers of two.

Every double is such a number, so that nothing needs rounding. A matrix is positive
definite exactly if its leading minors are positive, and fraction-free elimination
(Bareiss 1968) has them as its pivots. What is no number or infinite is refused.
"""

import math
from fractions import Fraction
from typing import Any

import numpy as np


class Exact:
    """An array of whole numbers times 2^exponent.

    Attributes:
        numbers: array of Python's int.
        exponent: of 2, common to all.
    """

    def __init__(self, numbers: np.ndarray, exponent: int):
        """Takes the whole numbers and their common exponent."""
        self.numbers = np.asarray(numbers, dtype=object)  # A sum of two is an int.
        self.exponent = exponent

    def __add__(self, other: "Exact") -> "Exact":
        low = min(self.exponent, other.exponent)
        return Exact(self.at(low) + other.at(low), low)

    def __sub__(self, other: "Exact") -> "Exact":
        return self + Exact(-other.numbers, other.exponent)

    def __matmul__(self, other: "Exact") -> "Exact":
        product = np.dot(self.numbers, other.numbers)
        return Exact(product, self.exponent + other.exponent)

    def scaled(self, factor: int) -> "Exact":
        """Returns the array times a whole number."""
        return Exact(self.numbers * factor, self.exponent)

    def times(self, other: "Exact") -> "Exact":
        """Returns the product entry by entry."""
        return Exact(self.numbers * other.numbers, self.exponent + other.exponent)

    def of(self, index: Any) -> "Exact":
        """Returns a part of the array."""
        return Exact(self.numbers[index], self.exponent)

    def summed(self) -> "Exact":
        """Returns the sum of all entries."""
        return Exact(self.numbers.sum(), self.exponent)

    def padded(self, size: int) -> "Exact":
        """Returns a square matrix with zeros below and to the right, up to a size."""
        numbers = np.zeros((size, size), dtype=object)
        numbers[: len(self.numbers), : len(self.numbers)] = self.numbers
        return Exact(numbers, self.exponent)

    def transposed(self) -> "Exact":
        """Returns the transpose."""
        return Exact(self.numbers.T, self.exponent)

    def at(self, exponent: int) -> np.ndarray:
        """Returns the whole numbers for a lower common exponent."""
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
    """Returns doubles as they are, without rounding.

    Raises:
        ValueError: where they are not finite.
    """
    array = _finite(values)
    mantissas, exponents = np.frexp(array)
    whole = np.ldexp(mantissas, 53).astype(np.int64).astype(object)
    used = exponents[mantissas != 0.0]
    low = int(used.min()) if used.size else 0
    shifts = np.where(mantissas != 0.0, exponents - low, 0).astype(object)
    return Exact(whole * (2**shifts), low - 53)


def rounded(values: np.ndarray, bits: int) -> Exact:
    """Returns doubles rounded to so many binary places.

    Raises:
        ValueError: where they are not finite, or too large for it.
    """
    with np.errstate(over="ignore"):
        whole = np.rint(_finite(np.ldexp(np.asarray(values, dtype=float), bits)))
    numbers = np.array([int(v) for v in whole.ravel()], dtype=object)
    return Exact(numbers.reshape(whole.shape), -bits)


def fractions(values: np.ndarray | float) -> np.ndarray:
    """Returns doubles as they are, as an array of fractions."""
    return np.vectorize(Fraction, otypes=[object])(_finite(values))


def dyadic(values: np.ndarray) -> Exact:
    """Returns fractions whose denominators are powers of 2, without rounding."""
    array = np.asarray(values, dtype=object)
    common = max(value.denominator for value in array.ravel())
    numbers = np.array([int(value * common) for value in array.ravel()], dtype=object)
    return Exact(numbers.reshape(array.shape), 1 - common.bit_length())


def at_least(value: Fraction, bits: int = 60) -> Exact:
    """Returns a number of so many bits, or one more, that is not below a fraction."""
    size = value.numerator.bit_length() - value.denominator.bit_length()
    whole = math.ceil(value * Fraction(2) ** (bits - size))
    return Exact(np.array(whole, dtype=object), size - bits)


def _finite(values):
    array = np.asarray(values, dtype=float)
    if not np.all(np.isfinite(array)):
        raise ValueError("exact arithmetic is of finite numbers")
    return array


def is_positive_definite(matrix: Exact) -> bool:
    """Returns whether a symmetric matrix is, by the signs of its leading minors."""
    minor = matrix.numbers.copy()
    if not np.array_equal(minor, minor.T):
        return False
    before = 1
    while len(minor):
        pivot = minor[0, 0]
        if pivot <= 0:
            return False
        column = minor[1:, 0]
        minor = (minor[1:, 1:] * pivot - np.multiply.outer(column, column)) // before
        before = pivot
    return True


def leaves_definite(gram: Exact, change: Exact) -> tuple[bool, float]:
    """Returns whether gram + change is positive definite for sure.

    A symmetric matrix whose rows sum to μ in absolute values changes no eigenvalue by
    more than μ (Gershgorin), so that gram - μ I is checked.

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
