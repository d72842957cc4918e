"""Effects of a glider of which little is known: forces come first.

The flights follow their measured attitude, whatever the moment. The residual is an
error of the forces that persists, whose strength and time are estimated, and sets of
effects are compared by how well they predict held-out flights.
"""

import dataclasses
from collections.abc import Sequence

import numpy as np

from glider.progress import Progress, Step
from glider.sysid.constants import ALONG_ATTITUDE, HELD_OUT_THRESHOLD
from glider.sysid.likelihood.candidates import Candidates, gather
from glider.sysid.likelihood.fit_result import FitResult, start_of
from glider.sysid.likelihood.information import solve_scaled
from glider.sysid.likelihood.model_fit import error_flights, fit_model
from glider.sysid.likelihood.scale_fit import fit_scales
from glider.sysid.likelihood.scales import NAMES, start_scales
from glider.sysid.likelihood.task import Task
from glider.sysid.replay.record import Noise
from glider.sysid.report import EvidenceThreshold
from glider.sysid.search.fits import FirstOrder, without
from glider.sysid.search.subsets import best_set
from glider.sysid.search.support import SearchResult, weigh

HELD_OUT = EvidenceThreshold(**HELD_OUT_THRESHOLD)
"""Gain on held-out flights that an effect must bring."""

EVERY_GLIDER_HAS = (  # No wing's lift is exactly a flat plate's.
    *("camber", "profile_drag", "axial_drag", "induced_drag"),
    *("attached_lift", "pitch_rate_lift"),
)
_OF_MOMENT = (  # Unknown parameters of a vehicle that barely show in the forces.
    ("parameters", "pitch_inertia"),
    ("parameters", "wing_offset"),
    ("elevator_trim", "angle"),
    ("pitch_moment", "coefficient"),
    ("pitch_damping", "coefficient"),
)
# Scales that are estimated from the forces: errors of the moment, whose formula is
# rougher, must not turn the flights' axes or their winds.
OF_FORCES = ("wind", "trim", "pitch_zero")
_ROUNDS = 4  # Of sets and strengths of errors that depend on each other.
_MOST_ENTRIES = 1_000_000  # Of matrices that are solved at once, for the memory.
_SLACK = 1e-9  # Rounding by which a bound may be passed.


class HeldOutEvidence:
    """Log-likelihood that columns gain on flights, each held out in turn [nats].

    An error common to all flights is evidence for any effect that imitates it, more of
    it with more flights; cross-validation does not reward that (Stone, J. R. Stat. Soc.
    B 39, 1977). Everything is linear, so that each flight is held out exactly, the
    unknown parameters of the vehicle refitted without it.
    """

    def __init__(self, candidates: Candidates, grams: np.ndarray, counts: np.ndarray):
        """Takes the flights' information and how often each counts."""
        drawn = np.flatnonzero(counts)
        self._counts, self._always = counts[drawn], np.array(candidates.always, int)
        self._own, self._prior = candidates.from_nothing(grams[drawn])
        weighted = self._counts[:, None, None] * self._own
        self._sum = weighted.sum(axis=0, keepdims=True)
        self._rest = self._sum - weighted
        self._alone = self._costs(np.zeros((1, 0), dtype=int))

    def extended(
        self, columns: Sequence[int], more: Sequence[Sequence[int]]
    ) -> list[float]:
        """Gain of columns with each of several others over none; -inf: not physical."""
        sets = [[*columns, *variant] for variant in more]
        gains = np.zeros(len(sets))
        for size in {*map(len, sets)} - {0}:
            at = np.flatnonzero([len(own) == size for own in sets])
            entries = len(self._own) * (len(self._always) + size) ** 2
            parts = 1 + len(at) * entries // _MOST_ENTRIES
            for part in np.array_split(at, min(parts, len(at))):
                gains[part] = self._gains(np.array([sets[i] for i in part]))
        return gains.tolist()

    def step(self, columns: Sequence[int]) -> np.ndarray:
        """Returns the coefficients of columns, counted from zero."""
        sets = np.array([columns], dtype=int)
        return self._steps(self._sum, sets)[0, 0, len(self._always) :]

    def _gains(self, sets: np.ndarray) -> np.ndarray:
        """Returns the gains of sets of columns (v, k) over none, (v,)."""
        steps = self._steps(self._sum, sets)[0, :, len(self._always) :]
        lower, upper = self._prior.lower[sets], self._prior.upper[sets]
        is_out = steps < lower - _SLACK * np.abs(lower)
        is_out |= steps > upper + _SLACK * np.abs(upper)
        gains = self._counts @ (self._alone - self._costs(sets))
        return np.where(is_out.any(axis=1), -np.inf, gains)

    def _steps(self, grams: np.ndarray, sets: np.ndarray) -> np.ndarray:
        """Returns the most likely changes of columns, after those that act, (n, v, m).

        By each of the information (n, M + 1, M + 1).
        """
        index = self._with_always(sets)
        precision = self._prior.precision[index][..., None] * np.eye(index.shape[1])
        systems = grams[:, index[..., None], index[:, None]] + precision
        return solve_scaled(systems, grams[:, index, -1], 0.0)

    def _costs(self, sets: np.ndarray) -> np.ndarray:
        """Returns flights' costs by what the others say of sets of columns (n, v)."""
        steps = self._steps(self._rest, sets)
        weights = np.concatenate([-steps, np.ones((*steps.shape[:2], 1))], axis=2)
        index = np.pad(self._with_always(sets), ((0, 0), (0, 1)), constant_values=-1)
        own = self._own[:, index[..., None], index[:, None]]
        return 0.5 * np.sum(weights * (own @ weights[..., None])[..., 0], axis=2)

    def _with_always(self, sets: np.ndarray) -> np.ndarray:
        """Returns sets with the columns that always act before them."""
        return np.hstack([np.tile(self._always, (len(sets), 1)), sets])


def held_out_threshold(task: Task, kind: str) -> float:
    """Returns the gain that an effect must bring on held-out flights [nats]."""
    slots = task.layout.slots_of(kind)
    sizes = sum(not task.is_shape(i) for i in slots)
    cause = 0.0 if kind in EVERY_GLIDER_HAS else HELD_OUT.uncommon
    return HELD_OUT.effect + HELD_OUT.coefficient * (sizes - 1) + cause


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
        score = held_out_scorer(candidates, grams, np.ones(len(grams)))
        alone = alone or score.alone()
        members = best_set(score)
        model = refit_forces(task, score.begin(members))
        if frozenset(model.kinds) in tried:
            break
        tried.append(frozenset(model.kinds))
    progress(Step("weighing the effects", 0.3))
    weighed = weigh(task, model, held_out_scorer, rng)
    bare = model
    if model.kinds:
        progress(Step("fitting the flat plate alone", 0.5))
        bare = fit_model(task, without(task, model, *model.kinds), free_scales=())
    progress(Step("fitting the moment", 0.53))
    return SearchResult(
        model=with_moment(task, model, noise),
        bare=with_moment(task, bare, noise),
        evidence=score.lost(members),
        weighed=weighed,
        alone=alone,
        combinations=score.ranked(),
        threshold=HELD_OUT,
        forces=model,
    )


def held_out_scorer(
    candidates: Candidates, grams: np.ndarray, counts: np.ndarray
) -> FirstOrder:
    """Returns the gain of sets on held-out flights that count so often, penalized."""
    evidence, task = HeldOutEvidence(candidates, grams, counts), candidates.task
    thresholds = {kind: held_out_threshold(task, kind) for kind in candidates.variants}
    return FirstOrder(candidates, evidence, lambda kind, kinds: thresholds[kind])


def refit_forces(task: Task, model: FitResult) -> FitResult:
    """Returns a model fitted to the forces, and the errors that it leaves there."""
    model = fit_model(task, model, free_scales=())
    flights = error_flights(task, model)
    scales = fit_scales(flights, model.scales, free=("air", "air_time")).scales
    return dataclasses.replace(model, scales=scales)


def _slots_of_moment(task: Task) -> set[int]:
    """Returns the slots of unknowns that only the moment and the log show."""
    return {task.layout.index[slot] for slot in _OF_MOMENT} | {*task.vehicle.of_log}


def with_moment(task: Task, model: FitResult, noise: Noise) -> FitResult:
    """Returns a model of forces with its moment fitted, and all scales."""
    slots = _slots_of_moment(task)
    free = tuple(i for i in task.vehicle.nuisance if i in slots)
    kept = {name: getattr(model.scales, name) for name in OF_FORCES}
    scales = dataclasses.replace(start_scales(noise), **kept)
    start = dataclasses.replace(model, free=free, scales=scales, has_force_errors=False)
    others = [name for name in NAMES if name not in OF_FORCES]
    fitted = fit_model(task, start, free_scales=others)
    return dataclasses.replace(fitted, free=model.free)


def forces_alone(task: Task, model: FitResult, forces: FitResult) -> FitResult:
    """Returns a model of which only the forces will be fitted, to other flights."""
    kept = _slots_of_moment(task)
    free = tuple(i for i in model.free if i not in kept)
    return dataclasses.replace(
        model, free=free, scales=forces.scales, has_force_errors=True
    )
