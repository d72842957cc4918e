"""Directions in which a model may be wrong: each is a column of a flight's errors."""

import dataclasses
import itertools
from collections.abc import Sequence

import numpy as np

from glider.physics.effects import EffectKind
from glider.sysid.replay.theta import Layout

SMALL = 1e-6
"""Step of a derivative, in the coefficient's scale: good to 1e-6 of it."""

SMALL_SIGNAL = 5e-4
"""The same of a coefficient on the log's clocks: about 1e-5 s of a delay."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Direction:
    """One coefficient moved, the shapes of its effect set to some start."""

    kind: str  # Of the effect, or "parameters".
    slot: int  # Of the coefficient in theta.
    base: np.ndarray  # Theta with the effect's shapes set.
    moved: np.ndarray  # Base with the coefficient moved.
    size: float  # By how much.
    # The effect's starting shapes, by slot; empty where it acts already.
    shapes: tuple[tuple[int, float], ...] = ()


def slopes(layout: Layout, theta: np.ndarray, free: Sequence[int]) -> list[Direction]:
    """Returns the directions of slots as they are, for a fit."""
    found = []
    for slot in free:
        kind = layout.slots[slot][0]
        small = SMALL if slot < layout.num_compiled else SMALL_SIGNAL
        size = small * layout.scale[slot]
        moved = theta.copy()
        moved[slot] += size
        found.append(
            Direction(kind=kind, slot=slot, base=theta, moved=moved, size=size)
        )
    return found


def starts_of(
    layout: Layout, kind: EffectKind, theta: np.ndarray
) -> list[list[Direction]]:
    """Returns an absent effect's directions, for each combination of its shapes.

    An effect whose every coefficient is a shape (a lag, a delay) is tried by secants to
    its starting values, for it is not linear there.
    """
    slots = layout.slots_of(kind.kind)
    entries = list(zip(slots, kind.coefficients, strict=True))
    sizes = [(i, c) for i, c in entries if not c.is_shape]
    if not sizes:
        return [
            [_secant(kind.kind, i, theta, value)]
            for i, c in entries
            for value in c.grid
        ]
    shapes = [(i, c) for i, c in entries if c.is_shape]
    found = []
    for values in itertools.product(*(c.grid for _, c in shapes)):
        base = theta.copy()
        chosen = tuple((i, v) for (i, _), v in zip(shapes, values, strict=True))
        for i, value in chosen:
            base[i] = value
        columns = []
        for direction in slopes(layout, base, [i for i, _ in sizes]):
            columns.append(dataclasses.replace(direction, shapes=chosen))
        found.append(columns)
    return found


def nearest_start(
    layout: Layout, starts: Sequence[Sequence[Direction]], theta: np.ndarray
) -> int:
    """Index of the start whose shapes are nearest to those of theta."""
    apart = [
        sum(abs(v - theta[i]) / layout.scale[i] for i, v in columns[0].shapes)
        for columns in starts
    ]
    return int(np.argmin(apart))


def _secant(kind: str, slot: int, theta: np.ndarray, value: float) -> Direction:
    moved = theta.copy()
    moved[slot] = value
    return Direction(
        kind=kind, slot=slot, base=theta, moved=moved, size=value - theta[slot]
    )
