"""Sets near the one that was found: rivals that would do as well, and its evidence."""

import dataclasses
import types

import numpy as np
import pytest

from glider.physics.effects import KINDS
from glider.progress import silent
from glider.sysid.constants import CLEAR, EVIDENCE_THRESHOLD, RIVAL_GAP
from glider.sysid.likelihood.candidates import gather
from glider.sysid.likelihood.model_fit import fit_model
from glider.sysid.likelihood.uncertainty import uncertainty_of
from glider.sysid.search.moves import Search
from glider.sysid.search.subsets import near_sets, scorer_of
from glider.sysid.search.tracing import _needed, _rivals_of, trace
from tests.helpers.searches import search_among
from tests.helpers.tasks import begin, fly, task_of


def fitted(effect, *kinds, offered, flights=8):
    task, noise = task_of(fly(effect, flights=flights))
    task = dataclasses.replace(task, kinds=offered)
    return task, fit_model(task, begin(task, noise, kinds))


def rivals_of(task, model):
    score = Search(task.offering(task.kinds), silent).near(model)
    return near_sets(score, score.by_first(model.kinds))[1]


def test_a_strong_effect_has_no_rival():
    drag = KINDS["profile_drag"](cd0=0.05)
    offered = ("profile_drag", "wind", "servo_lag", "pitch_damping")
    found = rivals_of(*fitted(drag, "profile_drag", offered=offered))
    assert found == {"profile_drag": set()}


def test_an_idle_effect_has_no_evidence():
    drag = KINDS["profile_drag"](cd0=0.05)
    offered = ("profile_drag", "pitch_damping")
    task, model = fitted(drag, *offered, offered=offered)
    near = Search(task, silent).near(model)
    shown = near.lost(near.by_first(offered))
    assert shown["profile_drag"] > 1000.0 and shown["pitch_damping"] < 5.0


def test_the_reported_threshold_is_that_beside_others():
    """Though a single effect, or none, needs less."""
    task, noise = task_of(fly(flights=3))
    traced = trace(Search(task.offering(("wind",)), silent), noise)
    assert len(traced.model.kinds) < 2
    assert traced.threshold == EVIDENCE_THRESHOLD


def test_what_can_hardly_be_told_apart_is_a_rival():
    """Drags along the flow and along the body, of so little that either will do."""
    offered = ("profile_drag", "axial_drag", "servo_lag")
    drag = KINDS["profile_drag"](cd0=0.0008)
    found = rivals_of(*fitted(drag, "profile_drag", offered=offered, flights=3))
    assert found == {"profile_drag": {"axial_drag"}}


def test_an_effect_without_which_a_model_diverges_has_evidence_all_the_same():
    """As much as the strongest: more, and all others would be slight beside it."""
    task, noise = task_of(fly(flights=3))
    model = dataclasses.replace(begin(task, noise), cost=1.0)
    worse = dataclasses.replace(model, cost=8.0)
    diverging = dataclasses.replace(model, cost=np.inf)

    def evidence(**fewer):
        search = types.SimpleNamespace(
            fit_without=lambda model, kind: fewer[kind],
            penalized_cost=lambda model: model.cost,
            prefers=lambda model, other: False,
        )
        return _needed(search, dataclasses.replace(model, kinds=tuple(fewer)))[1]

    assert evidence(mass=worse, wind=diverging) == {"mass": 7.0, "wind": 7.0}
    assert evidence(wind=diverging) == {"wind": CLEAR}


def test_a_rival_is_fitted_in_an_effects_place():
    """Not only named: errors are averaged over its model too."""
    offered = ("profile_drag", "axial_drag", "servo_lag")
    drag = KINDS["profile_drag"](cd0=0.0008)
    task, model = fitted(drag, "profile_drag", offered=offered, flights=3)
    model = Search(task, silent).fit(model)
    ((rival, lack),) = _rivals_of(Search(task, silent), model)
    assert rival.kinds == ("axial_drag",) and 0.0 <= lack < RIVAL_GAP


def test_a_set_with_one_effect_more_that_adds_nothing_is_no_rival():
    task, noise = task_of(fly(flights=3))
    bare = dataclasses.replace(begin(task, noise), cost=0.0)
    idle = dataclasses.replace(bare, kinds=("wind",), cost=0.1)
    weak = dataclasses.replace(bare, kinds=("mass",), cost=-0.1)
    search = types.SimpleNamespace(
        fitted={frozenset(model.kinds): model for model in (bare, idle, weak)},
        near=lambda model: None,
        penalized_cost=lambda model: model.cost + len(model.kinds),
    )
    assert _rivals_of(search, bare) == ((weak, pytest.approx(0.9)),)


def gains_of(score):
    """Returns the gain of each kind alone."""
    return {kind: score.gain(score.by_first([kind])) for kind in score.variants}


def test_free_functions_are_compared_beside_formulas():
    """Flights are made linear once for each model, in both."""
    offered = ("profile_drag", "lagged_separation")
    search, plate = search_among(KINDS["profile_drag"](cd0=0.05), *offered)
    both = search.near(plate)
    assert search.near(plate) is both
    assert search.near(dataclasses.replace(plate)) is not both
    assert gains_of(both).keys() == {*offered, *search.task.functions}
    search.task = search.task.offering(offered)
    formulas = gains_of(search.near(plate))
    assert formulas.keys() == {*offered}
    assert formulas == pytest.approx({k: gains_of(both)[k] for k in offered}, rel=1e-6)


def test_no_set_without_a_strong_effect_is_fitted():
    offered = ("profile_drag", "axial_drag", "servo_lag")
    drag = KINDS["profile_drag"](cd0=0.05)
    task, model = fitted(drag, "profile_drag", offered=offered)
    search = Search(task, silent)
    assert _rivals_of(search, search.fit(model)) == ()
    assert [*search.fitted] == [{"profile_drag"}]


def test_the_only_effect_need_only_be_likelier_than_none():
    """Beside others, free ones too, it has to bring more."""
    task, noise = task_of(fly(flights=3))
    model = begin(task, noise)
    candidates = gather(dataclasses.replace(task, kinds=("mass", "thrust")), model)
    score = scorer_of(candidates, candidates.grams(model.scales))
    everything = np.log(len(task.vehicle.kinds))  # Offered or not.
    assert score.penalty("mass", ("mass",)) == pytest.approx(everything)
    for other in ("thrust", "drag over alpha"):
        assert score.penalty("mass", ("mass", other)) == EVIDENCE_THRESHOLD
    alone = dataclasses.replace(model, kinds=("mass",), cost=0.0)
    both = dataclasses.replace(alone, kinds=("mass", "thrust"))
    search = Search(task, silent)
    assert search.penalized_cost(alone) == pytest.approx(everything)
    assert search.penalized_cost(both) == 2.0 * EVIDENCE_THRESHOLD


def test_what_is_not_free_has_no_standard_error():
    drag = KINDS["profile_drag"](cd0=0.05)
    task, model = fitted(drag, "profile_drag", offered=("profile_drag",), flights=3)
    known = uncertainty_of(task, model)
    index = task.space.index
    assert 0.0 < known.std(index["profile_drag.cd0"]) < 0.005
    assert np.isnan(known.std(index["wind.x"]))
    matrix, _ = known.covariance
    assert matrix.shape == (1, 1)
    assert matrix[0, 0] == pytest.approx(known.std(index["profile_drag.cd0"]) ** 2)
