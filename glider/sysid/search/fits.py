"""Models with sets of effects: begun, fitted, and what they are worth."""

import dataclasses
from collections.abc import Collection, Iterable
from typing import Any

import numpy as np

from glider.physics.effects.families import BLOCKS
from glider.progress import Progress
from glider.sysid.constants import CLEAR, MANY_FLIGHTS, RIVAL_GAP
from glider.sysid.likelihood.candidates import gather, saturated
from glider.sysid.likelihood.model_fit import fit_model
from glider.sysid.likelihood.task import FitResult, Task
from glider.sysid.search.subsets import Members, Scorer, penalty_in, scorer_of


@dataclasses.dataclass
class Search:
    """A search in progress; it remembers all fits."""

    task: Task
    progress: Progress
    fitted: dict[frozenset[str], FitResult] = dataclasses.field(default_factory=dict)
    #: Sets whose fits stopped far behind a rival, and the cost that was too much.
    stopped: dict[frozenset[str], float] = dataclasses.field(default_factory=dict)
    alone: dict[str, float] = dataclasses.field(default_factory=dict)
    found_by: dict[str, str] = dataclasses.field(default_factory=dict)  #: Move by kind.
    #: Effects whose shapes were searched again, and the sets in which they were.
    reshaped: set[tuple[str, frozenset[str]]] = dataclasses.field(default_factory=set)
    _near: tuple[Any, ...] = (None, None, None)  #: What was compared last.

    @property
    def finished(self) -> list[FitResult]:
        """All fits but those that stopped far behind a rival."""
        limits = self.stopped.get
        return [m for key, m in self.fitted.items() if np.isinf(limits(key, np.inf))]

    def penalized_cost(self, model: FitResult) -> float:
        """Returns a model's cost with the thresholds of its effects [nats]."""
        return model.cost + model.freedom + self._penalty_of(model)

    def _penalty_of(self, model: FitResult) -> float:
        """Returns the thresholds of a model's effects [nats]."""
        penalty = penalty_in(self.task)
        return sum(penalty(kind, model.kinds) for kind in model.kinds)

    def prefers(self, model: FitResult, other: FitResult) -> bool:
        """Whether a model is worth more than another.

        Clearly so, unless it has some of the other's effects, or formulas beside them
        or in the place of free functions, which their thresholds are for.
        """
        own, its = set(model.kinds), set(other.kinds)
        is_simpler = own <= its
        is_named = its - own <= BLOCKS.keys() and not (own - its) & BLOCKS.keys()
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
        """Fits a model, and the strengths of its blocks, unless its set is known.

        Not to the end where it is far behind a rival; beside a worse one, or none, such
        a set is fitted once more. A known set is fitted again from another start if
        asked; that fit is kept where it is clearly better.
        """
        key, most = frozenset(model.kinds), np.inf
        known = self.fitted.get(key)
        if rival is not None:
            most = self.penalized_cost(rival) - self._penalty_of(model) + CLEAR
        is_done = most <= self.stopped.get(key, np.inf)
        if known is not None and is_done and np.isfinite(known.cost) and not again:
            return known
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
        leading = [block.leading_only for block in few.blocks.values()]
        candidates = gather(few, model, leading)
        about = saturated(candidates, 2 if np.isfinite(model.cost) else 3)
        if about.scales.is_still:
            about = dataclasses.replace(about, about=model.about)
            candidates = dataclasses.replace(candidates, model=about)
        else:
            candidates = gather(few, about, leading)
        gram = candidates.total(about.scales)
        if not np.all(np.isfinite(gram)):
            return None
        light = dataclasses.replace(candidates, flights=())
        score = scorer_of(light, gram[None], np.ones(1))
        if not self.alone.keys() >= set(score.variants).intersection(few.kinds):
            self.alone = score.among(few.kinds).alone() | self.alone
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
