"""Which effects does the model lack? A search over the library, judged by evidence.

The search adds effects one at a time to the few best sets so far (a beam), each
fitted by rollout. It ends with the smallest set that leaves nothing, or whose
next member would not earn its place. Then each member is weighed on flights that
its fit has not seen, and swapped against every other kind, which names what the
data cannot tell apart.
"""

import dataclasses
import itertools
import math
from collections.abc import Callable, Sequence

import numpy as np
from scipy.stats import chi2

from glider.effects import KINDS, EffectKind
from glider.sysid.replay import INDEX, slots_of
from glider.sysid.rollout_fit import (
    Fit,
    Problem,
    cost,
    fit,
    gather,
    held_out_costs,
    solve,
)
from glider.sysid.whiteness import LackOfFit, lack_of_fit

Progress = Callable[[str], None]

FALSE_ALARM = 0.002
"""Chance that the whole library of candidates finds one effect where none is."""

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


@dataclasses.dataclass(frozen=True, kw_only=True)
class Fitted:
    """Effects fitted together.

    Attributes:
        kinds: in the order in which they were added.
        fit: by rollout.
    """

    kinds: tuple[str, ...]
    fit: Fit


@dataclasses.dataclass(frozen=True, kw_only=True)
class EffectSet(Fitted):
    """Effects fitted together, and what they leave.

    Attributes:
        lack: what is left.
    """

    lack: LackOfFit

    @property
    def left(self) -> float:
        """What is left, no less than the noise of that figure."""
        return max(self.lack.excess, 0.0) + 2.0 * self.lack.std


@dataclasses.dataclass(frozen=True, kw_only=True)
class Weighed:
    """One effect of the chosen set, and how sure it is.

    Attributes:
        kind: of the effect.
        evidence: log-likelihood gained on held-out flights (leave one flight out,
            the others of the set kept), over the error's dispersion.
        share: of the drawing's error that goes when the effect is added last.
        alternatives: kinds that would do as well in its place.
    """

    kind: str
    evidence: float
    share: float
    alternatives: tuple[str, ...]


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


@dataclasses.dataclass(frozen=True, kw_only=True)
class Search:
    """What to search and from where.

    Attributes:
        problem: the flights to fit.
        theta: the drawing.
        nuisance: indices into theta that are unknown and always fitted.
        kinds: the candidates.
        progress: called with a line of text now and then.
    """

    problem: Problem
    theta: np.ndarray
    nuisance: tuple[int, ...] = ()
    kinds: tuple[str, ...] = ()
    progress: Progress = lambda text: None

    def free(self, kinds: Sequence[str]) -> tuple[int, ...]:
        """Returns the indices to fit for a set of kinds."""
        slots = {i for kind in kinds for i in slots_of(kind)}
        if INDEX["parameters", "wing_offset"] in self.nuisance:
            slots.discard(INDEX["center_of_pressure", "shift"])
        return tuple(sorted(slots | set(self.nuisance)))

    def on(self, problem: Problem) -> "Search":
        """Returns the same search on other flights."""
        return dataclasses.replace(self, problem=problem)


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
            for child in _extend(search, parent, 10 if depth == 0 else 6):
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


def fit_set(search: Search, kinds: tuple[str, ...], theta: np.ndarray) -> EffectSet:
    """Fits a set of effects from a start and tests what it leaves."""
    found = fit(search.problem, theta, search.free(kinds))
    return judge(search, Fitted(kinds=kinds, fit=found))


def judge(search: Search, fitted: Fitted) -> EffectSet:
    """Returns the set with a test of what it leaves."""
    lack = lack_of_fit(search.problem, fitted.fit.theta)
    return EffectSet(kinds=fitted.kinds, fit=fitted.fit, lack=lack)


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


def significant(small: Fit, large: Fit, num_kinds: int) -> bool:
    """Whether a fit beats a smaller one by more than the best of many would by luck.

    The likelihood ratio over the dispersion is held against χ², with the level
    divided by the number of candidates; and the gain must hold on flights that
    were left out of the fit.
    """
    extra = max(len(large.free) - len(small.free), 1)
    ratio = (small.cost - large.cost) / max(large.dispersion, 1e-9)
    by_luck = chi2.sf(ratio, extra) * max(num_kinds, 1)
    return bool(by_luck < FALSE_ALARM and evidence(small, large) > 3.0)


def evidence(small: Fit, large: Fit) -> float:
    """Log-likelihood that a larger fit gains on flights left out of it."""
    gain = held_out_costs(small.information) - held_out_costs(large.information)
    gain = gain[: len(large.degrees)]  # A prior is no flight.
    return float(0.5 * gain.sum() / max(large.dispersion, 1.0))


def starts(kind: EffectKind, theta: np.ndarray) -> list[np.ndarray]:
    """Returns theta with each combination of the kind's starting values."""
    options = [c.grid or (c.default,) for c in kind.coefficients]
    found = []
    for values in itertools.product(*options):
        start = theta.copy()
        start[list(slots_of(kind.kind))] = values
        found.append(start)
    return found


def _sizes(kind: EffectKind) -> set[int]:
    """Indices of the coefficients that the cost is nearly quadratic in."""
    slots = slots_of(kind.kind)
    sizes = {i for i, c in zip(slots, kind.coefficients, strict=True) if not c.is_shape}
    return sizes or set(slots)


def _extend(search: Search, parent: Fitted, most: int) -> list[Fitted]:
    """Fits a set with each promising further effect."""
    ranked = []
    free = set(search.free(parent.kinds))
    for name in search.kinds:
        if name in parent.kinds:
            continue
        sizes = tuple(sorted(free | (_sizes(KINDS[name]) & set(search.free((name,))))))
        best = math.inf, parent.fit.theta
        for start in starts(KINDS[name], parent.fit.theta):
            information = gather(search.problem, start, sizes).sum(axis=0)
            promised = cost(information, solve(information))
            if promised < best[0]:
                best = promised, start
        ranked.append((*best, name))
    ranked.sort(key=lambda entry: entry[0])
    found = []
    for _, start, name in ranked[:most]:
        kinds = (*parent.kinds, name)
        result = fit(search.problem, start, search.free(kinds))
        found.append(Fitted(kinds=kinds, fit=result))
    return found


def _prune(search: Search, chosen: EffectSet) -> EffectSet:
    """Drops members that the others have made needless."""
    for kind in chosen.kinds:
        if len(chosen.kinds) < 2:
            break
        smaller = _without(search, chosen, kind)
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
        children = _extend(search, chosen, 3)
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


_NEARLY_SILENT = 20.0


def _without(search: Search, chosen: EffectSet, kind: str) -> EffectSet:
    theta = chosen.fit.theta.copy()
    slots = list(slots_of(kind))
    theta[slots] = search.theta[slots]
    return fit_set(search, tuple(k for k in chosen.kinds if k != kind), theta)


def _weigh(search: Search, base: EffectSet, chosen: EffectSet) -> tuple[Weighed, ...]:
    weighed = []
    total = max(base.lack.excess - min(chosen.lack.excess, 0.0), 1e-9)
    for kind in chosen.kinds:
        smaller = _without(search, chosen, kind)
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
    for other in _extend(rest, smaller, 4):
        penalty = math.log(chosen.fit.degrees.sum()) * (
            len(other.fit.free) - len(chosen.fit.free)
        )
        gap = (other.fit.cost - chosen.fit.cost) / max(chosen.fit.dispersion, 1.0)
        if gap + min(penalty, 0.0) < _INDISTINGUISHABLE:
            equal.append(other.kinds[-1])
    return tuple(equal)


_INDISTINGUISHABLE = 12.0
"""Difference of twice the log-likelihood below which two kinds are one to us."""
