"""Flights held out in folds: a real effect holds there, an idle one does not."""

import dataclasses

import numpy as np
import pytest

from glider.physics.effects import KINDS
from glider.progress import silent
from glider.sysid.constants import FOLDS
from glider.sysid.fit import folds
from glider.sysid.fit.folds import Gains, hold_out
from glider.sysid.likelihood.candidates import gather_in_parts
from glider.sysid.likelihood.filtering import negative_log_likelihood
from glider.sysid.likelihood.information import counted_from
from glider.sysid.likelihood.model_fit import error_flights, fit_model, in_surroundings
from glider.sysid.search.moves import Search
from glider.sysid.search.subsets import near_sets
from glider.sysid.search.tracing import without_late
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
    score = Search(without_late(task, kinds), silent).near(model)
    near, _ = near_sets(score, score.by_first(kinds))
    offered = task.offering(near)
    return hold_out(offered, model, {"refitted": plate}, np.random.default_rng(0))


def test_a_planted_effect_holds():
    drag = KINDS["profile_drag"](cd0=0.05)
    held = held_out(fly(drag, flights=7), "profile_drag")
    gain = held.gains["refitted"]
    assert held.inclusion("profile_drag") == 1.0 and len(held.chosen) == FOLDS
    assert gain.t > 5.0 and gain.are_significant
    assert np.all(gain.values > 0.0)


def test_costs_of_unseen_flights_are_by_their_predictive_distribution():
    """What their evidence adds to that of the others, by linear models' closed form."""
    task, noise = task_of(fly(KINDS["profile_drag"](cd0=0.05), flights=6))
    model = fit_model(task, begin(task, noise, ("profile_drag", "camber")))
    model = in_surroundings(task, model, error_flights(task, model))
    candidates, grams = gather_in_parts(task.offering(()), model, model.scales)
    given, prior = candidates.nothing()
    about_model = counted_from(grams, -given)
    now = negative_log_likelihood(error_flights(task, model), model.scales)
    constant = now - 0.5 * about_model[:, -1, -1]
    counts = np.array([1.0, 1.0, 1.0, 1.0, 1.0, 0.0])

    def evidence(counts):
        all_flights = np.tensordot(counts, grams, 1)
        total = prior.added_to(all_flights)
        a, b = total[:-1, :-1], total[:-1, -1]
        least = total[-1, -1] - b @ np.linalg.solve(a, b)
        return counts @ constant + 0.5 * (least + np.linalg.slogdet(a)[1])

    linear = folds.LinearFlights(task.offering(()), model)
    costs = linear.costs([np.array([5])], [range(len(prior.mean))])
    expected = evidence(np.ones(6)) - evidence(counts)
    assert costs[5] == pytest.approx(expected, abs=1e-3)


@pytest.mark.nightly
def test_what_the_plates_own_numbers_do_holds_against_the_nominal_glider_alone():
    campaign = fly(KINDS["mass"](change=0.1), flights=7)
    task, noise = task_of(campaign)
    drawn = fit_model(task, begin(task, noise))
    plate = fit_model(
        task, dataclasses.replace(drawn, free=task.vehicle.baseline_slots)
    )
    model = fit_model(task, begin(task, noise, ("mass",)))
    others = {"refitted": plate, "nominal": drawn}
    gains = hold_out(task, model, others, np.random.default_rng(0)).gains
    over_plate = gains["refitted"]
    over_nominal = gains["nominal"]
    assert over_nominal.are_significant
    assert over_plate.t > -over_plate.least_t  # Of four parameters it needs one.
    assert over_nominal.values.mean() > 10.0 * over_plate.values.mean()


def test_an_idle_effect_does_not():
    held = held_out(fly(flights=10), "profile_drag", "pitch_damping")
    assert held.inclusion("profile_drag") < 0.5
    gain = held.gains["refitted"]
    assert not gain.are_significant
    assert np.abs(gain.values).max() < 20.0


def test_effects_are_searched_again_in_each_fold():
    """A set that was chosen by chance is not there; one that is real is, each time."""
    assert held_out(fly(flights=8), "pitch_moment").chosen == FOLDS * [set()]
    drag = fly(KINDS["profile_drag"](cd0=0.05), flights=8)
    chosen = held_out(drag, "profile_drag", "camber").chosen
    assert all("profile_drag" in kinds for kinds in chosen)
    assert not any("camber" in kinds for kinds in chosen)
