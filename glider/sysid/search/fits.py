"""Models with sets of effects: begun, fitted, and what they are worth."""

import dataclasses
from collections.abc import Collection, Iterable
from typing import Any

import numpy as np

from glider.progress import Progress
from glider.sysid.constants import (
    COEFFICIENT_THRESHOLD,
    EVIDENCE_THRESHOLD,
    MOST_COMPARED,
    RIVAL_GAP,
    SIMPLE_COEFFICIENT_THRESHOLD,
    SIMPLE_MOMENT,
    SIMPLE_THRESHOLD,
    THRESHOLD_FLIGHTS,
)
from glider.sysid.likelihood.blocks import BLOCKS, FittedBlock
from glider.sysid.likelihood.candidates import Candidates, Variant, gather, saturated
from glider.sysid.likelihood.model_fit import FitResult, fit_model, fit_strength
from glider.sysid.likelihood.task import Task
from glider.sysid.result import EvidenceThreshold
from glider.sysid.search.subsets import Members, Scorer


def without(task: Task, model: FitResult, *gone: str) -> FitResult:
    """Returns a model without some of its effects."""
    kinds = tuple(k for k in model.kinds if k not in gone)
    theta = model.theta.copy()
    slots = [i for kind in gone for i in task.layout.slots_of(kind)]
    theta[slots] = task.vehicle.theta[slots]
    return model.with_kinds(task, kinds, theta).without_blocks(*gone)


def bare_of(task: Task, model: FitResult) -> FitResult:
    """Returns a model without effects and blocks."""
    return without(task, dataclasses.replace(model, blocks=()), *model.kinds)


@dataclasses.dataclass(frozen=True, kw_only=True)
class FirstOrder:
    """Sets of effects compared to first order about a model."""

    candidates: Candidates  #: About the model.
    score: Scorer  #: Of sets.

    def begin(self, members: Members) -> FitResult:
        """Returns the model with the coefficients of a set, not fitted yet."""
        task, model = self.candidates.task, self.candidates.model
        kinds = tuple(kind for kind, _ in members)
        model = without(task, model, *(set(model.kinds) - set(kinds)))
        theta = model.theta
        columns = [c for _, variant in members for c in variant]
        steps = dict(zip(columns, self.score.evidence.step(columns), strict=True))
        blocks = model.by_name
        for kind, variant in members:
            step = np.array([steps[c] for c in variant])
            if kind in task.blocks:
                blocks[kind] = self._block(blocks.get(kind), kind, variant, step)
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

    def _block(
        self, acting: FittedBlock | None, kind: str, variant: Variant, step: np.ndarray
    ) -> FittedBlock:
        """A block with the coordinates of a step from nothing."""
        if acting is not None:
            return dataclasses.replace(acting, coordinates=step)
        block = self.candidates.task.blocks[kind]
        strength = self.candidates.columns[variant[0]][1]
        return FittedBlock(block=block, coordinates=strength * step, strength=strength)


@dataclasses.dataclass
class Search:
    """A search in progress; it remembers all fits."""

    task: Task
    progress: Progress
    fitted: dict[frozenset[str], FitResult] = dataclasses.field(default_factory=dict)
    alone: dict[str, float] = dataclasses.field(default_factory=dict)
    _near: tuple[Any, ...] = (None, None, None)  #: What was compared last.

    def penalized_cost(self, model: FitResult) -> float:
        """Returns a model's cost with the thresholds of its effects [nats]."""
        slots = [i for kind in model.kinds for i in self.task.layout.slots_of(kind)]
        sizes = sum(not self.task.is_shape(i) for i in slots)
        free = len(model.free_kinds)
        count, threshold = len(model.kinds) - free, threshold_of(self.task, model)
        penalty = threshold.effect * count + threshold.coefficient * (sizes - count)
        flights = len(self.task.records)
        penalty += sum(
            threshold_of_kind(flights, block_threshold(name, model.kinds))
            for name in model.free_kinds
        )
        return model.cost + model.freedom + penalty

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

    def fit(self, model: FitResult, words: str = "") -> FitResult:
        """Fits a model, and the strengths of its blocks, unless its set is known."""
        key = frozenset(model.kinds)
        if key not in self.fitted or not np.isfinite(self.fitted[key].cost):
            what = ", ".join(sorted(model.kinds)) or "the flat plate"
            self.progress(words or f"fitting {what}")
            if model.free_kinds:  # Strengths shape the fit.
                model = fit_strength(self.task, fit_model(self.task, model, 2))
            self.fitted[key] = fit_strength(self.task, fit_model(self.task, model))
        return self.fitted[key]

    def near(self, model: FitResult) -> FirstOrder | None:
        """Compares sets about a model, cached; None where the model diverges.

        On some of many flights: what is proposed is fitted to all.
        """
        if self._near[0] is self.task and self._near[1] is model:
            return self._near[2]
        few = self.task.thinned(MOST_COMPARED)
        candidates, found = gather(few, model, with_blocks=True), None
        about = saturated(candidates, 2 if np.isfinite(model.cost) else 3)
        if about.scales.is_still:
            about = dataclasses.replace(about, about=model.about)
            candidates = dataclasses.replace(candidates, model=about)
        else:
            candidates = gather(few, about, with_blocks=True)
        gram = candidates.total(about.scales)
        if np.all(np.isfinite(gram)):
            score = marginal_scorer(candidates, gram[None], np.ones(1))
            if not self.alone.keys() >= set(score.variants).intersection(few.kinds):
                self.alone = score.among(few.kinds).alone() | self.alone
            candidates = dataclasses.replace(candidates, flights=())  # They are large.
            found = FirstOrder(candidates=candidates, score=score)
        self._near = self.task, model, found
        return found

    def better(
        self,
        model: FitResult,
        near: FirstOrder,
        sets: Iterable[Members],
        first: bool = False,
    ) -> FitResult | None:
        """Returns the best of some sets, or the first, that is worth more; or None."""
        found = model
        for members in sets:
            other = self.fit(near.begin(members))
            found = other if self.prefers(other, found) else found
            if first and found is not model:
                break
        return None if found is model else found


def threshold_of(task: Task, model: FitResult) -> EvidenceThreshold:
    """Returns the evidence that each effect of a model must bring, at least."""
    effect, coefficient = EVIDENCE_THRESHOLD, COEFFICIENT_THRESHOLD
    if is_simple(model):
        effect, coefficient = SIMPLE_THRESHOLD, SIMPLE_COEFFICIENT_THRESHOLD
    effect = threshold_of_kind(len(task.records), effect)
    return EvidenceThreshold(effect=effect, coefficient=coefficient)


def marginal_scorer(
    candidates: Candidates, grams: np.ndarray, counts: np.ndarray
) -> Scorer:
    """Returns the evidence of sets on flights that count so often, less a penalty.

    A marginal likelihood penalizes the prior volume of coefficients already: about a
    simple model, a member need only be likelier than that no effect acts. Once fitted,
    sets are compared by `Search.penalized_cost`.
    """
    evidence = candidates.evidence(np.tensordot(counts, grams, 1))
    model = candidates.model
    is_fair = is_simple(model)
    base = float(np.log(len(candidates.task.kinds))) if is_fair else EVIDENCE_THRESHOLD
    blocks, flights = candidates.task.blocks, len(candidates.task.records)

    def penalty(kind: str, kinds: Collection[str]) -> float:
        own = block_threshold(kind, kinds) if kind in blocks else base
        return threshold_of_kind(flights, own)

    return Scorer(evidence, candidates.variants, penalty)


def block_threshold(name: str, kinds: Collection[str]) -> float:
    """Returns the evidence that a free function must bring in a set [nats].

    One that bends a formula of the set claims nothing new: it need only be likelier
    than that none of all acts.
    """
    bends = not BLOCKS[name].bends.isdisjoint(kinds)
    return float(np.log(len(BLOCKS))) if bends else EVIDENCE_THRESHOLD


def threshold_of_kind(flights: int, base: float) -> float:
    """Returns the evidence that an effect must bring, from that of few flights."""
    return base * max(1.0, flights / THRESHOLD_FLIGHTS)


def is_simple(model: FitResult) -> bool:
    """Whether one effect at most and air explain the flights, and nothing else."""
    if model.blocks or model.has_force_errors or len(model.kinds) > 1:
        return False
    return model.scales.moment < SIMPLE_MOMENT
