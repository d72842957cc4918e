"""How sure an effect is: rivals that would do as well, and how often it is chosen."""

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
from glider.sysid.search import support, tracing
from glider.sysid.search.subsets import Scorer, scorer_of
from glider.sysid.search.support import EffectSupport, Search, weigh
from glider.sysid.search.tracing import _evidence_of, _rivals_of
from tests.helpers.searches import kinds_fitted, search_among
from tests.helpers.tasks import begin, fly, task_of


def weighed(effect, *kinds, offered, flights=8):
    task, noise = task_of(fly(effect, flights=flights))
    task = dataclasses.replace(task, kinds=offered)
    model = fit_model(task, begin(task, noise, kinds))
    return weigh(task, model, np.random.default_rng(0)), task, model


def test_a_strong_effect_is_chosen_by_all_and_has_no_rival():
    drag = KINDS["profile_drag"](cd0=0.05)
    offered = ("profile_drag", "wind", "servo_lag", "pitch_damping")
    found, *_ = weighed(drag, "profile_drag", offered=offered)
    assert found["profile_drag"].inclusion == 1.0
    assert found["profile_drag"].rivals == ()


def test_an_idle_effect_is_chosen_by_few():
    drag = KINDS["profile_drag"](cd0=0.05)
    offered = ("profile_drag", "pitch_damping")
    found, task, model = weighed(drag, *offered, offered=offered)
    assert found["profile_drag"].inclusion == 1.0
    assert found["pitch_damping"].inclusion < 0.5
    near = Search(task, silent).near(model)
    shown = near.lost(near.by_first(offered))
    assert shown["profile_drag"] > 1000.0 and shown["pitch_damping"] < 5.0


def test_what_can_hardly_be_told_apart_is_a_rival():
    """Drags along the flow and along the body, of so little that either will do."""
    offered = ("profile_drag", "axial_drag", "servo_lag")
    drag = KINDS["profile_drag"](cd0=0.0008)
    found, *_ = weighed(drag, "profile_drag", offered=offered, flights=3)
    assert found["profile_drag"].rivals == ("axial_drag",)


def test_an_effect_without_which_a_model_diverges_has_evidence_all_the_same():
    """As much as the strongest: more, and all others would be slight beside it."""
    task, noise = task_of(fly(flights=3))
    model = dataclasses.replace(begin(task, noise), cost=1.0)
    worse = dataclasses.replace(model, cost=8.0)
    diverging = dataclasses.replace(model, cost=np.inf)
    found = _evidence_of(model, {"mass": worse, "wind": diverging})
    assert found == {"mass": 7.0, "wind": 7.0}
    assert _evidence_of(model, {"wind": diverging}) == {"wind": CLEAR}


def test_a_rival_is_fitted_in_an_effects_place():
    """Not only named: errors are averaged over its model too."""
    offered = ("profile_drag", "axial_drag", "servo_lag")
    drag = KINDS["profile_drag"](cd0=0.0008)
    found, task, model = weighed(drag, "profile_drag", offered=offered, flights=3)
    model = Search(task, silent).fit(model)
    ((rival, lack),) = _rivals_of(Search(task, silent), model, found)
    assert rival.kinds == ("axial_drag",) and 0.0 <= lack < RIVAL_GAP
    none = {"profile_drag": dataclasses.replace(found["profile_drag"], rivals=())}
    ((again, _),) = _rivals_of(Search(task, silent), model, none)
    assert again.kinds == ("axial_drag",)  # As the best set without the effect.


def gains_of(score):
    """Returns the gain of each kind alone."""
    return {kind: score.gain(score.by_first([kind])) for kind in score.variants}


def test_free_functions_are_compared_about_what_formulas_were(monkeypatch):
    """Flights are made linear once for both, and again about another model."""
    offered = ("profile_drag", "lagged_separation")
    search, plate = search_among(KINDS["profile_drag"](cd0=0.05), *offered)
    made = []
    monkeypatch.setattr(support, "gather", lambda *of: made.append(of) or gather(*of))
    search.task, whole = search.task.offering(offered), search.task
    formulas, count = search.near(plate), len(made)
    assert gains_of(formulas).keys() == {*offered} and count > 0
    search.task = whole
    both = search.near(plate)
    assert len(made) == count
    apart = gains_of(Search(whole, silent).near(plate))
    assert gains_of(both) == pytest.approx(apart, rel=1e-9)
    assert apart.keys() == {*offered, *whole.functions}
    known = len(made)
    search.near(dataclasses.replace(plate))
    assert len(made) > known


def test_no_set_without_a_strong_effect_is_fitted():
    offered = ("profile_drag", "axial_drag", "servo_lag")
    drag = KINDS["profile_drag"](cd0=0.05)
    found, task, model = weighed(drag, "profile_drag", offered=offered)
    search = Search(task, silent)
    assert _rivals_of(search, search.fit(model), found) == ()
    assert [*search.fitted] == [{"profile_drag"}]


def test_what_is_worth_less_than_an_unsupported_effect_does_not_take_its_place(
    monkeypatch,
):
    """Draws support it no more: only what is worth more is looked at."""
    tilt, mass, thrust = "frame_tilt", "mass", "thrust"
    search, plate = search_among(KINDS[tilt](angle=0.02), tilt, mass, thrust)
    start, left, other = (
        kinds_fitted(search, plate, tilt, *more) for more in ((mass,), (), (thrust,))
    )

    def weigh(task, model, *rest):
        shares = {kind: 0.5 if kind == mass else 1.0 for kind in model.kinds}
        return {
            kind: EffectSupport(rivals=(), inclusion=share, support=share)
            for kind, share in shares.items()
        }

    monkeypatch.setattr(tracing, "weigh", weigh)
    monkeypatch.setattr(tracing, "_improved", lambda search, model: other)
    monkeypatch.setattr(tracing.moves, "one_less", lambda search, model: {})
    evidence = dict.fromkeys((tilt, mass, thrust), 1.0)
    monkeypatch.setattr(tracing, "_evidence_of", lambda *rest: evidence)
    for better, expected in ((other, other), (None, left)):
        worth = {(id(better), id(start))}
        monkeypatch.setattr(
            search,
            "prefers",
            lambda own, than, worth=worth: (id(own), id(than)) in worth,
        )
        model, *_ = tracing._supported(search, start, np.random.default_rng(0))
        assert model is expected


def test_of_what_few_draws_support_the_least_is_doubted(monkeypatch):
    """That of least evidence, though more of them support it."""
    tilt, mass = "frame_tilt", "mass"
    search, plate = search_among(KINDS[tilt](angle=0.02), tilt, mass)
    start = kinds_fitted(search, plate, tilt, mass)
    asked = []

    def weigh(task, model, *rest):
        shares = {tilt: 0.8, mass: 0.5} if not asked else {mass: 1.0}
        asked.append(model.kinds)
        return {
            kind: EffectSupport(rivals=(), inclusion=share, support=share)
            for kind, share in shares.items()
        }

    monkeypatch.setattr(tracing, "weigh", weigh)
    monkeypatch.setattr(tracing, "_improved", lambda search, model: model)
    monkeypatch.setattr(tracing.moves, "one_less", lambda search, model: {})
    monkeypatch.setattr(tracing, "_evidence_of", lambda *rest: {tilt: 19.0, mass: 20.0})
    tracing._supported(search, start, np.random.default_rng(0))
    assert asked == [(tilt, mass), (mass,)]


def test_draws_that_choose_what_is_no_rival_count_against_an_effect(monkeypatch):
    """As is what does worse by more than a rival may on the flights at hand."""
    offered = types.SimpleNamespace(variants={"right": [(0,)], "other": [(1,)]})

    class Drawn:
        """Evidence of two effects; draws with a flight twice prefer the other."""

        def __init__(self, counts):
            self.value = np.array([30.0, 20.0] if counts[0] == 1.0 else [10.0, 30.0])
            if counts[0] == 0.0:
                self.value = self.value[::-1]

        def extended(self, chosen, more):
            sets = [[*chosen, *variant] for variant in more]
            return [float(self.value[own].max(initial=0.0)) for own in sets]

        def step(self, chosen):
            return np.zeros(len(chosen))

    def chances(candidates, grams, counts):
        return Scorer(offered, Drawn(counts), lambda kind, kinds: 4.0)

    drag = KINDS["profile_drag"](cd0=0.05)
    task, noise = task_of(fly(drag, flights=3))
    task = dataclasses.replace(task, kinds=())
    model = dataclasses.replace(begin(task, noise), kinds=("right",))
    monkeypatch.setattr(support, "scorer_of", chances)
    found = weigh(task, model, np.random.default_rng(0))["right"]
    assert found.rivals == ()
    assert found.support == found.inclusion
    assert found.support == pytest.approx(20.0 / 27.0, abs=0.1)  # Drawn once at most.


def test_the_only_effect_need_only_be_likelier_than_none():
    """Beside others, free ones too, it has to bring more."""
    task, noise = task_of(fly(flights=3))
    model = begin(task, noise)
    candidates = gather(dataclasses.replace(task, kinds=("mass", "thrust")), model)
    score = scorer_of(candidates, candidates.grams(model.scales), np.ones(3))
    everything = np.log(len(task.vehicle.kinds))  # Offered or not.
    assert score.penalty("mass", ("mass",)) == pytest.approx(everything)
    for other in ("thrust", "drag over alpha"):
        assert score.penalty("mass", ("mass", other)) == EVIDENCE_THRESHOLD
    alone = dataclasses.replace(model, kinds=("mass",), cost=0.0)
    both = dataclasses.replace(alone, kinds=("mass", "thrust"))
    search = Search(task, silent)
    assert search.penalized_cost(alone) == pytest.approx(everything)
    assert search.penalized_cost(both) == 2.0 * EVIDENCE_THRESHOLD


def test_without_effects_there_is_nothing_to_weigh():
    task, noise = task_of(fly(flights=2, duration=0.3))
    assert weigh(task, begin(task, noise), np.random.default_rng(0)) == {}


def test_what_is_not_free_has_no_standard_error():
    drag = KINDS["profile_drag"](cd0=0.05)
    _, task, model = weighed(drag, "profile_drag", offered=("profile_drag",), flights=3)
    known = uncertainty_of(task, model)
    index = task.space.index
    assert 0.0 < known.std(index["profile_drag.cd0"]) < 0.005
    assert np.isnan(known.std(index["wind.x"]))
    matrix, _ = known.covariance
    assert matrix.shape == (1, 1)
    assert matrix[0, 0] == pytest.approx(known.std(index["profile_drag.cd0"]) ** 2)


def test_an_effect_in_doubt_is_resampled_more_often():
    """Of 25 draws the share is known to 0.07: that settles all and none only."""

    def settled(support, draws):
        found = EffectSupport(rivals=(), inclusion=0.0, support=support)
        return found.is_settled(draws)

    assert settled(1.0, 25) and settled(0.6, 25)
    assert not settled(0.92, 25) and not settled(0.76, 25)
    assert settled(0.92, 200) and settled(0.76, 200)
