"""Moves from a set of effects to a better one that the first order does not see."""

import dataclasses

from glider.physics.effects import KINDS
from glider.sysid.likelihood.model_fit import start_of
from glider.sysid.search.fits import Search
from glider.sysid.search.moves import (
    left_of_many,
    prune,
    with_a_rival,
    with_a_shaped_one,
    with_another,
    with_weaker_curves,
    without_needless_curves,
)
from glider.sysid.search.support import EffectSupport
from glider.sysid.search.tracing import effects_instead_of_curves
from tests.helpers.searches import kinds_fitted, search_among
from tests.helpers.tasks import fly, task_of


def test_what_was_dropped_makes_room_for_another():
    offered = ("frame_tilt", "mass")
    search, plate = search_among(KINDS["frame_tilt"](angle=0.02), *offered)
    bare = search.fit(plate)
    found = with_another(search, bare, dropped={"mass"})
    assert found is not None
    assert found.kinds == ("frame_tilt",)
    assert search.penalized_cost(found) < search.penalized_cost(bare)
    assert with_another(search, found, dropped={"mass"}) is None
    assert with_another(search, bare, dropped=offered) is None


def test_a_rival_takes_the_place_of_what_was_named_for_it():
    offered = ("servo_lag", "command_delay")
    search, plate = search_among(KINDS["servo_lag"](time_constant=0.03), *offered)
    named = kinds_fitted(search, plate, "command_delay")

    def weighed(inclusion):
        rivals = ("servo_lag",)
        weighed = EffectSupport(
            rivals=rivals, inclusion=inclusion, support=1.0, enough=0.85
        )
        return {"command_delay": weighed}

    assert with_a_rival(search, named, weighed(1.0)) is None  # It is sure of itself.
    found = with_a_rival(search, named, weighed(0.5))
    assert found is not None
    assert found.kinds == ("servo_lag",)
    assert search.penalized_cost(found) < search.penalized_cost(named)
    assert with_a_rival(search, named, weighed(0.5)) is None  # It is known by now.


def test_a_stall_is_found_behind_three_that_imitate_it():
    imitate = ("pitch_rate_lift", "mass", "camber")
    task, noise = task_of(fly(KINDS["attached_lift"](slope=2.0), flights=8))
    task = dataclasses.replace(task, kinds=(*imitate, "attached_lift"))
    search = Search(task, lambda text: None)
    start = start_of(task, noise, with_curves=True)
    model = search.fit_with_strength(
        dataclasses.replace(start, kinds=imitate, free=task.free(imitate))
    )
    found = with_a_shaped_one(search, model)
    assert found is not None
    assert search.penalized_cost(found) < search.penalized_cost(model)
    found, _ = prune(search, found)
    assert found.kinds == ("attached_lift",)
    assert with_a_shaped_one(search, found) is None


def test_an_effect_is_found_that_curves_had_explained():
    """As the tests of lifelike campaigns ask too, of a stall in nobody's form."""
    drags = KINDS["profile_drag"](cd0=0.05), KINDS["induced_drag"](k=0.04)
    task, noise = task_of(fly(*drags, flights=8))
    task = dataclasses.replace(task, kinds=("profile_drag", "induced_drag", "mass"))
    search = Search(task, lambda text: None)
    start = start_of(task, noise, with_curves=True)
    start = dataclasses.replace(
        start, kinds=("profile_drag",), free=task.free(("profile_drag",))
    )
    model = search.fit_with_strength(search.fit_with_strength(start))
    assert model.strength > 0.2
    found = with_weaker_curves(search, model)
    assert found is not None
    assert set(found.kinds) == {"profile_drag", "induced_drag"}
    assert search.penalized_cost(found) < search.penalized_cost(model)
    assert with_weaker_curves(search, found) is None  # They have nothing left to do.
    bare = model.without_blocks("curves")
    assert with_weaker_curves(search, bare) is None


def test_two_that_stand_in_for_one_are_thinned_out_beside_it():
    """A tilted frame is a turned pitch and a thrust, which leave nothing for it."""
    stand_ins = ("pitch_offset", "thrust")
    offered = (*stand_ins, "frame_tilt", "mass")
    search, plate = search_among(KINDS["frame_tilt"](angle=0.03), *offered)
    model = kinds_fitted(search, plate, *stand_ins)
    found = left_of_many(search, model)
    assert found is not None
    assert found.kinds == ("frame_tilt",)
    assert search.penalized_cost(found) < search.penalized_cost(model)
    assert left_of_many(search, found) is None


def test_names_take_the_place_of_curves_that_explain_no_more():
    """Where the effect is among those that are offered."""
    task, noise = task_of(fly(KINDS["profile_drag"](cd0=0.01), flights=4))
    for offered, expected in ((("profile_drag", "mass"), True), (("mass",), False)):
        own = dataclasses.replace(task, kinds=offered)
        search = Search(own, lambda text: None)
        model = search.fit_with_strength(start_of(own, noise, with_curves=True))
        assert without_needless_curves(search, model) is model
        found = effects_instead_of_curves(search, model)
        if expected:
            assert found.kinds == ("profile_drag",) and not found.has_curves
        else:
            assert found is model
