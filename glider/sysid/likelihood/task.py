"""The task of a fit: flights, known parameters and the effects to try."""

import dataclasses
from collections.abc import Collection, Mapping, Sequence

import numpy as np
from scipy.special import ndtri

from glider.compiled.theta import SERVO_LOG, Layout
from glider.physics.confidence import LEVEL
from glider.physics.effects import SERVO_LAG
from glider.sysid.constants import CLOCK_ERROR, PRIOR_SCALES
from glider.sysid.likelihood.blocks import Block, flown_values, make_blocks
from glider.sysid.replay.record import Record
from glider.sysid.replay.vehicle import Vehicle


@dataclasses.dataclass(frozen=True, kw_only=True)
class Task:
    """Flights and a model to fit to them."""

    records: Sequence[Record]  #: The flights.
    vehicle: Vehicle  #: What is known of the glider.
    kinds: tuple[str, ...]  #: Effects to try.
    blocks: Mapping[str, Block]  #: Free functions to try, by name.

    @property
    def layout(self) -> Layout:
        """Layout of theta."""
        return self.vehicle.layout

    @property
    def offered(self) -> set[str]:
        """Effects and free functions to try."""
        return {*self.kinds, *self.blocks}

    def free(self, kinds: Sequence[str]) -> tuple[int, ...]:
        """Returns the indices into theta to fit for a set of kinds, sorted."""
        slots = {i for kind in kinds for i in self.layout.slots_of(kind)}
        index = self.layout.index
        if index["parameters", "wing_offset"] in self.vehicle.nuisance:
            slots.discard(index["center_of_pressure", "shift"])
        return tuple(sorted({*slots, *self.vehicle.nuisance}))

    def is_shape(self, slot: int) -> bool:
        """Whether a slot only shapes an effect that has another for its size."""
        return slot in self.layout.shapes

    def priors(
        self, slots: Sequence[int], theta: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Returns prior means and precisions of slots; shapes are where they are."""
        vehicle, scale = self.vehicle, PRIOR_SCALES * self.layout.scale
        means = [theta[i] if self.is_shape(i) else vehicle.theta[i] for i in slots]
        spreads = [vehicle.nuisance.get(i, scale[i]) for i in slots]
        return np.array(means), np.array(spreads) ** -2.0

    def bounds(self, slots: Sequence[int]) -> tuple[np.ndarray, np.ndarray]:
        """Returns the least and the largest values of slots that are possible."""
        slots, of_log = list(slots), self.vehicle.of_log
        lower, upper = self.layout.lower.copy(), self.layout.upper.copy()
        poses, commands, *_ = self.layout.slots_of(SERVO_LOG.kind)
        for slot in of_log.keys() & {poses, commands}:
            upper[slot] = min(ndtri(0.5 + 0.5 * LEVEL) * of_log[slot], upper[slot])
            lower[slot] = -upper[slot]
        if commands in of_log:  # Samples as far apart smooth an elevator like a lag.
            [lag] = self.layout.slots_of(SERVO_LAG.kind)
            lower[lag] = min(upper[commands], CLOCK_ERROR)
        return lower[slots], upper[slots]

    def on(self, records: Sequence[Record]) -> "Task":
        """Returns the same task on other flights."""
        return dataclasses.replace(self, records=records)

    def offering(self, names: Collection[str]) -> "Task":
        """Returns the task with only these of its effects and free functions."""
        kinds = tuple(name for name in self.kinds if name in names)
        blocks = {name: own for name, own in self.blocks.items() if name in names}
        return dataclasses.replace(self, kinds=kinds, blocks=blocks)

    def thinned(self, count: int) -> "Task":
        """Returns the task on at most `count` of its flights, evenly picked."""
        last = len(self.records) - 1
        keep = np.linspace(0, last, min(count, last + 1)).round().astype(int)
        return self.on([self.records[i] for i in keep])


def make_task(
    records: Sequence[Record], vehicle: Vehicle, kinds: tuple[str, ...]
) -> Task:
    """Returns the task of finding the effects in a vehicle's flights."""
    return Task(
        records=records,
        vehicle=vehicle,
        kinds=kinds,
        blocks=make_blocks(flown_values(records, vehicle.theta)),
    )
