"""The search finds the set that trying all of them would find."""

import itertools
import types

import numpy as np
import pytest

from glider.sysid.constants import EVIDENCE_THRESHOLD as EVIDENCE
from glider.sysid.constants import MOST_EFFECTS
from glider.sysid.likelihood.information import Evidence, Prior
from glider.sysid.search.subsets import (
    Scorer,
    best_of_sizes,
    best_set,
    climb,
    threshold_of,
)
from tests.helpers.searches import gain_of

EVIDENCE_THRESHOLD = 3.0


def offering(variants):
    return types.SimpleNamespace(variants=variants)


def scorer(table, variants, price=EVIDENCE_THRESHOLD):
    count = table.shape[1] - 1
    prior = Prior(
        mean=np.zeros(count),
        precision=np.full(count, 0.01),
        lower=np.full(count, -np.inf),
        upper=np.full(count, np.inf),
    )
    evidence = Evidence(gram=table.T @ table, at=np.arange(count), prior=prior)
    return Scorer(offering(variants), evidence, lambda kind, kinds: price)


@pytest.fixture
def decoyed():
    """Two true effects, and one that looks like their sum."""
    rng = np.random.default_rng(1)
    x = rng.normal(size=(200, 4))
    x[:, 2] = x[:, 0] + x[:, 1] + 0.3 * rng.normal(size=200)
    y = x[:, 0] + x[:, 1] + 0.5 * rng.normal(size=200)
    table = np.column_stack([x, y])
    return scorer(table, {"a": [(0,)], "b": [(1,)], "decoy": [(2,)], "none": [(3,)]})


def kinds_of(members):
    return {kind for kind, _ in members}


def test_a_decoy_is_best_alone_and_still_loses(decoyed):
    alone = max(decoyed.larger(()), key=decoyed)
    assert kinds_of(alone) == {"decoy"}
    assert kinds_of(best_set(decoyed)) == {"a", "b"}
    wrong = (("decoy", (2,)), ("none", (3,)))
    assert kinds_of(climb(decoyed, wrong)) == {"decoy"}  # No swap finds both.


def test_a_climb_swaps_what_another_does_better(decoyed):
    start = (("a", (0,)), ("decoy", (2,)))
    assert kinds_of(climb(decoyed, start)) == {"a", "b"}
    assert len(climb(decoyed, (("none", (3,)),), same_size=True)) == 1


class Told:
    """Evidence of sets of columns from a table."""

    def __init__(self, gains, usual):
        self.gains, self.usual = gains, usual

    def extended(self, columns, more):
        sets = [tuple(sorted([*columns, *variant])) for variant in more]
        return [self.gains.get(own, self.usual) for own in sets]

    def step(self, columns):
        raise AssertionError


def test_a_climb_finds_one_in_the_place_of_two():
    """No swap, drop or addition betters the pair."""
    variants = {"turn": [(0,)], "thrust": [(1,)], "tilt": [(2,)]}
    gains = {(): 0.0, (0,): 10.0, (1,): 10.0, (2,): 98.0, (0, 1): 100.0}
    told = Told(gains | {(0, 1, 2): 101.0}, 99.0)
    score = Scorer(offering(variants), told, lambda kind, kinds: EVIDENCE_THRESHOLD)
    pair = score.by_first(("turn", "thrust"))
    steps = [*score.swapped(pair), *score.smaller(pair), *score.larger(pair)]
    assert all(score(other) < score(pair) for other in steps)
    assert kinds_of(climb(score, pair)) == {"tilt"}
    assert climb(score, pair, same_size=True) == pair


def test_a_loss_is_finite_where_the_others_are_not_physical_alone():
    variants = {"lift": [(0,)], "drag": [(1,)], "moment": [(2,)]}
    gains = {(): 0.0, (0,): 40.0, (1,): 10.0, (2,): -np.inf, (0, 1): 45.0}
    gains |= {(0, 2): 60.0, (1, 2): -np.inf, (0, 1, 2): 70.0}
    score = Scorer(offering(variants), Told(gains, 0.0), lambda kind, kinds: 1.0)
    three = tuple((kind, own) for kind, (own,) in variants.items())
    # Without lift, drag alone is physical.
    assert score.lost(three) == {"lift": 60.0, "drag": 10.0, "moment": 25.0}


def test_the_best_of_each_size_is_told(decoyed):
    sizes = best_of_sizes(decoyed)
    assert [len(members) for members in sizes[:3]] == [1, 2, 3]
    assert kinds_of(sizes[0]) == {"decoy"}
    assert kinds_of(sizes[1]) == {"a", "b"}


def test_a_member_costs_its_price_and_order_does_not_count(decoyed):
    pair = (("a", (0,)), ("b", (1,)))
    assert decoyed(pair[::-1]) == pytest.approx(decoyed(pair))
    assert decoyed(pair) == gain_of(decoyed.evidence, [0, 1]) - 2.0 * EVIDENCE_THRESHOLD
    assert decoyed(()) == 0.0


def test_neighbours_are_one_step_away(decoyed):
    pair = (("a", (0,)), ("b", (1,)))
    assert {len(m) for m in decoyed.larger(pair)} == {3}
    assert [kinds_of(m) for m in decoyed.smaller(pair)] == [{"b"}, {"a"}]
    for other in decoyed.swapped(pair):
        assert len(kinds_of(other)) == 2
        assert len(set(other) & set(pair)) == 1


def every_set(variants, most):
    for count in range(most + 1):
        for kinds in itertools.combinations(variants, count):
            for chosen in itertools.product(*(variants[k] for k in kinds)):
                yield tuple(zip(kinds, chosen, strict=True))


@pytest.mark.parametrize("seed", [0, 1, 2, 3, 4, 5, 7])
def test_the_best_of_all_sets_is_found(seed):
    """Six kinds, two starting shapes each, columns alike; in 5, only three gain."""
    rng = np.random.default_rng(seed)
    x = rng.normal(size=(60, 3)) @ rng.normal(size=(3, 12))
    x += 0.5 * rng.normal(size=x.shape)
    y = x[:, rng.choice(12, 3, replace=False)].sum(axis=1) + rng.normal(size=60)
    variants = {f"kind {k}": [(2 * k,), (2 * k + 1,)] for k in range(6)}
    score = scorer(np.column_stack([x, y]), variants)
    best = max(every_set(variants, 6), key=score)
    assert score(best_set(score)) == pytest.approx(score(best))
    assert len(best) > 1


def test_noise_gets_no_name():
    rng = np.random.default_rng(0)
    score = scorer(rng.normal(size=(300, 11)), {str(k): [(k,)] for k in range(10)})
    assert best_set(score) == ()
    assert climb(score, (("3", (3,)),)) == ()


def test_a_set_grows_to_the_most_effects_and_no_farther():
    count = MOST_EFFECTS + 3
    x = np.eye(count)
    table = np.column_stack([x, np.full(count, 50.0)])
    score = scorer(table, {str(k): [(k,)] for k in range(count)})
    assert len(best_set(score)) == MOST_EFFECTS


def test_thresholds_grow_with_many_flights_only():
    def threshold(flights):
        vehicle = types.SimpleNamespace(kinds=("wind", "mass"))
        task = types.SimpleNamespace(records=range(flights), vehicle=vehicle)
        return threshold_of(task, "wind", ("wind", "mass"))

    assert threshold(6) == threshold(40) == EVIDENCE
    assert threshold(400) == 10.0 * EVIDENCE
