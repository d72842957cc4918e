"""The learned residual of C_L, C_D and C_M: found, flown, and worth something."""

import dataclasses

import numpy as np
import pytest

from coefficients import (
    basis_values,
    coefficient_data,
    corrected_coefficients,
    residual_basis,
)
from glider.campaign.motion_capture import MotionCapture
from glider.campaign.reader import load_campaign
from glider.errors import InputError
from glider.physics.effects.free_functions import COEFFICIENTS
from glider.physics.model import GliderModel
from glider.simulation.campaigns import CampaignPlan
from glider.sysid.replay.record import measure_noise, prepare
from glider.sysid.replay.replayed import make_table
from glider.sysid.replay.vehicle import make_vehicle
from glider.systems.plant import GliderPlant
from residual_study import learn_residuals
from tests.helpers.campaigns import campaign_path

FINE_CAPTURE = MotionCapture(position=1e-5, pitch=1e-4, elevator=1e-4)


def coefficients_of(plant, state):
    """Returns C_L, C_D, C_M of a plant's forces, elevator at rest."""
    context = plant.CreateDefaultContext()
    context.SetContinuousState(state)
    plant.GetInputPort("elevator_rate").FixValue(context, [0.0])
    _, _, x, z, moment = plant.GetOutputPort("forces").Eval(context)
    p, (xdot, zdot) = plant.model.parameters, state[4:6]
    speed = np.hypot(xdot, zdot)
    pressure = 0.5 * p.air_density * speed**2 * p.wing_area
    lift, drag = (z * xdot - x * zdot) / speed, -(x * xdot + z * zdot) / speed
    return np.array([lift, drag, moment]) / pressure


@pytest.mark.parametrize("speeds", [None, (3.0, 8.0)], ids=["26", "126"])
def test_the_plant_flies_the_coefficients_that_were_fitted(speeds):
    rng = np.random.default_rng(2)
    basis = residual_basis(speeds)
    count = len(basis.centers) + 1
    weights = {name: rng.normal(size=count).tolist() for name in COEFFICIENTS}
    field = dataclasses.replace(basis, weights=weights)
    plate, learned = GliderPlant(), GliderPlant(GliderModel(free_functions=(field,)))
    for _ in range(5):
        state = rng.normal(size=7) * [1.0, 1.0, 0.5, 0.3, 1.0, 1.0, 1.0]
        state[4] += 6.0
        xdot, zdot = state[4:6]
        variables = {
            "alpha": np.array([np.arctan2(-zdot, xdot) - state[2]]),
            "elevator": state[3:4],
            "V": np.array([np.hypot(xdot, zdot)]),
        }
        expected = basis_values(field, variables) @ np.array(list(weights.values())).T
        added = coefficients_of(learned, state) - coefficients_of(plate, state)
        np.testing.assert_allclose(added, expected[0], atol=1e-6)


def test_the_articles_basis_has_26_functions_and_126_with_airspeed():
    small, large = residual_basis(), residual_basis((2.0, 8.0))
    rows = {name: np.zeros(1) for name in ("alpha", "elevator", "V")}
    assert basis_values(small, rows).shape == (1, 26)
    assert basis_values(large, rows).shape == (1, 126)
    assert basis_values(small, rows)[0, -1] == 1.0
    centers = np.array(small.centers)
    np.testing.assert_allclose(centers.min(axis=0), [0.0, -np.pi / 4])
    np.testing.assert_allclose(centers.max(axis=0), [np.pi, np.pi / 4])
    at_center = {"alpha": centers[:1, 0], "elevator": centers[:1, 1]}
    assert basis_values(small, at_center)[0, 0] == 1.0
    one_off = {"alpha": centers[:1, 0] + np.sqrt(0.1), "elevator": centers[:1, 1]}
    assert basis_values(small, one_off)[0, 0] == pytest.approx(np.exp(-0.5))


def test_a_residual_that_was_flown_is_found_again():
    """Flights of a glider with known weights give its coefficients back."""
    rng = np.random.default_rng(5)
    weights = {name: [0.0] * 26 for name in COEFFICIENTS}
    weights["c_lift"] = rng.uniform(-0.3, 0.3, 26).tolist()
    weights["c_drag"] = rng.uniform(0.0, 0.1, 26).tolist()
    true = dataclasses.replace(residual_basis(), weights=weights)
    plan = CampaignPlan(flights=10, capture=FINE_CAPTURE)
    study = learn_residuals(plan.simulate(GliderModel(free_functions=(true,)), rng))
    learned = study.models["26"].residual
    expected, found = (
        corrected_coefficients(study.held_out, field) for field in (true, learned)
    )
    lacking = np.abs(expected - study.held_out.plate).mean(axis=0)
    error = np.median(np.abs(found - expected), axis=0)
    assert np.all(error[:2] < 0.2 * lacking[:2])
    plate, small = (study.models[n].errors.position_rms_m for n in ("plate", "26"))
    assert small < 0.1 * plate


def test_a_glider_that_tumbles_meets_the_angles_that_the_plant_knows():
    plan = CampaignPlan(
        flights=2,
        duration=0.4,
        launch=(-3.5, 0.1, -2.6, 0.0, 7.0, 0.0, -30.0),
        capture=FINE_CAPTURE,
    )
    campaign = plan.simulate(GliderModel(), np.random.default_rng(0))
    noise, theta = measure_noise(campaign), make_vehicle(campaign).theta
    records = prepare(campaign.flights, campaign, noise)
    turning = make_table(records, theta, [0.0, 0.0]).variables["alpha"]
    assert turning.max() > np.pi
    alpha = coefficient_data(records, theta).variables["alpha"]
    assert np.abs(alpha).max() <= np.pi
    turns = (turning - alpha) / (2.0 * np.pi)
    np.testing.assert_allclose(turns, turns.round(), atol=1e-6)


def test_speeds_must_increase():
    with pytest.raises(InputError, match="speeds are 8 and 8"):
        residual_basis((8.0, 8.0))


def test_a_vehicle_without_a_nominal_model_is_refused():
    campaign = load_campaign(campaign_path("attached_lift"), flights=["flight_000"])
    vehicle = {k: v for k, v in campaign.vehicle.items() if k != "pitch_inertia"}
    with pytest.raises(InputError, match="need all parameters"):
        learn_residuals(dataclasses.replace(campaign, vehicle=vehicle))
