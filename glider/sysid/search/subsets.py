"""Sets of effects by their evidence: a beam with swaps, and hill climbing."""

from collections.abc import Iterable, Mapping, Sequence

from glider.sysid.likelihood.candidates import Member, Variant
from glider.sysid.likelihood.evidence import Evidence

MOST_EFFECTS = 8
"""Effects of a set at most."""

BEAM = 4
"""Sets that each round goes on from."""

_HOPELESS = 30.0
"""Loss below the best set from which on larger sets are not looked at [nats]."""

Members = tuple[Member, ...]


class Scorer:
    """Evidence of sets less a price for each member; what was asked once is kept."""

    def __init__(
        self,
        evidence: Evidence,
        variants: Mapping[str, Sequence[Variant]],
        price: float,
    ):
        """Takes the price of a member [nats]."""
        self.evidence, self.variants, self.price = evidence, variants, price
        self._kept: dict[frozenset[Member], float] = {}

    def __call__(self, members: Members) -> float:
        """Returns the evidence of a set less its price [nats]."""
        key = frozenset(members)
        if key not in self._kept:
            columns = [c for _, variant in members for c in variant]
            value = self.evidence.log_marginal(columns)
            self._kept[key] = value - self.price * len(members)
        return self._kept[key]

    def larger(self, members: Members) -> Iterable[Members]:
        """Yields the sets with one member more."""
        have = {kind for kind, _ in members}
        for kind, variants in self.variants.items():
            if kind not in have:
                for variant in variants:
                    yield (*members, (kind, variant))

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


def climb(score: Scorer, members: Members, same_size: bool = False) -> Members:
    """Returns the set that no swap betters, and no drop or addition where it may."""
    while True:
        options = [*score.swapped(members)]
        if not same_size:
            options += score.smaller(members)
        if not same_size and len(members) < MOST_EFFECTS:
            options += score.larger(members)
        if not options:
            return members
        best = max(options, key=score)
        if not score(best) > score(members) + 1e-6:
            return members
        members = best


def best_set(score: Scorer, start: Members = ()) -> Members:
    """Returns the best set found by a beam from nothing and a climb from a start.

    The beam's sets are swapped only: one that dropped members would be back at a size
    that the beam has left, though two members may hide what a third one shows.
    """
    found = [climb(score, start)]
    beam: list[Members] = [()]
    best = max(found, key=score)
    if score(()) > score(best):
        best = ()
    for _ in range(MOST_EFFECTS):
        pool = {frozenset(m): m for parent in beam for m in score.larger(parent)}
        ranked = sorted(pool.values(), key=score, reverse=True)[:BEAM]
        if not ranked:
            break
        reached = [climb(score, m, same_size=True) for m in ranked]
        beam = list({frozenset(m): m for m in reached}.values())
        top = max(beam, key=score)
        if score(top) > score(best) + 1e-6:
            best = top
        elif score(ranked[0]) < score(best) - _HOPELESS:
            break
    return climb(score, best)
