"""Outcome of a search, named or not."""

import dataclasses

import numpy as np

from glider.physics.effects import (
    NO_FIELD,
    Field,
)
from glider.sysid.fit.output_error import Fit
from glider.sysid.search.candidates import Weighed
from glider.sysid.search.residual_field import UnexplainedField


@dataclasses.dataclass(frozen=True, kw_only=True)
class Explanation:
    """Effects that were found, named or not.

    Attributes:
        fit: of the named effects' coefficients.
        weighed: the effects, strongest first; one may be "unexplained".
        unexplained: the residual field, or None.
        candidates: evidence of each kind when tried alone.
        left_z: what the effects and the field leave of the fitted flights, in
            standard deviations of noise.
        plate: theta of the flat plate with its own parameters refitted, where that
            took rollouts; else None.
    """

    fit: Fit
    weighed: tuple[Weighed, ...]
    unexplained: UnexplainedField | None
    candidates: dict[str, float]
    left_z: float = np.inf
    plate: np.ndarray | None = None

    @property
    def theta(self) -> np.ndarray:
        """The corrected model's numbers."""
        return self.fit.theta

    @property
    def field(self) -> Field:
        """The corrected model's residual field."""
        return NO_FIELD if self.unexplained is None else self.unexplained.field
