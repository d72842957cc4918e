"""The mark of a formula that compiled code may call.

The compiler takes a third of a second to import. Whoever needs only the names and the
numbers of effects need not wait for it: until `glider.compiled.kernel` imports it, a
mark is only noted.
"""

from collections.abc import Callable
from typing import TypeVar

F = TypeVar("F", bound=Callable)

_MARKED: list[Callable] = []
_COMPILERS: list[Callable[[Callable], object]] = []


def scalar(formula: F) -> F:
    """Marks a pure function of scalars; in Python it stays as it is."""
    _MARKED.append(formula)
    for register in _COMPILERS:
        register(formula)
    return formula


def tell_compiler(register: Callable[[Callable], object]) -> None:
    """Hands all marked formulas to a compiler, and those still to come."""
    for formula in _MARKED:
        register(formula)
    _COMPILERS.append(register)
