"""Sets of effects by their evidence: a beam with swaps, and hill climbing.

A `Scorer` compares sets in closed form, to first order about one model. `climb` and
`best_set` search by it; `near_sets` and `survey` say what else is nearly as good.

An effect acts by one of its variants: columns of the linear model, for one choice of
its starting shapes or of a function's strength.
"""

import copy
import dataclasses
import functools
from collections.abc import Callable, Collection, Iterable
from itertools import combinations
from math import log

import numpy as np

from glider.physics.effects.families import FAMILIES
from glider.sysid.constants import (
    CLEAR,
    EVIDENCE_THRESHOLD,
    FEW_FLIGHTS,
    FOLLOWED,
    HELD_OUT_THRESHOLD,
    MANY_FLIGHTS,
    MOST_EFFECTS,
    RIVAL_GAP,
)
from glider.sysid.likelihood.candidates import Candidates, gather
from glider.sysid.likelihood.held_out import HeldOutEvidence
from glider.sysid.likelihood.information import Evidence
from glider.sysid.likelihood.task import FitResult, Task

Members = tuple[tuple[str, tuple[int, ...]], ...]  # Kinds and their variants, sorted.


class Scorer:
    """Evidence of sets less a penalty for each member, cached.

    The evidence is -inf where the likeliest coefficients are not physical.
    """

    def __init__(
        self,
        candidates: Candidates,
        evidence: Evidence | HeldOutEvidence,
        penalty: Callable[[str, Collection[str]], float],
    ):
        """Takes what the sets are made of.

        Args:
            candidates: columns of the effects, about one model.
            evidence: of sets of columns.
            penalty: of a kind in a set of kinds, by their names [nats].
        """
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
        """Returns the evidence that is lost without each member, by its kind [nats].

        It is not penalized. Where the others are not physical without the member, the
        best of them are left.
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
        """Returns the scorer with only some kinds to choose from; caches are shared."""
        other = copy.copy(self)
        other.variants = {k: own for k, own in self.variants.items() if k in kinds}
        return other

    def begin(self, members: Members) -> FitResult:
        """Returns the model with the likeliest coefficients of a set, to first order.

        It is not fitted yet, and has the noise of the model that the columns are about.
        """
        task = self.candidates.task
        kinds = tuple(kind for kind, _ in members)
        columns = columns_of(members)
        # The likeliest value of each column, counted from none of its effect.
        steps = dict(zip(columns, self.evidence.step(columns), strict=True))

        model = self.candidates.model
        model = model.without(task, *(set(model.kinds) - set(kinds)))
        theta = model.theta
        functions = model.by_name
        for kind, variant in members:
            step = np.array([steps[column] for column in variant])
            own = functions.get(kind) or task.functions.get(kind)
            if own is None:
                directions = [self.candidates.directions[j] for j in variant]
                for direction in directions:
                    theta = direction.base(theta)  # The shapes come first.
                slots = [direction.slot for direction in directions]
                means, _ = task.priors(slots, theta)
                theta[slots] = np.clip(means + step, *task.bounds(slots))
                continue

            strength = own.strength
            if kind not in functions:  # It does not act yet.
                _, strength = self.candidates.columns[variant[0]]
            coordinates = np.pad(step, (0, own.count - len(step)))
            functions[kind] = dataclasses.replace(
                own, coordinates=coordinates, strength=strength
            )

        return dataclasses.replace(
            model,
            kinds=kinds,
            theta=theta,
            free=task.free(kinds),
            functions=tuple(functions.values()),
        )

    def larger(self, members: Members) -> Iterable[Members]:
        """Returns the sets with one member more, in each of its variants.

        Their evidence is computed at once, which is faster than one after the other.
        """
        have = dict(members)
        added = {}  # The columns that each set has more.
        for kind, variants in self.variants.items():
            if kind not in have:
                for variant in variants:
                    larger = tuple(sorted((*members, (kind, variant))))
                    added[larger] = variant

        new = [own for own in added if own not in self._kept]
        if new:
            more = [added[own] for own in new]
            gains = self.evidence.extended(columns_of(members), more)
            self._kept.update(zip(new, gains, strict=True))

        return list(added)

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
            rest = tuple(member for member in members if member not in pair)
            yield from self.larger(rest)


def scorer_of(candidates: Candidates, grams: np.ndarray) -> Scorer:
    """Returns the evidence of sets, penalized, to first order about a model.

    That is the gain on held-out flights of a model with errors of the forces, else the
    marginal likelihood.

    Args:
        candidates: about the model.
        grams: of flights, see `Candidates.grams`.
    """
    task = candidates.task
    if candidates.model.has_force_errors:
        held_out = HeldOutEvidence(candidates, grams)
        penalty = functools.partial(_held_out_threshold, task)
        return Scorer(candidates, held_out, penalty)

    evidence = candidates.evidence(grams.sum(axis=0))
    return Scorer(candidates, evidence, functools.partial(threshold_of, task))


def _held_out_threshold(task: Task, kind: str, kinds: Collection[str]) -> float:
    """Returns the gain that an effect must bring on held-out flights [nats].

    More for each coefficient that is not a shape, and for an effect that is uncommon.
    The others of the set, `kinds`, do not matter; see `threshold_of`.
    """
    space = task.space
    sizes = sum(slot not in space.shapes for slot in space.slots_of(kind))
    is_common = kind in space.kinds and space.kinds[kind].is_common
    cause = 0.0 if is_common else HELD_OUT_THRESHOLD["uncommon"]
    of_coefficients = HELD_OUT_THRESHOLD["coefficient"] * (sizes - 1)
    return HELD_OUT_THRESHOLD["effect"] + of_coefficients + cause


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
        own = log(len(task.vehicle.kinds)) if is_alone else EVIDENCE_THRESHOLD
    elif not FAMILIES[kind].bends.isdisjoint(kinds):
        own = log(len(FAMILIES))
    else:
        own = EVIDENCE_THRESHOLD + RIVAL_GAP

    # The more flights, the more an error that they share looks like an effect.
    return max(1.0, len(task.records) / MANY_FLIGHTS) * own


def survey(task: Task, model: FitResult) -> dict[str, float]:
    """Returns the evidence of each free function beside a model without it [nats].

    On a few flights, each function with the best of its strengths. Empty where the
    model diverges.
    """
    few = dataclasses.replace(task.thinned(FEW_FLIGHTS), kinds=())
    candidates = gather(few, model)
    gram = candidates.total(model.scales)
    if not np.all(np.isfinite(gram)):
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
    """Compares the sets that are one addition or one exchange away from a set.

    Farther away, errors of the linearization look like effects.

    Returns:
        the kinds of the set and the formulas of sets nearly as good, and of each of its
        kinds the formulas that would do as well in its place.
    """
    kinds = {kind for kind, _ in found}
    offered = set(kinds)
    alike: dict[str, set[str]] = {kind: set() for kind in kinds}
    best = score(found)
    for other in (*score.larger(found), *score.swapped(found)):
        [(kind, _)] = {*other} - {*found}
        lost = best - score(other)
        is_formula = kind not in kinds and kind not in FAMILIES
        if not is_formula or lost > CLEAR:
            continue
        offered.add(kind)
        if lost < RIVAL_GAP:
            for gone in kinds - {name for name, _ in other}:
                alike[gone].add(kind)

    return offered, alike


def columns_of(members: Members) -> list[int]:
    """Returns the columns of a set."""
    return [column for _, variant in members for column in variant]


def climb(score: Scorer, members: Members, same_size: bool = False) -> Members:
    """Climbs from a set to one that no move betters.

    Moves are a swap, a drop, an addition, and one effect in the place of two: a tilted
    frame is a turned pitch and a thrust.

    Args:
        score: evidence of sets, penalized.
        members: where it starts.
        same_size: whether only swaps are tried.
    """
    while True:
        options = [*score.swapped(members)]
        if not same_size:
            options += score.smaller(members)
            if len(members) < MOST_EFFECTS:
                options += score.larger(members)

        best = max(options, key=score, default=members)
        least = score(members) + 1e-6
        if not score(best) > least and not same_size:
            best = max(score.merged(members), key=score, default=members)
        if not score(best) > least:
            return members
        members = best


def best_of_sizes(score: Scorer) -> list[Members]:
    """Returns the best sets of one effect, of two and so on that a beam finds.

    The best sets of a size are exchanged effect by effect before they are extended. The
    beam ends where the next larger sets are clearly worse than the best smaller one.
    """
    beam: list[Members] = [()]
    found: list[Members] = []
    best: Members = ()
    for _ in range(MOST_EFFECTS):
        pool = dict.fromkeys(m for parent in beam for m in score.larger(parent))
        ranked = sorted(pool, key=score, reverse=True)[:FOLLOWED]
        if not ranked or score(ranked[0]) < score(best) - CLEAR:
            break
        reached = [climb(score, members, same_size=True) for members in ranked]
        beam = list(dict.fromkeys(reached))
        found.append(max(beam, key=score))
        best = max(best, found[-1], key=score)

    return found


def best_set(score: Scorer) -> Members:
    """Returns the best set that a beam, or a climb from nothing, finds."""
    found = [climb(score, ()), *best_of_sizes(score)]
    return climb(score, max(found, key=score))
