"""Moves from a set of effects to a better one."""

import dataclasses
import types

from glider.physics.effects import KINDS
from glider.sysid.likelihood.task import start_of
from glider.sysid.search.moves import MOVES, _pruned, _reshaped, _with_another, one_less
from glider.sysid.search.support import Search
from glider.sysid.search.tracing import _improved
from tests.helpers.searches import kinds_fitted, search_among
from tests.helpers.tasks import fly, task_of


def test_a_rival_takes_the_place_of_what_was_named_for_it():
    offered = ("servo_lag", "command_delay")
    search, plate = search_among(KINDS["servo_lag"](time_constant=0.03), *offered)
    named = kinds_fitted(search, plate, "command_delay")
    found = _with_another(search, named)
    assert found is not None
    assert "servo_lag" in found.kinds
    assert search.penalized_cost(found) < search.penalized_cost(named)


def test_a_tilted_frame_is_no_turned_pitch_with_a_thrust():
    """They leave nothing for it beside them."""
    offered = ("frame_tilt", "pitch_offset", "thrust")
    search, plate = search_among(KINDS["frame_tilt"](angle=0.02), *offered)
    pair = kinds_fitted(search, plate, "pitch_offset", "thrust")
    found = _improved(search, pair)
    assert found.kinds == ("frame_tilt",)
    assert search.penalized_cost(found) < search.penalized_cost(pair)


def test_what_is_not_needed_is_dropped():
    offered = ("frame_tilt", "mass")
    search, plate = search_among(KINDS["frame_tilt"](angle=0.02), *offered)
    model = _pruned(search, kinds_fitted(search, plate, *offered))
    assert model is not None and model.kinds == ("frame_tilt",)
    without = one_less(search, model)["frame_tilt"]
    assert search.penalized_cost(without) - search.penalized_cost(model) > 100.0
    assert _pruned(search, model) is None


def test_a_stall_is_found_behind_three_that_imitate_it():
    imitate = ("pitch_rate_lift", "mass", "camber")
    task, noise = task_of(fly(KINDS["attached_lift"](slope=2.0), flights=5))
    task = dataclasses.replace(task, kinds=(*imitate, "attached_lift"))
    search = Search(task, lambda text: None)
    start = start_of(task, noise)
    model = search.fit(start.with_kinds(task, imitate, start.theta))
    found = _improved(search, model)
    assert found.kinds == ("attached_lift",)
    assert all(move(search, found) is None for move in MOVES.values())


def test_a_second_drag_is_found_behind_the_first():
    drags = KINDS["profile_drag"](cd0=0.05), KINDS["induced_drag"](k=0.04)
    task, noise = task_of(fly(*drags, flights=5))
    task = dataclasses.replace(task, kinds=("profile_drag", "induced_drag", "mass"))
    search = Search(task, lambda text: None)
    start = start_of(task, noise)
    model = search.fit(start.with_kinds(task, ("profile_drag",), start.theta))
    found = _improved(search, model)
    assert set(found.kinds) == {"profile_drag", "induced_drag"}


def test_a_stall_that_a_fit_did_not_reach_is_found_from_where_there_is_none():
    search, plate = search_among(KINDS["attached_lift"](slope=3.0), "attached_lift")
    theta, slots = plate.theta.copy(), search.task.space.slots_of("attached_lift")
    theta[list(slots)] = 0.2, 0.9, 0.2  # Slope, and a stall that no flight reached.
    trapped = search.fit(plate.with_kinds(search.task, ("attached_lift",), theta))
    found = _reshaped(search, trapped)
    assert found is not None and found.kinds == trapped.kinds
    assert search.penalized_cost(found) < search.penalized_cost(trapped) - 50.0
    assert search.fit(trapped) is found  # The better one of the set is kept,
    assert _reshaped(search, found) is None
    assert search.fit(trapped, again=True) is found  # whatever is fitted again.


def test_of_sets_worth_more_than_the_model_the_best_is_taken(monkeypatch):
    """A little better than the first suffices: both are better than the model."""
    search, plate = search_among(KINDS["frame_tilt"](angle=0.02), "frame_tilt")

    def worth(*kinds, gain=0.0):
        return dataclasses.replace(plate, kinds=kinds, cost=-gain, freedom=0.0)

    monkeypatch.setattr(Search, "fit", lambda self, model, rival: model)
    monkeypatch.setattr(Search, "_penalty_of", lambda self, model: 0.0)
    model = worth("frame_tilt")
    first, best = (
        worth("frame_tilt", kind, gain=gain)
        for kind, gain in (("camber", 2.0), ("thrust", 4.0))
    )
    near = types.SimpleNamespace(begin=lambda members: members)
    assert search.better(model, near, [first, best]) is best
    assert search.better(model, near, [best, first]) is best
    assert search.better(model, near, [first, best], first=True) is first
    assert search.better(best, near, [model, first]) is None


def test_a_fit_that_stopped_far_behind_a_rival_is_done_when_it_is_asked_for():
    stall, drag = "attached_lift", "profile_drag"
    search, plate = search_among(KINDS[stall](slope=3.0), stall, drag)
    done = kinds_fitted(search, plate, stall)
    search.fitted.clear()
    start = plate.with_kinds(search.task, (stall,), plate.theta)
    rival = dataclasses.replace(plate, cost=done.cost - 1e4)
    stopped = search.fit(start, rival=rival)
    assert stopped.cost > done.cost + 10.0
    assert search.fit(start, rival=rival) is stopped
    worse = dataclasses.replace(plate, cost=done.cost + 1.0)
    whole = search.fit(start, rival=worse)
    assert whole.cost < done.cost + 1.0
    assert search.fit(start, rival=rival) is whole and search.fit(start) is whole
