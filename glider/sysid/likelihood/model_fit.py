"""Coefficients, curves and scales fitted together to the flights of a campaign.

Gauss-Newton on the filter's innovations, which are linear in the coefficients about
each linearisation, and Fisher scoring for the scales in between.
"""

import dataclasses
from collections.abc import Sequence

import numpy as np

from glider.compiled.parallel import in_parallel
from glider.physics.effects import NO_FIELD, Field
from glider.physics.effects.field import FieldData, make_field
from glider.sysid.likelihood.information import bounded_step
from glider.sysid.likelihood.linear_flight import (
    NO_CONSTANTS,
    Direction,
    LinearFlight,
    linearize,
    slopes,
)
from glider.sysid.likelihood.scales import (
    NAMES,
    Scales,
    fit_scales,
    flight_constants,
    negative_log_likelihood,
    start_scales,
    whiten,
)
from glider.sysid.likelihood.task import Task
from glider.sysid.replay.record import Record
from glider.sysid.replay.smoothing import Noise

FEWEST_ITERATIONS = 2  # Before a fit may stop: the first step changes the scales too.
LARGEST_COORDINATE = 30.0  # Of a curve: it keeps a fit that diverges from overflow.
STRENGTH_RANGE = (0.1, 5.0)  # Of curves: less is as good as none, more no error of one.
_TOLERANCE = 0.3  # Gain of an iteration below which a fit stops [nats].


@dataclasses.dataclass(frozen=True, kw_only=True)
class FitResult:
    """A model with everything about it fitted."""

    kinds: tuple[str, ...]  #: That act.
    theta: np.ndarray  #: Its parameters and coefficients.
    free: tuple[int, ...]  #: Slots of theta that are fitted.
    coordinates: np.ndarray  #: Of the curves; empty where there are none.
    strength: float = 1.0  #: Prior strength of the curves.
    scales: Scales  #: Of all noise.
    #: Name of each flight to its constants, about which it is linear.
    constants: dict[str, np.ndarray] = dataclasses.field(default_factory=dict)
    extra: FieldData | None = None  #: An unmodelled field that acts too, or None.
    #: Whether errors of the forces stand in for moving air, see
    #: `LinearFlight.with_force_errors`; `scales.air` is then of coefficients.
    has_force_errors: bool = False
    cost: float = np.inf  #: Negative log posterior [nats].
    freedom: float = 0.0  #: Penalty for prior volume that curves do not fill [nats].

    @property
    def has_curves(self) -> bool:
        """Whether curves act."""
        return len(self.coordinates) > 0


def start_of(task: Task, noise: Noise, with_curves: bool) -> FitResult:
    """Returns the nominal model, unfitted, in still air."""
    count = task.curves.count if with_curves else 0
    return FitResult(
        kinds=(),
        theta=task.vehicle.theta.copy(),
        free=task.free(()),
        coordinates=np.zeros(count),
        scales=start_scales(noise),
    )


def field_of(task: Task, model: FitResult) -> Field:
    """Returns a model's curves and its extra field as the dynamics take them."""
    parts = [task.curves.field(model.coordinates)] if model.has_curves else []
    if model.extra is not None:
        parts.append(make_field(model.extra))
    if not parts:
        return NO_FIELD
    return Field(*(np.vstack(arrays) for arrays in zip(*parts, strict=True)))


def linear_flights(
    task: Task, model: FitResult, directions: Sequence[Direction] | None = None
) -> list[LinearFlight]:
    """Returns all flights, linear about a model; the curves' columns come last.

    By default the columns before them are those of the model's free parameters.
    """
    field, curves = field_of(task, model), task.curves
    if directions is None:
        directions = slopes(task.layout, model.theta, model.free)

    def one(record: Record) -> LinearFlight:  # It holds one flight only.
        own = model.constants.get(record.name, NO_CONSTANTS)
        flight = linearize(record, model.theta, field, directions, own)
        if model.has_force_errors:
            flight = flight.with_force_errors()
        if not model.has_curves:
            return flight
        return curves.added_to(flight, model.theta, curves.mix)

    return in_parallel(one, task.records)


def error_flights(task: Task, model: FitResult) -> list[LinearFlight]:
    """Returns all flights with one column, their error under a model."""
    return [flight.error_only() for flight in linear_flights(task, model, ())]


@dataclasses.dataclass(frozen=True, kw_only=True)
class Prior:
    """Prior of changes of a model: along slots of theta, then of the curves."""

    mean: np.ndarray  #: (m,) expected changes.
    precision: np.ndarray  #: (m,)
    lower: np.ndarray  #: (m,) least changes that are physical.
    upper: np.ndarray  #: (m,) largest.

    def added_to(self, gram: np.ndarray) -> np.ndarray:
        """Returns a Gram matrix with the prior added as one more flight."""
        total = gram.copy()
        total[:-1, :-1] += np.diag(self.precision)
        total[:-1, -1] += self.precision * self.mean
        total[-1, :-1] = total[:-1, -1]
        total[-1, -1] += float(self.precision @ self.mean**2)
        return total

    def best_step(self, gram: np.ndarray) -> np.ndarray:
        """Returns the most probable physical change (m,)."""
        return bounded_step(self.added_to(gram), self.lower, self.upper)


def prior_of(
    task: Task,
    model: FitResult,
    slots: Sequence[int] | None = None,
    start: np.ndarray | None = None,
) -> Prior:
    """Returns the prior of slots, by default the free ones, and of the curves.

    Shapes are expected where they are in `start`, by default the model's theta.
    """
    slots = list(model.free if slots is None else slots)
    (lower, upper), value = task.bounds(slots), model.theta[slots]
    mean, precision = task.priors(slots, model.theta if start is None else start)
    curves = model.coordinates
    return Prior(
        mean=np.append(mean - value, -curves),
        precision=np.append(precision, np.full(len(curves), model.strength**-2)),
        lower=np.append(lower - value, -LARGEST_COORDINATE - curves),
        upper=np.append(upper - value, LARGEST_COORDINATE - curves),
    )


def fit_model(
    task: Task,
    model: FitResult,
    iterations: int = 6,
    free_scales: Sequence[str] = NAMES,
) -> FitResult:
    """Fits a model's free parameters, its curves and its scales."""
    best, about, step, halvings = None, [], None, 0
    current = model
    for iteration in range(iterations + 1):
        flights = linear_flights(task, current)
        now = [f.error_only() for f in flights]
        scales = current.scales
        if free_scales:
            scales, value = fit_scales(
                now, scales, free_scales, iterations=2 if iteration else 6
            )
        else:
            value = float(negative_log_likelihood(now, scales).sum())
        prior = prior_of(task, current, start=model.theta)
        value += 0.5 * float(prior.precision @ prior.mean**2)
        value = value if np.isfinite(value) else np.inf
        current = dataclasses.replace(current, scales=scales, cost=value)
        if best is not None and not value < best.cost + 0.5 * _TOLERANCE:
            halvings += 1
            if halvings > 3 or step is None:
                break
            step = 0.5 * step
            current = _moved_with(task, best, about, step)
            continue
        gained = np.inf if best is None else best.cost - value
        best, about = current, flights
        if iteration == iterations:
            break
        if gained < _TOLERANCE and iteration >= FEWEST_ITERATIONS:
            break
        step = prior.best_step(grams_of(flights, scales).sum(axis=0))
        if not np.all(np.isfinite(step)):  # It diverges.
            best = dataclasses.replace(best, cost=np.inf)
            break
        current = _moved_with(task, best, about, step)
    assert best is not None
    return best


def grams_of(flights: Sequence[LinearFlight], scales: Scales) -> np.ndarray:
    """Returns the flights' information on their columns, (flights, m + 1, m + 1)."""
    return np.stack(in_parallel(lambda f: whiten(f, scales).gram, flights))


def moved(task: Task, model: FitResult, step: np.ndarray) -> FitResult:
    """Returns a model with its free parameters and its curves changed by a step."""
    index, theta = list(model.free), model.theta.copy()
    theta[index] = np.clip(theta[index] + step[: len(index)], *task.bounds(index))
    coordinates = model.coordinates + step[len(index) :]
    return dataclasses.replace(model, theta=theta, coordinates=coordinates)


def _moved_with(
    task: Task, model: FitResult, flights: Sequence[LinearFlight], step: np.ndarray
) -> FitResult:
    """Returns a model changed by a step, and the flights' constants with it."""
    constants = flight_constants([f.combined(step) for f in flights], model.scales)
    return dataclasses.replace(moved(task, model, step), constants=constants)


def with_constants(task: Task, model: FitResult) -> FitResult:
    """Returns a model with the constants of each flight of a task, old and new."""
    constants = flight_constants(error_flights(task, model), model.scales)
    return dataclasses.replace(model, constants=constants)


def fit_strength(task: Task, model: FitResult, rounds: int = 8) -> FitResult:
    """Returns the model with the prior strength of the curves that the flights show.

    MacKay's fixed point of the marginal likelihood (Neural Computation 4, 1992).
    """
    if not model.has_curves:
        return model
    gram = grams_of(linear_flights(task, model), model.scales).sum(axis=0)
    if not np.all(np.isfinite(gram)):  # It diverges.
        return dataclasses.replace(model, cost=np.inf)
    strength, curve = model.strength, slice(len(model.free), None)
    for _ in range(rounds):
        prior = prior_of(task, dataclasses.replace(model, strength=strength))
        total = prior.added_to(gram)
        covariance = np.linalg.inv(total[:-1, :-1])
        value = model.coordinates + (covariance @ total[:-1, -1])[curve]
        mean_square = np.mean(value**2 + np.diag(covariance)[curve])
        strength = float(np.clip(np.sqrt(mean_square), *STRENGTH_RANGE))
    corner = np.linalg.inv(covariance[curve, curve])
    freedom = 0.5 * float(np.linalg.slogdet(corner)[1])
    freedom += len(corner) * np.log(strength)
    return dataclasses.replace(model, strength=strength, freedom=freedom)
