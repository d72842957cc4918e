"""Moves from a set of effects to a better one that the first order does not see."""

import dataclasses

import pytest

from glider.physics.effects import KINDS
from glider.sysid.likelihood.model_fit import start_of
from glider.sysid.search.fits import Search
from glider.sysid.search.moves import (
    prune,
    with_a_rival,
    with_a_shaped_one,
    with_another,
    with_fewer,
    with_means,
)
from glider.sysid.search.weighing import Weighed
from tests.helpers.tasks import begin, fly, task_of


def search_among(effect, *offered):
    """Returns a search, and the plate to start from."""
    task, noise = task_of(fly(effect, flights=8))
    task = dataclasses.replace(task, kinds=offered)
    return Search(task, lambda text: None), begin(task, noise)


def kinds_fitted(search, plate, *kinds):
    start = dataclasses.replace(plate, kinds=kinds, free=search.task.free(kinds))
    return search.fit(start)


def test_what_all_flights_have_is_no_spread():
    search, plate = search_among(KINDS["pitch_offset"](angle=0.03), "pitch_offset")
    spread = search.fit(plate)
    assert spread.scales.pitch_zero == pytest.approx(0.03, rel=0.3)
    found = with_means(search, spread)
    assert found.kinds == ("pitch_offset",)
    slot = search.task.layout.index["pitch_offset", "angle"]
    assert found.theta[slot] == pytest.approx(0.03, abs=1e-3)
    assert found.scales.pitch_zero < 0.003
    assert with_means(search, found) is found


def test_a_tilted_frame_is_no_turned_pitch_with_a_thrust():
    offered = ("frame_tilt", "pitch_offset", "thrust")
    search, plate = search_among(KINDS["frame_tilt"](angle=0.02), *offered)
    pair = kinds_fitted(search, plate, "pitch_offset", "thrust")
    found = with_fewer(search, pair)
    assert found is not None
    assert found.kinds == ("frame_tilt",)
    assert search.price(found) < search.price(pair)
    assert with_fewer(search, found) is None


def test_what_is_not_needed_is_dropped():
    offered = ("frame_tilt", "mass")
    search, plate = search_among(KINDS["frame_tilt"](angle=0.02), *offered)
    model, evidence = prune(search, kinds_fitted(search, plate, *offered))
    assert model.kinds == ("frame_tilt",)
    assert evidence["frame_tilt"] > 100.0


def test_what_was_dropped_makes_room_for_another():
    offered = ("frame_tilt", "mass")
    search, plate = search_among(KINDS["frame_tilt"](angle=0.02), *offered)
    bare = search.fit(plate)
    found = with_another(search, bare, dropped={"mass"})
    assert found is not None
    assert found.kinds == ("frame_tilt",)
    assert search.price(found) < search.price(bare)
    assert with_another(search, found, dropped={"mass"}) is None
    assert with_another(search, bare, dropped=offered) is None


def test_a_rival_takes_the_place_of_what_was_named_for_it():
    offered = ("servo_lag", "command_delay")
    search, plate = search_among(KINDS["servo_lag"](time_constant=0.03), *offered)
    named = kinds_fitted(search, plate, "command_delay")

    def weighed(inclusion):
        rivals = ("servo_lag",)
        weighed = Weighed(rivals=rivals, inclusion=inclusion, support=1.0)
        return {"command_delay": weighed}

    assert with_a_rival(search, named, weighed(1.0)) is None  # It is sure of itself.
    found = with_a_rival(search, named, weighed(0.5))
    assert found is not None
    assert found.kinds == ("servo_lag",)
    assert search.price(found) < search.price(named)
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
    assert search.price(found) < search.price(model)
    found, _ = prune(search, found)
    assert found.kinds == ("attached_lift",)
    assert with_a_shaped_one(search, found) is None
