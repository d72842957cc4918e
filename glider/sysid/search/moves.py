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
from glider.sysid.constants import CLEAR, FOLLOWED, MANY_FLIGHTS, RIVAL_GAP, SLACK
from glider.sysid.likelihood.candidates import gather, saturated
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
    _near: tuple[Any, ...] = (None, None, None)  #: What was compared last.

    def thinned(self, count: int) -> "Search":
        """Returns the search on at most `count` flights, with the fits if on all."""
        task = self.task.thinned(count)
        is_whole = len(task.records) == len(self.task.records)
        return Search(task, self.progress, self.fitted if is_whole else {})

    def penalized_cost(self, model: FitResult) -> float:
        """Returns a model's cost with the thresholds of its effects [nats]."""
        kinds = model.kinds
        thresholds = sum(threshold_of(self.task, kind, kinds) for kind in kinds)
        return model.cost + model.freedom + thresholds

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

    def fit(self, model: FitResult) -> FitResult:
        """Fits a model, and the strengths of its functions, unless its set is known.

        One that diverged is fitted once more, from elsewhere.
        """
        key = frozenset(model.kinds)
        known = self.fitted.get(key)
        if known is not None and np.isfinite(known.cost):
            return known
        what = ", ".join(sorted(model.kinds)) or "the flat plate"
        self.progress(f"fitting {what}")
        if model.free_kinds:  # Strengths shape the fit.
            model = fit_model(self.task, model, 2, with_strength=True)
        self.fitted[key] = fit_model(self.task, model, with_strength=True)
        return self.fitted[key]

    def fit_without(self, model: FitResult, kind: str) -> FitResult:
        """Fits a model without one of its effects.

        A set that was fitted before is fitted again from this model if it lacks little:
        it may have ended at a worse minimum, which the effect has only led out of.
        """
        rest = model.without(self.task, kind)
        known = self.fitted.get(frozenset(rest.kinds))
        found = self.fit(rest)
        if found is known and found.cost < model.cost + CLEAR:
            again = fit_model(self.task, rest, with_strength=True)
            if again.cost + again.freedom < found.cost + found.freedom:
                self.fitted[frozenset(rest.kinds)] = found = again

        return found

    def near(self, model: FitResult) -> Scorer | None:
        """Compares sets about a model; None where the model diverges.

        On some of many flights: what is proposed is fitted to all.
        """
        if self._near[0] is self.task and self._near[1] is model:
            return self._near[2]
        few = self.task.thinned(MANY_FLIGHTS)
        candidates = gather(few, model)
        about = saturated(candidates, 2 if np.isfinite(model.cost) else 3)
        if about.scales.is_still:
            about = dataclasses.replace(about, about=model.about)
            candidates = dataclasses.replace(candidates, model=about)
        else:
            del candidates  # Before there are others.
            candidates = gather(few, about)

        gram = candidates.total(about.scales)
        score = None
        if np.all(np.isfinite(gram)):
            light = dataclasses.replace(candidates, flights=())
            score = scorer_of(light, gram[None])

        self._near = self.task, model, score
        return score

    def better(
        self, model: FitResult, near: Scorer, sets: Iterable[Members]
    ) -> FitResult | None:
        """Returns the best of some sets that are worth more; or None."""
        found = model
        for members in sets:
            other = self.fit(near.begin(members))
            is_best = self.penalized_cost(other) < self.penalized_cost(found)
            found = other if is_best and self.prefers(other, model) else found

        return None if found is model else found

    def improved(self, model: FitResult, by_sets_only: bool = False) -> FitResult:
        """Returns the model that no move betters, or no best set of effects."""
        moves = {"best set": self._best}
        if not by_sets_only:
            moves["formula of a free function"] = self._renamed
            moves["another effect"] = self._with_another

        better: FitResult | None = model
        while better:
            model = better
            score = self.near(model)
            if score is None:
                return model
            for name, move in moves.items():
                self.progress(name)
                better = move(model, score)
                if better:
                    break

        return model

    def _best(self, model: FitResult, score: Scorer) -> FitResult | None:
        """The best set about a model.

        Errors of the linearization look like small effects, in proportion to the gain:
        the smallest set that reaches most of it comes first.
        """
        start = score.by_first(model.kinds)
        sizes = best_of_sizes(score)
        members = climb(score, max([climb(score, start), *sizes], key=score))
        gained = score(members) - score(start)
        enough = score(members) - SLACK * gained
        outstanding = next((m for m in sizes if score(m) >= enough), members)
        found = self.better(model, score, [outstanding])
        return found or self.better(model, score, [members])

    def _renamed(self, model: FitResult, score: Scorer) -> FitResult | None:
        """The model with formulas in the place of a free function that they explain.

        Formulas are names where they are worth at least as much as the free function,
        or as they are with what it adds to them.
        """
        own = score.by_first(model.kinds)
        for function in model.free_kinds:
            formulas = score.among(set(FAMILIES[function].formulas))
            rest = tuple(member for member in own if member[0] != function)
            options = [
                max(formulas.larger(members), key=score, default=members)
                for members in (rest, own)
            ]

            if found := self.better(model, score, options):
                return found

        return None

    def _with_another(self, model: FitResult, score: Scorer) -> FitResult | None:
        """The model with an effect that first order undervalues, added or exchanged."""
        own = score.by_first(model.kinds)
        found: dict[str, Members] = {}
        for other in (*score.larger(own), *score.swapped(own)):
            [(kind, _)] = {*other} - {*own}
            best = found.get(kind, other)
            found[kind] = max(best, other, key=score)

        least = score(own) - CLEAR
        near = [members for members in found.values() if score(members) > least]
        few = heapq.nlargest(FOLLOWED, near, key=score)
        return self.better(model, score, few)
