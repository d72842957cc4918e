"""Moves from a set of effects to a better one."""

import dataclasses
import types

from glider.physics.effects import KINDS
from glider.sysid.likelihood.task import start_of
from glider.sysid.search import moves
from glider.sysid.search.moves import Search
from glider.sysid.search.tracing import _needed
from tests.helpers.searches import kinds_fitted, search_among
from tests.helpers.tasks import fly, task_of


def with_kinds(task, model, *kinds):
    return dataclasses.replace(model, kinds=kinds, free=task.free(kinds))


def test_a_rival_takes_the_place_of_what_was_named_for_it():
    offered = ("servo_lag", "command_delay")
    search, plate = search_among(KINDS["servo_lag"](time_constant=0.03), *offered)
    named = kinds_fitted(search, plate, "command_delay")
    found = search._with_another(named, search.near(named))
    assert found is not None
    assert "servo_lag" in found.kinds
    assert search.penalized_cost(found) < search.penalized_cost(named)


def test_a_tilted_frame_is_no_turned_pitch_with_a_thrust():
    """They leave nothing for it beside them."""
    offered = ("frame_tilt", "pitch_offset", "thrust")
    search, plate = search_among(KINDS["frame_tilt"](angle=0.02), *offered)
    pair = kinds_fitted(search, plate, "pitch_offset", "thrust")
    found = search.improved(pair)
    assert found.kinds == ("frame_tilt",)
    assert search.penalized_cost(found) < search.penalized_cost(pair)


def test_what_is_not_needed_is_dropped():
    offered = ("frame_tilt", "mass")
    search, plate = search_among(KINDS["frame_tilt"](angle=0.02), *offered)
    both = kinds_fitted(search, plate, *offered)
    model, evidence = _needed(search, both)
    assert model.kinds == ("frame_tilt",)
    assert evidence["frame_tilt"] > 100.0


def test_a_stall_is_found_behind_three_that_imitate_it():
    imitate = ("pitch_rate_lift", "mass", "camber")
    task, noise = task_of(fly(KINDS["attached_lift"](slope=2.0), flights=5))
    task = dataclasses.replace(task, kinds=(*imitate, "attached_lift"))
    search = Search(task, lambda text: None)
    start = start_of(task, noise)
    model = search.fit(with_kinds(task, start, *imitate))
    found = search.improved(model)
    assert found.kinds == ("attached_lift",)
    assert search.improved(found) is found


def test_a_second_drag_is_found_behind_the_first():
    drags = KINDS["profile_drag"](cd0=0.05), KINDS["induced_drag"](k=0.04)
    task, noise = task_of(fly(*drags, flights=5))
    task = dataclasses.replace(task, kinds=("profile_drag", "induced_drag", "mass"))
    search = Search(task, lambda text: None)
    start = start_of(task, noise)
    model = search.fit(with_kinds(task, start, "profile_drag"))
    found = search.improved(model)
    assert set(found.kinds) == {"profile_drag", "induced_drag"}


def test_of_sets_worth_more_than_the_model_the_best_is_taken(monkeypatch):
    """A little better than the first suffices: both are better than the model."""
    search, plate = search_among(KINDS["frame_tilt"](angle=0.02), "frame_tilt")

    def worth(*kinds, gain=0.0):
        return dataclasses.replace(plate, kinds=kinds, cost=-gain, freedom=0.0)

    monkeypatch.setattr(Search, "fit", lambda self, model: model)
    monkeypatch.setattr(moves, "threshold_of", lambda task, kind, kinds: 0.0)
    model = worth("frame_tilt")
    first, best = (
        worth("frame_tilt", kind, gain=gain)
        for kind, gain in (("camber", 2.0), ("thrust", 4.0))
    )
    near = types.SimpleNamespace(begin=lambda members: members)
    assert search.better(model, near, [first, best]) is best
    assert search.better(model, near, [best, first]) is best
    assert search.better(best, near, [model, first]) is None
