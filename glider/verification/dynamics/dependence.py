"""A kind of number that tells which variables a formula depends on, and how."""

import dataclasses
from typing import Any

import numpy as np

from glider.verification.dynamics.arithmetic import Number

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


def variables(count: int) -> list[Dependence]:
    """Returns the variables 0 to count - 1, each of which depends on itself."""
    return [Dependence(frozenset([i])) for i in range(count)]
