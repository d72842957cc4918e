"""Which effects do the flights show? Sets of the library, by their evidence.

In turn: all flights are made linear about the best model so far, the scales of noise
are fitted with everything acting at once, the best set of effects is searched in closed
form, and that set is fitted with its curves and scales. It ends where a set comes back.
"""

import dataclasses
from collections.abc import Callable

import numpy as np

from glider.compiled.parallel import in_parallel
from glider.sysid.likelihood.candidates import (
    Candidates,
    gather,
    saturated_scales,
)
from glider.sysid.likelihood.model_fit import (
    Fitted,
    fit_model,
    fit_strength,
    linear_flights,
    start_of,
)
from glider.sysid.likelihood.scales import own_values
from glider.sysid.likelihood.task import Task
from glider.sysid.replay.noise import Noise
from glider.sysid.search.attitude import trace_along_attitude
from glider.sysid.search.fields import (
    SURVEY_FLIGHTS,
    FoundField,
    fit_fields,
    survey,
)
from glider.sysid.search.sets_in_models import begin, plate_of, without
from glider.sysid.search.subsets import Scorer, best_of_sizes, best_set
from glider.sysid.search.traced import Traced
from glider.sysid.search.weighing import uncertainty_of, weakest, weigh

PRICE = 10.0
"""Evidence that an effect must bring [nats], of up to `FLIGHTS_OF_PRICE` flights."""

FLIGHTS_OF_PRICE = 40
"""Flights from which on the price grows with them: what making flights linear gets
wrong in each adds up as evidence does. The price was tried on 12 to 40."""

ROUNDS = 8
"""Rounds at most."""

Progress = Callable[[str], None]


@dataclasses.dataclass
class Search:
    """A search as it goes on: what was fitted is remembered."""

    task: Task
    progress: Progress
    fitted: dict[frozenset[str], Fitted] = dataclasses.field(default_factory=dict)
    alone: dict[str, float] = dataclasses.field(default_factory=dict)

    def price(self, model: Fitted) -> float:
        """Returns a model's cost with the price of its effects [nats]."""
        return price_of(self.task, model)

    def fit(self, model: Fitted, iterations: int = 6) -> Fitted:
        """Fits a model and remembers it."""
        found = fit_model(self.task, model, iterations)
        if found.extra is None:
            key = frozenset(found.kinds)
            if key not in self.fitted or found.cost < self.fitted[key].cost:
                self.fitted[key] = found
        return found


def trace(
    task: Task, noise: Noise, rng: np.random.Generator, progress: Progress
) -> Traced:
    """Finds the effects that the flights show.

    Args:
        task: the flights, and what may be wrong.
        noise: of the sensors.
        rng: that resamples the flights.
        progress: called with a line of text as the work goes on.
    """
    if not task.vehicle.knows_forces:
        return trace_along_attitude(task, noise, rng, progress)
    search = Search(task, progress)
    start = start_of(task, noise, with_curves=True)
    model, evidence = prune(search, by_sets(search, start))
    while (fewer := with_fewer(search, model)) is not None:
        model, evidence = prune(search, fewer)
    field = None
    if leaves_something(model):
        progress("looking for what else the residual depends on")
        field = beyond_names(search, model)
        if field is not None:
            model, evidence = prune(search, field.model)
    model = without_needless_curves(search, model)
    progress("weighing the effects")
    weighed = weigh(task, model, scoring, rng)
    while weak := weakest(weighed, evidence):
        model, evidence = prune(search, search.fit(without(task, model, weak)))
        weighed = weigh(task, model, scoring, rng)
    if field is not None:
        field = dataclasses.replace(field, model=model)
    plate = model
    if model.kinds or model.extra is not None or model.has_curves:
        progress("fitting the plate alone")
        plate = search.fit(plate_of(task, model))
    combinations = sorted(
        (
            (m.kinds, search.price(plate) - search.price(m))
            for m in search.fitted.values()
            if m.kinds
        ),
        key=lambda c: -c[1],
    )
    return Traced(
        model=model,
        plate=plate,
        evidence=evidence,
        weighed=weighed,
        alone=search.alone,
        combinations=tuple(combinations),
        field=field,
        forces=None,
    )


def scoring(candidates: Candidates, grams: np.ndarray, counts: np.ndarray) -> Scorer:
    """Returns the evidence of sets on flights that count so often, less their price."""
    evidence, variants = candidates.evidence(np.tensordot(counts, grams, 1))
    price = price_of_kind(len(candidates.task.records))
    return Scorer(evidence, variants, lambda kind: price)


def price_of_kind(flights: int) -> float:
    """Returns the evidence that an effect must bring [nats]."""
    return PRICE * max(1.0, flights / FLIGHTS_OF_PRICE)


def without_needless_curves(search: Search, model: Fitted) -> Fitted:
    """Returns the model without its curves, unless they are worth their price."""
    if not model.has_curves:
        return model
    search.progress("are curves needed?")
    bare = dataclasses.replace(model, coordinates=np.zeros(0), freedom=0.0)
    bare = search.fit(bare, iterations=4)
    gained = bare.cost - model.cost - model.freedom
    return model if gained > CURVE_PRICE else bare


CURVE_PRICE = 15.0
"""Evidence that curves beside the formulas must bring [nats]."""


def leaves_something(model: Fitted) -> bool:
    """Whether a model leaves more than the sensors' noise: moving air, own errors."""
    scales = model.scales
    return scales.air > 0.02 or scales.moment > 0.3 or model.strength > 0.5


def beyond_names(search: Search, model: Fitted) -> FoundField | None:
    """Returns a field that is worth its price, on top of the effects or in their place.

    A field in the place of effects comes first: effects bend far to be like one.
    """
    task = search.task
    found = survey(task, model)
    scale = len(task.records) / min(len(task.records), SURVEY_FLIGHTS)
    if scale * found.gains[found.best] < FIELD_PRICE:
        return None
    options = fit_fields(task, model, found)
    if model.kinds:
        nothing = without(task, model, *model.kinds)
        bare = min(
            fit_fields(task, nothing, survey(task, nothing)),
            key=lambda o: search.price(o.model),
        )
        if np.isfinite(bare.model.cost):
            again = by_sets(search, bare.model)
            options += [bare, dataclasses.replace(bare, model=again)]
    best = min(options, key=lambda o: search.price(o.model))
    gained = search.price(model) - search.price(best.model)
    if gained > FIELD_PRICE:
        return dataclasses.replace(best, evidence=gained)
    return None


FIELD_PRICE = 40.0
"""Evidence that a field without a name must bring [nats]."""


def by_sets(search: Search, model: Fitted) -> Fitted:
    """Returns the best of the sets that a search in closed form proposes."""
    task, tried = search.task, dict[frozenset[str], Fitted]()
    for round_ in range(ROUNDS):
        search.progress(f"searching for effects, round {round_ + 1}")
        candidates = gather(task, model)
        scales, _ = saturated_scales(candidates, model.scales, 2 if round_ else 3)
        grams = candidates.grams(scales)
        if not np.all(np.isfinite(grams)):  # The model blows up: so would its sets.
            break
        score = scoring(candidates, grams, np.ones(len(task.records)))
        start = tuple((kind, score.variants[kind][0]) for kind in model.kinds)
        if not search.alone:
            search.alone = score.alone()
        members = best_set(score, start)
        dear = score.at_least(HASTE * (score(members) - score(start)))
        first = best_set(dear, start)
        if frozenset(kind for kind, _ in first) not in tried:
            members = first
        kinds = frozenset(kind for kind, _ in members)
        if kinds in tried:
            break
        search.progress(f"fitting {', '.join(sorted(kinds)) or 'the plate'}")
        begun = begin(candidates, score.evidence, members, scales)
        model = with_means(search, fit_strength(task, search.fit(begun)))
        tried[kinds] = model
    return min(tried.values(), key=search.price, default=model)


OWN_VALUES = {
    "wind": {"x": 0, "z": 1},
    "elevator_trim": {"angle": 2},
    "pitch_offset": {"angle": 3},
}
"""Effects that each flight may have of its own: coefficient to place in `own_values`"""


def with_means(search: Search, model: Fitted) -> Fitted:
    """Returns a model with what flights have of their own, where its mean is not zero.

    To first order a spread that took up the mean hides it; both are fitted anew.
    """
    task = search.task
    flights = [f.error_only() for f in linear_flights(task, model, ())]
    own = np.array(in_parallel(lambda f: own_values(f, model.scales), flights))
    mean, error = own.mean(axis=0), own.std(axis=0) / np.sqrt(len(own))
    for kind, places in OWN_VALUES.items():
        slots = {task.layout.index[kind, name]: place for name, place in places.items()}
        off = [place for place in slots.values() if abs(mean[place]) > OFF * error[place]]
        if kind not in task.kinds or set(slots) & set(model.free) or not off:
            continue
        theta = model.theta.copy()
        for slot, place in slots.items():
            theta[slot] += mean[place]
        kinds = (*model.kinds, kind)
        search.progress(f"{kind} in all flights?")
        other = dataclasses.replace(
            model, kinds=kinds, theta=theta, free=task.free(kinds)
        )
        other = fit_strength(task, search.fit(other, iterations=4))
        if search.price(other) < search.price(model):
            model = other
    return model


OFF = 3.0
"""Standard errors by which a mean over flights is off zero."""


def with_fewer(search: Search, model: Fitted) -> Fitted | None:
    """Returns a model with fewer effects that is worth more, or None.

    To first order about a set that is wrong, several effects may do as well as the few
    that act: the best set of each smaller size is fitted.
    """
    task = search.task
    if len(model.kinds) < 2:
        return None
    candidates = gather(task, model)
    scales, _ = saturated_scales(candidates, model.scales, 2)
    grams = candidates.grams(scales)
    if not np.all(np.isfinite(grams)):
        return None
    score = scoring(candidates, grams, np.ones(len(task.records)))
    sizes = best_of_sizes(score)[: len(model.kinds) - 1]
    least = score(sizes[-1]) - SLACK * (score(sizes[-1]) - score(()))
    for members in reversed(sizes):
        kinds = frozenset(kind for kind, _ in members)
        if kinds in search.fitted or score(members) < least:
            continue
        search.progress(f"fitting {', '.join(sorted(kinds))} instead")
        begun = begin(candidates, score.evidence, members, scales)
        fewer = fit_strength(task, search.fit(begun, iterations=4))
        if search.price(fewer) < search.price(model):
            return fewer
    return None


SLACK = 0.1
"""Share of the evidence of all that a smaller set may lack, to first order."""


HASTE = 0.01
"""Share of what a round gains that each effect must bring to come with it: what making
flights linear gets wrong is like small effects, which wait for the next round."""


def price_of(task: Task, model: Fitted) -> float:
    """Returns a model's cost with the price of its effects [nats]."""
    layout = task.layout
    sizes = [i for k in model.kinds for i in layout.slots_of(k) if not task.is_shape(i)]
    more = len(sizes) - len(model.kinds)
    price = price_of_kind(len(task.records))
    names = price * len(model.kinds) + PRICE_OF_MORE * more
    return model.cost + model.freedom + names


PRICE_OF_MORE = 4.0
"""Evidence that each further coefficient of an effect must bring [nats]."""


def prune(search: Search, model: Fitted) -> tuple[Fitted, dict[str, float]]:
    """Drops the effects that are not worth their price when all else is refitted.

    Returns:
        the model, and the evidence of each effect that stays [nats].
    """
    while True:
        lost = {}
        for kind in model.kinds:
            search.progress(f"is {kind} needed?")
            fewer = search.fit(without(search.task, model, kind), iterations=4)
            if search.price(fewer) < search.price(model):
                model = fewer
                break
            lost[kind] = fewer.cost - model.cost
        else:
            lighter = without_a_pair(search, model)
            if lighter is None:
                return model, lost
            model = lighter


def without_a_pair(search: Search, model: Fitted) -> Fitted | None:
    """Returns the model without two effects that only work against each other.

    Where a formula has not quite the right shape, two others may be bought that nearly
    cancel; each alone then seems needed. Curves, as strong as they must be, do better.
    """
    task = search.task
    if not model.has_curves or len(model.kinds) < 3:
        return None
    for first, second in opposed_pairs(task, model):
        search.progress(f"are {first} and {second} needed?")
        fewer = without(task, model, first, second)
        fewer = dataclasses.replace(fewer, strength=max(model.strength, 1.0))
        fewer = fit_strength(task, search.fit(fewer, iterations=4))
        fewer = fit_strength(task, search.fit(fewer, iterations=4))
        if search.price(fewer) < search.price(model):
            return fewer
    return None


OPPOSED = 0.7
"""Correlation of two effects' coefficients from which on they may cancel."""


def opposed_pairs(task: Task, model: Fitted) -> list[tuple[str, str]]:
    """Returns pairs of effects whose coefficients are hard to tell apart."""
    known = uncertainty_of(task, model)
    std = np.sqrt(np.diag(known.covariance))
    correlation = np.abs(known.covariance / std[:, None] / std)
    slots = {
        kind: [
            known.free.index(i)
            for i in task.layout.slots_of(kind)
            if i in known.free and not task.is_shape(i)
        ]
        for kind in model.kinds
    }
    found = []
    for k, first in enumerate(model.kinds):
        for second in model.kinds[k + 1 :]:
            block = correlation[np.ix_(slots[first], slots[second])]
            if block.size and block.max() > OPPOSED:
                found.append((float(block.max()), first, second))
    return [(a, b) for _, a, b in sorted(found, reverse=True)[:3]]
