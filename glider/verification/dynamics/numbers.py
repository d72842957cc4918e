"""Kinds of number that go through `glider.physics.compose` like a float does.

The physics knows + - * / and six functions of NumPy. All of it comes down to three
operations, which a kind of number defines: `plus`, `times` and `apply`. A Slope carries
derivatives along; `taylor_models` has polynomials, which are sums of Monomials.
"""

import abc
import dataclasses
import functools
import itertools
from collections.abc import Callable
from typing import Any

import numpy as np

from glider.compiled.taylor import FUNCTIONS


class Number(np.lib.mixins.NDArrayOperatorsMixin, abc.ABC):
    """A kind of number that meets floats, arrays and its own kind in formulas.

    It takes + - * / and NumPy's sqrt, sin, cos, exp, tanh and arctan.
    """

    @abc.abstractmethod
    def plus(self, other: Any) -> "Number":
        """Returns the sum with another of this kind or a plain number."""

    @abc.abstractmethod
    def times(self, other: Any) -> "Number":
        """Returns the product with another of this kind or a plain number."""

    @abc.abstractmethod
    def apply(self, function: np.ufunc) -> "Number":
        """Returns one of `FUNCTIONS` of this number."""

    def within(self, first: Any, second: Any) -> "Number":
        """Returns this number, of which |x|² <= first² + second² is known."""
        return self

    def __array_ufunc__(self, ufunc, method, *inputs, **kwargs):
        """Lets operators and NumPy's numbers, arrays and functions meet this kind."""
        if method != "__call__" or kwargs:
            return NotImplemented
        if ufunc in FUNCTIONS:
            return self.apply(ufunc)
        if ufunc in _OPERATIONS:
            return _OPERATIONS[ufunc](*inputs)
        return NotImplemented


def _sum(a, b):
    return a.plus(b) if isinstance(a, Number) else b.plus(a)


def _product(a, b):
    return a.times(b) if isinstance(a, Number) else b.times(a)


def _quotient(a, b):
    inverse = b.apply(np.reciprocal) if isinstance(b, Number) else 1.0 / b
    return _product(a, inverse)


_OPERATIONS: dict[np.ufunc, Callable] = {
    np.add: _sum,
    np.subtract: lambda a, b: _sum(a, -b),
    np.multiply: _product,
    np.true_divide: _quotient,
    np.negative: lambda a: a.times(-1.0),
}


@dataclasses.dataclass(frozen=True, eq=False)
class Slope(Number):
    """A number and its slopes along some variables, all of one kind."""

    value: Any  #: The number.
    slopes: tuple[Any, ...]  #: One for each variable; the plain number 0 where none.
    #: Numbers whose squares, and a constant that is not negative, it is the sum of.
    roots: tuple["Slope", ...] = ()

    def plus(self, other: Any) -> "Slope":
        if not isinstance(other, Slope):
            roots = self.roots if isinstance(other, float) and other >= 0.0 else ()
            return Slope(self.value + other, self.slopes, roots)
        roots = self.roots + other.roots if self.roots and other.roots else ()
        pairs = zip(self.slopes, other.slopes, strict=True)
        slopes = tuple(a + b for a, b in pairs)
        return Slope(self.value + other.value, slopes, roots)

    def times(self, other: Any) -> "Slope":
        if not isinstance(other, Slope):
            return Slope(self.value * other, self._scaled(other))
        pairs = zip(self._scaled(other.value), other._scaled(self.value), strict=True)
        slopes = tuple(a + b for a, b in pairs)
        roots = (self,) if other is self else ()
        return Slope(self.value * other.value, slopes, roots)

    def apply(self, function: np.ufunc) -> "Slope":
        value = function(self.value)
        slopes = self._scaled(_DERIVATIVES[function](self.value, value))
        if function is np.sqrt and len(self.roots) == 2:
            # |a a' + b b'| / √(a² + b² + c) <= √(a'² + b'²), also near zero.
            limits = zip(*(root.slopes for root in self.roots), strict=True)
            slopes = tuple(
                slope.within(*both) if isinstance(slope, Number) else slope
                for slope, both in zip(slopes, limits, strict=True)
            )
        return Slope(value, slopes)

    def _scaled(self, factor):
        """Returns slopes times a number; what is zero stays a plain number."""
        return tuple(
            0.0 if isinstance(slope, float) and slope == 0.0 else slope * factor
            for slope in self.slopes
        )


_DERIVATIVES: dict[np.ufunc, Callable] = {  # Of y = g(x), by x and y.
    np.sqrt: lambda x, y: 0.5 / y,
    np.sin: lambda x, y: np.cos(x),
    np.cos: lambda x, y: -np.sin(x),
    np.exp: lambda x, y: y,
    np.tanh: lambda x, y: 1.0 - y * y,
    np.arctan: lambda x, y: 1.0 / (1.0 + x * x),
    np.reciprocal: lambda x, y: -y * y,
}


class Monomials:
    """The monomials of some variables up to a degree, and their products.

    Attributes:
        num_variables: n.
        degree: of the highest monomials.
        exponents: (M, n) by degree, then in the order of combinations.
        degrees: (M,) of each monomial.
        left, right: (P,) indices of the factors of all products up to the degree, in
            the order of the monomials that they give.
        starts: (M,) where the products that give each monomial start.
    """

    def __init__(self, num_variables: int, degree: int):
        """Lists the monomials and prepares their multiplication table."""
        self.num_variables = num_variables
        self.degree = degree
        rows = [exponents_of(num_variables, d) for d in range(degree + 1)]
        self.exponents = np.concatenate(rows)
        self.degrees = self.exponents.sum(axis=1)
        self._places = place = {tuple(e): k for k, e in enumerate(self.exponents)}
        pairs = np.argwhere(np.add.outer(self.degrees, self.degrees) <= degree)
        products = [place[tuple(e)] for e in self.exponents[pairs].sum(axis=1)]
        self.left, self.right = pairs[np.argsort(products, kind="stable")].T
        # Every monomial is a product, by 1 if by nothing else: none is missing.
        self.starts = np.flatnonzero(np.diff(np.sort(products), prepend=-1))
        # And every one of degree 1 or more is a variable times a lower one.
        self._factor = np.argmax(self.exponents > 0, axis=1)
        unit = np.eye(num_variables, dtype=int)
        lower = self.exponents[1:] - unit[self._factor[1:]]
        self._lower = np.array([0, *(place[tuple(e)] for e in lower)])

    def values(self, points: np.ndarray) -> np.ndarray:
        """Returns the monomials' values (B, M) at points (B, n)."""
        values = np.ones((len(self.degrees), len(points)))
        for degree in range(1, self.degree + 1):
            here = self.of_degree(degree)
            values[here] = values[self._lower[here]] * points.T[self._factor[here]]
        return values.T

    def without(self, others: np.ndarray) -> np.ndarray:
        """Returns which monomials have none of some variables, (M,).

        They are those of the variables that are left, in the same order.
        """
        return np.logical_not(np.any(self.exponents[:, others], axis=1))

    def place(self, exponents: np.ndarray) -> int:
        """Returns the index of a monomial."""
        return self._places[tuple(exponents)]

    def of_degree(self, degree: int) -> slice:
        """Returns where the monomials of one degree are."""
        return slice(*np.searchsorted(self.degrees, [degree, degree + 1]))


def exponents_of(num_variables: int, degree: int) -> np.ndarray:
    """Returns the exponents (M, n) of all monomials of exactly this degree."""
    choices = itertools.combinations_with_replacement(range(num_variables), degree)
    rows = [np.bincount(c, minlength=num_variables) for c in choices]
    return np.array(rows, dtype=int).reshape(-1, num_variables)


@functools.lru_cache(maxsize=16)
def monomials(num_variables: int, degree: int) -> Monomials:
    """Returns the table of these monomials, made once."""
    return Monomials(num_variables, degree)
