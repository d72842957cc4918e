"""Which formulas and free functions are reported, and by which name."""

import dataclasses
import types

import numpy as np
import pytest

from glider.physics.effects.families import FAMILIES, formulas_at
from glider.sysid.likelihood.fitted_functions import flown_values
from glider.sysid.likelihood.uncertainty import Uncertainty
from glider.sysid.naming import LIFT, UNEXPLAINED, names_of
from glider.sysid.search.moves import nearest_of
from glider.sysid.search.subsets import Scorer
from tests.helpers.tasks import begin, fly, task_of

LOAD = "tail's angle over tail_load"
WAKE = "tail's force over alpha"
PAIR = "lift over alpha and reduced_rate"
STREAM = "stream at the tail over alpha"


@pytest.fixture(scope="module")
def plain():
    """A task, and its nominal model."""
    task, noise = task_of(fly(flights=3))
    return task, begin(task, noise)


def sized(task, model, name, size=0.5):
    """Returns a free function that is so large, over its prior's RMS."""
    own, flown = task.functions[name], flown_values(task.records, model.theta)
    own = dataclasses.replace(own, coordinates=np.ones(own.count))
    values = own.gaussians(flown[:, own.columns]) @ own.weights
    [value] = own.effect.coefficients
    factor = size * value.scale / np.sqrt(np.mean(values**2))
    return dataclasses.replace(own, coordinates=factor * own.coordinates)


def names(plain, evidence, nearest=(), sizes=(), functions=(), std=0.01):
    """Returns the names of a model's effects, by the evidence of each."""
    task, model = plain
    sizes = dict(sizes)
    kinds = [name for name in evidence if name in FAMILIES]
    acting = functions or [sized(task, model, k, sizes.get(k, 0.5)) for k in kinds]
    model = dataclasses.replace(model, kinds=(*evidence,), functions=tuple(acting))
    count = len(model.free) + sum(own.count for own in acting)
    known = Uncertainty(
        free=model.free,
        named=(),
        places=model.places(),
        likelihood=std**2 * np.eye(count),
        changes=np.zeros((2, count)),
    )
    traced = types.SimpleNamespace(
        model=model, evidence=evidence, nearest=dict(nearest)
    )
    return names_of(task, traced, known)


def test_formulas_have_their_own_names(plain):
    evidence = {"profile_drag": 2000.0, "camber": 12.0}
    assert names(plain, evidence) == {
        "profile_drag": "profile_drag",
        "camber": "camber",
    }


def test_a_free_function_has_the_name_of_the_formula_that_explains_it(plain):
    alone = {STREAM: 400.0}
    assert names(plain, alone) == {STREAM: UNEXPLAINED}
    assert names(plain, alone, {STREAM: "downwash"}) == {STREAM: "downwash"}


def test_a_function_and_a_formula_of_its_family_are_one_effect(plain):
    """That of the formula, unless it explains less than a tenth."""
    nearest = {WAKE: "tail_wake"}
    assert names(plain, {"tail_wake": 46.0, WAKE: 400.0}, nearest) == {
        "tail_wake": "tail_wake"
    }
    assert names(plain, {"tail_wake": 36.0, WAKE: 400.0}, nearest) == {
        WAKE: "tail_wake"
    }
    drag = "drag over V"  # Of no family: it bends every drag.
    assert names(plain, {"profile_drag": 150.0, drag: 900.0}) == {
        "profile_drag": "profile_drag"
    }


def test_a_function_beside_a_formula_of_another_family_is_an_effect(plain):
    """Unless it explains less than a tenth of what the formula does."""
    evidence = {"elevator_blowback": 178.0, WAKE: 550.0}
    nearest = {WAKE: "tail_wake"}
    assert names(plain, evidence, nearest) == {
        "elevator_blowback": "elevator_blowback",
        WAKE: "tail_wake",
    }
    assert names(plain, evidence | {WAKE: 17.0}, nearest) == {
        "elevator_blowback": "elevator_blowback"
    }


def test_no_name_is_reported_twice(plain):
    nearest = {LOAD: "elevator_blowback", PAIR: "attached_lift"}
    evidence = {LOAD: 90.0, PAIR: 300.0, "attached_lift": 80.0}
    assert names(plain, evidence, nearest) == {
        LOAD: "elevator_blowback",
        "attached_lift": "attached_lift",
    }


def test_what_stands_for_errors_of_free_functions_has_no_name(plain):
    drag = "drag over V"
    evidence = {drag: 3000.0, "profile_drag": 900.0, "camber": 12.0}
    assert names(plain, evidence).keys() == {"profile_drag"}
    assert names(plain, evidence | {"camber": 50.0}).keys() == {
        "profile_drag",
        "camber",
    }


@pytest.mark.parametrize(
    ("sizes", "found"),
    [
        ({}, {LOAD, STREAM}),
        ({LOAD: 0.035}, {STREAM}),
        ({LOAD: 0.045}, {LOAD, STREAM}),
        ({LOAD: 0.02, STREAM: 0.03}, {STREAM}),  # One of them has to be.
    ],
    ids=["large", "one small", "one hardly small", "all small"],
)
def test_a_small_free_function_is_no_effect_where_a_larger_one_acts(
    plain, sizes, found
):
    """Its size is along the flights, over what is expected, of which 4 % count."""
    evidence = {LOAD: 100.0, STREAM: 100.0}
    assert names(plain, evidence, sizes=sizes).keys() == found


@pytest.mark.parametrize(
    ("at_zero", "beside", "std", "name"),
    [
        (0.0, {}, 0.01, "attached_lift"),
        (0.3, {}, 0.01, "attached_lift"),
        (0.8, {}, 0.01, "camber"),
        (0.3, {"attached_lift": 90.0}, 0.01, "camber"),
        (0.3, {"attached_lift": 90.0}, 10.0, None),
        (0.05, {"attached_lift": 90.0}, 0.01, None),
    ],
)
def test_a_normal_force_where_a_plate_has_none_is_camber(
    plain, at_zero, beside, std, name
):
    """A large part of the force, or any beside a formula of lift; else it is lift."""
    function = plain[0].functions[LIFT]
    alpha = np.linspace(*function.flown[:, 0], 200)
    force = at_zero + (1.0 - at_zero) * np.sin(alpha) / np.sin(alpha).max()
    shown = function.gaussians(alpha[:, None]) @ function.mix
    weights = np.linalg.lstsq(shown, force, rcond=1e-6)[0]
    own = dataclasses.replace(function, coordinates=weights)
    expected = {kind: kind for kind in beside}
    if name:
        expected[LIFT] = name
    found = names(plain, {LIFT: 50.0} | beside, functions=[own], std=std)
    assert found == expected


def test_formulas_at_a_link_may_explain_functions_of_more_variables():
    of_lift = formulas_at("lift over alpha")
    assert {"camber", "attached_lift"} <= of_lift
    assert of_lift < formulas_at(PAIR) >= {"pitch_rate_lift", "dynamic_stall"}
    assert "dynamic_stall" not in of_lift
    assert formulas_at("drag over V") == set()


@pytest.mark.parametrize(("gain", "found"), [(11.0, {WAKE: "tail_wake"}), (9.0, {})])
def test_a_formula_explains_a_function_that_it_gains_a_tenth_of(gain, found):
    """In its place, beside all other effects."""
    gains = {(): 0.0, (2,): 50.0, (0, 2): 150.0, (1, 2): 50.0 + gain}

    class Gained:
        """Evidence by the columns of a set."""

        def extended(self, columns, more):
            return [gains[tuple(sorted((*columns, *own)))] for own in more]

    variants = {WAKE: ((0,),), "tail_wake": ((1,),), "mass": ((2,),)}
    candidates = types.SimpleNamespace(variants=variants)
    near = Scorer(candidates, Gained(), lambda kind, kinds: 0.0)
    search = types.SimpleNamespace(near=lambda model: near)
    model = types.SimpleNamespace(free_kinds=(WAKE,), kinds=("mass", WAKE))
    assert nearest_of(search, model) == found
