"""Directions in which a model may be wrong, each a column of a flight's errors.

A column is the change of a flight's errors with one coefficient. `slopes` are the
derivatives that a fit needs; `starts_of` are those of an effect that does not act yet.
"""

import itertools
from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from glider.physics.effects import EffectKind
from glider.physics.parameter_space import ParameterSpace

_SMALL = 1e-6  # Step of a derivative, in the coefficient's scale: good to 1e-6 of it.
_SMALL_SIGNAL = 5e-4  # The same on the log's clocks: about 1e-5 s of a delay.
Shapes = tuple[tuple[int, float], ...]  # Slots of an effect's shapes, and values.


class Direction(NamedTuple):
    """One coefficient moved, the shapes of its effect set to some start.

    Attributes:
        kind: of the effect, or "parameters".
        slot: of the coefficient in theta.
        size: change of the coefficient, in its unit.
        shapes: starting values; empty where the effect acts already.
    """

    kind: str
    slot: int
    size: float
    shapes: Shapes = ()

    def base(self, theta: np.ndarray) -> np.ndarray:
        """Returns theta with the shapes set."""
        base = theta.copy()
        for slot, value in self.shapes:
            base[slot] = value
        return base

    def moved(self, theta: np.ndarray) -> np.ndarray:
        """Returns theta with the shapes set and the coefficient moved."""
        moved = self.base(theta)
        moved[self.slot] += self.size
        return moved


def slopes(
    space: ParameterSpace, free: Iterable[int], shapes: Shapes = ()
) -> list[Direction]:
    """Returns the directions of slots as they are, for a fit."""
    found = []
    for slot in free:
        share = _SMALL if slot < space.num_flown else _SMALL_SIGNAL
        step = share * float(space.scale[slot])
        found.append(Direction(space.owners[slot], slot, step, shapes))
    return found


def starts_of(
    space: ParameterSpace, kind: EffectKind, theta: np.ndarray
) -> list[list[Direction]]:
    """Returns an absent effect's directions, for each combination of its shapes.

    An effect whose every coefficient is a shape (a lag, a delay) is tried by secants to
    its starting values, for it is not linear there.
    """
    sizes = []
    grids = []  # Of each shape, its slot with each starting value.
    slots = space.slots_of(kind.kind)
    for slot, coefficient in zip(slots, kind.coefficients, strict=True):
        if coefficient.is_shape:
            grids.append([(slot, value) for value in coefficient.grid])
        else:
            sizes.append(slot)

    if sizes:
        return [slopes(space, sizes, shapes) for shapes in itertools.product(*grids)]

    secants = []
    for slot, value in itertools.chain.from_iterable(grids):
        change = value - float(theta[slot])
        secants.append([Direction(kind.kind, slot, change)])
    return secants
