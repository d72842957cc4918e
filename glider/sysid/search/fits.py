"""Models with sets of effects: begun, fitted, and what they are worth."""

import dataclasses
from collections.abc import Collection, Iterable
from math import log
from typing import Any

import numpy as np

from glider.physics.effects.families import BLOCKS
from glider.progress import Progress
from glider.sysid.constants import CLEAR, EVIDENCE_THRESHOLD, MANY_FLIGHTS, RIVAL_GAP
from glider.sysid.likelihood.candidates import Candidates, gather, saturated
from glider.sysid.likelihood.fit_result import FitResult
from glider.sysid.likelihood.model_fit import fit_model
from glider.sysid.likelihood.task import Task
from glider.sysid.search.subsets import Members, Penalty, Scorer, SetEvidence


def without(task: Task, model: FitResult, *gone: str) -> FitResult:
    """Returns a model without some of its effects."""
    kinds = tuple(k for k in model.kinds if k not in gone)
    theta = model.theta.copy()
    slots = [i for kind in gone for i in task.layout.slots_of(kind)]
    theta[slots] = task.vehicle.theta[slots]
    blocks = tuple(own for own in model.blocks if own.name not in gone)
    return dataclasses.replace(model.with_kinds(task, kinds, theta), blocks=blocks)


class FirstOrder(Scorer):
    """Scorer of sets of effects, to first order about the model of candidates."""

    def __init__(self, candidates: Candidates, evidence: SetEvidence, penalty: Penalty):
        """Takes the evidence of the candidates' columns, without their flights."""
        super().__init__(evidence, candidates.variants, penalty)
        # They are large.
        self.candidates = dataclasses.replace(candidates, flights=())

    def begin(self, members: Members) -> FitResult:
        """Returns the model with the coefficients of a set, not fitted yet."""
        task, model = self.candidates.task, self.candidates.model
        kinds = tuple(kind for kind, _ in members)
        model = without(task, model, *(set(model.kinds) - set(kinds)))
        theta = model.theta
        columns = [c for _, variant in members for c in variant]
        steps = dict(zip(columns, self.evidence.step(columns), strict=True))
        blocks = model.by_name
        for kind, variant in members:
            step = np.array([steps[c] for c in variant])
            if own := blocks.get(kind) or task.blocks.get(kind):
                strength = own.strength  # That of one that acts.
                if kind not in blocks:
                    strength = self.candidates.columns[variant[0]][1]
                step = np.pad(step, (0, own.count - len(step)))
                blocks[kind] = dataclasses.replace(
                    own, coordinates=step, strength=strength
                )
                continue
            directions = [self.candidates.directions[c] for c in variant]
            for slot, shape in (pair for d in directions for pair in d.shapes):
                theta[slot] = shape
            slots = [d.slot for d in directions]
            values = task.priors(slots, theta)[0] + step
            theta[slots] = np.clip(values, *task.bounds(slots))
        return dataclasses.replace(
            model, kinds=kinds, free=task.free(kinds), blocks=tuple(blocks.values())
        )


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
        return self.fit(without(self.task, model, kind), f"is {kind} needed?")

    def near(self, model: FitResult) -> FirstOrder | None:
        """Compares sets about a model; None where the model diverges."""
        if self._near[0] is not self.task or self._near[1] is not model:
            offered = self.task.offered
            self._near = self.task, model, self.compare(model, offered)
        return self._near[2]

    def compare(self, model: FitResult, kinds: Collection[str]) -> FirstOrder | None:
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
        score = marginal_scorer(candidates, gram[None], np.ones(1))
        if not self.alone.keys() >= set(score.variants).intersection(few.kinds):
            self.alone = score.among(few.kinds).alone() | self.alone
        return score

    def better(
        self,
        model: FitResult,
        near: FirstOrder,
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


def marginal_scorer(
    candidates: Candidates, grams: np.ndarray, counts: np.ndarray
) -> FirstOrder:
    """Returns the evidence of sets on flights that count so often, penalized."""
    evidence = candidates.evidence(np.tensordot(counts, grams, 1))
    return FirstOrder(candidates, evidence, penalty_in(candidates.task))


def penalty_in(task: Task) -> Penalty:
    """Returns the evidence that each effect of a set must bring.

    A marginal likelihood penalizes the prior volume of coefficients already. The only
    effect of a set need but be likelier than that none of all acts. Others may stand in
    for errors of its formula, and must bring more, with what the first was spared. A
    free function that bends a formula of the set claims nothing new, and need only be
    likelier than that none of them acts; any other claims that no formula will do,
    which is its rival.
    """
    more = max(1.0, len(task.records) / MANY_FLIGHTS)

    def penalty(kind: str, kinds: Collection[str]) -> float:
        if kind not in BLOCKS:
            is_alone = len(kinds) <= 1
            own = log(len(task.vehicle.kinds)) if is_alone else EVIDENCE_THRESHOLD
        elif not BLOCKS[kind].bends.isdisjoint(kinds):
            own = log(len(BLOCKS))
        else:
            own = EVIDENCE_THRESHOLD + RIVAL_GAP
        return more * own

    return penalty
