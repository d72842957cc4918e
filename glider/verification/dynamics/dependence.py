"""Which variables a formula depends on, and in which it is not linear."""

import dataclasses
from typing import Any

import numpy as np

from glider.verification.dynamics.arithmetic import Number

_NONE: frozenset[int] = frozenset()


@dataclasses.dataclass(frozen=True)
class Dependence(Number):
    """A number that knows of itself only this.

    It may name a variable too many (x - x depends on x), never one too few.
    """

    linear: frozenset[int] = _NONE
    """Variables that it depends on at all."""

    curved: frozenset[int] = _NONE
    """Those in which it need not be linear, jointly with the others."""

    def plus(self, other: Any) -> "Dependence":
        """Returns the dependence of a sum."""
        if not isinstance(other, Dependence):
            return self
        return Dependence(self.linear | other.linear, self.curved | other.curved)

    def times(self, other: Any) -> "Dependence":
        """Returns the dependence of a product."""
        if not isinstance(other, Dependence) or not other.linear:
            return self
        if not self.linear:
            return other
        both = self.linear | other.linear
        return Dependence(both, both)

    def of(self, function: np.ufunc) -> "Dependence":
        """Returns the dependence of a function."""
        return Dependence(self.linear, self.linear)


def variables(count: int) -> list[Dependence]:
    """Returns that many variables."""
    return [Dependence(frozenset([i])) for i in range(count)]
