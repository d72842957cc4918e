"""Formulas that run on any kind of number and in compiled code, and how to mark them.

The compiler takes a third of a second to import, so a mark is only noted until
`glider.compiled.kernel` imports it. In Python sine, cosine, root and exponential are
NumPy's, in compiled code those of `glider.compiled.fast_functions`.
"""

from collections.abc import Callable
from typing import TypeVar

import numpy as np

F = TypeVar("F", bound=Callable)

_MARKED: list[Callable] = []
_COMPILERS: list[Callable[[Callable], object]] = []


def scalar(formula: F) -> F:
    """Marks a pure function of scalars; in Python it stays as it is."""
    _MARKED.append(formula)
    for register in _COMPILERS:
        register(formula)
    return formula


def connect_compiler(register: Callable[[Callable], object]) -> None:
    """Hands all marked formulas to a compiler, and those still to come."""
    for formula in _MARKED:
        register(formula)
    _COMPILERS.append(register)


def sin(angle):
    """Sine of a float, AutoDiffXd, Expression or complex number [rad]."""
    return np.sin(angle)


def cos(angle):
    """Cosine of a float, AutoDiffXd, Expression or complex number [rad]."""
    return np.cos(angle)


def sqrt(square):
    """Square root of a float, AutoDiffXd, Expression or complex number."""
    return np.sqrt(square)


def exp(power):
    """Exponential of a float, AutoDiffXd, Expression or complex number."""
    return np.exp(power)
