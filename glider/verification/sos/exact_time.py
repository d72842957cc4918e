"""Polynomials in time over an interval, in whole numbers and without a division.

With τ from 0 to 1,
    p(τ) = Σ_j p_j τʲ (1 - τ)^(d - j),
the p_j being arrays: Bernstein's form but for his factor, binomial(d, j). Products are
convolutions, and where all p_j are positive definite, so is p at every τ.
"""

import functools
import math
import operator
from collections.abc import Callable
from fractions import Fraction

import numpy as np

from glider.verification.sos.exact import Exact, dyadic, exact

InTime = tuple[Exact, ...]
"""A polynomial in time, its p_j."""


def line(first: np.ndarray, last: np.ndarray) -> InTime:
    """Returns the straight line between doubles."""
    return exact(first), exact(last)


def hermite(
    values: np.ndarray, slopes: np.ndarray, step: Exact
) -> tuple[InTime, InTime]:
    """Returns the cubic through doubles with given slopes, and its slope times step.

    Args:
        values: (2, ...) at τ = 0 and 1.
        slopes: (2, ...) there, in the unit of time.
        step: duration of the interval.
    """
    a, b = map(exact, values)
    rise_a, rise_b = (exact(slope).times(step) for slope in slopes)
    cubic = (a, a.scaled(3) + rise_a, b.scaled(3) - rise_b, b)
    middle = (b - a).scaled(6) - (rise_a + rise_b).scaled(2)
    return cubic, (rise_a, middle, rise_b)


def product(first: InTime, second: InTime, multiply: Callable) -> InTime:
    """Returns a product of two, given that of two arrays."""
    degree = len(first) + len(second) - 2
    return tuple(
        _sum(
            multiply(first[i], second[k - i])
            for i in range(max(0, k - len(second) + 1), min(k + 1, len(first)))
        )
        for k in range(degree + 1)
    )


def raised(polynomial: InTime, degree: int) -> InTime:
    """Returns the same polynomial as one of a higher degree."""
    more = degree - len(polynomial) + 1
    ones = tuple(
        Exact(np.array(math.comb(more, j), dtype=object), 0) for j in range(more + 1)
    )
    return product(polynomial, ones, Exact.times)


def total(*polynomials: InTime) -> InTime:
    """Returns the sum of polynomials of any degrees."""
    degree = max(map(len, polynomials)) - 1
    parts = zip(*(raised(p, degree) for p in polynomials), strict=True)
    return tuple(_sum(part) for part in parts)


def mapped(polynomial: InTime, function: Callable[[Exact], Exact]) -> InTime:
    """Returns a linear function of a polynomial."""
    return tuple(function(part) for part in polynomial)


def halves(polynomial: InTime) -> tuple[InTime, InTime]:
    """Returns a polynomial over the first half of its time, and over the second."""
    second = _first_half(polynomial[::-1])[::-1]
    return _first_half(polynomial), second


def at_share(polynomial: InTime, share: Fraction) -> Exact:
    """Returns the value at a time τ whose denominator is a power of 2."""
    tau, degree = dyadic(np.array(share)), len(polynomial) - 1
    rest = dyadic(np.array(1 - share))
    return _sum(
        part.times(_power(tau, j)).times(_power(rest, degree - j))
        for j, part in enumerate(polynomial)
    )


def bernstein(polynomial: InTime) -> np.ndarray:
    """Returns Bernstein's coefficients, the nearest doubles."""
    degree = len(polynomial) - 1
    return np.array(
        [p.to_float() / math.comb(degree, j) for j, p in enumerate(polynomial)]
    )


def _first_half(polynomial):
    """With τ = σ / 2 and 1 - τ = (1 - σ) + σ / 2."""
    degree = len(polynomial) - 1
    parts = []
    for i in range(degree + 1):
        terms = (
            polynomial[j].scaled(math.comb(degree - j, i - j)) for j in range(i + 1)
        )
        part = _sum(terms)
        parts.append(Exact(part.numbers, part.exponent - i))
    return tuple(parts)


def _power(number, exponent):
    return Exact(number.numbers**exponent, number.exponent * exponent)


def _sum(terms):
    return functools.reduce(operator.add, terms)
