"""Candidate effects as columns of all flights, linear about one model.

`gather` linearizes the flights once, in every coefficient of every effect that may be
tried. Sets of effects are compared on the resulting columns' information by `Evidence`
or `HeldOutEvidence`, so that thousands of sets cost as much as one fit. An effect that
is not linear in its shapes has several variants, one for each choice of starting
shapes; a free function has several too, one for each strength.
"""

import dataclasses
from collections.abc import Sequence

import numpy as np

from glider.sysid.likelihood.directions import Direction, slopes, starts_of
from glider.sysid.likelihood.fitted_functions import FittedFunction
from glider.sysid.likelihood.information import (
    Evidence,
    Prior,
    counted_from,
    eliminate,
    solve,
)
from glider.sysid.likelihood.linear_flight import LinearFlight
from glider.sysid.likelihood.model_fit import (
    grams_of,
    in_surroundings,
    linear_flights,
    prior_of,
)
from glider.sysid.likelihood.scale_fit import fit_scales
from glider.sysid.likelihood.scales import Scales
from glider.sysid.likelihood.task import FitResult, Task

_Variant = tuple[int, ...]  # Columns of an effect with one choice of starting shapes.

_STRENGTHS = 0.1, 0.3, 1.0  # Tried of a free function that does not act yet.
_LARGEST_PUSH = 1e3  # Change of a state in an interval that no flight has.
_AT_ONCE = 4  # Flights whose information is in memory at once.
_IN_PART = 8  # Flights whose columns are.


@dataclasses.dataclass(frozen=True, kw_only=True)
class Candidates:
    """Columns of the flights about a model, and the effects they belong to.

    A flight's columns are those of `directions`, then of functions that act in the
    model, then of `functions`; the error is last.

    Attributes:
        task: of the flights.
        model: the model about which the flights are linear.
        directions: of the first columns.
        variants: kind of each effect to its variants, tuples of indices into `columns`;
            a kind that acts has one.
        flights: linear in the directions and in functions that act or may act.
        functions: free functions that do not act yet.
        columns: of each candidate, its column in `grams`, and the prior spread of its
            coordinate over that in `nothing`. Candidate j is column j itself, but for
            functions that do not act yet: each strength of theirs is another candidate.
    """

    task: Task
    model: FitResult
    directions: tuple[Direction, ...]
    variants: dict[str, tuple[_Variant, ...]]
    flights: Sequence[LinearFlight]
    functions: tuple[FittedFunction, ...] = ()
    columns: tuple[tuple[int, float], ...]

    @property
    def slots(self) -> list[int]:
        """Slots of theta that the directions move."""
        return [d.slot for d in self.directions]

    @property
    def always(self) -> list[int]:
        """Columns that act in every set: unknown parameters, given free functions."""
        own = self.task.vehicle.nuisance
        unknown = [j for j, slot in enumerate(self.slots) if slot in own]
        places = self.model.places(len(self.directions))
        names = places.keys() - {*self.model.kinds}
        return unknown + sorted(j for name in names for j in places[name])

    def grams(self, scales: Scales) -> np.ndarray:
        """Returns the flights' information on all columns, (flights, m + 1, m + 1).

        The error is that of the model without effects, see `nothing`.
        """
        grams = grams_of(self.flights, scales)
        return counted_from(grams, self.nothing()[0])

    def total(self, scales: Scales) -> np.ndarray:
        """Returns the sum of `grams`, (m + 1, m + 1).

        Only a few flights' information is in memory at once.
        """
        total = np.zeros(())
        for k in range(0, len(self.flights), _AT_ONCE):
            few = self.flights[k : k + _AT_ONCE]
            total = total + grams_of(few, scales).sum(axis=0)

        return counted_from(total, self.nothing()[0])

    def nothing(self) -> tuple[np.ndarray, Prior]:
        """Returns how the model without effects differs, and the prior about it.

        Functions that do not act yet have a prior spread of one; see `columns`.

        Returns:
            what of each column acts in the model (m,), see `counted_from`; and the
            prior of changes from the model without effects.
        """
        functions = (*self.model.functions, *self.functions)
        model = dataclasses.replace(self.model, functions=functions)
        prior = prior_of(self.task, model, self.slots)
        share = -prior.mean

        # Unknown parameters, given functions and shapes count from where they are.
        shapes = self.task.space.shapes
        is_shape = [j for j, slot in enumerate(self.slots) if slot in shapes]
        share[self.always + is_shape] = 0.0
        lower = prior.lower + share
        upper = prior.upper + share
        prior = dataclasses.replace(prior, mean=0.0 * share, lower=lower, upper=upper)
        return share, prior

    def evidence(self, gram: np.ndarray) -> Evidence:
        """Returns the evidence of sets of columns beside those that always act.

        Args:
            gram: the sum of `grams`, (m + 1, m + 1).
        """
        _, prior = self.nothing()
        always = self.always
        rest = eliminate(gram, always, prior.precision[always])

        # The prior of a column in each strength with which it is a candidate.
        at = [column for column, _ in self.columns]
        strengths = np.array([strength for _, strength in self.columns])
        prior = prior.among(at)
        precision = prior.precision / strengths**2
        prior = dataclasses.replace(prior, precision=precision)
        return Evidence(gram=rest, at=np.array(at, dtype=int), prior=prior)


def gather(task: Task, model: FitResult) -> Candidates:
    """Linearizes all flights about a model, in all candidates.

    Free functions are candidates too, those that do not act yet by their leading
    coordinates, with several strengths. Formulas that diverge on a flight are none.

    Args:
        task: the flights, and the effects and free functions to try.
        model: about which they are linear; what acts in it is a candidate as well.
    """
    directions, variants = _formulas(task, model)
    leading = [own.leading_only for own in task.functions.values()]
    functions = [own for own in leading if own.count and own.name not in model.kinds]
    # Only effects that do not act yet are left out: the others are in the model.
    flights = linear_flights(task, model, directions, functions)
    wild = tame(task, directions, flights)
    for kind in set(variants) - set(model.kinds):
        variants[kind] = [v for v in variants[kind] if v and wild.isdisjoint(v)]

    # Columns of functions that act.
    places = model.places(len(directions))
    for kind in model.free_kinds:
        variants[kind] = [tuple(places[kind])]

    # Columns of the other functions, each with several strengths.
    first = len(directions) + len(model.coordinates)
    scaled = [(j, 1.0) for j in range(first)]
    for function in functions:
        last = first + function.count
        variants[function.name] = []
        for strength in _STRENGTHS:
            begin = len(scaled)
            scaled += [(j, strength) for j in range(first, last)]
            variants[function.name].append(tuple(range(begin, len(scaled))))

        first = last

    return Candidates(
        task=task,
        model=model,
        directions=tuple(directions),
        variants={kind: tuple(own) for kind, own in variants.items() if own},
        flights=flights,
        functions=tuple(functions),
        columns=tuple(scaled),
    )


def _formulas(
    task: Task, model: FitResult
) -> tuple[list[Direction], dict[str, list[_Variant]]]:
    """Returns the directions of a model and of formulas to try, and their variants.

    Directions of the model's free slots come first. Those of unknown parameters and of
    slots that stay at a bound are in no variant. A kind without a formula has one empty
    variant if it acts.
    """
    space = task.space
    unknown = set(task.vehicle.nuisance)
    directions = slopes(space, model.free)
    idle = unknown | _at_bounds(task, model)
    acting: dict[str, _Variant] = dict.fromkeys(model.kinds, ())
    for j, d in enumerate(directions):
        if d.kind in acting and d.slot not in idle:
            acting[d.kind] += (j,)

    variants = {kind: [own] for kind, own in acting.items()}
    for kind in task.kinds:
        if kind in acting:
            continue
        allowed = set(task.free((kind,))) - unknown
        variants[kind] = []
        for columns in starts_of(space, space.kinds[kind], model.theta):
            first = len(directions)
            directions += [d for d in columns if d.slot in allowed]
            variants[kind].append(tuple(range(first, len(directions))))

    return directions, variants


def gather_in_parts(
    task: Task, model: FitResult, scales: Scales
) -> tuple[Candidates, np.ndarray]:
    """Gathers formulas on many flights, a few of which are in memory at once.

    A variant that diverges on any flight is no candidate.

    Args:
        task: the flights and the effects to try; its free functions are left out.
        model: about which they are linear.
        scales: of the noise, under which they are filtered.

    Returns:
        the candidates without flights; and `Candidates.grams` of all flights.
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

    # A variant is kept if all parts have it.
    variants = {}
    for kind, own in parts[0].variants.items():
        others = [part.variants.get(kind, ()) for part in parts]
        common = set(own).intersection(*others)
        if common or kind in model.kinds:
            variants[kind] = tuple(v for v in own if v in common)

    return dataclasses.replace(parts[0], task=task, variants=variants), grams


def _at_bounds(task: Task, model: FitResult) -> set[int]:
    """Returns the free slots that stay at a bound of theirs.

    Beyond it they would fit better, so that no set that moves them is physical: shapes,
    and sizes whose bound is that of no effect.
    """
    # Within a millionth of a coefficient's scale it is at the bound.
    slots = [i for i in model.free if i not in task.vehicle.nuisance]
    values = model.theta[slots]
    apart = np.abs(values - np.array(task.bounds(slots)))
    is_at_end = np.any(apart < 1e-6 * task.space.scale[slots], axis=0)
    is_none = values == task.vehicle.theta[slots]

    found = set()
    for slot, at_end, none in zip(slots, is_at_end, is_none, strict=True):
        if at_end and (none or slot in task.space.shapes):
            found.add(slot)
    return found


def tame(
    task: Task, directions: Sequence[Direction], flights: Sequence[LinearFlight]
) -> set[int]:
    """Sets columns that diverge on a flight to zero, and returns which those are.

    They push a state farther in an interval than any flight moves.

    Args:
        task: has the coefficients' scales; a push is that of one scale.
        directions: of the first columns.
        flights: their arrays are changed.

    Returns:
        the columns that are zero now.
    """
    slots = [d.slot for d in directions]
    largest = _LARGEST_PUSH / task.space.scale[slots]
    is_tame = np.ones(len(slots), dtype=bool)
    for flight in flights:
        pushes = np.abs(flight.inputs[..., : len(slots)]).max(axis=(0, 1))
        is_tame &= pushes < largest  # What is no number is not.

    wild = np.flatnonzero(~is_tame)
    for flight in flights:
        flight.inputs[..., wild] = 0.0

    return set(wild.tolist())


def saturated(candidates: Candidates, rounds: int) -> FitResult:
    """Returns the model with scales and surroundings as if all formulas acted.

    They act at once, shrunken: otherwise a missing effect would be taken for noise, or
    for gusts, before it is searched for.

    Args:
        candidates: about the model.
        rounds: of a step of all coefficients and a fit of the scales to what is left.
    """
    model = candidates.model
    prior = prior_of(candidates.task, model, candidates.slots)
    scales = model.scales
    acting = [  # Without the columns of functions that do not act.
        dataclasses.replace(flight, added=flight.added[: len(model.functions)])
        for flight in candidates.flights
    ]
    for _ in range(rounds):
        gram = grams_of(acting, scales).sum(axis=0)
        change = solve(prior.added_to(gram))
        flights = [f.combined(change) for f in acting]
        scales, _ = fit_scales(flights, scales, iterations=3)

    model = dataclasses.replace(model, scales=scales)
    own = in_surroundings(candidates.task, model, flights).about
    return dataclasses.replace(model, about=model.about | own)
