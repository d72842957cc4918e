"""Candidate effects as columns of all flights, linear about one model."""

import dataclasses
from collections.abc import Sequence

import numpy as np

from glider.sysid.likelihood import model_fit
from glider.sysid.likelihood.directions import Direction, slopes, starts_of
from glider.sysid.likelihood.fitted_functions import FittedFunction
from glider.sysid.likelihood.information import (
    Evidence,
    Prior,
    counted_from,
    eliminate,
    solve,
    solve_scaled,
)
from glider.sysid.likelihood.linear_flight import LinearFlight
from glider.sysid.likelihood.scale_fit import fit_scales
from glider.sysid.likelihood.scales import Scales
from glider.sysid.likelihood.task import FitResult, Task

_Variant = tuple[int, ...]  # Columns of an effect with one choice of starting shapes.

_STRENGTHS = 0.1, 0.3, 1.0  # Tried of a free function that does not act yet.
_LARGEST_PUSH = 1e3  # Change of a state in an interval that no flight has.
_AT_ONCE = 4  # Flights whose information is in memory at once.
_IN_PART = 8  # Flights whose columns are.
_MOST_ENTRIES = 1_000_000  # Of matrices that are solved at once, for the memory.
_SLACK = 1e-9  # Rounding by which a bound may be passed.


@dataclasses.dataclass(frozen=True, kw_only=True)
class Candidates:
    """Columns of the flights about a model, and the effects they belong to."""

    task: Task  #: Of the flights.
    model: FitResult  #: About which the flights are linear.
    #: Of the columns; those of acting functions follow.
    directions: tuple[Direction, ...]
    variants: dict[str, tuple[_Variant, ...]]  #: By kind; one of a kind that acts.
    flights: Sequence[LinearFlight]  #: Linear in the directions and what acts.
    #: That do not act yet; their columns come last.
    functions: tuple[FittedFunction, ...] = ()
    #: Column of each of a variant, and the prior spread of its coordinate.
    columns: tuple[tuple[int, float], ...]

    @property
    def slots(self) -> list[int]:
        """Slots of theta that the directions move."""
        return [d.slot for d in self.directions]

    @property
    def always(self) -> list[int]:
        """Columns that act in every set: unknown parameters, given free functions."""
        own = set(self.task.vehicle.nuisance)
        model = self.model
        places = model.places(len(self.directions))
        given = (places[name] for name in places.keys() - {*model.kinds})
        unknown = [j for j, slot in enumerate(self.slots) if slot in own]
        return [*unknown, *sorted(j for place in given for j in place)]

    def grams(self, scales: Scales) -> np.ndarray:
        """Returns the flights' information on all columns, (flights, m + 1, m + 1).

        The error is that of the model without effects, see `nothing`.
        """
        grams = model_fit.grams_of(self.flights, scales)
        return counted_from(grams, self.nothing()[0])

    def total(self, scales: Scales) -> np.ndarray:
        """Returns the sum of `grams`, a few flights' at a time in memory."""
        total = np.zeros(())
        for k in range(0, len(self.flights), _AT_ONCE):
            few = model_fit.grams_of(self.flights[k : k + _AT_ONCE], scales)
            total = total + few.sum(axis=0)

        return counted_from(total, self.nothing()[0])

    def nothing(self) -> tuple[np.ndarray, Prior]:
        """Returns the model without effects, and the prior about it.

        That is what of each column acts in the model (m,), see `counted_from`.
        Functions that do not act yet have a prior spread of one; see `columns`.
        """
        functions = (*self.model.functions, *self.functions)
        model = dataclasses.replace(self.model, functions=functions)
        prior = model_fit.prior_of(self.task, model, self.slots)
        is_shape = [
            j for j, slot in enumerate(self.slots) if slot in self.task.space.shapes
        ]
        share = -prior.mean
        share[self.always + is_shape] = 0.0  # They count from where they are.
        lower = prior.lower + share
        upper = prior.upper + share
        prior = dataclasses.replace(prior, mean=0.0 * share, lower=lower, upper=upper)
        return share, prior

    def evidence(self, gram: np.ndarray) -> Evidence:
        """Returns the evidence of sets of columns beside those that always act.

        `gram` is the sum of `grams`.
        """
        _, prior = self.nothing()
        always = self.always
        rest = eliminate(gram, always, prior.precision[always])
        at = [column for column, _ in self.columns]
        strengths = np.array([strength for _, strength in self.columns])
        prior = prior.among(at)
        precision = prior.precision / strengths**2
        prior = dataclasses.replace(prior, precision=precision)
        return Evidence(gram=rest, at=np.array(at, dtype=int), prior=prior)


class HeldOutEvidence:
    """Log-likelihood that columns gain on flights, each held out in turn [nats].

    An error common to all flights is evidence for any effect that imitates it, more of
    it with more flights; cross-validation does not reward that (Stone, J. R. Stat. Soc.
    B 39, 1977). Everything is linear, so that each flight is held out exactly, the
    unknown parameters of the vehicle refitted without it.
    """

    def __init__(self, candidates: Candidates, grams: np.ndarray):
        """Takes the flights' information, that of `Candidates.grams`."""
        self._always = np.array(candidates.always, int)
        _, self._prior = candidates.nothing()
        self._own = grams
        self._sum = self._own.sum(axis=0, keepdims=True)
        self._rest = self._sum - self._own
        self._alone = self._costs(self._always[None])

    def extended(
        self, columns: Sequence[int], more: Sequence[Sequence[int]]
    ) -> list[float]:
        """Gain of columns with each of several others over none; -inf: not physical."""
        always = len(self._always)
        sets = [[*self._always, *columns, *variant] for variant in more]
        sizes = np.array([len(own) for own in sets])
        gains = np.zeros(len(sets))
        for size in np.unique(sizes[sizes > always]):
            # Equally large sets at once, in parts that fit the memory.
            at = np.flatnonzero(sizes == size)
            parts = 1 + len(at) * len(self._own) * size**2 // _MOST_ENTRIES
            for part in np.array_split(at, min(parts, len(at))):
                own = np.array([sets[i] for i in part])
                step = self._steps(self._sum, own)[0]
                lower = self._prior.lower[own]
                upper = self._prior.upper[own]
                is_out = step < lower - _SLACK * np.abs(lower)
                is_out |= step > upper + _SLACK * np.abs(upper)
                gain = np.sum(self._alone - self._costs(own), axis=0)
                is_physical = ~is_out[:, always:].any(axis=1)
                gains[part] = np.where(is_physical, gain, -np.inf)

        return gains.tolist()

    def step(self, columns: Sequence[int]) -> np.ndarray:
        """Returns the coefficients of columns, counted from zero."""
        sets = np.array([[*self._always, *columns]], dtype=int)
        return self._steps(self._sum, sets)[0, 0, len(self._always) :]

    def _steps(self, grams: np.ndarray, sets: np.ndarray) -> np.ndarray:
        """Returns the likeliest changes (n, v, m) by information (n, M + 1, M + 1)."""
        precision = self._prior.precision[sets][..., None] * np.eye(sets.shape[1])
        systems = grams[:, sets[..., None], sets[:, None]] + precision
        return solve_scaled(systems, grams[:, sets, -1], 0.0)

    def _costs(self, sets: np.ndarray) -> np.ndarray:
        """Returns flights' costs by what the others say of sets of columns (n, v)."""
        steps = self._steps(self._rest, sets)
        weights = np.concatenate([-steps, np.ones((*steps.shape[:2], 1))], axis=2)
        index = np.pad(sets, ((0, 0), (0, 1)), constant_values=-1)
        own = self._own[:, index[..., None], index[:, None]]
        return 0.5 * np.sum(weights * (own @ weights[..., None])[..., 0], axis=2)


def gather(task: Task, model: FitResult) -> Candidates:
    """Linearizes all flights about a model, in all candidates.

    Free functions are candidates too, those that do not act yet by their leading
    coordinates, with several strengths.
    """
    space = task.space
    leading = [own.leading_only for own in task.functions.values()]
    functions = [own for own in leading if own.count and own.name not in model.kinds]
    own = set(task.vehicle.nuisance)
    directions = slopes(space, model.free)
    idle = own | _at_bounds(task, model)
    acting = [(j, d.kind) for j, d in enumerate(directions) if d.slot not in idle]
    # No columns of an effect that is at its bounds.
    variants: dict[str, list[_Variant]] = {
        kind: [tuple(j for j, other in acting if other == kind)] for kind in model.kinds
    }
    for kind in [kind for kind in task.kinds if kind not in variants]:
        allowed = set(task.free((kind,))) - own
        variants[kind] = []
        for columns in starts_of(space, space.kinds[kind], model.theta):
            first = len(directions)
            directions += [d for d in columns if d.slot in allowed]
            variants[kind].append(tuple(range(first, len(directions))))

    # Formulas that diverge on a flight are no candidates.
    flights = model_fit.linear_flights(task, model, directions, functions)
    wild = tame(task, directions, flights)
    for kind in set(variants) - set(model.kinds):
        variants[kind] = [v for v in variants[kind] if v and not wild & set(v)]

    # Columns of functions that act, and of others, each with several strengths.
    places = model.places(len(directions))
    variants |= {kind: [tuple(places[kind])] for kind in model.free_kinds}
    first = len(directions) + len(model.coordinates)
    scaled = [(j, 1.0) for j in range(first)]
    for function in functions:
        variants[function.name] = []
        for strength in _STRENGTHS:
            begin = len(scaled)
            scaled += [(first + j, strength) for j in range(function.count)]
            variants[function.name].append(tuple(range(begin, len(scaled))))

        first += function.count

    return Candidates(
        task=task,
        model=model,
        directions=tuple(directions),
        variants={kind: tuple(own) for kind, own in variants.items() if own},
        flights=flights,
        functions=tuple(functions),
        columns=tuple(scaled),
    )


def gather_in_parts(
    task: Task, model: FitResult, scales: Scales
) -> tuple[Candidates, np.ndarray]:
    """Gathers formulas on many flights, a few of which are in memory at once.

    Returns:
        the candidates without flights, and `grams` of all.
    """
    task = task.offering(task.kinds)
    records = task.records
    parts = list[Candidates]()
    grams = np.empty((0, 0, 0))
    for k in range(0, len(records), _IN_PART):
        part = gather(task.on(records[k : k + _IN_PART]), model)
        found = part.grams(scales)
        if not k:  # Not stacked afterwards, which takes twice the memory.
            grams = np.empty((len(records), *found.shape[1:]))
        grams[k : k + _IN_PART] = found
        parts.append(dataclasses.replace(part, flights=()))
        del part  # Before there are others.

    kept = {  # What diverges on some flights is offered on none.
        kind: tuple(v for v in own if all(v in p.variants.get(kind, ()) for p in parts))
        for kind, own in parts[0].variants.items()
    }

    variants = {k: own for k, own in kept.items() if own or k in model.kinds}
    return dataclasses.replace(parts[0], task=task, variants=variants), grams


def _at_bounds(task: Task, model: FitResult) -> set[int]:
    """Returns the free slots that stay at a bound of theirs.

    Beyond it they would fit better, so that no set that moves them is physical: shapes,
    and sizes whose bound is that of no effect.
    """
    slots = [i for i in model.free if i not in task.vehicle.nuisance]
    ends = np.array(task.bounds(slots))
    values = model.theta[slots]
    is_at_end = np.any(np.abs(values - ends) < 1e-6 * task.space.scale[slots], axis=0)
    is_none = values == task.vehicle.theta[slots]
    is_shape = np.array([slot in task.space.shapes for slot in slots], dtype=bool)
    return set(np.array(slots)[is_at_end & (is_shape | is_none)].tolist())


def tame(
    task: Task, directions: Sequence[Direction], flights: Sequence[LinearFlight]
) -> set[int]:
    """Sets columns that diverge on a flight to zero, and returns which those are."""
    count = len(directions)
    largest = _LARGEST_PUSH / task.space.scale[[d.slot for d in directions]]
    pushes = [np.abs(flight.inputs[..., :count]).max(axis=(0, 1)) for flight in flights]
    is_tame = np.all(np.array(pushes) < largest, axis=0)  # What is no number is not.
    wild = np.flatnonzero(~is_tame)
    for flight in flights:
        flight.inputs[..., wild] = 0.0

    return set(wild.tolist())


def saturated(candidates: Candidates, rounds: int) -> FitResult:
    """Returns the model with scales and surroundings as if all formulas acted.

    They act at once, shrunken: otherwise a missing effect would be taken for noise, or
    for gusts, before it is searched for.
    """
    model = candidates.model
    prior = model_fit.prior_of(candidates.task, model, candidates.slots)
    scales = model.scales
    acting = [
        dataclasses.replace(flight, added=flight.added[: len(model.functions)])
        for flight in candidates.flights
    ]
    for _ in range(rounds):
        gram = model_fit.grams_of(acting, scales).sum(axis=0)
        change = solve(prior.added_to(gram))
        flights = [f.combined(change) for f in acting]
        scales, _ = fit_scales(flights, scales, iterations=3)

    model = dataclasses.replace(model, scales=scales)
    own = model_fit.in_surroundings(candidates.task, model, flights).about
    return dataclasses.replace(model, about=model.about | own)
