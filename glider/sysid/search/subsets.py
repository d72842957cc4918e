"""Sets of effects by their evidence: a beam with swaps, and hill climbing."""

import copy
import dataclasses
import functools
from collections.abc import Callable, Collection, Iterable
from itertools import combinations
from math import log

import numpy as np

from glider.physics.effects.families import FAMILIES
from glider.sysid import constants
from glider.sysid.likelihood.candidates import Candidates, gather
from glider.sysid.likelihood.held_out import HeldOutEvidence
from glider.sysid.likelihood.information import Evidence
from glider.sysid.likelihood.task import FitResult, Task

# Kinds, and the columns they act by, sorted.
Members = tuple[tuple[str, tuple[int, ...]], ...]

_HELD_OUT = constants.HELD_OUT_THRESHOLD


class Scorer:
    """Evidence of sets less a penalty for each member, cached."""

    def __init__(
        self,
        candidates: Candidates,
        evidence: Evidence | HeldOutEvidence,
        penalty: Callable[[str, Collection[str]], float],
    ):
        """Takes the columns' evidence and the penalty of a kind in a set [nats]."""
        self.candidates = candidates
        self.variants = candidates.variants
        self.evidence = evidence
        self.penalty = penalty
        self._kept = dict[Members, float]()
        self._scores = dict[Members, float]()

    def __call__(self, members: Members) -> float:
        """Returns the evidence of a set less its penalty [nats]."""
        if members not in self._scores:
            kinds = [kind for kind, _ in members]
            penalties = sum(self.penalty(kind, kinds) for kind in kinds)
            self._scores[members] = self.gain(members) - penalties

        return self._scores[members]

    def gain(self, members: Members) -> float:
        """Returns the evidence of a set without its penalty [nats]."""
        if members not in self._kept:
            [self._kept[members]] = self.evidence.extended(columns_of(members), [()])
        return self._kept[members]

    def lost(self, members: Members) -> dict[str, float]:
        """Returns the loss without each member, without its penalty [nats].

        Where the others are not physical without it, the best of them are left.
        """
        found = {}
        for (kind, _), others in zip(members, self.smaller(members), strict=True):
            left = others
            if not np.isfinite(self.gain(others)):
                left = climb(self.among([name for name, _ in others]), ())
            found[kind] = self.gain(members) - self.gain(left)

        return found

    def by_first(self, kinds: Iterable[str]) -> Members:
        """Returns the set of some kinds, each by its first variant."""
        return tuple((kind, self.variants[kind][0]) for kind in sorted(kinds))

    def among(self, kinds: Collection[str]) -> "Scorer":
        """Returns the scorer with only some kinds to choose from."""
        other = copy.copy(self)
        other.variants = {k: own for k, own in self.variants.items() if k in kinds}
        return other

    def begin(self, members: Members) -> FitResult:
        """Returns the model with the coefficients of a set, not fitted yet."""
        task = self.candidates.task
        model = self.candidates.model
        kinds = tuple(kind for kind, _ in members)
        model = model.without(task, *(set(model.kinds) - set(kinds)))
        theta = model.theta
        columns = columns_of(members)
        steps = dict(zip(columns, self.evidence.step(columns), strict=True))
        functions = model.by_name
        for kind, variant in members:
            step = np.array([steps[c] for c in variant])
            if own := functions.get(kind) or task.functions.get(kind):
                strength = own.strength  # That of one that acts.
                if kind not in functions:
                    strength = self.candidates.columns[variant[0]][1]
                step = np.pad(step, (0, own.count - len(step)))
                functions[kind] = dataclasses.replace(
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
            model,
            kinds=kinds,
            free=task.free(kinds),
            functions=tuple(functions.values()),
        )

    def larger(self, members: Members) -> Iterable[Members]:
        """Returns the sets with one member more."""
        have = dict(members)
        sets = {
            tuple(sorted((*members, (kind, variant)))): variant
            for kind, variants in self.variants.items()
            for variant in variants
            if kind not in have
        }

        if new := [own for own in sets if own not in self._kept]:
            more = [sets[own] for own in new]
            gains = self.evidence.extended(columns_of(members), more)
            self._kept.update(zip(new, gains, strict=True))

        return list(sets)

    def smaller(self, members: Members) -> Iterable[Members]:
        """Yields the sets with one member less."""
        for i in range(len(members)):
            yield (*members[:i], *members[i + 1 :])

    def swapped(self, members: Members) -> Iterable[Members]:
        """Yields the sets with one member exchanged."""
        for rest in self.smaller(members):
            for other in self.larger(rest):
                if other != members:
                    yield other

    def merged(self, members: Members) -> Iterable[Members]:
        """Yields the sets with two members exchanged for another one."""
        for pair in combinations(members, 2):
            yield from self.larger(tuple(m for m in members if m not in pair))


def scorer_of(candidates: Candidates, grams: np.ndarray) -> Scorer:
    """Returns the evidence of sets on flights of such information, penalized.

    To first order about the candidates' model: the gain on held-out flights of one with
    errors of the forces, else the marginal likelihood.
    """
    task = candidates.task
    if candidates.model.has_force_errors:
        held_out = HeldOutEvidence(candidates, grams)
        return Scorer(
            candidates, held_out, functools.partial(_held_out_threshold, task)
        )

    evidence = candidates.evidence(grams.sum(axis=0))
    return Scorer(candidates, evidence, functools.partial(threshold_of, task))


def _held_out_threshold(task: Task, kind: str, kinds: Collection[str]) -> float:
    """Returns the gain that an effect must bring on held-out flights [nats]."""
    slots = task.space.slots_of(kind)
    sizes = sum(i not in task.space.shapes for i in slots)
    is_common = kind in task.space.kinds and task.space.kinds[kind].is_common
    cause = 0.0 if is_common else _HELD_OUT["uncommon"]
    return _HELD_OUT["effect"] + _HELD_OUT["coefficient"] * (sizes - 1) + cause


def threshold_of(task: Task, kind: str, kinds: Collection[str]) -> float:
    """Returns the evidence that an effect of a set must bring [nats].

    A marginal likelihood penalizes the prior volume of coefficients already. The only
    effect of a set need but be likelier than that none of all acts. Others may stand in
    for errors of its formula, and must bring more, with what the first was spared. A
    free function that bends a formula of the set claims nothing new, and need only be
    likelier than that none of them acts; any other claims that no formula will do,
    which is its rival.
    """
    if kind not in FAMILIES:
        is_alone = len(kinds) <= 1
        own = log(len(task.vehicle.kinds)) if is_alone else constants.EVIDENCE_THRESHOLD
    elif not FAMILIES[kind].bends.isdisjoint(kinds):
        own = log(len(FAMILIES))
    else:
        own = constants.EVIDENCE_THRESHOLD + constants.RIVAL_GAP

    return max(1.0, len(task.records) / constants.MANY_FLIGHTS) * own


def survey(task: Task, model: FitResult) -> dict[str, float]:
    """Returns the evidence of each function beside a model without it [nats].

    On a few flights. Empty where the model diverges.
    """
    few = dataclasses.replace(task.thinned(constants.FEW_FLIGHTS), kinds=())
    candidates = gather(few, model)
    gram = candidates.total(model.scales)
    if not np.all(np.isfinite(gram)):  # It diverges.
        return {}
    evidence = candidates.evidence(gram)
    score = Scorer(candidates, evidence, functools.partial(threshold_of, task))
    members = score.by_first(model.kinds)
    gains: dict[str, float] = {}
    for more in score.larger(members):
        [(name, _)] = {*more} - {*members}
        gain = score.gain(more) - score.gain(members)
        gains[name] = max(gains.get(name, gain), gain)

    return gains


def near_sets(score: Scorer, found: Members) -> tuple[set[str], dict[str, set[str]]]:
    """Returns formulas of sets near one, and those as good in place of each of its own.

    Farther away, errors of the linearization look like effects.
    """
    kinds = {kind for kind, _ in found}
    offered = set(kinds)
    alike: dict[str, set[str]] = {kind: set() for kind in kinds}
    best = score(found)
    for other in (*score.larger(found), *score.swapped(found)):
        [(kind, _)] = {*other} - {*found}
        lost = best - score(other)
        if kind in kinds or kind in FAMILIES or lost > constants.CLEAR:
            continue
        offered.add(kind)
        if lost < constants.RIVAL_GAP:
            for gone in kinds - {name for name, _ in other}:
                alike[gone].add(kind)

    return offered, alike


def columns_of(members: Members) -> list[int]:
    """Returns the columns of a set."""
    return [column for _, variant in members for column in variant]


def climb(score: Scorer, members: Members, same_size: bool = False) -> Members:
    """Returns the set that no swap betters, and no drop or addition where it may.

    Nor one effect in the place of two: a tilted frame is a turned pitch and a thrust.
    """
    while True:
        options = [*score.swapped(members)]
        if not same_size:
            options += score.smaller(members)
        if not same_size and len(members) < constants.MOST_EFFECTS:
            options += score.larger(members)
        best = max(options, key=score, default=members)
        if not same_size and not score(best) > score(members) + 1e-6:
            best = max(score.merged(members), key=score, default=members)
        if not score(best) > score(members) + 1e-6:
            return members
        members = best


def best_of_sizes(score: Scorer) -> list[Members]:
    """Returns the best sets of one effect, of two and so on that a beam finds."""
    beam: list[Members] = [()]
    found: list[Members] = []
    best: Members = ()
    for _ in range(constants.MOST_EFFECTS):
        pool = dict.fromkeys(m for parent in beam for m in score.larger(parent))
        ranked = sorted(pool, key=score, reverse=True)[: constants.FOLLOWED]
        if not ranked or score(ranked[0]) < score(best) - constants.CLEAR:
            break
        reached = [climb(score, m, same_size=True) for m in ranked]
        beam = list(dict.fromkeys(reached))
        found.append(max(beam, key=score))
        best = max(best, found[-1], key=score)

    return found


def best_set(score: Scorer) -> Members:
    """Returns the best set that a beam, or a climb from nothing, finds."""
    return climb(score, max([climb(score, ()), *best_of_sizes(score)], key=score))
