"""Which formulas and free functions are reported, and by which name."""

import dataclasses
import types
from typing import NamedTuple
from unittest import mock

import pytest

from glider.physics.effects.families import FAMILIES, formulas_at
from glider.sysid.constants import RESOLVED
from glider.sysid.result import UNEXPLAINED
from glider.sysid.search import tracing
from glider.sysid.search.subsets import Scorer

LIFT = "lift over alpha"
WAKE = "tail's force over alpha"
PAIR = "lift over alpha and reduced_rate"


@dataclasses.dataclass(frozen=True)
class FakeModel:
    """A model that is nothing but its kinds and its cost."""

    kinds: tuple
    cost: float = 0.0
    freedom: float = 0.0
    scales: object = None
    sizes: dict = dataclasses.field(default_factory=dict)
    theta: object = None

    @property
    def free_kinds(self):
        return tuple(kind for kind in self.kinds if kind in FAMILIES)

    @property
    def functions(self):
        return [FakeFunction(kind, self.sizes.get(kind, 1.0)) for kind in self.kinds]

    def without(self, task, *gone):
        return FakeModel(tuple(kind for kind in self.kinds if kind not in gone))


class FakeFunction(NamedTuple):
    """A free function that is nothing but its name and its size."""

    name: str
    rms: float

    def size(self, flown):
        return self.rms


class FakeSearch:
    """Fits of sets of kinds: what a function gains counts once, whatever it is by."""

    task = types.SimpleNamespace(records=())

    def __init__(self, evidence, shares):
        self._functions = FAMILIES.keys() & evidence.keys()
        self._shares = shares

    def fit(self, model):
        members = set(model.kinds)
        cost = 0.0
        for function in self._functions:
            by = [
                100.0 * share
                for (of, kind), share in self._shares.items()
                if of == function and kind in members
            ]
            cost -= 100.0 if function in members else max(by, default=0.0)
        return FakeModel(model.kinds, cost)

    def penalized_cost(self, model):
        return model.cost

    def near(self, model):
        kinds = [*model.kinds, *(kind for _, kind in self._shares)]
        variants = {kind: ((j,),) for j, kind in enumerate(dict.fromkeys(kinds))}
        scorer = Scorer(types.SimpleNamespace(variants=variants), Alike(), None)
        scorer.begin = lambda members: FakeModel(tuple(kind for kind, _ in members))
        return scorer


class Alike:
    """Evidence to first order, which does not tell variants apart."""

    def extended(self, columns, more):
        return [0.0 for _ in more]


def names(evidence, shares=(), sizes=()):
    """Returns the names of effects by their evidence.

    `shares` are those of a free function, which gains 100, that formulas explain;
    `sizes` those of free functions that have not 1.
    """
    search = FakeSearch(evidence, dict(shares))

    def fit_model(task, model, **options):
        return search.fit(model)

    with (
        mock.patch.object(tracing, "fit_model", fit_model),
        mock.patch.object(tracing, "flown_values"),
    ):
        model = search.fit(FakeModel(tuple(evidence)))
        model = dataclasses.replace(model, sizes=dict(sizes))
        return tracing._names_of(search, model, evidence)


def test_formulas_have_their_own_names():
    evidence = {"profile_drag": 2000.0, "camber": 1.0}
    assert names(evidence) == {"profile_drag": "profile_drag", "camber": "camber"}


@pytest.mark.parametrize(("share", "name"), [(0.11, "tail_wake"), (0.09, UNEXPLAINED)])
def test_a_free_function_has_the_name_of_a_formula_that_explains_a_tenth_of_it(
    share, name
):
    assert names({WAKE: 400.0}, {(WAKE, "tail_wake"): share}) == {WAKE: name}


@pytest.mark.parametrize(("share", "name"), [(0.6, "camber"), (0.4, UNEXPLAINED)])
def test_a_formula_of_fewer_variables_must_explain_most_of_it(share, name):
    assert names({PAIR: 400.0}, {(PAIR, "camber"): share}) == {PAIR: name}


def test_a_function_and_a_formula_that_it_bends_are_one_effect():
    assert names({"tail_wake": 46.0, WAKE: 400.0}) == {
        "tail_wake": "tail_wake",
        WAKE: "tail_wake",
    }
    drag = "drag over V"  # Of no family: it bends every drag, the strongest here.
    found = names({"profile_drag": 150.0, "induced_drag": 200.0, drag: 900.0})
    assert found[drag] == "induced_drag"


@pytest.mark.parametrize(("share", "name"), [(0.6, "camber"), (0.4, "attached_lift")])
def test_it_is_one_of_its_own_where_another_formula_explains_most_of_it(share, name):
    evidence = {"attached_lift": 30.0, LIFT: 270.0, "profile_drag": 9000.0}
    found = names(evidence, {(LIFT, "camber"): share})
    assert found == {
        "profile_drag": "profile_drag",
        "attached_lift": "attached_lift",
        LIFT: name,
    }


def test_a_formula_and_what_bends_it_may_be_slight_together():
    """Without both the model loses 100, a share of what the others bring."""
    evidence = {"attached_lift": 30.0, LIFT: 270.0}
    assert "attached_lift" in names(evidence | {"profile_drag": 9600.0})
    assert "attached_lift" not in names(evidence | {"profile_drag": 9800.0})


def test_what_stands_for_errors_of_free_functions_has_no_name():
    """It is not what the function bends then, but may be what explains it.

    A tenth of what the function brings counts, whatever the others do.
    """
    found = names({"camber": -0.6, LIFT: 1500.0}, {(LIFT, "attached_lift"): 0.5})
    assert found == {LIFT: "attached_lift"}
    found = names({"camber": -0.6, LIFT: 1500.0}, {(LIFT, "camber"): 0.2})
    assert found == {LIFT: "camber"}
    found = names({"mass": 14.0, WAKE: 5.0, LIFT: 1500.0})
    assert found == {LIFT: UNEXPLAINED}


def test_a_function_of_next_to_no_size_has_a_name_alone():
    """Beside a larger one it stands for what that leaves."""
    shares, small = {(PAIR, "dynamic_stall"): 0.9}, {PAIR: 1.9 * RESOLVED}
    assert names({PAIR: 86.0}, shares, small) == {PAIR: "dynamic_stall"}
    both = {PAIR: 86.0, WAKE: 422.0}
    assert names(both, shares) == {PAIR: "dynamic_stall", WAKE: UNEXPLAINED}
    assert names(both, shares, small) == {WAKE: UNEXPLAINED}


def test_formulas_at_a_link_may_explain_functions_of_more_variables():
    of_lift = formulas_at(LIFT)
    assert {"camber", "attached_lift"} <= of_lift
    assert of_lift < formulas_at(PAIR) >= {"pitch_rate_lift", "dynamic_stall"}
    assert "dynamic_stall" not in of_lift
    assert formulas_at("drag over V") == set()


def test_of_several_formulas_the_one_that_explains_most_is_the_name():
    shares = {(LIFT, "camber"): 0.2, (LIFT, "attached_lift"): 0.6}
    assert names({LIFT: 1500.0}, shares) == {LIFT: "attached_lift"}
