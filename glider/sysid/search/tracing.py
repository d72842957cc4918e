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
from glider.sysid.search.subsets import Members, Scorer, best_set

PRICE = 10.0
"""Evidence that an effect must bring [nats]."""

ROUNDS = 6
"""Rounds at most."""

Progress = Callable[[str], None]


def trace(task: Task, scales: Scales, progress: Progress) -> Fitted:
    """Returns the model with the effects that the flights show, fitted."""
    model = start_of(task, scales, with_curves=True)
    if task.vehicle.prior is not None:
        progress("forces along the measured attitude")
        model = along_attitude(task, model)
    tried: dict[frozenset[str], Fitted] = {frozenset(model.kinds): model}
    if not model.kinds:
        tried = {}
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
    best = min(tried.values(), key=price_of)
    return prune(task, best, progress)


def price_of(model: Fitted) -> float:
    """Returns a model's cost with the price of its effects [nats]."""
    return model.cost + PRICE * len(model.kinds)


def prune(task: Task, model: Fitted, progress: Progress) -> Fitted:
    """Drops the effects that are not worth their price when all else is refitted."""
    for kind in reversed(model.kinds):
        progress(f"is {kind} needed?")
        fewer = fit_model(task, without(task, model, kind), iterations=4)
        if price_of(fewer) < price_of(model):
            model = fewer
    return model


def without(task: Task, model: Fitted, kind: str) -> Fitted:
    """Returns a model without one of its effects, not fitted anew."""
    kinds = tuple(k for k in model.kinds if k != kind)
    theta = model.theta.copy()
    slots = list(task.layout.slots_of(kind))
    theta[slots] = task.vehicle.theta[slots]
    return dataclasses.replace(model, kinds=kinds, theta=theta, free=task.free(kinds))


def along_attitude(task: Task, model: Fitted) -> Fitted:
    """Returns a start for a glider of which little is known: forces alone.

    The flights are taken along their measured attitude, with errors that last for
    whole flights: what bends the path counts, not what makes it tremble.
    """
    model = fit_model(task, dataclasses.replace(model, coordinates=np.zeros(0)))
    candidates = gather(task, model)
    scales = dataclasses.replace(model.scales, **ALONG_ATTITUDE)
    evidence, variants = candidates.evidence(candidates.grams(scales).sum(axis=0))
    score = Scorer(evidence, variants, PRICE)
    members = best_set(score)
    begun = begin(candidates, evidence, members, model.scales)
    begun = dataclasses.replace(begun, coordinates=np.zeros(task.curves.count))
    return fit_strength(task, fit_model(task, begun))


ALONG_ATTITUDE = {
    "position": 0.05,
    "pitch": 2e-3,
    "moment": 200.0,
    "air": 1e-3,
    "wind": 1e-3,
    "pitch_zero": 3e-3,
}
"""Scales of flights along their measured attitude: the moment tells nothing, and the
path is known to a few centimetres, as good as models of thrown gliders get."""


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
