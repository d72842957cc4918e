"""Moves from one set of effects to a better one, everything refitted.

A move returns a model that is worth more, or None. It proposes sets by closed forms,
to first order about the model, and fits what it proposes.
"""

import dataclasses
import heapq
from collections.abc import Iterable
from typing import Any

import numpy as np

from glider.physics.effects.families import FAMILIES
from glider.progress import Progress
from glider.sysid.constants import (
    CLEAR,
    FOLLOWED,
    MANY_FLIGHTS,
    MOST_EFFECTS,
    RIVAL_GAP,
    SLACK,
)
from glider.sysid.likelihood.candidates import Candidates, gather, saturated
from glider.sysid.likelihood.model_fit import fit_model
from glider.sysid.likelihood.task import FitResult, Task
from glider.sysid.search.subsets import (
    Members,
    Scorer,
    best_of_sizes,
    climb,
    scorer_of,
    threshold_of,
)


@dataclasses.dataclass
class Search:
    """A search in progress; it remembers all fits."""

    task: Task
    progress: Progress
    fitted: dict[frozenset[str], FitResult] = dataclasses.field(default_factory=dict)
    #: Sets whose fits stopped far behind a rival, and the cost that was too much.
    stopped: dict[frozenset[str], float] = dataclasses.field(default_factory=dict)
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

    def fit(self, model: FitResult, rival: FitResult | None = None) -> FitResult:
        """Fits a model, and the strengths of its functions, unless its set is known.

        Not to the end where it is far behind a rival; beside a worse one, or none, such
        a set is fitted once more.
        """
        key = frozenset(model.kinds)
        most = np.inf
        known = self.fitted.get(key)
        if rival is not None:
            most = self.penalized_cost(rival) - self._penalty_of(model) + CLEAR
        is_done = most <= self.stopped.get(key, np.inf)
        if known is not None and is_done and np.isfinite(known.cost):
            return known
        self._formulas = None, None, None  # For the memory.
        what = ", ".join(sorted(model.kinds)) or "the flat plate"
        self.progress(f"fitting {what}")
        if model.free_kinds:  # Strengths shape the fit.
            model = fit_model(self.task, model, 2, with_strength=True)
        if not model.free_kinds or model.cost < most:
            model = fit_model(self.task, model, with_strength=True, most=most)
        self.stopped[key] = most if model.cost > most else np.inf
        if known is not None:
            model = min(known, model, key=self.penalized_cost)
        self.fitted[key] = model
        return model

    def fit_without(self, model: FitResult, kind: str) -> FitResult:
        """Fits a model without one of its effects."""
        return self.fit(model.without(self.task, kind))

    def near(self, model: FitResult) -> Scorer | None:
        """Compares sets about a model; None where the model diverges.

        On some of many flights: what is proposed is fitted to all.
        """
        if self._near[0] is self.task and self._near[1] is model:
            return self._near[2]
        few = self.task.thinned(MANY_FLIGHTS)
        if self._formulas[0] is not model or self._formulas[1] != few.kinds:
            self._formulas = model, few.kinds, self._formulas_about(few, model)
        leading = [function.leading_only for function in few.functions.values()]
        candidates = self._formulas[2].offering(leading)
        gram = candidates.total(candidates.model.scales)
        score = None
        if np.all(np.isfinite(gram)):
            light = dataclasses.replace(candidates, task=few, flights=())
            score = scorer_of(light, gram[None], np.ones(1))
        self._near = self.task, model, score
        return score

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

    def _formulas_about(self, task: Task, model: FitResult) -> Candidates:
        """Returns the formulas about a model with noise as if they acted, `saturated`.

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

    def improved(self, model: FitResult, by_sets_only: bool = False) -> FitResult:
        """Returns the model that no move betters, or no best set of effects."""
        moves = {"best set": self._best}
        if not by_sets_only:
            moves["prune"] = self._pruned
            moves["formula of a free function"] = self._renamed
            moves["another effect"] = self._with_another

        better: FitResult | None = model
        while better:
            model = better
            for name, move in moves.items():
                self.progress(name)
                better = move(model)
                if better:
                    break

        return model

    def _best(self, model: FitResult) -> FitResult | None:
        """The best set about a model.

        Errors of the linearization look like small effects, in proportion to the gain:
        the smallest set that reaches most of it comes first.
        """
        score = self.near(model)
        if score is None:
            return None
        start = score.by_first(model.kinds)
        sizes = best_of_sizes(score)
        members = climb(score, max([climb(score, start), *sizes], key=score))
        if len(members) < MOST_EFFECTS:  # One may stand for two.
            parted = score.parted(members)
            members = climb(score, max([members, *parted], key=score))
        gained = score(members) - score(start)
        enough = score(members) - SLACK * gained
        outstanding = next((m for m in sizes if score(m) >= enough), members)
        return self.better(model, score, [outstanding, members], first=True)

    def _pruned(self, model: FitResult) -> FitResult | None:
        """The model without effects that do not reach their thresholds."""
        near = self.near(model)
        if near is None:
            return None
        lost = near.lost(near.by_first(model.kinds))
        found = model
        for kind in sorted(lost, key=lost.__getitem__):
            if lost[kind] > CLEAR:
                break
            fewer = self.fit_without(found, kind)
            if self.prefers(fewer, found):
                found = fewer

        return None if found is model else found

    def _renamed(self, model: FitResult) -> FitResult | None:
        """The model with formulas in the place of a free function that they explain.

        Formulas are names where they are worth at least as much as the free function,
        or as they are with what it adds to them.
        """
        near = self.near(model) if model.free_kinds else None
        if near is None:
            return None
        own = near.by_first(model.kinds)
        for function in model.free_kinds:
            score = near.among(set(FAMILIES[function].formulas))
            rest = tuple(member for member in own if member[0] != function)
            options = []
            for members in (rest, own):
                larger = score.larger(members)
                options.append(max(larger, key=score, default=members))
            if found := self.better(model, near, options):
                return found

        return None

    def _with_another(self, model: FitResult) -> FitResult | None:
        """The model with an effect that first order undervalues, added or exchanged."""
        score = self.near(model)
        if score is None:
            return None
        own = score.by_first(model.kinds)
        found: dict[str, Members] = {}
        for other in (*score.larger(own), *score.swapped(own)):
            kind, _ = other[-1]
            best = found.get(kind, other)
            found[kind] = max(best, other, key=score)

        least = score(own) - CLEAR
        near = [members for members in found.values() if score(members) > least]
        few = heapq.nlargest(FOLLOWED, near, key=score)
        return self.better(model, score, few)
