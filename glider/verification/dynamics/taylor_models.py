"""Taylor models: polynomials on boxes and a proven bound of their remainder.

A TaylorModel goes through the physics like a Jet does, for many boxes at once. On a box
c + h v, |v_i| <= 1, it holds of what it stands for
    |f(c + h v) - p(v)| <= remainder,
with p the polynomial that its coefficients are. All of it is proven: what a product or
a function has beyond the degree goes into `remainder`, and so does the rounding of
every operation (Makino and Berz 2003). NumPy's functions are assumed accurate to
100 units in the last place.
"""

import dataclasses
import math
from collections.abc import Callable
from typing import Any

import numpy as np

from glider.compiled.kernel import machine_code
from glider.verification.dynamics.jets import SERIES, Monomials, Number

ROUNDING = 1e-13
"""Relative bound of an operation's rounding: a sum of 300 products has 7e-14."""

WIDER = 1.0 + 1e-12
"""Factor that covers the rounding of the bounds themselves: they are sums of a
few hundred terms that are not negative, with an error below 1e-13."""


@dataclasses.dataclass(eq=False)
class TaylorModel(Number):
    """A polynomial and a bound of its remainder, on each of many boxes."""

    table: Monomials  #: The Monomials in v.
    coefficients: np.ndarray  #: (M, B) of the polynomials.
    remainder: np.ndarray  #: (B,) bounds of what they leave out.

    def plus(self, other: Any) -> "TaylorModel":
        if isinstance(other, TaylorModel):
            total = _add(
                self.coefficients, self.remainder, other.coefficients, other.remainder
            )
            return TaylorModel(self.table, *total)
        coefficients = self.coefficients.copy()
        coefficients[0] += other
        remainder = (self.remainder + ROUNDING * np.abs(coefficients[0])) * WIDER
        return TaylorModel(self.table, coefficients, remainder)

    def times(self, other: Any) -> "TaylorModel":
        if isinstance(other, TaylorModel):
            table = self.table
            mine = self.coefficients, self.remainder
            theirs = other.coefficients, other.remainder
            products = table.left, table.right, table.starts, table.degrees
            return TaylorModel(table, *_multiply(*mine, *theirs, *products))
        factors = np.broadcast_to(np.asarray(other, dtype=float), self.remainder.shape)
        return TaylorModel(
            self.table, *_scale(self.coefficients, self.remainder, factors)
        )

    def apply(self, function: np.ufunc) -> "TaylorModel":
        """Returns a function of this model, by its series about the center."""
        center, spread = self.coefficients[0], self.spread()
        with np.errstate(all="ignore"):
            terms = SERIES[function](center, self.table.degree)
            tail = _TAILS[function](center, spread, terms)
        change = TaylorModel(self.table, self.coefficients.copy(), self.remainder)
        change.coefficients[0] = 0.0
        total = self.constant(terms[-1])
        for term in terms[-2::-1]:
            total = total.times(change).plus(self.constant(term))
        total.remainder = (total.remainder + tail) * WIDER
        return _better_root(total, self) if function is np.sqrt else total

    def spread(self) -> np.ndarray:
        """Returns how far the value is from the polynomial's center at most, (B,)."""
        return (np.abs(self.coefficients[1:]).sum(axis=0) + self.remainder) * WIDER

    def constant(self, value: np.ndarray | float) -> "TaylorModel":
        """Returns a constant on these boxes that was computed with rounding."""
        coefficients = np.zeros_like(self.coefficients)
        coefficients[0] = value
        remainder = ROUNDING * (1.0 + np.abs(coefficients[0]))
        return TaylorModel(self.table, coefficients, remainder)


def _better_root(root, square):
    """Replaces roots by straight lines where these leave out less, as near zero.

    Over [a, b] the root lies above its chord, of slope 1 / (√a + √b), by at most
    (√b - √a)² / (4 (√a + √b)).
    """
    spread = square.spread() * WIDER
    low = np.maximum(square.coefficients[0] - spread, 0.0)
    with np.errstate(all="ignore"):
        first, last = np.sqrt(low), np.sqrt(square.coefficients[0] + spread)
        slope = 1.0 / (first + last)
        gap = 0.125 * (last - first) ** 2 * slope
    line = square.plus(-low).times(slope).plus(first + gap)
    line.remainder = (line.remainder + gap + ROUNDING * last) * WIDER
    better = ~(line.remainder >= root.remainder)
    coefficients = np.where(better, line.coefficients, root.coefficients)
    return TaylorModel(
        root.table, coefficients, np.where(better, line.remainder, root.remainder)
    )


@machine_code
def _add(a, remainder_a, b, remainder_b):
    """Returns coefficients and remainder of a sum of two models."""
    total, sizes = np.empty_like(a), np.zeros(a.shape[1])
    for k in range(a.shape[0]):
        row, x, y = total[k], a[k], b[k]
        for box in range(a.shape[1]):
            row[box] = x[box] + y[box]
            sizes[box] += abs(row[box])
    return total, (remainder_a + remainder_b + ROUNDING * sizes) * WIDER


@machine_code
def _scale(a, remainder, factors):
    """Returns coefficients and remainder of a product with plain numbers."""
    scaled, sizes = np.empty_like(a), np.zeros(a.shape[1])
    for k in range(a.shape[0]):
        row, x = scaled[k], a[k]
        for box in range(a.shape[1]):
            row[box] = x[box] * factors[box]
            sizes[box] += abs(row[box])
    return scaled, (remainder * np.abs(factors) + ROUNDING * sizes) * WIDER


@machine_code
def _multiply(a, remainder_a, b, remainder_b, left, right, starts, degrees):
    """Returns coefficients and remainder of a product of two models."""
    count, boxes = a.shape
    order = degrees[-1]
    product = np.zeros((count, boxes))
    for k in range(count):
        stop = starts[k + 1] if k + 1 < count else len(left)
        total = product[k]  # Rows, for the loops over boxes to be vectorised.
        for p in range(starts[k], stop):
            x, y = a[left[p]], b[right[p]]
            for box in range(boxes):
                total[box] += x[box] * y[box]
    sizes_a, sizes_b = np.zeros((order + 1, boxes)), np.zeros((order + 1, boxes))
    for k in range(count):
        x, y = sizes_a[degrees[k]], sizes_b[degrees[k]]
        row_a, row_b = a[k], b[k]
        for box in range(boxes):
            x[box] += abs(row_a[box])
            y[box] += abs(row_b[box])
    remainder = np.zeros(boxes)
    for box in range(boxes):
        sum_a, sum_b, beyond = 0.0, 0.0, 0.0
        for i in range(order + 1):
            sum_a += sizes_a[i, box]
            sum_b += sizes_b[i, box]
            for j in range(order + 1 - i, order + 1):
                beyond += sizes_a[i, box] * sizes_b[j, box]
        known = (sum_a + remainder_a[box]) * remainder_b[box] + remainder_a[box] * sum_b
        remainder[box] = (beyond + known + ROUNDING * sum_a * sum_b) * WIDER
    return product, remainder


def _reciprocal_tail(center, spread, terms):
    """Bounds the tail of 1 / (a + h) = Σ (-h)ᵏ / aᵏ⁺¹, a geometric series."""
    size = np.abs(center)
    share = spread / size
    tail = share ** len(terms) / (size * (1.0 - share * WIDER))
    return np.where(share * WIDER < 1.0, tail * WIDER, np.inf)


def _root_tail(center, spread, terms):
    """Bounds the tail of √(a + h) by that at h = -spread: its terms agree in sign."""
    low = center - spread * WIDER
    polynomial = sum(term * (-spread) ** k for k, term in enumerate(terms))
    tail = polynomial - np.sqrt(low) + ROUNDING * np.sqrt(center)
    return np.where(low >= 0.0, tail, np.inf)


def _lagrange(bound):
    """Returns the tail where |g⁽ᵏ⁾ / k!| <= bound(k, largest argument)."""

    def tail(center, spread, terms):
        k = len(terms)
        return bound(k, center + spread) * spread**k * WIDER

    return tail


_TAILS: dict[np.ufunc, Callable] = {
    np.reciprocal: _reciprocal_tail,
    np.sqrt: _root_tail,
    np.sin: _lagrange(lambda k, high: 1.0 / math.factorial(k)),
    np.cos: _lagrange(lambda k, high: 1.0 / math.factorial(k)),
    np.exp: _lagrange(lambda k, high: np.exp(high) / math.factorial(k)),
    # Cauchy's estimate: |tanh| <= tan 1 within 1 of the real line.
    np.tanh: _lagrange(lambda k, high: math.tan(1.0)),
    np.arctan: _lagrange(lambda k, high: 1.0 / k),
}
"""Bounds of the tail of a function's series, given where it is expanded, how far the
argument is from there at most, and the terms that are kept."""
