"""Models with another set of effects, not fitted yet."""

import dataclasses

import numpy as np

from glider.sysid.likelihood.candidates import Candidates
from glider.sysid.likelihood.model_fit import FitResult
from glider.sysid.likelihood.scales import Scales
from glider.sysid.likelihood.task import Task
from glider.sysid.search.subsets import Members, SetEvidence


def begin(
    candidates: Candidates, evidence: SetEvidence, members: Members, scales: Scales
) -> FitResult:
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


def without(task: Task, model: FitResult, *gone: str) -> FitResult:
    """Returns a model without some of its effects."""
    kinds = tuple(k for k in model.kinds if k not in gone)
    theta = model.theta.copy()
    slots = [i for kind in gone for i in task.layout.slots_of(kind)]
    theta[slots] = task.vehicle.theta[slots]
    return dataclasses.replace(model, kinds=kinds, theta=theta, free=task.free(kinds))


def plate_of(task: Task, model: FitResult) -> FitResult:
    """Returns a model without effects, curves and fields."""
    bare = dataclasses.replace(
        model, extra=None, coordinates=np.zeros(0), cost=np.inf, freedom=0.0
    )
    return without(task, bare, *model.kinds)
