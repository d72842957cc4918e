"""Exact arithmetic on arrays of integers times powers of two, and polynomials of them.

Every double is such a number, so that nothing needs rounding. Values that are not
finite are refused. Polynomials are in time over an interval, without a division: with τ
from 0 to 1,
    p(τ) = Σ_j p_j τʲ (1 - τ)^(d - j),
the p_j being arrays: Bernstein's form without its factor, binomial(d, j). Products are
convolutions, and where all p_j are positive definite, so is p at every τ.
"""

import dataclasses
import functools
import math
import operator
from collections.abc import Callable
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
    """Determines whether gram + change is positive definite for certain; returns μ too.

    A symmetric matrix whose rows sum to at most μ in absolute values changes no
    eigenvalue by more than μ (Gershgorin), so that gram - μ I is checked. Gram is of
    few digits, the change is small and of any.
    """
    sums = np.abs(change.numbers).sum(axis=1) if change.numbers.size else np.zeros(1)
    shift = gram.exponent - change.exponent
    largest = int(max(sums))
    units = -(-largest // (1 << shift)) if shift >= 0 else largest << -shift
    lowered = gram.numbers.copy()
    lowered[np.diag_indices(len(lowered))] -= units
    slack = float(units) * 2.0**gram.exponent
    return is_positive_definite(Exact(lowered, gram.exponent)), slack


@dataclasses.dataclass(frozen=True)
class InTime:
    """A polynomial in time, with NumPy's operators + - * @ and [].

    An Exact joins in as a constant.
    """

    parts: tuple[Exact, ...]  #: Its p_j.

    @property
    def degree(self) -> int:
        """Degree d."""
        return len(self.parts) - 1

    def map(self, function: Callable[[Exact], Exact]) -> "InTime":
        """Returns a linear function of the polynomial."""
        return InTime(tuple(map(function, self.parts)))

    def product(self, other: "InTime | Exact", multiply: Callable) -> "InTime":
        """Returns a product, given that of two arrays."""
        mine, theirs = self.parts, _in_time(other).parts
        return InTime(
            tuple(
                _sum(
                    multiply(mine[i], theirs[k - i])
                    for i in range(max(0, k - len(theirs) + 1), min(k + 1, len(mine)))
                )
                for k in range(len(mine) + len(theirs) - 1)
            )
        )

    def __mul__(self, other: "InTime | Exact | int") -> "InTime":
        """Multiplies entry by entry."""
        if isinstance(other, int):
            return self.map(lambda part: part * other)
        return self.product(other, operator.mul)

    __rmul__ = __mul__

    def __matmul__(self, other: "InTime | Exact") -> "InTime":
        return self.product(other, operator.matmul)

    def __rmatmul__(self, other: Exact) -> "InTime":
        return _in_time(other) @ self

    def __add__(self, other: "InTime | Exact") -> "InTime":
        more = _in_time(other)
        degree = max(self.degree, more.degree)
        pairs = zip(self.raised(degree).parts, more.raised(degree).parts, strict=True)
        return InTime(tuple(a + b for a, b in pairs))

    __radd__ = __add__

    def __neg__(self) -> "InTime":
        return self.map(operator.neg)

    def __sub__(self, other: "InTime | Exact") -> "InTime":
        return self + -other

    def __rsub__(self, other: Exact) -> "InTime":
        return -self + other

    def __getitem__(self, index: Any) -> "InTime":
        return self.map(lambda part: part[index])

    @property
    def T(self) -> "InTime":
        """Transpose."""
        return self.map(lambda part: part.T)

    def raised(self, degree: int) -> "InTime":
        """Returns the same polynomial as one of a higher degree."""
        more = degree - self.degree
        if not more:
            return self
        ones = tuple(Exact(math.comb(more, j), 0) for j in range(more + 1))
        return self * InTime(ones)

    def halves(self) -> tuple["InTime", "InTime"]:
        """Returns the polynomial over the first half of its time, and the second."""
        second = _first_half(self.parts[::-1])[::-1]
        return InTime(_first_half(self.parts)), InTime(second)

    def at(self, share: Fraction) -> Exact:
        """Returns the value at a time τ whose denominator is a power of 2."""
        total = Exact(0, 0)
        for j, part in enumerate(self.parts):
            power = share**j * (1 - share) ** (self.degree - j)
            total += part * Exact(power.numerator, 1 - power.denominator.bit_length())
        return total

    def bernstein(self) -> np.ndarray:
        """Returns Bernstein's coefficients (d + 1, ...), the nearest doubles."""
        return np.array(
            [p.to_float() / math.comb(self.degree, j) for j, p in enumerate(self.parts)]
        )


def line(values: np.ndarray) -> InTime:
    """Returns the straight line between doubles (2, ...); a constant, given one."""
    return InTime(tuple(map(exact, values)))


def hermite(
    values: np.ndarray, slopes: np.ndarray, step: Exact
) -> tuple[InTime, InTime]:
    """Returns the cubic through doubles with given slopes, and its slope times step.

    Values (2, ...) are at τ = 0 and 1, slopes (2, ...) in the unit of time.
    """
    a, b = map(exact, values)
    rise_a, rise_b = (exact(slope) * step for slope in slopes)
    middle = (b - a) * 6 - (rise_a + rise_b) * 2
    cubic = InTime((a, a * 3 + rise_a, b * 3 - rise_b, b))
    return cubic, InTime((rise_a, middle, rise_b))


def _in_time(value: InTime | Exact) -> InTime:
    return InTime((value,)) if isinstance(value, Exact) else value


def _first_half(parts):
    """With τ = σ / 2 and 1 - τ = (1 - σ) + σ / 2."""
    degree = len(parts) - 1
    found = []
    for i in range(degree + 1):
        part = _sum(parts[j] * math.comb(degree - j, i - j) for j in range(i + 1))
        found.append(Exact(part.numbers, part.exponent - i))
    return tuple(found)


def _sum(terms):
    return functools.reduce(operator.add, terms)
