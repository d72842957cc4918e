"""A search that begins with the model of an earlier one."""

import dataclasses

import numpy as np
import pytest

from glider.physics.effects import KINDS
from glider.progress import silent
from glider.sysid.search.moves import MOVES
from glider.sysid.search.tracing import EARLIER, trace
from tests.helpers.tasks import fly, task_of

OFFERED = "wind", "mass", "camber", "profile_drag"


def trace_among(effect, flights, earlier=None):
    """Traces flights of an effect among a few kinds, and the one function of winds."""
    task, noise = task_of(fly(effect, flights=flights))
    functions = {"air along x over z": task.functions["air along x over z"]}
    task = dataclasses.replace(task, kinds=OFFERED, functions=functions)
    return trace(task, noise, np.random.default_rng(0), silent, earlier)


@pytest.fixture(scope="module")
def windy():
    return trace_among(KINDS["wind"](x=-0.4), 6)


def test_the_same_effects_in_more_flights_are_the_answer_of_a_full_search(windy):
    full = trace_among(KINDS["wind"](x=-0.4), 8)
    found = trace_among(KINDS["wind"](x=-0.4), 8, windy.model)
    assert found.model.kinds == full.model.kinds == ("wind",)
    assert found.found_by == {"wind": EARLIER} and full.found_by["wind"] in MOVES
    assert found.model.cost == pytest.approx(full.model.cost, abs=0.3)
    np.testing.assert_allclose(found.model.theta, full.model.theta, atol=1e-4)


@pytest.mark.nightly
def test_other_effects_are_searched_as_if_there_had_been_no_earlier_model(windy):
    drag = KINDS["profile_drag"](cd0=0.1)
    full, found = trace_among(drag, 8), trace_among(drag, 8, windy.model)
    assert found.model.kinds == full.model.kinds == ("profile_drag",)
    assert np.array_equal(found.model.theta, full.model.theta)
    assert found.found_by == full.found_by and found.evidence == full.evidence


@pytest.mark.nightly
def test_an_earlier_model_of_what_is_not_tried_is_no_start():
    thrust = KINDS["thrust"](force=0.1)
    full = trace_among(thrust, 6)
    earlier = dataclasses.replace(full.model, kinds=("thrust",), functions=())
    found = trace_among(thrust, 6, earlier)
    assert "thrust" not in found.model.kinds
    assert np.array_equal(found.model.theta, full.model.theta)


def test_a_free_function_begins_again_where_the_flights_are():
    """Its Gaussians are elsewhere in other flights."""
    shear = KINDS["wind_shear"](gradient=0.5)
    earlier = trace_among(shear, 6).model
    assert earlier.free_kinds
    full, found = trace_among(shear, 8), trace_among(shear, 8, earlier)
    assert found.model.kinds == full.model.kinds
    assert set(found.found_by.values()) == {EARLIER}
    assert found.model.cost == pytest.approx(full.model.cost, abs=0.5)
    [own], [other] = found.model.functions, full.model.functions
    assert np.array_equal(own.centers, other.centers)
