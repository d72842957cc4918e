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

from glider.sysid.result import Z_SIGNIFICANT
from glider.sysid.search.candidates import (
    NEEDED_RATIO,
    EffectSet,
    Fitted,
    Search,
    Weighed,
    evidence,
    extend,
    fit_set,
    judge,
    ranked,
    significant,
    without,
)

LEFT_RATIO = 4.0
"""Ratio of what is left without an added effect to what is left with it, from which
on the effect earns its place; or else it does by LEAST_SHARE."""

LEAST_SHARE = 0.1
"""Share of the nominal model's error that an added effect must explain."""

PAIR_SHARE_LEFT = 0.35
"""Share of the nominal model's error that the best pair may leave for a triple."""

WEAK_EVIDENCE = 10.0
"""Evidence that an effect needs where it only shows beside stronger ones [nats]."""

BEAM = 3
"""Sets that each round starts from."""

SEARCH_FLIGHTS = 12
"""Flights to search with where the error is large; all are used in the end."""

_LARGE_DISPERSION = 10.0
"""Mean squared error over noise variance from which on SEARCH_FLIGHTS are enough."""

_Z_LITTLE = 10.0
"""Lack of fit of the nominal model, in standard deviations, below which there is
little to explain."""

_Z_NEARLY_NOISE = 20.0
"""Lack of fit of a set, in standard deviations, below which a weak effect may be all
that is missing."""

_DEVIANCE_GAP = 12.0
"""Difference of twice the log-likelihood below which two kinds are one to us."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Trace:
    """Outcome of the search.

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
    if (
        base.fit.dispersion > _LARGE_DISPERSION
        and len(search.problem.records) > SEARCH_FLIGHTS
    ):
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
        children = ranked(found.values())
        if depth == 0:
            alone = children
        if not children:
            break
        levels.append(children)
        sizes.append(judge(search, children[0]))
        if sizes[-1].lack_of_fit.z < Z_SIGNIFICANT or _is_hopeless(sizes):
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


def _is_hopeless(sizes: Sequence[EffectSet]) -> bool:
    """Whether pairs explain so little that a third effect is not worth a search."""
    return len(sizes) > 2 and sizes[-1].left > PAIR_SHARE_LEFT * sizes[0].left


def choose(sets: Sequence[EffectSet], num_kinds: int) -> EffectSet:
    """Returns the set that earns its place, from the best of each size.

    A larger set must leave `LEFT_RATIO` times less for every effect that it adds, or
    explain a further `LEAST_SHARE` of the nominal model's error with each (unless
    there was little to explain), and it must be significant among all the candidates
    tried.
    """
    chosen = sets[0]
    for larger in sets[1:]:
        added = len(larger.kinds) - len(chosen.kinds)
        cut = larger.left * LEFT_RATIO**added <= chosen.left
        explained = chosen.left - larger.left >= LEAST_SHARE * added * sets[0].left
        weak = sets[0].lack_of_fit.z < _Z_LITTLE
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
        if not needed or smaller.left < NEEDED_RATIO * chosen.left:
            chosen = smaller
    return chosen


def _refine(search: Search, chosen: EffectSet, most: int) -> EffectSet:
    """Adds a weak effect that the whole set of flights shows beside strong ones.

    The search's few flights may miss it. Where all that is left is nearly noise,
    an effect must gain `WEAK_EVIDENCE` and leave nothing.
    """
    while (
        chosen.kinds
        and len(chosen.kinds) < most
        and chosen.lack_of_fit.z < _Z_NEARLY_NOISE
    ):
        children = extend(search, chosen, 3)
        if not children:
            break
        best = judge(search, ranked(children)[0])
        clear = significant(chosen.fit, best.fit, len(search.kinds))
        if not clear or evidence(chosen.fit, best.fit) < WEAK_EVIDENCE:
            break
        if best.lack_of_fit.z > Z_SIGNIFICANT:
            break
        chosen = best
    return chosen


def _weigh(search: Search, base: EffectSet, chosen: EffectSet) -> tuple[Weighed, ...]:
    weighed = []
    total = max(base.lack_of_fit.excess - min(chosen.lack_of_fit.excess, 0.0), 1e-9)
    for kind in chosen.kinds:
        smaller = without(search, chosen, kind)
        share = (
            smaller.lack_of_fit.excess - max(chosen.lack_of_fit.excess, 0.0)
        ) / total
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
        if gap + min(penalty, 0.0) < _DEVIANCE_GAP:
            equal.append(other.kinds[-1])
    return tuple(equal)
