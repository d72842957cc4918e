"""Moves from one set of effects to a better one, everything refitted.

A move returns a model that is worth more, or None. It proposes sets by closed forms,
to first order about the model, and fits what it proposes. `Search.improved` makes moves
until none is found.
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
    """A search in progress; it remembers all fits.

    Attributes:
        task: flights, and the effects to try.
        progress: called with a line of text as the work goes on.
        fitted: fitted models by their kinds.
    """

    task: Task
    progress: Progress
    fitted: dict[frozenset[str], FitResult] = dataclasses.field(default_factory=dict)
    _near: tuple[Any, ...] = (None, None, None)  # What was compared last.

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
        added = own - its
        gone = its - own
        has_more_formulas = gone <= FAMILIES.keys() and added.isdisjoint(FAMILIES)
        margin = 0.0 if not added or has_more_formulas else RIVAL_GAP
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
        key = frozenset(rest.kinds)
        known = self.fitted.get(key)
        found = self.fit(rest)
        if found is known and found.cost < model.cost + CLEAR:
            again = fit_model(self.task, rest, with_strength=True)
            if again.cost + again.freedom < found.cost + found.freedom:
                self.fitted[key] = again
                return again

        return found

    def near(self, model: FitResult) -> Scorer | None:
        """Compares sets about a model; None where the model diverges.

        On some of many flights: what is proposed is fitted to all.
        """
        task, about, score = self._near
        if task is self.task and about is model:
            return score
        score = self._compare(model)
        self._near = self.task, model, score
        return score

    def _compare(self, model: FitResult) -> Scorer | None:
        """Returns the scorer of sets about a model, see `near`.

        The noise is that with all formulas acting at once. Where the air then moves,
        the flights are made linear again, with it.
        """
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
        if not np.all(np.isfinite(gram)):
            return None
        light = dataclasses.replace(candidates, flights=())
        return scorer_of(light, gram[None])

    def better(
        self, model: FitResult, near: Scorer, sets: Iterable[Members]
    ) -> FitResult | None:
        """Fits sets about a model; returns the best that is worth more, or None.

        Args:
            model: that must be bettered.
            near: compares sets about it, see `near`.
            sets: to fit.
        """
        found = None
        cost = self.penalized_cost(model)
        for members in sets:
            other = self.fit(near.begin(members))
            its = self.penalized_cost(other)
            if its < cost and self.prefers(other, model):
                found, cost = other, its

        return found

    def improved(self, model: FitResult, by_sets_only: bool = False) -> FitResult:
        """Returns the model that no move betters.

        With `by_sets_only` the best set of effects is the only move.
        """
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
        found = [climb(score, start), *sizes]
        best = climb(score, max(found, key=score))

        gained = score(best) - score(start)
        enough = score(best) - SLACK * gained
        smallest = next((own for own in sizes if score(own) >= enough), best)
        better = self.better(model, score, [smallest])
        return better or self.better(model, score, [best])

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

            found = self.better(model, score, options)
            if found:
                return found

        return None

    def _with_another(self, model: FitResult, score: Scorer) -> FitResult | None:
        """The model with an effect that first order undervalues, added or exchanged.

        The few best of the sets that may be better are fitted, one for each effect.
        """
        own = score.by_first(model.kinds)
        others = [*score.larger(own), *score.swapped(own)]
        best_with: dict[str, Members] = {}  # Of the sets with each effect the best.
        for other in others:
            [(kind, _)] = {*other} - {*own}
            best_with[kind] = max(best_with.get(kind, other), other, key=score)

        # First order undervalues an effect by no more than CLEAR.
        least = score(own) - CLEAR
        near = [members for members in best_with.values() if score(members) > least]
        few = heapq.nlargest(FOLLOWED, near, key=score)
        return self.better(model, score, few)
