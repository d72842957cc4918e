"""Which effects does the model lack? A search over the library, judged by evidence.

The search adds effects one at a time to the few best sets so far (a beam), each
fitted by rollout. It ends with the smallest set that leaves nothing, or whose
next member would not earn its place. Then each member is weighed on flights that
its fit has not seen, and swapped against every other kind, which names what the
data cannot tell apart.
"""

import dataclasses
import math
from collections.abc import Sequence

import numpy as np

from glider.sysid.search.candidates import (
    EffectSet,
    Fitted,
    Search,
    Weighed,
    evidence,
    extend,
    fit_set,
    judge,
    significant,
    without,
)

SILENT = 4.0
"""Lack of fit, in standard deviations, below which nothing is left."""

EARNING = 4.0
"""Factor by which an added effect must cut what is left, or else ..."""

CLEAR = 10.0
"""Evidence that an effect needs where it only shows beside stronger ones [nats]."""

SHARE = 0.1
"""... the share of the drawing's error that it must explain."""

HOPELESS = 0.35
"""Share of the drawing's error that the best pair may leave for a triple."""

BEAM = 3
"""Sets that each round starts from."""

SEARCH_FLIGHTS = 12
"""Flights to search with where the error is large; all are used in the end."""

_NEARLY_SILENT = 20.0

_INDISTINGUISHABLE = 12.0
"""Difference of twice the log-likelihood below which two kinds are one to us."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Trace:
    """What the search found.

    Attributes:
        chosen: the set, possibly empty.
        base: no effect at all.
        weighed: one per member, strongest first.
        candidates: evidence of the most promising kinds when tried alone.
        singles: the most promising kinds, each fitted alone, best first.
    """

    chosen: EffectSet
    base: EffectSet
    weighed: tuple[Weighed, ...]
    candidates: dict[str, float]
    singles: tuple[Fitted, ...]


def trace(search: Search, most: int = 3, earlier: Trace | None = None) -> Trace:
    """Finds the effects that explain the flights.

    Args:
        search: see there.
        most: effects at most.
        earlier: a trace with most = 1 to go on from.
    """
    everything = search
    base = fit_set(search, (), search.theta)
    if base.fit.dispersion > 10.0 and len(search.problem.records) > SEARCH_FLIGHTS:
        search = search.on(search.problem.thinned(SEARCH_FLIGHTS))
        start = fit_set(search, (), base.fit.theta)
    else:
        start = base

    sizes = [start]
    levels: list[Sequence[Fitted]] = [[start]]
    alone: Sequence[Fitted] = earlier.singles if earlier else []
    if alone:
        levels.append(alone)
        sizes.append(judge(search, alone[0]))
    for depth in range(len(levels) - 1, most):
        search.progress(
            f"trying {'one effect' if depth == 0 else f'{depth + 1} effects'}"
        )
        found: dict[frozenset[str], Fitted] = {}
        for parent in levels[-1][:BEAM]:
            for child in extend(search, parent, 10 if depth == 0 else 6):
                key = frozenset(child.kinds)
                if key not in found or child.fit.cost < found[key].fit.cost:
                    found[key] = child
        children = sorted(found.values(), key=lambda s: s.fit.cost)
        if depth == 0:
            alone = children
        if not children:
            break
        levels.append(children)
        sizes.append(judge(search, children[0]))
        if sizes[-1].lack.z < SILENT or _hopeless(sizes):
            break

    best = choose(sizes, len(search.kinds))
    chosen = fit_set(everything, best.kinds, best.fit.theta) if best.kinds else base
    chosen = _refine(everything, _prune(everything, chosen), most)
    search.progress("weighing the effects")
    return Trace(
        chosen=chosen,
        base=base,
        weighed=_weigh(everything, base, chosen),
        candidates={s.kinds[0]: evidence(start.fit, s.fit) for s in alone},
        singles=tuple(alone),
    )


def _hopeless(sizes: Sequence[EffectSet]) -> bool:
    """Whether pairs explain so little that a third effect is not worth a search."""
    return len(sizes) > 2 and sizes[-1].left > HOPELESS * sizes[0].left


def choose(sets: Sequence[EffectSet], num_kinds: int) -> EffectSet:
    """Returns the set that earns its place, from the best of each size.

    A larger set must leave `EARNING` times less for every effect that it adds, or
    explain a further `SHARE` of the drawing's error with each (unless there was
    little to explain), and it must be significant among all the candidates tried.
    """
    chosen = sets[0]
    for larger in sets[1:]:
        added = len(larger.kinds) - len(chosen.kinds)
        cut = larger.left * EARNING**added <= chosen.left
        explained = chosen.left - larger.left >= SHARE * added * sets[0].left
        weak = sets[0].lack.z < 10.0
        if significant(chosen.fit, larger.fit, num_kinds) and (
            cut or explained or weak
        ):
            chosen = larger
    return chosen


def _prune(search: Search, chosen: EffectSet) -> EffectSet:
    """Drops members that the others have made needless."""
    for kind in chosen.kinds:
        if len(chosen.kinds) < 2:
            break
        smaller = without(search, chosen, kind)
        needed = significant(smaller.fit, chosen.fit, len(search.kinds))
        if not needed or smaller.left < 1.2 * chosen.left:
            chosen = smaller
    return chosen


def _refine(search: Search, chosen: EffectSet, most: int) -> EffectSet:
    """Adds a weak effect that the whole set of flights shows beside strong ones.

    The search's few flights may miss it. Where all that is left is nearly noise,
    an effect must gain `CLEAR` evidence and leave nothing.
    """
    while chosen.kinds and len(chosen.kinds) < most and chosen.lack.z < _NEARLY_SILENT:
        children = extend(search, chosen, 3)
        if not children:
            break
        best = judge(search, min(children, key=lambda s: s.fit.cost))
        clear = significant(chosen.fit, best.fit, len(search.kinds))
        if not clear or evidence(chosen.fit, best.fit) < CLEAR:
            break
        if best.lack.z > SILENT:
            break
        chosen = best
    return chosen


def _weigh(search: Search, base: EffectSet, chosen: EffectSet) -> tuple[Weighed, ...]:
    weighed = []
    total = max(base.lack.excess - min(chosen.lack.excess, 0.0), 1e-9)
    for kind in chosen.kinds:
        smaller = without(search, chosen, kind)
        share = (smaller.lack.excess - max(chosen.lack.excess, 0.0)) / total
        weighed.append(
            Weighed(
                kind=kind,
                evidence=evidence(smaller.fit, chosen.fit),
                share=float(np.clip(share, 0.0, 1.0)),
                alternatives=_alternatives(search, smaller, chosen),
            )
        )
    return tuple(sorted(weighed, key=lambda w: -w.evidence))


def _alternatives(
    search: Search, smaller: EffectSet, chosen: EffectSet
) -> tuple[str, ...]:
    """Returns the kinds that leave no more in the place of the one taken out."""
    rest = dataclasses.replace(
        search, kinds=tuple(k for k in search.kinds if k not in chosen.kinds)
    )
    equal = []
    for other in extend(rest, smaller, 4):
        penalty = math.log(chosen.fit.degrees.sum()) * (
            len(other.fit.free) - len(chosen.fit.free)
        )
        gap = (other.fit.cost - chosen.fit.cost) / max(chosen.fit.dispersion, 1.0)
        if gap + min(penalty, 0.0) < _INDISTINGUISHABLE:
            equal.append(other.kinds[-1])
    return tuple(equal)
