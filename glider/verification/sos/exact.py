"""Exact arithmetic on arrays of integers times powers of two, and polynomials of them.

Every finite double is such a number, so that nothing needs rounding. Polynomials are in
time over an interval, without a division: with τ from 0 to 1,
    p(τ) = Σ_j p_j τʲ (1 - τ)^(d - j),
Bernstein's form without its factor, binomial(d, j). Products are convolutions, and
where all p_j are positive definite, so is p at every τ.
"""

import itertools
import math
import operator
from collections.abc import Callable
from fractions import Fraction
from typing import Any

import numpy as np
from flint import fmpz_mat


class Exact:
    """An exact array, or a polynomial of such in time, with NumPy's + - * @ and [].

    Attributes:
        numbers: (d + 1, ...) those of the p_j, one of a constant, as Python's int: in
            `np.tensordot` twice as fast as FLINT's.
        exponent: of 2, common to all.
    """

    def __init__(self, numbers: Any, exponent: int):
        self.numbers = np.asarray(numbers, dtype=object)
        self.exponent = exponent

    @property
    def degree(self) -> int:
        """Degree d in time; 0 of a constant."""
        return len(self.numbers) - 1

    @property
    def parts(self) -> tuple["Exact", ...]:
        """Its p_j, constants."""
        return tuple(Exact(part, self.exponent) for part in self.numbers[:, None])

    def __add__(self, other: "Exact") -> "Exact":
        if self.numbers.ndim != other.numbers.ndim:
            raise ValueError("exact arrays of different numbers of axes have no sum")
        low = min(self.exponent, other.exponent)
        degree = max(self.degree, other.degree)
        both = (one.raised(degree).integers(low) for one in (self, other))
        return type(self)(operator.add(*both), low)

    def __neg__(self) -> "Exact":
        return type(self)(-self.numbers, self.exponent)

    def __sub__(self, other: "Exact") -> "Exact":
        return self + -other

    def __mul__(self, other: "Exact | int") -> "Exact":
        """Multiplies entry by entry."""
        if isinstance(other, int):
            return type(self)(self.numbers * other, self.exponent)
        return self.product(other, operator.mul)

    def __matmul__(self, other: "Exact") -> "Exact":
        return self.product(other, np.dot)

    def __getitem__(self, index: Any) -> "Exact":
        index = index if isinstance(index, tuple) else (index,)
        return type(self)(self.numbers[(slice(None), *index)], self.exponent)

    def __len__(self) -> int:
        return self.numbers.shape[1]

    @property
    def T(self) -> "Exact":
        """Transpose."""
        axes = range(self.numbers.ndim - 1, 0, -1)
        return type(self)(self.numbers.transpose(0, *axes), self.exponent)

    def product(self, other: "Exact", multiply: Callable) -> "Exact":
        """Returns a product, given that of two arrays of integers."""
        numbers: list[Any] = [0] * (self.degree + other.degree + 1)
        pairs = itertools.product(enumerate(self.numbers), enumerate(other.numbers))
        for (i, mine), (j, theirs) in pairs:
            numbers[i + j] = numbers[i + j] + multiply(mine, theirs)
        return Exact(numbers, self.exponent + other.exponent)

    def sum(self) -> "Exact":
        """Returns the sum of all entries."""
        total = self.numbers.reshape(len(self.numbers), -1).sum(1)
        return type(self)(total, self.exponent)

    def integers(self, exponent: int) -> np.ndarray:
        """Returns the integers (d + 1, ...) for a lower common exponent."""
        return self.numbers * (1 << (self.exponent - exponent))

    def to_float(self) -> np.ndarray:
        """Returns the nearest doubles of a constant."""
        more = 1 << max(self.exponent, 0)
        less = 1 << max(-self.exponent, 0)
        values = [v * more / less for v in self.numbers.ravel()]
        return np.array(values).reshape(self.numbers.shape[1:])

    def raised(self, degree: int) -> "Exact":
        """Returns the same polynomial as one of a higher degree."""
        more = degree - self.degree
        ones = Exact([math.comb(more, j) for j in range(more + 1)], 0)
        return self * ones if more else self

    def halves(self) -> tuple["Exact", "Exact"]:
        """Returns the polynomial over the first half of its time, and the second."""
        low = self.exponent - self.degree
        first, last = map(_first_half, (self.numbers, self.numbers[::-1]))
        return Exact(first, low), Exact(last[::-1], low)

    def at(self, share: Fraction) -> "Exact":
        """Returns the value at a time τ whose denominator is a power of 2."""
        d = self.degree
        powers = [share**j * (1 - share) ** (d - j) for j in range(d + 1)]
        bits = max(power.denominator for power in powers).bit_length() - 1
        factors = [int(power * 2**bits) for power in powers]
        return Exact([np.tensordot(factors, self.numbers, 1)], self.exponent - bits)

    def bernstein(self) -> np.ndarray:
        """Returns Bernstein's coefficients (d + 1, ...), the nearest doubles."""
        parts = enumerate(self.parts)
        return np.array([p.to_float() / math.comb(self.degree, j) for j, p in parts])


class Sampled(Exact):
    """Doubles at T times, with the operations of polynomials: nothing of it is exact.

    Where a polynomial has its p_j, it has its values (T, ...); one is for all times.
    """

    def __init__(self, numbers: Any, exponent: int = 0):
        self.numbers = np.asarray(numbers, dtype=float)
        self.exponent = exponent

    def raised(self, degree: int) -> "Sampled":
        """Returns the values at as many times as a degree has p_j."""
        shape = degree + 1, *self.numbers.shape[1:]
        return Sampled(np.broadcast_to(self.numbers, shape))

    def product(self, other: Exact, multiply: Callable) -> "Sampled":
        """Returns the products at all times."""
        degree = max(self.degree, other.degree)
        both = self.raised(degree).numbers, other.raised(degree).numbers
        return Sampled([multiply(*pair) for pair in zip(*both, strict=True)])


def exact(values: np.ndarray | float) -> Exact:
    """Converts doubles without rounding; ValueError where they are not finite."""
    array = _finite(values)
    mantissas, exponents = np.frexp(array)
    whole = np.ldexp(mantissas, 53).astype(np.int64).astype(object)
    used = exponents[mantissas != 0.0]
    low = int(used.min()) if used.size else 0
    shifts = np.where(mantissas != 0.0, exponents - low, 0).astype(object)
    return Exact([whole * (2**shifts)], low - 53)


def rounded(values: np.ndarray, bits: int) -> Exact:
    """Rounds doubles to so many binary places; ValueError where they overflow."""
    with np.errstate(over="ignore"):
        whole = np.rint(_finite(np.ldexp(np.asarray(values, dtype=float), bits)))
    return Exact([np.vectorize(int, otypes=[object])(whole)], -bits)


def at_least(value: Fraction) -> Exact:
    """Rounds a fraction up to a number of 60 bits, or one more."""
    low = value.numerator.bit_length() - value.denominator.bit_length() - 60
    return Exact([math.ceil(value / Fraction(2) ** low)], low)


def _finite(values):
    array = np.asarray(values, dtype=float)
    if not np.all(np.isfinite(array)):
        raise ValueError("exact arithmetic needs finite numbers")
    return array


def is_positive_definite(matrix: Exact) -> bool:
    """Determines whether a symmetric matrix is, by its characteristic polynomial.

    All its roots are real: they are positive exactly if its coefficients alternate in
    sign and none is zero (Descartes).
    """
    [numbers] = matrix.numbers
    if not np.array_equal(numbers, numbers.T):
        return False
    coefficients = fmpz_mat(numbers.tolist()).charpoly().coeffs()
    return all((-1) ** k * c > 0 for k, c in enumerate(reversed(coefficients)))


def leaves_definite(gram: Exact, change: Exact) -> bool:
    """Determines whether gram + change is positive definite for certain.

    A symmetric matrix whose rows sum to at most μ in absolute values changes no
    eigenvalue by more than μ (Gershgorin), so that gram - μ I is checked. Gram is of
    few digits, the change is small and of any.
    """
    shift = gram.exponent - change.exponent
    largest = int(np.abs(change.numbers[0]).sum(axis=1).max(initial=0))
    units = -(-largest // (1 << shift)) if shift >= 0 else largest << -shift
    lowered = gram - Exact([units * np.eye(len(gram), dtype=object)], gram.exponent)
    return is_positive_definite(lowered)


def in_time(*parts: Exact) -> Exact:
    """Returns the polynomial whose p_j are constants."""
    return joined(*parts, axis=0)


def joined(*parts: Exact, axis: int) -> Exact:
    """Returns arrays joined along an axis; 0 is that of the p_j."""
    low = min(p.exponent for p in parts)
    degree = max(p.degree for p in parts)
    numbers = [part.raised(degree).integers(low) for part in parts]
    return Exact(np.concatenate(numbers, axis), low)


def line(values: np.ndarray) -> Exact:
    """Returns the straight line between doubles (2, ...); a constant, given one."""
    return in_time(*map(exact, values))


def hermite(values: np.ndarray, slopes: np.ndarray, step: Exact) -> tuple[Exact, Exact]:
    """Returns the cubic through doubles with given slopes, and its slope times step.

    Values (2, ...) are at τ = 0 and 1, slopes (2, ...) in the unit of time.
    """
    a, b = map(exact, values)
    rise_a, rise_b = (exact(slope) * step for slope in slopes)
    middle = (b - a) * 6 - (rise_a + rise_b) * 2
    cubic = in_time(a, a * 3 + rise_a, b * 3 - rise_b, b)
    return cubic, in_time(rise_a, middle, rise_b)


def _first_half(numbers):
    """With τ = σ / 2 and 1 - τ = (1 - σ) + σ / 2; times 2^d."""
    d = len(numbers) - 1
    all_ = range(len(numbers))
    rows = [[math.comb(d - j, d - i) << (d - i) for j in all_] for i in all_]
    return np.tensordot(np.array(rows, dtype=object), numbers, 1)
