"""Flights held out in folds: a real effect holds there, an idle one does not."""

import dataclasses

import numpy as np
import pytest

from glider.physics.effects import KINDS
from glider.sysid.fit.folds import FOLDS, LEAST_T, HeldOut, hold_out, robust_t
from glider.sysid.likelihood.model_fit import fit_model
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


def test_ratios_are_of_root_mean_squares_over_all_flights():
    free = np.array([[3.0, 1.0], [4.0, 2.0]])
    along = np.array([[1.0, 2.0], [1.0, 2.0]])
    held = HeldOut(folds=(), gain=np.zeros(2), free=free, along=along)
    assert held.ratios == pytest.approx((np.sqrt(5.0 / 25.0), 2.0))


def held_out(campaign, *kinds):
    task, noise = task_of(campaign)
    plate = fit_model(task, begin(task, noise))
    model = fit_model(task, begin(task, noise, kinds))
    return task, hold_out(task, plate, model, model.scales, np.random.default_rng(0))


def test_a_planted_effect_holds():
    drag = KINDS["profile_drag"](cd0=0.05)
    task, held = held_out(fly(drag, flights=7), "profile_drag")
    assert held.t > 5.0
    assert np.all(held.gain > 0.0)
    assert max(held.ratios) < 0.3
    assert len(held.folds) == FOLDS
    names = sorted(name for fold in held.folds for name in fold.held_out)
    assert names == sorted(record.name for record in task.records)
    for fold in held.folds:
        assert fold.corrected.position_rms_m < 0.5 * fold.refitted.position_rms_m


def test_what_the_plates_own_numbers_do_holds_against_the_nominal_glider_alone():
    campaign = fly(KINDS["mass"](change=0.1), flights=7)
    task, noise = task_of(campaign)
    drawn = fit_model(task, begin(task, noise))
    plate = fit_model(task, dataclasses.replace(drawn, free=task.vehicle.own))
    model = fit_model(task, begin(task, noise, ("mass",)))
    rng = np.random.default_rng(0)
    held = hold_out(task, plate, model, model.scales, rng, drawn)
    assert held.t_over_nominal > 5.0
    assert held.t > -LEAST_T  # Of four numbers it needs one.
    assert held.over_nominal.mean() > 10.0 * held.gain.mean()
    assert hold_out(task, plate, model, model.scales, rng).t_over_nominal is None


def test_an_idle_effect_does_not():
    _, held = held_out(fly(flights=10), "profile_drag", "pitch_damping")
    assert held.t < 2.0
    assert np.abs(held.gain).max() < 20.0
    assert min(held.ratios) > 0.9 and max(held.ratios) < 1.3
