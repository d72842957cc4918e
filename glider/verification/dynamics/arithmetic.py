"""A base for kinds of number that go through `glider.physics.compose`.

The physics knows + - * / and six functions of NumPy. All of it comes down to three
operations, which a kind of number defines: `plus`, `times` and `apply`.
"""

import abc
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
