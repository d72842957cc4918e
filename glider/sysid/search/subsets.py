"""Sets of effects by their evidence: a beam with swaps, and hill climbing."""

import heapq
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from itertools import combinations
from typing import Protocol

import numpy as np

from glider.sysid.constants import CLEAR, FOLLOWED, MOST_EFFECTS
from glider.sysid.likelihood.candidates import Member, Variant
from glider.sysid.report import Combination

Members = tuple[Member, ...]
Penalty = Callable[[str, Collection[str]], float]
"""Penalty of a kind in a set of kinds [nats]."""


class SetEvidence(Protocol):
    """How much better a set of columns explains the flights than none."""

    def extended(
        self, columns: Sequence[int], more: Sequence[Sequence[int]]
    ) -> list[float]:
        """Returns the gain of columns with each of several others [nats].

        It is minus infinity where coefficients are not physical.
        """

    def step(self, columns: Sequence[int]) -> np.ndarray:
        """Returns the columns' coefficients, counted from zero."""


class Scorer:
    """Evidence of sets less a penalty for each member, cached."""

    def __init__(
        self,
        evidence: SetEvidence,
        variants: Mapping[str, Sequence[Variant]],
        penalty: Penalty,
    ):
        """Takes the penalty of a member [nats]."""
        self.evidence, self.variants, self.penalty = evidence, variants, penalty
        self._kept: dict[frozenset[Member], float] = {}
        self._scores: dict[frozenset[Member], float] = {}

    def __call__(self, members: Members) -> float:
        """Returns the evidence of a set less its penalty [nats]."""
        key = frozenset(members)
        if key not in self._scores:
            kinds = [kind for kind, _ in members]
            penalties = sum(self.penalty(kind, kinds) for kind in kinds)
            self._scores[key] = self.gain(members) - penalties
        return self._scores[key]

    def gain(self, members: Members) -> float:
        """Returns the evidence of a set without its penalty [nats]."""
        key = frozenset(members)
        if key not in self._kept:
            [self._kept[key]] = self.evidence.extended(_columns_of(members), [()])
        return self._kept[key]

    def alone(self) -> dict[str, float]:
        """Returns the gain of each kind alone, without its penalty [nats]."""
        variants = self.variants.items()
        return {kind: max(self.evidence.extended((), own)) for kind, own in variants}

    def lost(self, members: Members) -> dict[str, float]:
        """Returns the loss without each member, without its penalty [nats]."""
        return {
            kind: self.gain(members) - self.gain(fewer)
            for (kind, _), fewer in zip(members, self.smaller(members), strict=True)
        }

    def ranked(self) -> tuple[Combination, ...]:
        """Returns the kinds of all sets that were scored, best first."""
        best: dict[tuple[str, ...], float] = {}
        for members in self._kept:
            kinds = tuple(sorted(kind for kind, _ in members))
            best[kinds] = max(best.get(kinds, -np.inf), self(tuple(members)))
        return ranked(best)

    def by_first(self, kinds: Iterable[str]) -> Members:
        """Returns the set of some kinds, each by its first variant."""
        return tuple((kind, self.variants[kind][0]) for kind in kinds)

    def among(self, kinds: Collection[str]) -> "Scorer":
        """Returns the scorer with only some kinds to choose from."""
        few = {kind: own for kind, own in self.variants.items() if kind in kinds}
        other = Scorer(self.evidence, few, self.penalty)
        other._kept = self._kept
        return other

    def larger(self, members: Members) -> Iterable[Members]:
        """Returns the sets with one member more."""
        have = dict(members)
        sets = [
            (*members, (kind, variant))
            for kind, variants in self.variants.items()
            for variant in variants
            if kind not in have
        ]
        new = [own for own in sets if frozenset(own) not in self._kept]
        if new:
            more = [variant for *_, (_, variant) in new]
            gains = self.evidence.extended(_columns_of(members), more)
            self._kept.update(zip(map(frozenset, new), gains, strict=True))
        return sets

    def smaller(self, members: Members) -> Iterable[Members]:
        """Yields the sets with one member less."""
        for i in range(len(members)):
            yield (*members[:i], *members[i + 1 :])

    def swapped(self, members: Members) -> Iterable[Members]:
        """Yields the sets with one member exchanged."""
        for rest in self.smaller(members):
            for other in self.larger(rest):
                if frozenset(other) != frozenset(members):
                    yield other

    def merged(self, members: Members) -> Iterable[Members]:
        """Yields the sets with two members exchanged for another one."""
        for pair in combinations(members, 2):
            yield from self.larger(tuple(m for m in members if m not in pair))

    def parted(self, members: Members) -> Iterable[Members]:
        """Yields sets with one member exchanged for two: one of the best, and any."""
        own = frozenset(members)
        for rest in self.smaller(members):
            others = (m for m in self.larger(rest) if frozenset(m) != own)
            for other in heapq.nlargest(FOLLOWED, others, key=self):
                yield from self.larger(other)


def _columns_of(members: Members) -> list[int]:
    """Returns the columns of a set."""
    return [column for _, variant in members for column in variant]


def ranked(gains: Mapping[tuple[str, ...], float]) -> tuple[Combination, ...]:
    """Returns sets by their gains [nats], best first, but for those that diverge."""
    found = [Combination(*own) for own in gains.items() if own[0] and own[1] > -np.inf]
    return tuple(sorted(found, key=lambda own: -own.evidence))


def climb(score: Scorer, members: Members, same_size: bool = False) -> Members:
    """Returns the set that no swap betters, and no drop or addition where it may.

    Nor one effect in the place of two: a tilted frame is a turned pitch and a thrust.
    """
    while True:
        options = [*score.swapped(members)]
        if not same_size:
            options += score.smaller(members)
        if not same_size and len(members) < MOST_EFFECTS:
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
    for _ in range(MOST_EFFECTS):
        pool = {frozenset(m): m for parent in beam for m in score.larger(parent)}
        ranked = sorted(pool.values(), key=score, reverse=True)[:FOLLOWED]
        if not ranked or score(ranked[0]) < score(best) - CLEAR:
            break
        reached = [climb(score, m, same_size=True) for m in ranked]
        beam = list({frozenset(m): m for m in reached}.values())
        found.append(max(beam, key=score))
        best = max(best, found[-1], key=score)
    return found


def best_set(score: Scorer) -> Members:
    """Returns the best set that a beam, or a climb from nothing, finds."""
    return climb(score, max([climb(score, ()), *best_of_sizes(score)], key=score))
