"""Polynomials in time over an interval, in exact arithmetic and without a division.

With τ from 0 to 1,
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

from glider.verification.sos.exact import Exact, dyadic, exact


@dataclasses.dataclass(frozen=True)
class InTime:
    """A polynomial in time, with NumPy's operators + - * @ and [].

    An Exact joins in as a constant.
    """

    parts: tuple[Exact, ...]
    """Its p_j."""

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
        return _sum(
            part * dyadic(share**j * (1 - share) ** (self.degree - j))
            for j, part in enumerate(self.parts)
        )

    def bernstein(self) -> np.ndarray:
        """Returns Bernstein's coefficients (d + 1, ...), the nearest doubles."""
        return np.array(
            [p.to_float() / math.comb(self.degree, j) for j, p in enumerate(self.parts)]
        )


def line(first: np.ndarray | float, last: np.ndarray | float) -> InTime:
    """Returns the straight line between doubles."""
    return InTime((exact(first), exact(last)))


def hermite(
    values: np.ndarray, slopes: np.ndarray, step: Exact
) -> tuple[InTime, InTime]:
    """Returns the cubic through doubles with given slopes, and its slope times step.

    Args:
        values: (2, ...) at τ = 0 and 1.
        slopes: (2, ...) there, in the unit of time.
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
