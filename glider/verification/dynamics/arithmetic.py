"""Kinds of number that go through `glider.physics.compose`: their base, and Dependence.

The physics knows + - * / and six functions of NumPy. All of it comes down to three
operations, which a kind of number defines: `plus`, `times` and `apply`.
"""

import abc
import dataclasses
from collections.abc import Callable
from typing import Any

import numpy as np


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
        """Returns one of FUNCTIONS of this number."""

    def __array_ufunc__(self, ufunc, method, *inputs, **kwargs):
        """Lets operators and NumPy's numbers, arrays and functions meet this kind."""
        if method != "__call__" or kwargs:
            return NotImplemented
        if ufunc in FUNCTIONS:
            return self.apply(ufunc)
        if ufunc in _OPERATIONS:
            return _OPERATIONS[ufunc](*inputs)
        return NotImplemented


FUNCTIONS = (np.sqrt, np.sin, np.cos, np.exp, np.tanh, np.arctan, np.reciprocal)
"""Functions that `Number.apply` is asked for; np.reciprocal stands for division."""


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


_NONE: frozenset[int] = frozenset()


@dataclasses.dataclass(frozen=True)
class Dependence(Number):
    """The variables that a number depends on.

    It may name a variable too many (x - x depends on x), never one too few.

    Attributes:
        variables: indices of the variables that it depends on at all.
        nonlinear: indices of those in which it need not be linear, jointly with the
            others.
    """

    variables: frozenset[int] = _NONE
    nonlinear: frozenset[int] = _NONE

    def plus(self, other: Any) -> "Dependence":
        if not isinstance(other, Dependence):
            return self
        return Dependence(
            self.variables | other.variables, self.nonlinear | other.nonlinear
        )

    def times(self, other: Any) -> "Dependence":
        if not isinstance(other, Dependence) or not other.variables:
            return self
        if not self.variables:
            return other
        both = self.variables | other.variables
        return Dependence(both, both)

    def apply(self, function: np.ufunc) -> "Dependence":
        return Dependence(self.variables, self.variables)


def dependences(count: int) -> list[Dependence]:
    """Returns the variables 0 to count - 1, each of which depends on itself."""
    return [Dependence(frozenset([i])) for i in range(count)]
