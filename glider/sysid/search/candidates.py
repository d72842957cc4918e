"""Candidates of a search for effects: sets fitted together, and evidence."""

import dataclasses
import itertools
import math
from collections.abc import Callable, Iterable, Sequence

import numpy as np
from scipy.stats import chi2

from glider.physics.effects import EffectKind
from glider.sysid.likelihood.information import (
    cost,
    held_out_costs,
    solve,
)
from glider.sysid.fit.output_error import Fit, fit, gather
from glider.sysid.fit.whiteness import (
    LackOfFit,
    lack_of_fit,
)
from glider.sysid.replay.problem import Problem
from glider.sysid.replay.theta import Layout

Progress = Callable[[str], None]

FALSE_ALARM_PROBABILITY = 0.002
"""Probability that the whole library of candidates finds an effect where none is."""

LEAST_EVIDENCE = 3.0
"""Evidence that an effect needs in any case [nats]."""

NEEDED_RATIO = 1.2
"""Ratio of what is left without a member of a set to what is left with it, below
which the member is not needed."""


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
        lack_of_fit: what they leave.
    """

    lack_of_fit: LackOfFit

    @property
    def left(self) -> float:
        """Bound of what is left, no less than the noise of that figure."""
        return self.lack_of_fit.bound


@dataclasses.dataclass(frozen=True, kw_only=True)
class Weighed:
    """One effect of the chosen set, and how sure it is.

    Attributes:
        kind: of the effect.
        evidence: log-likelihood gained on held-out flights (leave one flight out,
            the others of the set kept), over the error's dispersion.
        share: of the nominal model's error that goes when the effect is added last.
        alternatives: kinds that would do as well in its place.
    """

    kind: str
    evidence: float
    share: float
    alternatives: tuple[str, ...]


@dataclasses.dataclass(frozen=True, kw_only=True)
class Search:
    """Task of a search: what to search and from where.

    Attributes:
        problem: the flights to fit.
        theta: the nominal model.
        nuisance: indices into theta that are unknown and always fitted.
        kinds: the candidates.
        progress: called with a line of text now and then.
    """

    problem: Problem
    theta: np.ndarray
    nuisance: tuple[int, ...] = ()
    kinds: tuple[str, ...] = ()
    progress: Progress = lambda text: None

    @property
    def layout(self) -> Layout:
        """Layout of theta."""
        return self.problem.layout

    def free(self, kinds: Sequence[str]) -> tuple[int, ...]:
        """Returns the indices to fit for a set of kinds."""
        slots = {i for kind in kinds for i in self.layout.slots_of(kind)}
        index = self.layout.index
        if index["parameters", "wing_offset"] in self.nuisance:
            slots.discard(index["center_of_pressure", "shift"])
        if "inertia" in kinds or index["parameters", "pitch_inertia"] in self.nuisance:
            slots.discard(index["added_mass", "inertia"])
        return tuple(sorted(slots | set(self.nuisance)))

    def on(self, problem: Problem) -> "Search":
        """Returns the same search on other flights."""
        return dataclasses.replace(self, problem=problem)


def fit_set(search: Search, kinds: tuple[str, ...], theta: np.ndarray) -> EffectSet:
    """Fits a set of effects from a start and tests what it leaves."""
    found = fit(search.problem, theta, search.free(kinds))
    return judge(search, Fitted(kinds=kinds, fit=found))


def judge(search: Search, fitted: Fitted) -> EffectSet:
    """Returns the set with a test of what it leaves."""
    left = lack_of_fit(search.problem, fitted.fit.theta)
    return EffectSet(kinds=fitted.kinds, fit=fitted.fit, lack_of_fit=left)


def significant(small: Fit, large: Fit, num_kinds: int) -> bool:
    """Whether a fit beats a smaller one by more than the best of many would by luck.

    The likelihood ratio over the dispersion is held against χ², with the level
    divided by the number of candidates; and the gain must hold on flights that
    were left out of the fit.
    """
    extra = max(len(large.free) - len(small.free), 1)
    ratio = (small.cost - large.cost) / max(large.dispersion, 1e-9)
    by_luck = chi2.sf(ratio, extra) * max(num_kinds, 1)
    return bool(
        by_luck < FALSE_ALARM_PROBABILITY and evidence(small, large) > LEAST_EVIDENCE
    )


def evidence(small: Fit, large: Fit) -> float:
    """Log-likelihood that a larger fit gains on flights left out of it."""
    gain = held_out_costs(small.information) - held_out_costs(large.information)
    gain = gain[: len(large.degrees)]  # A prior is no flight.
    return float(0.5 * gain.sum() / max(large.dispersion, 1.0))


def starts(layout: Layout, kind: EffectKind, theta: np.ndarray) -> list[np.ndarray]:
    """Returns theta with each combination of the kind's starting values."""
    options = [c.grid or (c.default,) for c in kind.coefficients]
    found = []
    for values in itertools.product(*options):
        start = theta.copy()
        start[list(layout.slots_of(kind.kind))] = values
        found.append(start)
    return found


def _sizes(layout: Layout, kind: EffectKind) -> set[int]:
    """Indices of the coefficients that the cost is nearly quadratic in."""
    slots = layout.slots_of(kind.kind)
    sizes = {i for i, c in zip(slots, kind.coefficients, strict=True) if not c.is_shape}
    return sizes or set(slots)


def extend(search: Search, parent: Fitted, most: int) -> list[Fitted]:
    """Fits a set with each promising further effect."""
    promising = []
    free = set(search.free(parent.kinds))
    for name in search.kinds:
        if name in parent.kinds:
            continue
        kind = search.layout.kinds[name]
        mine = _sizes(search.layout, kind) & set(search.free((name,)))
        sizes = tuple(sorted(free | mine))
        best = math.inf, parent.fit.theta
        for start in starts(search.layout, kind, parent.fit.theta):
            information = gather(search.problem, start, sizes).sum(axis=0)
            promised = cost(information, solve(information))
            if promised < best[0]:
                best = promised, start
        promising.append((*best, name))
    promising.sort(key=lambda entry: entry[0])
    found = []
    for _, start, name in promising[:most]:
        kinds = (*parent.kinds, name)
        result = fit(search.problem, start, search.free(kinds))
        found.append(Fitted(kinds=kinds, fit=result))
    return found


def ranked(sets: Iterable[Fitted]) -> list[Fitted]:
    """Returns sets best first, by cost and a price for every coefficient.

    The price is that of the Bayesian information criterion at the best set's
    dispersion: a kind that holds another one, as `added_mass` an `inertia`, always
    fits a little better, and must not take its place for that.
    """
    found = sorted(sets, key=lambda s: s.fit.cost)
    if not found:
        return found
    best = found[0].fit
    price = max(best.dispersion, 1.0) * math.log(best.degrees.sum())
    return sorted(found, key=lambda s: s.fit.cost + price * len(s.fit.free))


def without(search: Search, chosen: EffectSet, kind: str) -> EffectSet:
    """Fits a set anew without one of its kinds."""
    theta = chosen.fit.theta.copy()
    slots = list(search.layout.slots_of(kind))
    theta[slots] = search.theta[slots]
    return fit_set(search, tuple(k for k in chosen.kinds if k != kind), theta)
