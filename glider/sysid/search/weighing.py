"""How sure is each effect of a set: evidence, rivals, resampled flights."""

import dataclasses
from collections.abc import Callable

import numpy as np

from glider.sysid.likelihood.candidates import Candidates, gather
from glider.sysid.likelihood.model_fit import Fitted
from glider.sysid.likelihood.task import Task
from glider.sysid.likelihood.uncertainty import uncertainty_of
from glider.sysid.search.subsets import Scorer, climb

RESAMPLES = 25
"""Sets of flights, drawn with replacement, that the search is repeated on."""

RIVAL_GAP = 6.0
"""Difference of evidence below which two effects are one to us [nats]: the odds of the
better one are then below 400 to 1."""

MOST_RIVALS = 0.5
"""Share of the library from which on what would do as well in an effect's place lends
it no support: where anything helps, the lack has another form."""

_NEAR = 25.0
"""Loss of evidence up to which an effect is offered to resampled searches [nats]."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Weighed:
    """An effect of the chosen set, and how sure it is.

    Attributes:
        rivals: kinds that would do as well in its place.
        inclusion: share of the resampled flights that it is chosen by.
        support: the same of it or one of its rivals.
    """

    rivals: tuple[str, ...]
    inclusion: float
    support: float


Scoring = Callable[[Candidates, np.ndarray, np.ndarray], Scorer]
"""Makes a scorer of candidates, of what each flight tells and how often it counts."""


def weigh(
    task: Task, model: Fitted, scoring: Scoring, rng: np.random.Generator
) -> dict[str, Weighed]:
    """Returns what speaks for each effect of a model."""
    if not model.kinds:
        return {}
    candidates = gather(task, model)
    grams = candidates.grams(model.scales)
    score = scoring(candidates, grams, np.ones(len(grams)))
    chosen = score.by_first(model.kinds)
    best = score(chosen)
    near = set(model.kinds)
    rivals: dict[str, list[str]] = {kind: [] for kind in model.kinds}
    for other in (*score.larger(chosen), *score.swapped(chosen)):
        kind = other[-1][0]
        value = score(other)
        if value > best - _NEAR:
            near.add(kind)
        lost = set(model.kinds) - {k for k, _ in other}
        if lost and value > best - RIVAL_GAP and kind not in model.kinds:
            (gone,) = lost
            if kind not in rivals[gone]:
                rivals[gone].append(kind)

    def stands_for_any(kind: str) -> bool:
        return len(rivals[kind]) > MOST_RIVALS * len(score.variants)

    counts = dict.fromkeys(model.kinds, 0)
    supports = dict.fromkeys(model.kinds, 0)
    for _ in range(RESAMPLES):
        drawn = rng.integers(len(grams), size=len(grams))
        times = np.bincount(drawn, minlength=len(grams)).astype(float)
        again = scoring(candidates, grams, times).among(near)
        found = {kind for kind, _ in climb(again, chosen)}
        for kind in model.kinds:
            counts[kind] += kind in found
            supports[kind] += not found.isdisjoint((kind, *rivals[kind]))
    return {
        kind: Weighed(
            rivals=tuple(rivals[kind]),
            inclusion=counts[kind] / RESAMPLES,
            support=(counts if stands_for_any(kind) else supports)[kind] / RESAMPLES,
        )
        for kind in model.kinds
    }


LEAST_SUPPORT = 0.85
"""Share of resampled flights by which an effect, or one that is like it, must be
chosen: one that hangs on a few flights is not claimed."""


DOUBTED = 60.0
"""Evidence up to which an effect is dropped for want of support [nats]: resampled
searches are to first order, and what costs more than this to leave out is there."""


def weakest(
    weighed: dict[str, Weighed], evidence: dict[str, float], beside_field: bool = False
) -> str | None:
    """Returns the effect that fewest resampled flights support, if too few.

    Args:
        weighed: of each effect.
        evidence: that is lost without it when all else is refitted [nats].
        beside_field: whether a field acts too: what its Gaussians leave of the true
            shape makes evidence of any size for effects that are not there.
    """
    doubted = [kind for kind in weighed if beside_field or evidence[kind] < DOUBTED]
    kind = min(doubted, key=lambda k: weighed[k].support, default=None)
    if kind is None or weighed[kind].support >= LEAST_SUPPORT:
        return None
    return kind


def shown_by(task: Task, model: Fitted) -> dict[str, float]:
    """Returns what flights show of each effect beside the others (Wald) [nats].

    Half of c' C⁻¹ c, of an effect's sizes c and their covariance C.
    """
    known = uncertainty_of(task, model)
    found = {}
    for kind in model.kinds:
        slots = [i for i in task.layout.slots_of(kind) if i in known.free]
        slots = [i for i in slots if not task.is_shape(i)] or slots
        places = [known.free.index(i) for i in slots]
        value = model.theta[slots] - task.vehicle.theta[slots]
        block = known.covariance[np.ix_(places, places)]
        found[kind] = 0.5 * float(value @ np.linalg.solve(block, value))
    return found
