"""Coefficients fitted to flights: right within honest standard errors."""

import dataclasses

import numpy as np
import pytest

from glider.physics.effects import KINDS
from glider.sysid.likelihood import model_fit
from glider.sysid.likelihood.filtering import (
    excludes,
    negative_log_likelihood,
    surroundings_of,
)
from glider.sysid.likelihood.linear_flight import Surroundings
from glider.sysid.likelihood.model_fit import (
    _fit_strength,
    error_flights,
    fit_model,
    in_surroundings,
)
from glider.sysid.likelihood.uncertainty import uncertainty_of
from glider.sysid.replay.record import Record
from tests.helpers.lifelike import turbulence_campaign
from tests.helpers.tasks import begin, fit_kinds, fly, task_of


def errors_of(task, model, kind, truth):
    """Returns the errors of a kind's coefficients and their standard errors."""
    slots = task.space.slots_of(kind)
    known = uncertainty_of(task, model)
    found = model.theta[list(slots)]
    return found - truth, np.array([known.std(i) for i in slots])


@pytest.fixture(scope="module")
def windy():
    return fly(KINDS["wind"](x=-0.4, z=0.1), flights=6)


@pytest.fixture(scope="module")
def fitted(windy):
    return fit_kinds(windy, "wind")


def test_wind_is_found_within_its_standard_error(fitted):
    error, std = errors_of(*fitted, "wind", [-0.4, 0.1])
    assert np.all(np.abs(error) < 4.0 * std)
    assert np.all(std < 0.01)


def test_the_truth_leaves_only_noise(fitted):
    _, model = fitted
    assert model.scales.position == pytest.approx(4e-4, rel=0.15)
    assert model.scales.air < 0.01


def test_what_acts_is_more_likely_than_the_plate_alone(windy, fitted):
    _, plate = fit_kinds(windy)
    assert fitted[1].cost < plate.cost - 50.0
    assert plate.scales.wind > 0.1  # What no model has, each flight has for itself.


def test_flights_whose_pitch_reads_wrong_are_linear_about_that():
    """The force is turned by as much as it changes: it bends the path by 20 mm."""
    one, other = (fly(KINDS["pitch_offset"](angle=a), flights=3) for a in (-0.03, 0.03))
    flights = tuple(
        dataclasses.replace(f, name=f"flight_{i:03d}.csv")
        for i, f in enumerate((*one.flights, *other.flights))
    )
    task, model = fit_kinds(dataclasses.replace(one, flights=flights))
    assert model.scales.air < 0.005 and model.scales.moment < 0.05
    assert model.scales.position < 5e-4
    zeros = [own.constants[3] for own in model.about.values()]
    np.testing.assert_allclose(zeros, [-0.03] * 3 + [0.03] * 3, atol=2e-3)

    def costs(model):
        return negative_log_likelihood(error_flights(task, model), model.scales)

    nobody = dataclasses.replace(model, about={})  # As of flights held out.
    assert np.sum(costs(nobody)) > np.sum(costs(model)) + 1000.0
    known = in_surroundings(task, nobody, error_flights(task, nobody))
    np.testing.assert_allclose(costs(known), costs(model), atol=3.0)


def test_a_fit_that_begins_at_the_truth_ends_there(windy):
    task, noise = task_of(windy)
    start = begin(task, noise, ["wind"])
    theta = start.theta.copy()
    theta[list(task.space.slots_of("wind"))] = [-0.4, 0.1]
    near = fit_model(task, dataclasses.replace(start, theta=theta))
    far = fit_model(task, start)
    assert near.cost == pytest.approx(far.cost, abs=1.0)
    np.testing.assert_allclose(near.theta, far.theta, atol=2e-3)


def test_a_shape_is_fitted_from_its_first_guess():
    campaign = fly(KINDS["servo_lag"](time_constant=0.033), flights=4)
    task, model = fit_kinds(campaign, "servo_lag")
    error, std = errors_of(task, model, "servo_lag", [0.033])
    assert abs(error[0]) < 4.0 * std[0] < 0.002


def test_scales_may_be_kept(windy):
    task, noise = task_of(windy)
    start = begin(task, noise, ["wind"])
    model = fit_model(task, start, free_scales=())
    assert model.scales == start.scales
    assert model.theta[task.space.slots_of("wind")[0]] == pytest.approx(-0.4, abs=0.1)


def test_what_is_known_beforehand_pulls(windy):
    """A wing area that is known to a millionth is not taken from the flights."""
    known = {k: v for k, v in windy.vehicle.items() if k != "wing_area"}
    known["wing_area"] = 1.1 * windy.vehicle["wing_area"]
    task, noise = task_of(dataclasses.replace(windy, vehicle=known))
    slot = task.space.index["wing_area"]
    told = task.vehicle.theta[slot]
    for spread, lowest, highest in ((1e-8, 0.999, 1.001), (0.05, 0.85, 0.95)):
        vehicle = dataclasses.replace(task.vehicle, nuisance={slot: spread})
        held = dataclasses.replace(task, vehicle=vehicle)
        model = fit_model(held, begin(held, noise, ["wind"]))
        assert lowest < model.theta[slot] / told < highest


def with_gap(campaign, rows):
    first, *others = campaign.flights
    keep = np.ones(len(first.time), dtype=bool)
    keep[rows] = False
    cut = dataclasses.replace(
        first,
        time=first.time[keep],
        pose=first.pose[keep],
        elevator=first.elevator[keep],
        command=first.command[keep],
    )
    return dataclasses.replace(campaign, flights=(cut, *others))


def test_forty_missing_rows_change_no_coefficient():
    campaign = fly(KINDS["profile_drag"](cd0=0.05), flights=2)
    whole = fit_kinds(campaign, "profile_drag")
    gapped = fit_kinds(with_gap(campaign, slice(30, 70)), "profile_drag")
    (before,), (std,) = errors_of(*whole, "profile_drag", [0.05])
    (after,), (wider,) = errors_of(*gapped, "profile_drag", [0.05])
    assert abs(before) < 4.0 * std and abs(after) < 4.0 * wider
    assert abs(after - before) < 3.0 * wider
    assert std < wider * 1.2  # Fewer rows tell no more.


def test_rows_that_nobody_saw_may_hold_anything():
    """Poses of unseen rows do not get into a fit."""
    campaign = with_gap(fly(KINDS["profile_drag"](cd0=0.05), flights=2), slice(30, 70))
    task, noise = task_of(campaign)

    def spoilt(record: Record) -> Record:
        pose = np.where(record.seen[:, :3], record.pose, 1e3)
        return dataclasses.replace(record, pose=pose)

    start = begin(task, noise, ["profile_drag"])
    other = task.on([spoilt(record) for record in task.records])
    results = [fit_model(t, start, iterations=2) for t in (task, other)]
    np.testing.assert_array_equal(results[0].theta, results[1].theta)


@pytest.mark.nightly
def test_standard_errors_cover_over_campaigns():
    """Over campaigns the error in standard errors has a spread near one."""
    scores = []
    for seed in range(12):
        campaign = fly(KINDS["profile_drag"](cd0=0.05), seed=seed, flights=5)
        task, model = fit_kinds(campaign, "profile_drag")
        (error,), (std,) = errors_of(task, model, "profile_drag", [0.05])
        scores.append(error / std)
    assert 0.4 < np.sqrt(np.mean(np.square(scores))) < 1.8


@pytest.mark.filterwarnings("ignore::RuntimeWarning")
def test_a_model_that_blows_up_is_never_the_best(windy):
    task, noise = task_of(windy)
    start = begin(task, noise, ["wind"])
    theta = start.theta.copy()
    theta[list(task.space.slots_of("wind"))] = 1e160
    lost = fit_model(task, dataclasses.replace(start, theta=theta))
    assert lost.cost == np.inf
    freed = dataclasses.replace(with_drag(task, start), theta=theta, cost=0.0)
    assert _fit_strength(task, freed).cost == np.inf


def with_drag(task, model, strength=1.0):
    """The model with a free function of drag, zero so far."""
    function = task.functions["drag over alpha"]
    own = dataclasses.replace(function, strength=strength)
    return dataclasses.replace(model, kinds=(function.name,), functions=(own,))


def test_the_cost_of_other_strengths_is_that_of_a_refit():
    task, noise = task_of(fly(KINDS["induced_drag"](k=0.03), flights=4))
    model = fit_model(task, with_drag(task, begin(task, noise), 5.0), iterations=15)
    other = _fit_strength(task, model)
    assert other.functions[0].strength < 4.0
    before = fit_model(task, model, iterations=0, free_scales=())
    again = fit_model(task, other, free_scales=())
    assert again.cost - before.cost > 5.0
    change = other.cost - model.cost
    assert change == pytest.approx(again.cost - before.cost, rel=0.1)


def test_the_cost_of_other_strengths_is_that_of_the_model_beside_a_shape():
    """A stall's angle and width moved with the strengths, and flights were far off."""
    stall = KINDS["attached_lift"](slope=2.5, stall_angle=0.3, fade=0.1)
    task, noise = task_of(fly(stall, flights=6))
    start = begin(task, noise, ("attached_lift",))
    function = task.functions["lift over alpha"]
    own = dataclasses.replace(function, strength=2.0)
    kinds = (*start.kinds, function.name)
    start = dataclasses.replace(start, kinds=kinds, functions=(own,))
    model = fit_model(task, start, 2, with_strength=True)
    real = fit_model(task, model, iterations=0, free_scales=())
    assert model.cost == pytest.approx(real.cost, abs=6.0)


# ------------------------------------------------------------------- surroundings


@pytest.fixture(scope="module")
def rough():
    """Flights in turbulence whose pitch reads wrong, each by its own."""
    campaign, _ = turbulence_campaign(2, flights=8)
    offsets = np.random.default_rng(0).normal(0.0, 0.03, size=8)
    flights = tuple(
        dataclasses.replace(f, pose=f.pose + np.array([0.0, 0.0, own]))
        for f, own in zip(campaign.flights, offsets, strict=True)
    )
    task, noise = task_of(dataclasses.replace(campaign, flights=flights))
    return task, noise, fit_model(task, begin(task, noise))


def test_linearization_about_smoothed_surroundings_converges(rough, monkeypatch):
    """A fit from its own result stays; about still air it is another problem."""
    task, noise, model = rough
    assert model.scales.air > 0.05 and model.scales.pitch_zero > 0.015
    again = fit_model(task, model)
    assert again.cost == pytest.approx(model.cost, abs=1.0)
    gusts = np.concatenate([own.gusts for own in model.about.values()])
    assert np.std(gusts) > 0.3 * model.scales.air
    monkeypatch.setattr(
        model_fit, "in_surroundings", lambda task, model, flights: model
    )
    still = fit_model(task, begin(task, noise))
    monkeypatch.undo()
    there = in_surroundings(task, still, error_flights(task, still))
    after = fit_model(task, there)
    assert abs(after.cost - still.cost) > 10.0


def test_fits_from_different_starts_end_at_the_same_cost(rough):
    task, noise, _ = rough
    start = begin(task, noise, ["profile_drag"])
    theta = start.theta.copy()
    theta[list(task.space.slots_of("profile_drag"))] = 0.2
    far = dataclasses.replace(start, theta=theta)
    costs = [fit_model(task, own).cost for own in (start, far)]
    assert costs[0] == pytest.approx(costs[1], abs=1.0)


def test_a_fit_leaves_surroundings_that_its_scales_exclude(windy, monkeypatch):
    """Those of a model without a wind: what is best there is wrong, and looked best."""
    task, model = fit_kinds(windy, "wind", "position_scale", "elevator_trim")
    there = Surroundings(np.array([-0.32, -0.15, 0.02, 0.02]))
    assert excludes(model.scales, there)
    assert not any(excludes(model.scales, own) for own in model.about.values())
    start = dataclasses.replace(model, about=dict.fromkeys(model.about, there))
    with monkeypatch.context() as patch:
        patch.setattr(model_fit, "excludes", lambda scales, about: False)
        patch.setattr(model_fit, "in_surroundings", lambda task, model, flights: model)
        wrong = fit_model(task, start)
    assert wrong.cost > model.cost + 50.0
    assert fit_model(task, wrong).cost == pytest.approx(model.cost, abs=0.5)


def test_flights_are_linear_about_gusts_that_scales_allow(rough):
    task, _, model = rough
    calm = dataclasses.replace(model.scales, air=0.01)
    found = surroundings_of(error_flights(task, model), calm)
    gusts = np.concatenate([own.gusts for own in found.values()])
    assert np.abs(gusts).max() == pytest.approx(0.03)


def test_the_volume_of_the_prior_that_effects_do_not_fill_counts_against_them():
    """Cost and freedom are the evidence of a set that is linear: ½ log |A| / |Λ|."""
    task, noise = task_of(fly(KINDS["profile_drag"](cd0=0.05), flights=4))
    model = fit_model(task, begin(task, noise, ("profile_drag", "wind")))
    assert _fit_strength(task, begin(task, noise)).freedom == 0.0
    known = uncertainty_of(task, model)
    slots = [s for k in model.kinds for s in task.space.slots_of(k)]
    places = [known.free.index(slot) for slot in slots]
    own = known.likelihood[np.ix_(places, places)]
    spreads = task.priors(slots, model.theta)[1] ** -0.5
    expected = np.log(spreads).sum() - 0.5 * np.linalg.slogdet(own)[1]
    assert _fit_strength(task, model).freedom == pytest.approx(expected, rel=1e-4)
    assert expected > 6.0
