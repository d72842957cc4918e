"""A search in progress, which fits sets, and the support of effects that it found."""

import dataclasses
import math
from collections.abc import Collection, Iterable
from typing import Any

import numpy as np

from glider.physics.effects.families import FAMILIES
from glider.progress import Progress
from glider.sysid.constants import CLEAR, LEAST_SUPPORT, MANY_FLIGHTS, RIVAL_GAP
from glider.sysid.likelihood.candidates import (
    Candidates,
    gather,
    gather_in_parts,
    saturated,
)
from glider.sysid.likelihood.model_fit import fit_model
from glider.sysid.likelihood.task import FitResult, Task
from glider.sysid.search.subsets import Members, Scorer, climb, scorer_of, threshold_of

# Sets of flights: the most where in doubt.
_LEAST_DRAWS = 25
_MOST_DRAWS = 200


@dataclasses.dataclass
class Search:
    """A search in progress; it remembers all fits."""

    task: Task
    progress: Progress
    fitted: dict[frozenset[str], FitResult] = dataclasses.field(default_factory=dict)
    #: Sets whose fits stopped far behind a rival, and the cost that was too much.
    stopped: dict[frozenset[str], float] = dataclasses.field(default_factory=dict)
    #: Effects whose shapes were searched again, and the sets in which they were.
    reshaped: set[tuple[str, frozenset[str]]] = dataclasses.field(default_factory=set)
    _near: tuple[Any, ...] = (None, None, None)  #: What was compared last.
    #: Formulas about a model in all flights; functions may be offered beside them.
    _formulas: tuple[Any, ...] = (None, None, None)

    def penalized_cost(self, model: FitResult) -> float:
        """Returns a model's cost with the thresholds of its effects [nats]."""
        return model.cost + model.freedom + self._penalty_of(model)

    def _penalty_of(self, model: FitResult) -> float:
        """Returns the thresholds of a model's effects [nats]."""
        return sum(threshold_of(self.task, kind, model.kinds) for kind in model.kinds)

    def prefers(self, model: FitResult, other: FitResult) -> bool:
        """Whether a model is worth more than another.

        Clearly so, unless it has some of the other's effects, or formulas beside them
        or in the place of free functions, which their thresholds are for.
        """
        own = set(model.kinds)
        its = set(other.kinds)
        is_simpler = own <= its
        is_named = its - own <= FAMILIES.keys() and not (own - its) & FAMILIES.keys()
        margin = 0.0 if is_simpler or is_named else RIVAL_GAP
        return self.penalized_cost(model) < self.penalized_cost(other) - margin

    def fit(
        self,
        model: FitResult,
        words: str = "",
        rival: FitResult | None = None,
        *,
        again: bool = False,
    ) -> FitResult:
        """Fits a model, and the strengths of its functions, unless its set is known.

        Not to the end where it is far behind a rival; beside a worse one, or none, such
        a set is fitted once more. A known set is fitted again from another start if
        asked; that fit is kept where it is clearly better.
        """
        key = frozenset(model.kinds)
        most = np.inf
        known = self.fitted.get(key)
        if rival is not None:
            most = self.penalized_cost(rival) - self._penalty_of(model) + CLEAR
        is_done = most <= self.stopped.get(key, np.inf)
        if known is not None and is_done and np.isfinite(known.cost) and not again:
            return known
        self._formulas = None, None, None  # For the memory.
        what = ", ".join(sorted(model.kinds)) or "the flat plate"
        self.progress(words or f"fitting {what}")
        if model.free_kinds:  # Strengths shape the fit.
            model = fit_model(self.task, model, 2, with_strength=True)
        if not model.free_kinds or model.cost < most:
            model = fit_model(self.task, model, with_strength=True, most=most)
        if not is_done or known is None:
            self.stopped[key] = most if model.cost > most else np.inf
        if known is not None:  # Little less is the same one.
            least = self.penalized_cost(known) - (RIVAL_GAP if is_done else 0.0)
            model = model if self.penalized_cost(model) < least else known

        self.fitted[key] = model
        return model

    def fit_without(self, model: FitResult, kind: str) -> FitResult:
        """Fits a model without one of its effects."""
        return self.fit(model.without(self.task, kind), f"is {kind} needed?")

    def near(self, model: FitResult) -> Scorer | None:
        """Compares sets about a model; None where the model diverges."""
        if self._near[0] is not self.task or self._near[1] is not model:
            offered = self.task.offered
            self._near = self.task, model, self.compare(model, offered)
        return self._near[2]

    def compare(self, model: FitResult, kinds: Collection[str]) -> Scorer | None:
        """Compares sets of some kinds about a model; None where it diverges.

        On some of many flights: what is proposed is fitted to all.
        """
        few = self.task.offering(kinds).thinned(MANY_FLIGHTS)
        if self._formulas[0] is not model or self._formulas[1] != few.kinds:
            self._formulas = model, few.kinds, _formulas_about(few, model)
        leading = [function.leading_only for function in few.functions.values()]
        candidates = self._formulas[2].offering(leading)
        gram = candidates.total(candidates.model.scales)
        if not np.all(np.isfinite(gram)):
            return None
        light = dataclasses.replace(candidates, task=few, flights=())
        return scorer_of(light, gram[None], np.ones(1))

    def better(
        self,
        model: FitResult,
        near: Scorer,
        sets: Iterable[Members],
        first: bool = False,
    ) -> FitResult | None:
        """Returns the best, or the first, of some sets that are worth more; or None."""
        found = model
        for members in sets:
            other = self.fit(near.begin(members), rival=found)
            is_best = self.penalized_cost(other) < self.penalized_cost(found)
            found = other if is_best and self.prefers(other, model) else found
            if first and found is not model:
                break

        return None if found is model else found


def _formulas_about(task: Task, model: FitResult) -> Candidates:
    """Returns the formulas about a model with all noise as if they acted, `saturated`.

    Any free function may be offered beside them.
    """
    terms = {family.free_function.kind for family in FAMILIES.values()}
    candidates = gather(task, model, terms)
    about = saturated(candidates, 2 if np.isfinite(model.cost) else 3)
    if about.scales.is_still:
        about = dataclasses.replace(about, about=model.about)
        return dataclasses.replace(candidates, model=about)
    del candidates  # Before there are others.
    return gather(task, about, terms)


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
    candidates, grams, _ = gather_in_parts(task, model, model.scales)
    near = Nearby(candidates, grams)
    rivals = near.rivals
    backers = {k: {k, *rivals[k], *_family_of(k, model)} for k in model.kinds}
    resampled: list[set[str]] = []
    while True:
        for _ in range(_LEAST_DRAWS):
            drawn = rng.integers(len(grams), size=len(grams))
            times = np.bincount(drawn, minlength=len(grams)).astype(float)
            _, members = near.best(times)
            resampled.append({kind for kind, _ in members})

        draws = len(resampled)
        found = {
            kind: EffectSupport(
                rivals=tuple(k for k in candidates.variants if k in rivals[kind]),
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
    functions = [b for b in model.free_kinds if kind == b or kind in FAMILIES[b].bends]
    return {
        name
        for function in functions
        for name in (function, *FAMILIES[function].formulas)
    }


class Nearby:
    """Sets of effects near that of a model, compared on any choice of its flights.

    Farther away, errors of the linearization look like effects.
    """

    def __init__(self, candidates: Candidates, grams: np.ndarray):
        """Takes the flights' information on the candidates about the model."""
        self._candidates = candidates
        self._grams = grams
        score = scorer_of(candidates, grams, np.ones(len(grams)))
        self._chosen = score.by_first(candidates.model.kinds)
        kinds = {kind for kind, _ in self._chosen}
        #: Of each effect of the set, what would do as well in its place.
        self.rivals: dict[str, set[str]] = {kind: set() for kind in kinds}
        self._kinds = set(kinds)  # That are offered.
        best = score(self._chosen)
        for other in (*score.larger(self._chosen), *score.swapped(self._chosen)):
            kind = other[-1][0]
            value = score(other)
            if value > best - CLEAR:
                self._kinds.add(kind)
            if kind not in kinds and value > best - RIVAL_GAP:
                for gone in kinds - {k for k, _ in other}:
                    self.rivals[gone].add(kind)

    def best(self, counts: np.ndarray) -> tuple[Scorer, Members]:
        """Returns the best set on flights that count so often, and its scorer."""
        score = scorer_of(self._candidates, self._grams, counts)
        return score, climb(score.among(self._kinds), self._chosen)


@dataclasses.dataclass(frozen=True, kw_only=True)
class SearchResult:
    """Outcome of a search."""

    model: FitResult  #: With the effects that were found.
    bare: FitResult  #: The model without any, fitted.
    evidence: dict[str, float]  #: Kind to the evidence lost without it [nats].
    weighed: dict[str, EffectSupport]  #: Kind to its support.
    names: dict[str, str]  #: By which effects are reported; others are not.
    #: Models of sets that are nearly as likely, and the evidence that they lack [nats].
    rivals: tuple[tuple[FitResult, float], ...] = ()
    threshold: float  #: Evidence of an effect beside others, at least [nats].
    #: The model as it was judged, along the measured attitude, if not as it is.
    forces: FitResult | None = None

    @property
    def judged(self) -> FitResult:
        """The model in which the effects were compared."""
        return self.model if self.forces is None else self.forces
