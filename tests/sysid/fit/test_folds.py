"""Flights held out in folds: a real effect holds there, an idle one does not."""

import dataclasses

import numpy as np
import pytest

from glider.physics.effects import KINDS
from glider.sysid.constants import FOLDS
from glider.sysid.fit import folds
from glider.sysid.fit.folds import WAYS, Gains, HeldOut, hold_out
from glider.sysid.likelihood.model_fit import fit_model
from glider.sysid.search.support import Nearby
from tests.helpers.tasks import begin, fly, task_of


def test_t_is_students_where_gains_are_alike():
    gains = np.random.default_rng(0).normal(1.0, 0.5, 40)
    t = gains.mean() / (gains.std(ddof=1) / np.sqrt(40))
    assert robust_t(gains) == pytest.approx(t, rel=0.05)
    assert robust_t(-gains) == pytest.approx(-robust_t(gains))


def test_one_flight_does_not_decide():
    gains = np.random.default_rng(0).normal(-0.5, 0.5, 20)
    assert robust_t(gains) < -2.0
    gains[3] = 1e4
    assert gains.mean() > 100.0
    assert robust_t(gains) < -2.0


def test_noise_is_seldom_significant():
    rng = np.random.default_rng(1)
    t = np.array([robust_t(rng.normal(size=25)) for _ in range(400)])
    assert abs(t.mean()) < 0.2
    assert 0.8 < t.std() < 1.3
    assert np.mean(t > 2.0) < 0.06


def test_of_one_flight_nothing_is_known():
    assert robust_t(np.array([30.0])) == 0.0


def test_losses_are_logarithms_of_ratios_of_flights_in_a_way():
    free = np.array([[3.0, 1.0], [4.0, 2.0]])
    along = np.array([[1.0, 2.0], [1.0, 2.0]])
    gain = Gains(values=np.zeros(2))
    paths = np.stack([free, along], axis=2)
    held = HeldOut(folds=(), gain=gain, paths=by_name(paths))
    assert held.lost("freely").values == pytest.approx(-np.log([3.0, 2.0]))
    assert held.lost("along the measured pitch").values == pytest.approx(np.log(2.0))
    # A flight on which both diverge counts for neither; one alone, for that one.
    lost = dataclasses.replace(held, paths=by_name(with_flight(paths, np.nan, np.inf)))
    assert len(lost.lost("freely").values) == 2
    lost = dataclasses.replace(held, paths=by_name(with_flight(paths, 1.0, np.nan)))
    assert len(lost.lost("freely").values) == 3
    assert lost.lost("freely").values.max() > 5.0


def test_the_median_flight_is_held_against_a_model_of_choice():
    """However far the others are off."""
    flights = np.ones((3, 3, 2))
    flights[:, 0, 0], flights[:, 2, 0] = [1.0, 2.0, 9.0], [1.1, 2.6, 0.1]
    models = "nominal", "refitted", "corrected"
    gain = Gains(values=np.zeros(3))
    held = HeldOut(folds=(), gain=gain, paths=by_name(flights, models))
    assert held.over_median("nominal") == pytest.approx(1.1)
    assert held.over_median("refitted") == pytest.approx(1.1)
    assert held.lost("freely", "nominal").values[1] == pytest.approx(np.log(1.3))


def by_name(paths, models=("refitted", "corrected")):
    """Paths of flights (F, models, 2) as `HeldOut` has them."""
    return {k: dict(zip(models, own, strict=True)) for k, own in enumerate(paths)}


def with_flight(paths, baseline, corrected):
    """A flight more, of such errors of free rollouts."""
    return np.vstack([paths, [[[baseline, 1.0], [corrected, 2.0]]]])


def robust_t(values):
    return Gains(values=values).t


def test_few_flights_need_a_larger_t():
    """Student's t of so many flights, not of infinitely many."""
    assert Gains(values=np.ones(3)).least_t == pytest.approx(4.303, abs=1e-3)
    assert Gains(values=np.ones(40)).least_t == pytest.approx(2.023, abs=1e-3)
    assert Gains(values=np.ones(1)).least_t == np.inf
    rng = np.random.default_rng(3)
    passed = [
        Gains(values=values).are_significant for values in rng.normal(size=(2000, 4))
    ]
    assert np.mean(passed) < 0.05


def test_a_flight_that_no_model_flies_changes_no_gain():
    values = 5.0 + 0.1 * np.sin(np.arange(9))
    assert Gains(values=np.append(values, np.nan)).are_significant


def held_out(campaign, *kinds):
    task, noise = task_of(campaign)
    plate = fit_model(task, begin(task, noise))
    model = fit_model(task, begin(task, noise, kinds))
    return task, hold_out(task, plate, model, model.scales, np.random.default_rng(0))


def test_a_planted_effect_holds():
    drag = KINDS["profile_drag"](cd0=0.05)
    task, held = held_out(fly(drag, flights=7), "profile_drag")
    assert held.gain.t > 5.0 and held.gain.are_significant
    assert np.all(held.gain.values > 0.0)
    assert max(held.lost("freely").values) < -1.0
    assert max(held.lost("along the measured pitch").values) < 0.0
    assert len(held.folds) == FOLDS
    names = sorted(name for fold in held.folds for name in fold.held_out)
    assert names == sorted(record.name for record in task.records)
    for fold in held.folds:
        assert fold.corrected.position_rms_m < 0.5 * fold.refitted.position_rms_m


def test_each_fold_is_flown_by_models_made_without_it(monkeypatch):
    flown = []
    compare = folds.compare
    monkeypatch.setattr(folds, "compare", lambda own: flown.append(own) or compare(own))
    task, _ = held_out(fly(KINDS["profile_drag"](cd0=0.05), flights=7), "profile_drag")
    index = task.space.index["profile_drag.cd0"]
    found = [own["corrected"][0].theta[index] for own in flown]
    assert len({*found}) == FOLDS and np.ptp(found) < 0.01
    assert len({own["corrected"][0].scales for own in flown}) == 1


def test_costs_of_unseen_flights_are_by_their_predictive_distribution():
    """What their evidence adds to that of the others, by linear models' closed form."""
    task, noise = task_of(fly(KINDS["profile_drag"](cd0=0.05), flights=6))
    model = fit_model(task, begin(task, noise, ("profile_drag", "camber")))
    refit = folds._Refits(task, model, is_searched=False)
    counts = np.array([1.0, 1.0, 1.0, 1.0, 1.0, 0.0])

    def evidence(counts):
        total = refit.prior.added_to(np.tensordot(counts, refit.grams, 1))
        a, b = total[:-1, :-1], total[:-1, -1]
        least = total[-1, -1] - b @ np.linalg.solve(a, b)
        return counts @ refit.constant + 0.5 * (least + np.linalg.slogdet(a)[1])

    _, [cost] = refit.on(counts, np.array([5]))
    expected = evidence(np.ones(6)) - evidence(counts)
    assert cost == pytest.approx(expected, abs=1e-3)


def test_a_fold_is_fitted_to_its_own_flights_where_a_shape_is_free():
    """One step along a stall's angle and width may overshoot: shorter ones follow."""
    stall = KINDS["attached_lift"](slope=2.5, stall_angle=0.3, fade=0.1)
    task, noise = task_of(fly(stall, flights=6))
    model = fit_model(task, begin(task, noise, ("attached_lift",)))
    refit = folds._Refits(task, model, is_searched=True)
    counts = np.array([1.0, 1.0, 1.0, 0.0, 0.0, 0.0])
    found, costs = refit.on(counts, np.array([3, 4, 5]))
    assert found.kinds == ("attached_lift",) and np.all(np.isfinite(costs))
    few = task.on(task.records[:3])
    start = fit_model(few, refit.model, iterations=0, free_scales=())
    assert found.cost < start.cost - 1.0
    assert np.abs(found.theta - model.theta).max() > 1e-4


def test_a_fold_of_a_glider_of_unknown_mass_frees_nothing_that_was_fixed():
    """As the moment of a model of the forces, if another set is found in the fold."""
    unknown = dataclasses.replace(fly(flights=6), vehicle={"hinge_offset": 0.27})
    task, noise = task_of(unknown)
    model = fit_model(task, begin(task, noise, ("camber",)))
    fixed = task.space.index["pitch_inertia"]
    assert fixed in model.free
    model = dataclasses.replace(model, free=tuple(i for i in model.free if i != fixed))
    refit = folds._Refits(task, model, is_searched=True)
    found, _ = refit.on(np.array([1.0] * 5 + [0.0]), np.array([5]))
    assert found.kinds != model.kinds and fixed not in found.free


@pytest.mark.nightly
def test_what_the_plates_own_numbers_do_holds_against_the_nominal_glider_alone():
    campaign = fly(KINDS["mass"](change=0.1), flights=7)
    task, noise = task_of(campaign)
    drawn = fit_model(task, begin(task, noise))
    plate = fit_model(
        task, dataclasses.replace(drawn, free=task.vehicle.baseline_slots)
    )
    model = fit_model(task, begin(task, noise, ("mass",)))
    rng = np.random.default_rng(0)
    held = hold_out(task, plate, model, model.scales, rng, nominal=drawn)
    assert held.over_nominal.are_significant
    assert held.gain.t > -held.gain.least_t  # Of four parameters it needs one.
    assert held.over_nominal.values.mean() > 10.0 * held.gain.values.mean()
    assert hold_out(task, plate, model, model.scales, rng).over_nominal is None


def test_an_idle_effect_does_not():
    _, held = held_out(fly(flights=10), "profile_drag", "pitch_damping")
    assert not held.gain.are_significant
    assert np.abs(held.gain.values).max() < 20.0
    assert np.median(np.abs(held.lost("freely").values)) < 0.3
    assert not held.lost("along the measured pitch").are_significant


def test_effects_are_searched_again_in_each_fold(monkeypatch):
    """A set that was chosen by chance is not there; one that is real is, each time."""
    found = []

    class Watched(Nearby):
        def best(self, counts):
            score, members = super().best(counts)
            found.append([kind for kind, _ in members])
            return score, members

    monkeypatch.setattr(folds, "Nearby", Watched)
    held_out(fly(flights=8), "pitch_moment")
    assert found == FOLDS * [[]]
    found.clear()
    held_out(fly(KINDS["profile_drag"](cd0=0.05), flights=8), "profile_drag", "camber")
    assert all("profile_drag" in kinds for kinds in found)
    assert not any("camber" in kinds for kinds in found)


def test_flights_apart_are_scored_but_not_fitted():
    drag = KINDS["profile_drag"](cd0=0.05)
    campaign = fly(drag, flights=7)
    task, noise = task_of(campaign)
    plate = fit_model(task, begin(task, noise))
    model = fit_model(task, begin(task, noise, ("profile_drag",)))
    names = [record.name for record in task.records]

    def found(apart):
        rng = np.random.default_rng(0)
        return hold_out(task, plate, model, model.scales, rng, apart)

    alone = found(names[1:])  # Nothing to search on but one flight at a time.
    assert sorted(alone.paths) == sorted(names)
    every = found(())
    assert not np.allclose(alone.gain.values, every.gain.values, rtol=0.01)
    assert np.all(np.isfinite(alone.gain.values))


@pytest.mark.parametrize("way", WAYS)
def test_a_loss_is_more_than_a_tie_and_of_flights_that_fly(way):
    gain = Gains(values=np.zeros(2))

    def held(ratios):
        paths = np.ones((len(ratios), 2, 2))
        paths[:, 1, WAYS.index(way)] = ratios
        return HeldOut(folds=(), gain=gain, paths=by_name(paths))

    rng = np.random.default_rng(0)
    assert held(1.1 + 0.01 * rng.normal(size=12)).is_worse(way)
    assert not held(1.0002 + 1e-5 * rng.normal(size=12)).is_worse(way)
    assert not held(1.1 + 0.5 * rng.normal(size=12)).is_worse(way)
    assert held(np.full(12, np.inf)).is_worse(way)
    nothing = by_name(np.full((1, 2, 2), np.nan))[0]
    both = held(np.full(2, 0.9)).paths | {7: nothing}
    assert len(HeldOut(folds=(), gain=gain, paths=both).lost(way).values) == 2
