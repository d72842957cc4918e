"""The task of a fit, flights and the effects to try, and a model that is fitted.

A `Task` says what may be fitted, with priors and bounds; a `FitResult` is one model of
it, fitted or about to be. Both hold the numbers of a glider as a vector theta, whose
slots `ParameterSpace` names. Free functions have their coordinates beside it.
"""

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
    """Flights and what to try on them.

    Attributes:
        records: the flights.
        vehicle: what is known of the glider.
        kinds: effects to try.
        functions: free functions to try, by name.
    """

    records: Sequence[Record]
    vehicle: Vehicle
    kinds: tuple[str, ...]
    functions: Mapping[str, FittedFunction]

    @property
    def space(self) -> ParameterSpace:
        """ParameterSpace of theta."""
        return self.vehicle.space

    @property
    def offered(self) -> set[str]:
        """Effects and free functions to try."""
        return {*self.kinds, *self.functions}

    def free(self, kinds: Sequence[str]) -> tuple[int, ...]:
        """Returns the slots of theta to fit for a set of kinds, sorted.

        An unknown parameter of the vehicle stands for the first coefficient of an
        effect that is like it.
        """
        space = self.space
        nuisance = self.vehicle.nuisance
        unknown = {space.names[slot] for slot in nuisance}
        found = {*nuisance}
        for kind in kinds:
            slots = space.slots_of(kind)  # None of a free function.
            if slots and not unknown.isdisjoint(space.kinds[kind].like):
                slots = slots[1:]
            found.update(slots)

        return tuple(sorted(found))

    def priors(
        self, slots: Sequence[int], theta: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Returns the prior means (m,) and precisions (m,) of slots of theta.

        A shape has its prior mean where it is.
        """
        nuisance = self.vehicle.nuisance
        shapes = [*self.space.shapes]
        means = self.vehicle.theta.copy()
        means[shapes] = theta[shapes]
        spreads = PRIOR_SCALES * self.space.scale
        spreads[[*nuisance]] = [*nuisance.values()]
        chosen = [*slots]
        return means[chosen], spreads[chosen] ** -2.0

    def bounds(self, slots: Sequence[int]) -> tuple[np.ndarray, np.ndarray]:
        """Returns the least and the largest possible values (m,) of slots of theta.

        Offsets of the log's clocks stay within their confidence band.
        """
        log_errors = self.vehicle.of_log
        lower = self.space.lower.copy()
        upper = self.space.upper.copy()
        poses, commands, *_ = self.space.slots_of(SERVO_LOG.kind)
        for slot in log_errors.keys() & {poses, commands}:
            band = ndtri(0.5 + 0.5 * LEVEL) * log_errors[slot]
            upper[slot] = min(band, upper[slot])
            lower[slot] = -upper[slot]

        # Samples as far apart as the clock's error smooth an elevator like a lag.
        if commands in log_errors:
            [lag] = self.space.slots_of(SERVO_LAG.kind)
            lower[lag] = min(upper[commands], CLOCK_ERROR)

        chosen = [*slots]
        return lower[chosen], upper[chosen]

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
    """A model with everything about it fitted.

    Attributes:
        kinds: effects and free functions that act.
        theta: parameters and coefficients, a vector of the task's space.
        free: slots of theta that are fitted.
        functions: free functions that act: those of `kinds`, and in a forecast the
            given ones.
        scales: standard deviations of all noise.
        about: name of each flight to what it is linear about.
        has_force_errors: whether errors of the forces stand in for moving air, see
            `linear_flight.FORCES`; `scales.air` is then of coefficients.
        cost: negative log posterior [nats].
        freedom: penalty for the volume of the prior that effects do not fill [nats].
    """

    kinds: tuple[str, ...]
    theta: np.ndarray
    free: tuple[int, ...]
    functions: tuple[FittedFunction, ...] = ()
    scales: Scales
    about: dict[str, Surroundings] = dataclasses.field(default_factory=dict)
    has_force_errors: bool = False
    cost: float = np.inf
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
        """Coordinates of all functions, one function after the other."""
        parts = [own.coordinates for own in self.functions]
        return np.concatenate([np.zeros(0), *parts])

    def places(self, first: int | None = None) -> dict[str, range]:
        """Returns the columns of each function's coordinates.

        Args:
            first: column of the first coordinate; by default those of `free` precede.
        """
        begin = len(self.free) if first is None else first
        found = {}
        for own in self.functions:
            end = begin + own.count
            found[own.name] = range(begin, end)
            begin = end

        return found

    def split(self, values: np.ndarray) -> list[np.ndarray]:
        """Splits values of all coordinates by functions."""
        return [values[columns] for columns in self.places(0).values()]

    def without(self, task: Task, *gone: str) -> "FitResult":
        """Returns the model without some of its effects, the others unchanged.

        Their coefficients in theta are those of the nominal glider.
        """
        theta = self.theta.copy()
        for kind in gone:
            slots = [*task.space.slots_of(kind)]
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
