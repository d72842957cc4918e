"""Which formulas and free functions are reported, and by which name."""

import types

import pytest

from glider.physics.effects.families import FAMILIES, formulas_at
from glider.sysid.result import UNEXPLAINED
from glider.sysid.search.subsets import Scorer
from glider.sysid.search.tracing import _names_of

LIFT = "lift over alpha"
WAKE = "tail's force over alpha"
PAIR = "lift over alpha and reduced_rate"


def names(evidence, shares=()):
    """Returns the names of effects by their evidence.

    `shares` are those of a free function, which gains 100, that formulas explain.
    """
    kinds = [*evidence, *(kind for _, kind in dict(shares) if kind not in evidence)]
    columns = {kind: j for j, kind in enumerate(kinds)}

    class Gains:
        """Evidence of sets: what functions gain counts once."""

        def extended(self, columns_of_set, more):
            return [self.gain([*columns_of_set, *own]) for own in more]

        def gain(self, found):
            members = {kinds[j] for j in found}
            total = 0.0
            for function in FAMILIES.keys() & evidence.keys():
                by = [
                    100.0 * own
                    for (of, kind), own in dict(shares).items()
                    if of == function and kind in members
                ]
                total += 100.0 if function in members else max(by, default=0.0)
            return total

    variants = {kind: ((j,),) for kind, j in columns.items()}
    candidates = types.SimpleNamespace(variants=variants)
    near = Scorer(candidates, Gains(), lambda kind, kinds: 0.0)
    search = types.SimpleNamespace(near=lambda model: near)
    functions = tuple(kind for kind in evidence if kind in FAMILIES)
    model = types.SimpleNamespace(kinds=tuple(evidence), free_kinds=functions)
    return _names_of(search, model, evidence)


def test_formulas_have_their_own_names():
    evidence = {"profile_drag": 2000.0, "camber": 1.0}
    assert names(evidence) == {"profile_drag": "profile_drag", "camber": "camber"}


@pytest.mark.parametrize(("share", "name"), [(0.11, "tail_wake"), (0.09, UNEXPLAINED)])
def test_a_free_function_has_the_name_of_a_formula_that_explains_a_tenth_of_it(
    share, name
):
    assert names({WAKE: 400.0}, {(WAKE, "tail_wake"): share}) == {WAKE: name}


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


def test_formulas_at_a_link_may_explain_functions_of_more_variables():
    of_lift = formulas_at(LIFT)
    assert {"camber", "attached_lift"} <= of_lift
    assert of_lift < formulas_at(PAIR) >= {"pitch_rate_lift", "dynamic_stall"}
    assert "dynamic_stall" not in of_lift
    assert formulas_at("drag over V") == set()
