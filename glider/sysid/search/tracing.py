"""Which effects do the flights show? Sets of the library, by their evidence.

In turn: all flights are made linear about the best model so far, the scales of noise
are fitted with everything acting at once, the best set of effects is searched in closed
form, and that set is fitted with its curves and scales. It ends where a set comes back.
"""

import dataclasses
from collections.abc import Callable

import numpy as np

from glider.sysid.likelihood.candidates import (
    Candidates,
    gather,
    saturated_scales,
)
from glider.sysid.likelihood.evidence import Evidence
from glider.sysid.likelihood.model_fit import (
    Fitted,
    fit_model,
    fit_strength,
    start_of,
)
from glider.sysid.likelihood.scales import Scales, start_scales
from glider.sysid.likelihood.task import Task
from glider.sysid.replay.noise import Noise
from glider.sysid.search.fields import (
    SURVEY_FLIGHTS,
    FoundField,
    fit_field,
    survey,
)
from glider.sysid.search.subsets import Members, Scorer, best_set
from glider.sysid.search.weighing import Weighed, uncertainty_of, weigh

PRICE = 10.0
"""Evidence that an effect must bring [nats]."""

ROUNDS = 6
"""Rounds at most."""

Progress = Callable[[str], None]


@dataclasses.dataclass(frozen=True, kw_only=True)
class Traced:
    """Outcome of a search.

    Attributes:
        model: with the effects that the flights show.
        plate: the model without any, fitted.
        evidence: kind to what is lost without it [nats].
        weighed: kind to its rivals and to how often it is chosen.
        alone: kind to what it gains alone, to first order [nats].
        combinations: kinds of each set that was fitted, and its gain less the price of
            its effects [nats].
        field: what has no name, or None.
        forces: the scales under which the forces were judged, if not the model's own.
    """

    model: Fitted
    plate: Fitted
    evidence: dict[str, float]
    weighed: dict[str, Weighed]
    alone: dict[str, float]
    combinations: tuple[tuple[tuple[str, ...], float], ...]
    field: FoundField | None
    forces: Scales | None

    @property
    def judged(self) -> Fitted:
        """The model under the scales that it was judged by."""
        scales = self.model.scales if self.forces is None else self.forces
        return dataclasses.replace(self.model, scales=scales)


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
        free = self.task.vehicle.prior is None
        found = fit_model(self.task, model, iterations, scales_free=free)
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
    search = Search(task, progress)
    start = start_of(task, noise, with_curves=task.vehicle.prior is None)
    is_known = task.vehicle.prior is None
    if is_known:
        model, evidence = prune(search, by_sets(search, start))
    else:
        model, evidence = along_attitude(search, start)
    field = None
    if is_known and leaves_something(model):
        progress("looking for what else the residual depends on")
        field = beyond_names(search, model)
        if field is not None:
            model, evidence = prune(search, field.model)
            field = dataclasses.replace(field, model=model)
    model = without_needless_curves(search, model)
    progress("weighing the effects")
    weighed = weigh(task, model, base_price(task), rng)
    while weak := [k for k, w in weighed.items() if w.support < LEAST_SUPPORT]:
        kind = min(weak, key=lambda k: weighed[k].support)
        model = search.fit(without(task, model, kind))
        model, evidence = prune(search, model) if is_known else (model, evidence)
        weighed = weigh(task, model, base_price(task), rng)
    if field is not None:
        field = dataclasses.replace(field, model=model)
    if not model.kinds and model.extra is None and not model.has_curves:
        plate = model
    else:
        progress("fitting the plate alone")
        nothing = dataclasses.replace(
            model, extra=None, coordinates=np.zeros(0), cost=np.inf, freedom=0.0
        )
        for kind in model.kinds:
            nothing = without(task, nothing, kind)
        plate = search.fit(nothing)
    forces = None
    if not is_known:
        progress("fitting the moment")
        forces = model.scales
        plate, model = (with_moment(task, m, noise) for m in (plate, model))
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
        forces=forces,
    )


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


LEAST_SUPPORT = 0.85
"""Share of resampled flights by which an effect, or one that is like it, must be
chosen: one that hangs on a few flights is not claimed."""


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
    options = [fit_field(task, model, found)]
    if model.kinds:
        nothing = model
        for kind in model.kinds:
            nothing = without(task, nothing, kind)
        bare = fit_field(task, nothing, survey(task, nothing))
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
        evidence, variants = candidates.evidence(candidates.grams(scales).sum(axis=0))
        score = Scorer(evidence, variants, PRICE)
        start = tuple((kind, variants[kind][0]) for kind in model.kinds)
        if not search.alone:
            search.alone = alone_of(score)
        members = best_set(score, start)
        kinds = frozenset(kind for kind, _ in members)
        if kinds in tried:
            break
        search.progress(f"fitting {', '.join(sorted(kinds)) or 'the plate'}")
        begun = begin(candidates, evidence, members, scales)
        model = fit_strength(task, search.fit(begun))
        tried[kinds] = model
    return min(tried.values(), key=search.price)


def alone_of(score: Scorer) -> dict[str, float]:
    """Returns what each kind gains alone, its price not taken [nats]."""
    return {
        kind: max(score(((kind, v),)) for v in own) + score.price
        for kind, own in score.variants.items()
    }


def price_of(task: Task, model: Fitted) -> float:
    """Returns a model's cost with the price of its effects [nats]."""
    layout = task.layout
    sizes = [i for k in model.kinds for i in layout.slots_of(k) if not task.is_shape(i)]
    more = len(sizes) - len(model.kinds)
    names = base_price(task) * len(model.kinds) + PRICE_OF_MORE * more
    return model.cost + model.freedom + names


def base_price(task: Task) -> float:
    """Returns the evidence that an effect must bring [nats]."""
    return PRICE if task.vehicle.prior is None else PRICE_OF_FORCES


PRICE_OF_FORCES = 6.0
"""The same where the vehicle is not known: no curves compete, and with the effects of
servo, tail and masses out of question there are half as many to choose from [nats]."""

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
        fewer = without(task, without(task, model, first), second)
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


def without(task: Task, model: Fitted, kind: str) -> Fitted:
    """Returns a model without one of its effects, not fitted anew."""
    kinds = tuple(k for k in model.kinds if k != kind)
    theta = model.theta.copy()
    slots = list(task.layout.slots_of(kind))
    theta[slots] = task.vehicle.theta[slots]
    return dataclasses.replace(model, kinds=kinds, theta=theta, free=task.free(kinds))


def along_attitude(search: Search, model: Fitted) -> tuple[Fitted, dict[str, float]]:
    """Finds the effects of a glider of which little is known: forces come first.

    The flights are taken along their measured attitude, with errors that last for
    whole flights: what bends the path counts, not what makes it tremble; and what the
    moment is, which nobody knows, tells nothing of the forces. The search is about the
    usual glider, for far from it areas and angles could look like anything.

    Returns:
        the model, and the evidence of each of its effects [nats].
    """
    task = search.task
    model = dataclasses.replace(model, scales=attitude_scales(task, model.scales))
    candidates = gather(task, model)
    gram = candidates.grams(model.scales).sum(axis=0)
    evidence, variants = candidates.evidence(gram)
    score = Scorer(evidence, variants, PRICE_OF_FORCES)
    search.alone = alone_of(score)
    members = best_set(score)
    begun = begin(candidates, evidence, members, model.scales)
    names = ", ".join(begun.kinds) or "the plate"
    search.progress(f"along the measured attitude: {names}")
    lost = {
        kind: score(members) - score(fewer) + PRICE_OF_FORCES
        for (kind, _), fewer in zip(members, score.smaller(members), strict=True)
    }
    return search.fit(begun), lost


def with_moment(task: Task, model: Fitted, noise: Noise) -> Fitted:
    """Returns a model of forces with its moment fitted, and all scales."""
    index = task.layout.index
    slots = [index[slot] for slot in _OF_MOMENT]
    free = tuple(i for i in slots if i in task.vehicle.nuisance)
    start = dataclasses.replace(model, free=free, scales=start_scales(noise))
    return dataclasses.replace(fit_model(task, start), free=model.free)


def forces_alone(task: Task, model: Fitted) -> Fitted:
    """Returns a model of which a refit to other flights leaves the moment as it is."""
    index = task.layout.index
    kept = {index[slot] for slot in _OF_MOMENT}
    return dataclasses.replace(
        model, free=tuple(i for i in model.free if i not in kept)
    )


_OF_MOMENT = (
    ("parameters", "pitch_inertia"),
    ("parameters", "wing_offset"),
    ("elevator_trim", "angle"),
    ("pitch_moment", "coefficient"),
)
"""Unknown numbers of a vehicle that are hardly seen in the forces."""


def attitude_scales(task: Task, scales: Scales) -> Scales:
    """Returns the scales of flights along their measured attitude."""
    rows = np.mean([len(record.time) for record in task.records])
    error = ATTITUDE_ERROR * np.sqrt(rows / INDEPENDENT_ERRORS)
    return dataclasses.replace(scales, position=float(error), **ALONG_ATTITUDE)


ATTITUDE_ERROR = 0.03
"""Error of good models along the measured attitude of thrown gliders [m]."""

INDEPENDENT_ERRORS = 20
"""How many rows of a flight's errors tell as much as all of them: they last."""

ALONG_ATTITUDE = {
    "pitch": 2e-3,
    "moment": 200.0,
    "air": 1e-3,
    "wind": 1e-3,
    "trim": 0.02,
    "pitch_zero": 3e-3,
}
"""Scales of flights along their measured attitude: the moment tells nothing, and the
others are as good as nothing."""


def begin(
    candidates: Candidates, evidence: Evidence, members: Members, scales: Scales
) -> Fitted:
    """Returns a set of effects with the coefficients that its evidence gives it."""
    task, model = candidates.task, candidates.model
    kinds = tuple(kind for kind, _ in members)
    theta = model.theta.copy()
    for kind in model.kinds:
        if kind not in kinds:
            slots = list(task.layout.slots_of(kind))
            theta[slots] = task.vehicle.theta[slots]
    columns = [c for _, variant in members for c in variant]
    always = set(candidates.always)
    kept = [d for j, d in enumerate(candidates.directions) if j not in always]
    for column, change in zip(columns, evidence.step(columns), strict=True):
        direction = kept[column]
        for slot, shape in direction.shapes:
            theta[slot] = shape
        base = theta[direction.slot]
        if not task.is_shape(direction.slot):
            base = task.prior(direction.slot, base)[0]
        theta[direction.slot] = np.clip(
            base + change,
            task.layout.lower[direction.slot],
            task.layout.upper[direction.slot],
        )
    return dataclasses.replace(
        model, kinds=kinds, theta=theta, free=task.free(kinds), scales=scales
    )
