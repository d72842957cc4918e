"""How sure is each effect of a set: evidence, rivals, resampled flights."""

import dataclasses
from collections import Counter
from collections.abc import Callable, Sequence

import numpy as np

from glider.sysid.likelihood.candidates import Candidates, gather
from glider.sysid.likelihood.model_fit import FitResult
from glider.sysid.likelihood.task import Task
from glider.sysid.likelihood.uncertainty import uncertainty_of
from glider.sysid.search.fits import is_plain
from glider.sysid.search.subsets import Members, Scorer, climb

RESAMPLES = 25
"""Sets of flights, drawn with replacement, that the search is repeated on."""

RIVAL_GAP = 6.0
"""Difference of evidence below which two effects are one to us [nats]: the odds of the
better one are then below 400 to 1."""

LEAST_STAND_IN = 0.1
"""Share of resampled flights that choose another effect in the place of the only one,
from which on it is a rival, too: the flights at hand might as well have been those."""

RESAMPLED_PRICE = 0.5
"""Share of its price that the only effect pays on resampled flights: they are to say
whether it hangs on a few flights, not to prove it anew."""

MOST_RIVALS = 0.5
"""Share of the library from which on what would do as well in an effect's place lends
it no support: where anything helps, the lack has another form."""

_NEAR = 25.0
"""Loss of evidence up to which an effect is offered to resampled searches [nats]."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class EffectSupport:
    """An effect of the chosen set, and how sure it is.

    Attributes:
        rivals: kinds that would do as well in its place, on these flights or on flights
            drawn from them.
        inclusion: share of the resampled flights that it is chosen by.
        support: the same of it or one of its rivals.
        enough: share from which on that is enough.
    """

    rivals: tuple[str, ...]
    inclusion: float
    support: float
    enough: float


Scoring = Callable[[Candidates, np.ndarray, np.ndarray], Scorer]
"""Makes a scorer of candidates, of what each flight tells and how often it counts."""


def weigh(
    task: Task, model: FitResult, scoring: Scoring, rng: np.random.Generator
) -> dict[str, EffectSupport]:
    """Returns what speaks for each effect of a model."""
    if not model.kinds:
        return {}
    candidates = gather(task, model)
    grams = candidates.grams(model.scales)
    score = scoring(candidates, grams, np.ones(len(grams)))
    chosen = score.by_first(model.kinds)
    near, rivals = _near_and_rivals(score, chosen)
    is_alone = is_plain(model, model.scales)
    share = RESAMPLED_PRICE if is_alone else 1.0
    resampled = []
    for _ in range(RESAMPLES):
        drawn = rng.integers(len(grams), size=len(grams))
        times = np.bincount(drawn, minlength=len(grams)).astype(float)
        again = scoring(candidates, grams, times).among(near)
        priced = again.priced(lambda kind: share * score.price(kind))
        resampled.append({kind for kind, _ in climb(priced, chosen)})
    found = {}
    for kind in model.kinds:
        alike = rivals[kind]
        if is_alone:
            alike = alike | _stand_ins(kind, resampled)
        backers = {kind, *alike}
        if len(alike) > MOST_RIVALS * len(score.variants):
            backers = {kind}
        found[kind] = EffectSupport(
            rivals=tuple(k for k in score.variants if k in alike),
            inclusion=sum(kind in s for s in resampled) / RESAMPLES,
            support=sum(not backers.isdisjoint(s) for s in resampled) / RESAMPLES,
            enough=PLAIN_SUPPORT if is_alone else LEAST_SUPPORT,
        )
    return found


def _near_and_rivals(
    score: Scorer, chosen: Members
) -> tuple[set[str], dict[str, set[str]]]:
    """Returns what is offered to resampled flights, and each member's rivals."""
    kinds = {kind for kind, _ in chosen}
    near, best = set(kinds), score(chosen)
    rivals: dict[str, set[str]] = {kind: set() for kind in kinds}
    for other in (*score.larger(chosen), *score.swapped(chosen)):
        kind, value = other[-1][0], score(other)
        if value > best - _NEAR:
            near.add(kind)
        lost = kinds - {k for k, _ in other}
        if lost and value > best - RIVAL_GAP and kind not in kinds:
            (gone,) = lost
            rivals[gone].add(kind)
    return near, rivals


def _stand_ins(kind: str, resampled: Sequence[set[str]]) -> set[str]:
    """Returns what resampled flights choose in the place of an effect."""
    counts = Counter(k for found in resampled if kind not in found for k in found)
    return {k for k, n in counts.items() if n >= LEAST_STAND_IN * len(resampled)}


LEAST_SUPPORT, PLAIN_SUPPORT = 0.85, 0.5
"""Shares of resampled flights by which an effect, or one that is like it, must be
chosen: one that hangs on a few flights is not claimed. Where it alone and air explain
the flights, the few that tell may be believed: most draws are enough."""


DOUBTED = 60.0
"""Evidence up to which an effect is dropped for want of support [nats]: resampled
searches are to first order, and what costs more than this to leave out is there."""


def weakest(
    weighed: dict[str, EffectSupport],
    evidence: dict[str, float],
    beside_field: bool = False,
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
    if kind is None or weighed[kind].support >= weighed[kind].enough:
        return None
    return kind


def shown_by(task: Task, model: FitResult) -> dict[str, float]:
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
