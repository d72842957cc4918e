"""A glider's dynamics as numbers, in a tuple that compiled loops take as it is."""

from typing import NamedTuple

import numpy as np

from glider.physics.effects.field import Field
from glider.physics.parameters import Parameters


class Theta(NamedTuple):
    """All numbers of a glider's dynamics."""

    p: Parameters
    """Parameters of the flat-plate glider."""

    c: np.ndarray
    """Coefficients of the acting effects, one effect after the other."""

    field: Field
    """The residual field."""
