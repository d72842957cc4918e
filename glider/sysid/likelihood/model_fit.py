"""Coefficients, free functions and scales fitted together to the flights of a campaign.

Gauss-Newton on the filter's innovations, which are linear in the coefficients about
each linearisation, and Fisher scoring for the scales in between. The step is found for
the model's free slots of theta and, after them, for the coordinates of its functions.

Each flight is linear about its own surroundings, smoothed constants and gusts, that
move with the model.
"""

import dataclasses
from collections.abc import Sequence

import numpy as np

from glider.compiled.parallel import in_parallel
from glider.physics.effects.free_functions import AIR_TERMS
from glider.sysid.constants import PRIOR_SCALES, RESOLVED
from glider.sysid.likelihood.directions import Direction, slopes
from glider.sysid.likelihood.filtering import (
    excludes,
    negative_log_likelihood,
    surroundings_of,
    whiten,
)
from glider.sysid.likelihood.fitted_functions import FittedFunction, values_at_nodes
from glider.sysid.likelihood.information import Prior, solve_scaled
from glider.sysid.likelihood.linear_flight import (
    FORCES,
    STILL_AIR,
    LinearFlight,
    Surroundings,
    linearize,
)
from glider.sysid.likelihood.scale_fit import fit_scales, lifted
from glider.sysid.likelihood.scales import NAMES, Scales
from glider.sysid.likelihood.task import FitResult, Task
from glider.sysid.replay.record import Record

_FEWEST_ITERATIONS = 2  # Before a fit may stop: the first step changes the scales too.
# Of free functions, in prior spreads: a fit that diverges does not overflow.
_LARGEST_COORDINATE = 30.0
_TOLERANCE = 0.3  # Gain of an iteration below which a fit stops [nats].
_MOST_TRIES = 3  # Of shorter steps in place of one.
_TRUSTED = 0.25  # Share of a promised gain that comes true where all is nearly linear.
_STRENGTH_ROUNDS = 8  # Of the fixed point of strengths.


def linear_flights(
    task: Task,
    model: FitResult,
    directions: Sequence[Direction] | None = None,
    others: Sequence[FittedFunction] = (),
) -> list[LinearFlight]:
    """Returns all flights, linear about a model; the functions' columns come last.

    Args:
        task: of the flights.
        model: the model and its surroundings.
        directions: of the columns before those of functions; by default those of the
            model's free parameters.
        others: functions whose columns follow those of the model's own.
    """
    if directions is None:
        directions = slopes(task.space, model.free)
    some = directions
    return in_parallel(lambda r: linear_flight(model, some, r, others), task.records)


def linear_flight(
    model: FitResult,
    directions: Sequence[Direction],
    record: Record,
    others: Sequence[FittedFunction] = (),
) -> LinearFlight:
    """Returns one flight, linear about a model; see `linear_flights`."""
    gaussians = model.gaussians
    functions = (*model.functions, *others)
    terms = sorted({own.effect.kind for own in functions})
    air = FORCES if model.has_force_errors else AIR_TERMS
    about = model.about.get(record.name, STILL_AIR)
    flight = linearize(record, model.theta, gaussians, directions, about, terms, air)
    if not functions:
        return flight

    # Columns are mixtures of Gaussians, which functions over the same variables share.
    values = values_at_nodes(flight, model.theta, gaussians)
    shown: dict[object, np.ndarray] = {}
    added = []
    for own in functions:
        basis = own.basis
        if basis not in shown:
            shown[basis] = own.along(values)
        added.append((own.effect, shown[basis] @ own.mix))

    return dataclasses.replace(flight, added=added)


def error_flights(task: Task, model: FitResult) -> list[LinearFlight]:
    """Returns all flights with one column, their error under a model."""
    return [flight.error_only() for flight in linear_flights(task, model, ())]


def prior_of(
    task: Task,
    model: FitResult,
    slots: Sequence[int] | None = None,
    start: np.ndarray | None = None,
) -> Prior:
    """Returns the prior of changes of a model, in its units.

    Args:
        task: has the priors and bounds of slots.
        model: from which the changes are counted.
        slots: of theta, by default the free ones; the coordinates of all functions
            follow.
        start: theta where shapes are expected, by default the model's.
    """
    slots = list(model.free if slots is None else slots)
    value = model.theta[slots]
    mean, precision = task.priors(slots, model.theta if start is None else start)
    lower, upper = task.bounds(slots)

    # Coordinates have a zero mean, and their function's strength as their spread.
    free = model.coordinates
    spreads = [b.strength for b in model.functions for _ in b.coordinates]
    return Prior(
        mean=np.append(mean - value, -free),
        precision=np.append(precision, np.array(spreads) ** -2.0),
        lower=np.append(lower - value, -_LARGEST_COORDINATE - free),
        upper=np.append(upper - value, _LARGEST_COORDINATE - free),
    )


def fit_model(
    task: Task,
    model: FitResult,
    iterations: int = 6,
    free_scales: Sequence[str] = NAMES,
    *,
    with_strength: bool = False,
) -> FitResult:
    """Fits a model's free parameters, its functions and its scales.

    Where a step does not lower the cost, it is tried again about the surroundings
    before it, and then shorter.

    Args:
        task: the flights, priors and bounds.
        model: where the fit begins.
        iterations: the most steps; none only fits the scales.
        free_scales: names of the scales to fit.
        with_strength: whether the strengths of functions are fitted at the end, and
            `freedom` computed.

    Returns:
        the best model; its cost is infinite if the fit diverges.
    """
    best = None
    step = None
    tries = 0
    current = model
    about_moves = True
    promised = np.inf
    flights = now = list[LinearFlight]()
    for iteration in range(iterations + 1):
        # The flights about the current model, and the scales that explain its errors.
        flights = now = []  # Before there are others.
        flights = linear_flights(task, current)
        now = [f.error_only() for f in flights]
        scales = current.scales
        if not iteration and len(free_scales) == len(NAMES):
            scales = lifted(scales)
        if free_scales:
            steps = 2 if iteration else 6
            scales, value = fit_scales(now, scales, free_scales, steps)
        else:
            value = float(negative_log_likelihood(now, scales).sum())

        # If they exclude the surroundings, it is linear about others first.
        if any(excludes(scales, own) for own in current.about.values()):
            current = dataclasses.replace(current, scales=scales)
            current = in_surroundings(task, current, now)
            continue

        # Is it better? Else a shorter step is tried from the best model.
        prior = prior_of(task, current, start=model.theta)
        value += 0.5 * float(prior.precision @ prior.mean**2)
        if not np.isfinite(value):
            value = np.inf
        current = dataclasses.replace(current, scales=scales, cost=value)
        if best is not None and not value < best.cost + 0.5 * _TOLERANCE:
            tries += 1
            if tries > _MOST_TRIES or step is None:
                break
            # First about the constants as they were: others shift the cost as well.
            if not about_moves:
                step = 0.5 * step
            about_moves = False
            current = moved(task, best, step)
            continue

        # Is it done? It may gain less than was promised where it is far from linear.
        gained = np.inf if best is None else best.cost - value
        best = current
        tries = 0
        if iteration == iterations:
            break
        is_done = gained < _TOLERANCE and _TRUSTED * promised < _TOLERANCE
        if is_done and iteration >= _FEWEST_ITERATIONS:
            break

        # The next step, and what the flights' surroundings are after it.
        gram = grams_of(flights, scales).sum(axis=0)
        step = prior.best_step(gram)
        promised = prior.gain(gram, step)
        if not np.all(np.isfinite(step)):  # It diverges.
            best = current = dataclasses.replace(best, cost=np.inf)
            break

        current = moved(task, best, step)
        if about_moves:
            now = [f.combined(step) for f in flights]
            current = in_surroundings(task, current, now)

    best = best or current
    if not with_strength:
        return best
    if current is not best:
        flights = []
    now = []
    return _fit_strength(task, best, flights)


def grams_of(flights: Sequence[LinearFlight], scales: Scales) -> np.ndarray:
    """Returns the flights' information on their columns, (flights, m + 1, m + 1)."""
    return np.stack(in_parallel(lambda f: whiten(f, scales).gram, flights))


def moved(task: Task, model: FitResult, step: np.ndarray) -> FitResult:
    """Returns a model with its free parameters and its functions changed by a step.

    Parameters stay within their bounds.

    Args:
        task: has the bounds.
        model: the model before.
        step: change of the free slots of theta, then of the coordinates.
    """
    index = list(model.free)
    count = len(index)
    theta = model.theta.copy()
    theta[index] = np.clip(theta[index] + step[:count], *task.bounds(index))
    functions = []
    for own, change in zip(model.functions, model.split(step[count:]), strict=True):
        coordinates = own.coordinates + change
        functions.append(dataclasses.replace(own, coordinates=coordinates))

    return dataclasses.replace(model, theta=theta, functions=tuple(functions))


def in_surroundings(
    task: Task, model: FitResult, flights: Sequence[LinearFlight]
) -> FitResult:
    """Returns a model about the constants and gusts that flights show.

    Args:
        task: says whether the flights' forces are known.
        model: with the scales of the constants and gusts.
        flights: of one column, the model's error.
    """
    about = surroundings_of(flights, model.scales)
    if not task.vehicle.knows_forces:  # Their errors are no gusts.
        about = {name: Surroundings(own.constants) for name, own in about.items()}
    return dataclasses.replace(model, about=about)


def _fit_strength(
    task: Task, model: FitResult, flights: Sequence[LinearFlight] = ()
) -> FitResult:
    """Returns the model with the prior strengths of functions that the flights show.

    What the marginal likelihood lacks of the cost, by Laplace's approximation, is
    `freedom`: ½ log |A| / |Λ| of effects' coefficients and functions, the unknown
    parameters eliminated.

    Args:
        task: of the flights.
        model: a fitted model.
        flights: linear about it; made so by default.
    """
    own = [j for j, slot in enumerate(model.free) if slot not in task.vehicle.nuisance]
    own += [j for place in model.places().values() for j in place]
    if not own:
        return dataclasses.replace(model, freedom=0.0)
    flights = flights or linear_flights(task, model)
    gram = grams_of(flights, model.scales).sum(axis=0)
    if not np.all(np.isfinite(gram)):  # It diverges.
        return dataclasses.replace(model, cost=np.inf)

    before = float(prior_of(task, model).added_to(gram)[-1, -1])
    if model.functions:
        model = _with_strengths(task, model, gram)

    # Of the volume, the share that the flights leave of the prior's.
    prior = prior_of(task, model)
    total = prior.added_to(gram)
    m = len(total) - 1
    precision = prior.precision[own]
    covariance = solve_scaled(total[:-1, :-1], np.eye(m), 1e-12)
    relative = covariance[np.ix_(own, own)]
    relative *= np.sqrt(precision[:, None] * precision)
    freedom = -0.5 * float(np.linalg.slogdet(relative)[1])
    model = dataclasses.replace(model, freedom=freedom)
    if not model.functions:
        return model

    # Other strengths are another optimum, one step away. Shapes stay: the cost is no
    # square of them, and is not computed again.
    linear = [j for j, slot in enumerate(model.free) if slot not in task.space.shapes]
    linear += range(len(model.free), m)
    keep = [*linear, m]
    step = np.zeros(m)
    step[linear] = prior.among(linear).best_step(gram[np.ix_(keep, keep)])
    gained = 0.5 * (before - float(total[-1, -1])) + prior.gain(gram, step)
    return dataclasses.replace(moved(task, model, step), cost=model.cost - gained)


def _with_strengths(task: Task, model: FitResult, gram: np.ndarray) -> FitResult:
    """Returns the model with the most likely strengths of its functions.

    MacKay's fixed point of the marginal likelihood (Neural Computation 4, 1992): the
    square of a strength is the mean of its coordinates' squares and variances, which
    the strengths determine in turn.

    Args:
        task: has the priors of slots.
        model: a fitted model.
        gram: the flights' information about it, (m + 1, m + 1).
    """
    first = len(model.free)
    start = model.coordinates
    for _ in range(_STRENGTH_ROUNDS):
        total = prior_of(task, model).added_to(gram)
        covariance = solve_scaled(total[:-1, :-1], np.eye(len(total) - 1), 1e-12)
        value = start + (covariance @ total[:-1, -1])[first:]
        squares = value**2 + np.diag(covariance)[first:]
        functions = []
        for fitted, mine in zip(model.functions, model.split(squares), strict=True):
            strength = np.clip(np.sqrt(np.mean(mine)), RESOLVED, PRIOR_SCALES)
            functions.append(dataclasses.replace(fitted, strength=float(strength)))

        model = dataclasses.replace(model, functions=tuple(functions))

    return model
