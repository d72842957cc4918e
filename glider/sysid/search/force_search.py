"""Effects of a glider of which little is known: forces come first.

The flights follow their measured attitude, whatever the moment. The residual is an
error of the forces that persists, whose strength and time are estimated, and sets of
effects are compared by how well they predict held-out flights.
"""

import dataclasses

import numpy as np

from glider.progress import Progress, Step
from glider.sysid.constants import ALONG_ATTITUDE
from glider.sysid.likelihood.candidates import gather
from glider.sysid.likelihood.model_fit import error_flights, fit_model
from glider.sysid.likelihood.scale_fit import fit_scales
from glider.sysid.likelihood.scales import NAMES, start_scales
from glider.sysid.likelihood.task import FitResult, Task, start_of
from glider.sysid.replay.record import Noise
from glider.sysid.search.subsets import HELD_OUT, best_set, scorer_of
from glider.sysid.search.support import SearchResult, weigh

# Unknown parameters of a vehicle that barely show in the forces.
_OF_MOMENT = ("pitch_inertia", "wing_offset")
# Scales that are estimated from the forces: errors of the moment, whose formula is
# rougher, must not turn the flights' axes or their winds.
_OF_FORCES = ("wind", "trim", "pitch_zero")
_ROUNDS = 4  # Of sets and strengths of errors that depend on each other.


def search_forces(
    task: Task, noise: Noise, rng: np.random.Generator, progress: Progress
) -> SearchResult:
    """Finds the effects that the forces along the measured attitude show."""
    start = start_of(task, noise)
    scales = dataclasses.replace(start.scales, **ALONG_ATTITUDE)
    model = dataclasses.replace(start, scales=scales, has_force_errors=True)
    alone: dict[str, float] = {}
    tried: list[frozenset[str]] = []
    for _ in range(_ROUNDS):
        progress("searching for effects along the measured attitude")
        candidates = gather(task, model)
        grams = candidates.grams(model.scales)
        score = scorer_of(candidates, grams, np.ones(len(grams)))
        alone = alone or score.alone()
        members = best_set(score)
        model = _refit_forces(task, score.begin(members))
        if frozenset(model.kinds) in tried:
            break
        tried.append(frozenset(model.kinds))
    progress(Step("weighing the effects", 0.3))
    weighed = weigh(task, model, rng)
    bare = model
    if model.kinds:
        progress(Step("fitting the flat plate alone", 0.5))
        bare = fit_model(task, model.without(task, *model.kinds), free_scales=())
    progress(Step("fitting the moment", 0.53))
    return SearchResult(
        model=_with_moment(task, model, noise),
        bare=_with_moment(task, bare, noise),
        evidence=score.lost(members),
        weighed=weighed,
        alone=alone,
        threshold=HELD_OUT,
        forces=model,
    )


def _refit_forces(task: Task, model: FitResult) -> FitResult:
    """Returns a model fitted to the forces, and the errors that it leaves there."""
    model = fit_model(task, model, free_scales=())
    flights = error_flights(task, model)
    scales = fit_scales(flights, model.scales, free=("air", "air_time")).scales
    return dataclasses.replace(model, scales=scales)


def _slots_of_moment(task: Task) -> set[int]:
    """Returns the slots of unknowns that only the moment and the log show."""
    found = {*task.space.places(_OF_MOMENT), *task.vehicle.of_log}
    for kind in task.space.kinds.values():
        if kind.unknown_without is not None:
            found.update(task.space.slots_of(kind.kind))
    return found


def _with_moment(task: Task, model: FitResult, noise: Noise) -> FitResult:
    """Returns a model of forces with its moment fitted, and all scales."""
    slots = _slots_of_moment(task)
    free = tuple(i for i in task.vehicle.nuisance if i in slots)
    kept = {name: getattr(model.scales, name) for name in _OF_FORCES}
    scales = dataclasses.replace(start_scales(noise), **kept)
    start = dataclasses.replace(model, free=free, scales=scales, has_force_errors=False)
    others = [name for name in NAMES if name not in _OF_FORCES]
    fitted = fit_model(task, start, free_scales=others)
    return dataclasses.replace(fitted, free=model.free)


def forces_alone(task: Task, model: FitResult, forces: FitResult) -> FitResult:
    """Returns a model of which only the forces will be fitted, to other flights."""
    kept = _slots_of_moment(task)
    free = tuple(i for i in model.free if i not in kept)
    return dataclasses.replace(
        model, free=free, scales=forces.scales, has_force_errors=True
    )
