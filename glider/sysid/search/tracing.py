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
    return min(tried.values(), key=lambda m: m.cost + PRICE * len(m.kinds))


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
