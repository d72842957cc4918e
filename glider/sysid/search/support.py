"""Support of each effect of a set: evidence, rivals, resampled flights."""

import dataclasses
import math

import numpy as np

from glider.physics.effects.families import BLOCKS
from glider.sysid.constants import CLEAR, LEAST_SUPPORT, RIVAL_GAP
from glider.sysid.likelihood.candidates import gather
from glider.sysid.likelihood.task import FitResult, Task
from glider.sysid.report import Combination, EvidenceThreshold
from glider.sysid.search.subsets import Members, Scorer, climb, scorer_of

_LEAST_DRAWS, _MOST_DRAWS = 25, 200  # Sets of flights: the most where in doubt.


@dataclasses.dataclass(frozen=True, kw_only=True)
class EffectSupport:
    """Support of an effect of the chosen set."""

    rivals: tuple[str, ...]  #: Kinds that would do as well.
    inclusion: float  #: Share of the resampled flights that choose it.
    support: float  #: Share that choose it or one of its rivals.

    def is_settled(self, draws: int) -> bool:
        """Whether the support is two standard errors of so many draws off its limit."""
        error = math.sqrt(LEAST_SUPPORT * (1.0 - LEAST_SUPPORT) / draws)
        return abs(self.support - LEAST_SUPPORT) > 2.0 * error


def weigh(
    task: Task, model: FitResult, rng: np.random.Generator
) -> dict[str, EffectSupport]:
    """Returns the support of each effect of a model."""
    if not model.kinds:
        return {}
    candidates = gather(task, model)
    grams = candidates.grams(model.scales)
    score = scorer_of(candidates, grams, np.ones(len(grams)))
    chosen = score.by_first(model.kinds)
    near, rivals = near_and_rivals(score, chosen)
    backers = {k: {k, *rivals[k], *_family_of(k, model)} for k in model.kinds}
    resampled: list[set[str]] = []
    while True:
        for _ in range(_LEAST_DRAWS):
            drawn = rng.integers(len(grams), size=len(grams))
            times = np.bincount(drawn, minlength=len(grams)).astype(float)
            again = scorer_of(candidates, grams, times).among(near)
            resampled.append({kind for kind, _ in climb(again, chosen)})
        draws = len(resampled)
        found = {
            kind: EffectSupport(
                rivals=tuple(k for k in score.variants if k in rivals[kind]),
                inclusion=sum(kind in s for s in resampled) / draws,
                support=sum(not own.isdisjoint(s) for s in resampled) / draws,
            )
            for kind, own in backers.items()
        }
        if draws >= _MOST_DRAWS or all(f.is_settled(draws) for f in found.values()):
            return found


def _family_of(kind: str, model: FitResult) -> set[str]:
    """Returns the free functions that bend a kind, and the formulas of their families.

    Beside a free function, any formula of its family does nearly as well.
    """
    blocks = [b for b in model.free_kinds if kind == b or kind in BLOCKS[b].bends]
    return {name for block in blocks for name in (block, *BLOCKS[block].formulas)}


def near_and_rivals(
    score: Scorer, chosen: Members
) -> tuple[set[str], dict[str, set[str]]]:
    """Returns the effects to offer to resampled flights, and each member's rivals."""
    kinds = {kind for kind, _ in chosen}
    near, best = set(kinds), score(chosen)
    rivals: dict[str, set[str]] = {kind: set() for kind in kinds}
    for other in (*score.larger(chosen), *score.swapped(chosen)):
        kind, value = other[-1][0], score(other)
        if value > best - CLEAR:
            near.add(kind)
        lost = kinds - {k for k, _ in other}
        if lost and value > best - RIVAL_GAP and kind not in kinds:
            (gone,) = lost
            rivals[gone].add(kind)
    return near, rivals


def weakest(
    weighed: dict[str, EffectSupport], evidence: dict[str, float]
) -> str | None:
    """Returns the effect of least evidence that too few resampled flights support."""
    weak = [k for k, own in weighed.items() if own.support < LEAST_SUPPORT]
    return min(weak, key=evidence.__getitem__, default=None)


@dataclasses.dataclass(frozen=True, kw_only=True)
class SearchResult:
    """Outcome of a search."""

    model: FitResult  #: With the effects that were found.
    bare: FitResult  #: The model without any, fitted.
    evidence: dict[str, float]  #: Kind to the evidence lost without it [nats].
    weighed: dict[str, EffectSupport]  #: Kind to its support.
    alone: dict[str, float]  #: Evidence as the only effect, to first order [nats].
    combinations: tuple[Combination, ...]  #: Sets that were fitted, best first.
    #: Free function to the library's formula of its family that is nearest.
    families: dict[str, str] = dataclasses.field(default_factory=dict)
    found_by: dict[str, str] = dataclasses.field(default_factory=dict)  #: Move by kind.
    #: Models of sets that are nearly as likely, and the evidence that they lack [nats].
    rivals: tuple[tuple[FitResult, float], ...] = ()
    threshold: EvidenceThreshold  #: Of evidence, below which an effect is not taken.
    #: The model as it was judged, along the measured attitude, if not as it is.
    forces: FitResult | None = None

    @property
    def judged(self) -> FitResult:
        """The model in which the effects were compared."""
        return self.model if self.forces is None else self.forces
