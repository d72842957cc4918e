"""Kinds of number that go through `glider.physics.compose`: their base, and Dependence.

The physics knows + - * / and six functions of NumPy. All of it comes down to three
operations, which a kind of number defines: `plus`, `times` and `apply`.
"""

import abc
import dataclasses
from collections.abc import Callable
from typing import Any

import numpy as np


class Number(abc.ABC):
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
        """Lets NumPy's numbers, arrays and functions meet this kind."""
        if method != "__call__" or kwargs:
            return NotImplemented
        if ufunc in FUNCTIONS:
            return self.apply(ufunc)
        if ufunc in _OPERATIONS:
            return _OPERATIONS[ufunc](*inputs)
        return NotImplemented

    def __neg__(self):
        return self.times(-1.0)

    def __add__(self, other):
        return self.plus(other)

    def __radd__(self, other):
        return self.plus(other)

    def __sub__(self, other):
        return self.plus(-other)

    def __rsub__(self, other):
        return self.times(-1.0).plus(other)

    def __mul__(self, other):
        return self.times(other)

    def __rmul__(self, other):
        return self.times(other)

    def __truediv__(self, other):
        inverse = (
            other.apply(np.reciprocal) if isinstance(other, Number) else 1.0 / other
        )
        return self.times(inverse)

    def __rtruediv__(self, other):
        return self.apply(np.reciprocal).times(other)


FUNCTIONS = (np.sqrt, np.sin, np.cos, np.exp, np.tanh, np.arctan, np.reciprocal)
"""Functions that `Number.apply` is asked for; np.reciprocal stands for division."""


def _either(forward: str, backward: str) -> Callable:
    """Returns an operation, given the methods of a Number on the left and right."""

    def operation(a, b):
        return (
            getattr(a, forward)(b) if isinstance(a, Number) else getattr(b, backward)(a)
        )

    return operation


_OPERATIONS: dict[np.ufunc, Callable] = {
    np.add: _either("__add__", "__radd__"),
    np.subtract: _either("__sub__", "__rsub__"),
    np.multiply: _either("__mul__", "__rmul__"),
    np.true_divide: _either("__truediv__", "__rtruediv__"),
    np.negative: Number.__neg__,
}


_NONE: frozenset[int] = frozenset()


@dataclasses.dataclass(frozen=True)
class Dependence(Number):
    """The variables that a number depends on.

    It may name a variable too many (x - x depends on x), never one too few.
    """

    variables: frozenset[int] = _NONE
    """Indices of the variables that it depends on at all."""

    nonlinear: frozenset[int] = _NONE
    """Indices of those in which it need not be linear, jointly with the others."""

    def plus(self, other: Any) -> "Dependence":
        """Returns the dependence of a sum."""
        if not isinstance(other, Dependence):
            return self
        return Dependence(
            self.variables | other.variables, self.nonlinear | other.nonlinear
        )

    def times(self, other: Any) -> "Dependence":
        """Returns the dependence of a product."""
        if not isinstance(other, Dependence) or not other.variables:
            return self
        if not self.variables:
            return other
        both = self.variables | other.variables
        return Dependence(both, both)

    def apply(self, function: np.ufunc) -> "Dependence":
        """Returns the dependence of a function."""
        return Dependence(self.variables, self.variables)


def dependences(count: int) -> list[Dependence]:
    """Returns the variables 0 to count - 1, each of which depends on itself."""
    return [Dependence(frozenset([i])) for i in range(count)]
