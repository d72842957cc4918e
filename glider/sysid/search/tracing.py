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
from glider.sysid.likelihood.scales import Scales
from glider.sysid.likelihood.task import Task
from glider.sysid.search.subsets import MOST_EFFECTS, Members, Scorer, best_set

PRICE = 10.0
"""Evidence that an effect must bring [nats]."""

ROUNDS = 6
"""Rounds at most."""

Progress = Callable[[str], None]


def trace(task: Task, scales: Scales, progress: Progress) -> Fitted:
    """Returns the model with the effects that the flights show, fitted."""
    if task.vehicle.prior is None:
        model = by_sets(task, start_of(task, scales, with_curves=True), progress)
        return prune(task, model, progress)
    model = along_attitude(task, start_of(task, scales, with_curves=False), progress)
    model = prune(task, grow(task, model, progress), progress)
    progress("fitting what formulas leave")
    with_curves = dataclasses.replace(model, coordinates=np.zeros(task.curves.count))
    return fit_strength(task, fit_model(task, with_curves))


def by_sets(task: Task, model: Fitted, progress: Progress) -> Fitted:
    """Returns the best of the sets that a search in closed form proposes."""
    tried: dict[frozenset[str], Fitted] = {}
    for round_ in range(ROUNDS):
        progress(f"searching for effects, round {round_ + 1}")
        candidates = gather(task, model)
        scales, _ = saturated_scales(candidates, model.scales, 2 if round_ else 3)
        evidence, variants = candidates.evidence(candidates.grams(scales).sum(axis=0))
        score = Scorer(evidence, variants, PRICE)
        start = tuple((kind, variants[kind][0]) for kind in model.kinds)
        members = best_set(score, start)
        kinds = frozenset(kind for kind, _ in members)
        if kinds in tried:
            break
        progress(f"fitting {', '.join(sorted(kinds)) or 'the plate'}")
        begun = begin(candidates, evidence, members, scales)
        model = fit_strength(task, fit_model(task, begun))
        tried[kinds] = model
    return min(tried.values(), key=lambda m: price_of(task, m))


def grow(task: Task, model: Fitted, progress: Progress) -> Fitted:
    """Adds effects one by one, the few most promising fitted in full.

    Where the vehicle itself is unknown, what a set without an effect would be cannot be
    told from the linear flights: areas and angles would go far.
    """
    while len(model.kinds) < MOST_EFFECTS:
        candidates = gather(task, model)
        gram = candidates.grams(model.scales).sum(axis=0)
        evidence, variants = candidates.evidence(gram)
        score = Scorer(evidence, variants, PRICE)
        start = tuple((kind, variants[kind][0]) for kind in model.kinds)
        ranked = sorted(score.larger(start), key=score, reverse=True)
        best_of_kind = {members[-1][0]: members for members in reversed(ranked)}
        hopeful = sorted(best_of_kind.values(), key=score, reverse=True)
        found = []
        for members in hopeful[:TRIED]:
            progress(f"with {members[-1][0]}?")
            begun = begin(candidates, evidence, members, model.scales)
            fitted = fit_model(task, begun, iterations=4)
            if fitted.cost < np.inf:
                found.append(fitted)
        best = min(found, key=lambda m: price_of(task, m), default=model)
        if not price_of(task, best) < price_of(task, model):
            return model
        model = best
    return model


TRIED = 4
"""Further effects that are fitted in full before one is taken."""


def price_of(task: Task, model: Fitted) -> float:
    """Returns a model's cost with the price of its effects [nats]."""
    layout = task.layout
    sizes = [i for k in model.kinds for i in layout.slots_of(k) if not task.is_shape(i)]
    more = len(sizes) - len(model.kinds)
    return model.cost + PRICE * len(model.kinds) + PRICE_OF_MORE * more


PRICE_OF_MORE = 4.0
"""Evidence that each further coefficient of an effect must bring [nats]."""


def prune(task: Task, model: Fitted, progress: Progress) -> Fitted:
    """Drops the effects that are not worth their price when all else is refitted."""
    for kind in reversed(model.kinds):
        progress(f"is {kind} needed?")
        fewer = fit_model(task, without(task, model, kind), iterations=4)
        if price_of(task, fewer) < price_of(task, model):
            model = fewer
    return model


def without(task: Task, model: Fitted, kind: str) -> Fitted:
    """Returns a model without one of its effects, not fitted anew."""
    kinds = tuple(k for k in model.kinds if k != kind)
    theta = model.theta.copy()
    slots = list(task.layout.slots_of(kind))
    theta[slots] = task.vehicle.theta[slots]
    return dataclasses.replace(model, kinds=kinds, theta=theta, free=task.free(kinds))


def along_attitude(task: Task, model: Fitted, progress: Progress) -> Fitted:
    """Returns a start for a glider of which little is known: forces alone.

    The flights are taken along their measured attitude, with errors that last for
    whole flights: what bends the path counts, not what makes it tremble.
    """
    rows = np.mean([len(record.time) for record in task.records])
    scales = dataclasses.replace(
        model.scales,
        position=ATTITUDE_ERROR * np.sqrt(rows / INDEPENDENT_ERRORS),
        **ALONG_ATTITUDE,
    )
    candidates = gather(task, model)
    evidence, variants = candidates.evidence(candidates.grams(scales).sum(axis=0))
    members = best_set(Scorer(evidence, variants, PRICE))
    begun = begin(candidates, evidence, members, scales)
    progress(f"along the measured attitude: {', '.join(begun.kinds) or 'the plate'}")
    begun = fit_model(task, begun, scales_free=False)
    return fit_model(task, dataclasses.replace(begun, scales=model.scales))


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
