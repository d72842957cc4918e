"""The task of a fit, flights and the effects to try, and a model that is fitted."""

import dataclasses
import functools
from collections.abc import Collection, Mapping, Sequence

import numpy as np
from scipy.special import ndtri

from glider.physics.confidence import LEVEL
from glider.physics.effects import SERVO_LAG, Gaussians
from glider.physics.effects.free_functions import gaussians_of
from glider.physics.parameter_space import ParameterSpace
from glider.sysid.constants import CLOCK_ERROR, PRIOR_SCALES
from glider.sysid.likelihood.fitted_functions import (
    FittedFunction,
    flown_values,
    make_functions,
)
from glider.sysid.likelihood.linear_flight import Surroundings
from glider.sysid.likelihood.scales import Scales, start_scales
from glider.sysid.replay.log_space import SERVO_LOG
from glider.sysid.replay.record import Noise, Record, evenly
from glider.sysid.replay.vehicle import Vehicle


@dataclasses.dataclass(frozen=True, kw_only=True)
class Task:
    """Flights and a model to fit to them."""

    records: Sequence[Record]  #: The flights.
    vehicle: Vehicle  #: What is known of the glider.
    kinds: tuple[str, ...]  #: Effects to try.
    functions: Mapping[str, FittedFunction]  #: Free functions to try, by name.

    @property
    def space(self) -> ParameterSpace:
        """ParameterSpace of theta."""
        return self.vehicle.space

    @property
    def offered(self) -> set[str]:
        """Effects and free functions to try."""
        return {*self.kinds, *self.functions}

    def free(self, kinds: Sequence[str]) -> tuple[int, ...]:
        """Returns the indices into theta to fit for a set of kinds, sorted."""
        space = self.space
        unknown = {space.names[i] for i in self.vehicle.nuisance}
        slots = {*self.vehicle.nuisance}
        for kind in kinds:
            own = space.slots_of(kind)
            is_unknown = own and not unknown.isdisjoint(space.kinds[kind].like)
            slots.update(own[1:] if is_unknown else own)
        return tuple(sorted(slots))

    def priors(
        self, slots: Sequence[int], theta: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Returns prior means and precisions of slots; shapes are where they are."""
        vehicle = self.vehicle
        scale = PRIOR_SCALES * self.space.scale
        means = [
            theta[i] if i in self.space.shapes else vehicle.theta[i] for i in slots
        ]
        spreads = [vehicle.nuisance.get(i, scale[i]) for i in slots]
        return np.array(means), np.array(spreads) ** -2.0

    def bounds(self, slots: Sequence[int]) -> tuple[np.ndarray, np.ndarray]:
        """Returns the least and the largest values of slots that are possible."""
        slots = list(slots)
        of_log = self.vehicle.of_log
        lower = self.space.lower.copy()
        upper = self.space.upper.copy()
        poses, commands, *_ = self.space.slots_of(SERVO_LOG.kind)
        for slot in of_log.keys() & {poses, commands}:
            upper[slot] = min(ndtri(0.5 + 0.5 * LEVEL) * of_log[slot], upper[slot])
            lower[slot] = -upper[slot]

        if commands in of_log:  # Samples as far apart smooth an elevator like a lag.
            [lag] = self.space.slots_of(SERVO_LAG.kind)
            lower[lag] = min(upper[commands], CLOCK_ERROR)

        return lower[slots], upper[slots]

    def on(self, records: Sequence[Record]) -> "Task":
        """Returns the same task on other flights."""
        return dataclasses.replace(self, records=records)

    def offering(self, names: Collection[str]) -> "Task":
        """Returns the task with only these of its effects and free functions."""
        kinds = tuple(name for name in self.kinds if name in names)
        functions = {name: own for name, own in self.functions.items() if name in names}
        return dataclasses.replace(self, kinds=kinds, functions=functions)

    def thinned(self, count: int) -> "Task":
        """Returns the task on at most `count` of its flights, evenly picked."""
        return self.on(evenly(self.records, count))


def make_task(
    records: Sequence[Record], vehicle: Vehicle, kinds: tuple[str, ...]
) -> Task:
    """Returns the task of finding the effects in a vehicle's flights."""
    return Task(
        records=records,
        vehicle=vehicle,
        kinds=kinds,
        functions=make_functions(flown_values(records, vehicle.theta)),
    )


@dataclasses.dataclass(frozen=True, kw_only=True)
class FitResult:
    """A model with everything about it fitted."""

    kinds: tuple[str, ...]  #: That act.
    theta: np.ndarray  #: Its parameters and coefficients.
    free: tuple[int, ...]  #: Slots of theta that are fitted.
    #: Free functions that act: those of `kinds`, and in a forecast the given ones.
    functions: tuple[FittedFunction, ...] = ()
    scales: Scales  #: Of all noise.
    #: Name of each flight to what it is linear about.
    about: dict[str, Surroundings] = dataclasses.field(default_factory=dict)
    #: Whether errors of the forces stand in for moving air, see
    #: `linear_flight.FORCES`; `scales.air` is then of coefficients.
    has_force_errors: bool = False
    cost: float = np.inf  #: Negative log posterior [nats].
    #: Penalty for the volume of the prior that effects do not fill [nats].
    freedom: float = 0.0

    @property
    def by_name(self) -> dict[str, FittedFunction]:
        """Functions that act, by name."""
        return {own.name: own for own in self.functions}

    @functools.cached_property
    def gaussians(self) -> Gaussians:
        """Functions that act, as the dynamics take them."""
        return gaussians_of(b.data for b in self.functions if b.coordinates.any())

    @property
    def free_kinds(self) -> tuple[str, ...]:
        """Free functions among the kinds."""
        return tuple(b.name for b in self.functions if b.name in self.kinds)

    @property
    def coordinates(self) -> np.ndarray:
        """Of all functions, one after the other."""
        return np.concatenate(
            [np.zeros(0), *(own.coordinates for own in self.functions)]
        )

    def places(self, first: int | None = None) -> dict[str, range]:
        """Returns the columns of each function; by default after those of `free`."""
        first = len(self.free) if first is None else first
        found = {}
        for own in self.functions:
            found[own.name] = range(first, first + own.count)
            first += own.count
        return found

    def split(self, values: np.ndarray) -> list[np.ndarray]:
        """Splits values of all coordinates by functions."""
        return [values[columns] for columns in self.places(0).values()]

    def without(self, task: Task, *gone: str) -> "FitResult":
        """Returns the model without some of its effects."""
        theta = self.theta.copy()
        slots = [i for kind in gone for i in task.space.slots_of(kind)]
        theta[slots] = task.vehicle.theta[slots]
        kinds = tuple(kind for kind in self.kinds if kind not in gone)
        functions = tuple(own for own in self.functions if own.name not in gone)
        return dataclasses.replace(
            self, kinds=kinds, theta=theta, free=task.free(kinds), functions=functions
        )


def start_of(task: Task, noise: Noise) -> FitResult:
    """Returns the nominal model, unfitted, in still air."""
    return FitResult(
        kinds=(),
        theta=task.vehicle.theta.copy(),
        free=task.free(()),
        scales=start_scales(noise),
    )
