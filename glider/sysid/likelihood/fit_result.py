"""A model with everything about it that is fitted."""

import dataclasses

import numpy as np

from glider.physics.effects import NO_FIELD, Field
from glider.physics.effects.field import joined, make_field
from glider.sysid.likelihood.blocks import Block
from glider.sysid.likelihood.linear_flight import Surroundings
from glider.sysid.likelihood.scales import Scales, start_scales
from glider.sysid.likelihood.task import Task
from glider.sysid.replay.record import Noise


@dataclasses.dataclass(frozen=True, kw_only=True)
class FitResult:
    """A model with everything about it fitted."""

    kinds: tuple[str, ...]  #: That act.
    theta: np.ndarray  #: Its parameters and coefficients.
    free: tuple[int, ...]  #: Slots of theta that are fitted.
    #: Free functions that act: those of `kinds`, and of a forecast those carried.
    blocks: tuple[Block, ...] = ()
    scales: Scales  #: Of all noise.
    #: Name of each flight to what it is linear about.
    about: dict[str, Surroundings] = dataclasses.field(default_factory=dict)
    #: Whether errors of the forces stand in for moving air, see
    #: `LinearFlight.with_force_errors`; `scales.air` is then of coefficients.
    has_force_errors: bool = False
    cost: float = np.inf  #: Negative log posterior [nats].
    #: Penalty for the volume of the prior that effects do not fill [nats].
    freedom: float = 0.0

    @property
    def by_name(self) -> dict[str, Block]:
        """Blocks that act, by name."""
        return {own.name: own for own in self.blocks}

    @property
    def free_kinds(self) -> tuple[str, ...]:
        """Free functions among the kinds."""
        return tuple(b.name for b in self.blocks if b.name in self.kinds)

    @property
    def coordinates(self) -> np.ndarray:
        """Of all blocks, one after the other."""
        return np.concatenate([np.zeros(0), *(own.coordinates for own in self.blocks)])

    def places(self, first: int | None = None) -> dict[str, range]:
        """Returns the columns of each block; by default after those of `free`."""
        first, found = len(self.free) if first is None else first, {}
        for own in self.blocks:
            found[own.name] = range(first, first + own.count)
            first += own.count
        return found

    def split(self, values: np.ndarray) -> list[np.ndarray]:
        """Splits values of all coordinates by blocks."""
        return [values[columns] for columns in self.places(0).values()]

    def with_kinds(
        self, task: Task, kinds: tuple[str, ...], theta: np.ndarray
    ) -> "FitResult":
        """Returns the model with other effects, and theta."""
        return dataclasses.replace(
            self, kinds=kinds, theta=theta, free=task.free(kinds)
        )

    def without(self, task: Task, *gone: str) -> "FitResult":
        """Returns the model without some of its effects."""
        theta = self.theta.copy()
        slots = [i for kind in gone for i in task.layout.slots_of(kind)]
        theta[slots] = task.vehicle.theta[slots]
        kinds = tuple(kind for kind in self.kinds if kind not in gone)
        blocks = tuple(own for own in self.blocks if own.name not in gone)
        return dataclasses.replace(self.with_kinds(task, kinds, theta), blocks=blocks)


def start_of(task: Task, noise: Noise) -> FitResult:
    """Returns the nominal model, unfitted, in still air."""
    return FitResult(
        kinds=(),
        theta=task.vehicle.theta.copy(),
        free=task.free(()),
        scales=start_scales(noise),
    )


def field_of(model: FitResult) -> Field:
    """Returns a model's blocks as the dynamics take them."""
    acting = [make_field(own.data) for own in model.blocks if own.coordinates.any()]
    return joined(acting) if acting else NO_FIELD
