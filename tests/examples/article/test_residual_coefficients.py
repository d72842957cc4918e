"""Lesson 3: coefficients of flights, and a residual that the plant flies."""

import numpy as np
import pytest

import residual_coefficients
from glider.campaign.motion_capture import MotionCapture
from glider.physics.model import GliderModel
from glider.simulation.campaigns import CampaignPlan
from glider.systems.plant import GliderPlant
from residual_coefficients import (
    features,
    fit_residual,
    gaussian_grid,
    glider_with,
    plate_at,
    residual_at,
    samples_of,
)

PLATE = GliderModel()
SPEEDS = np.linspace(3.0, 8.0, 5)


def test_the_articles_grid_has_26_functions_and_126_with_airspeed():
    small, large = gaussian_grid(), gaussian_grid(SPEEDS)
    assert small.weights.shape == (26, 3)
    assert large.weights.shape == (126, 3)
    np.testing.assert_allclose(small.centers.min(axis=0), [0.0, -np.pi / 4])
    np.testing.assert_allclose(small.centers.max(axis=0), [np.pi, np.pi / 4])
    aside = small.centers[:1] + np.array([np.sqrt(0.1), 0.0])
    psi = features(aside, small.centers, small.widths)[0]
    assert psi[0] == pytest.approx(np.exp(-0.5))
    assert psi[-1] == 1.0


def test_a_plate_has_the_article_s_coefficients():
    """2 sin α cos α and 2 sin² α, without a tail."""
    tailless = GliderModel()
    object.__setattr__(tailless.parameters, "elevator_area", 1e-12)
    alpha = np.linspace(0.1, 2.0, 9)
    still = np.zeros_like(alpha)
    values = plate_at(np.column_stack([alpha, still, still + 6.0]), tailless)
    expected = np.column_stack([np.sin(2.0 * alpha), 2.0 * np.sin(alpha) ** 2, still])
    np.testing.assert_allclose(values, expected, atol=1e-6)


@pytest.mark.parametrize("speeds", [None, SPEEDS], ids=["26", "126"])
def test_the_plant_flies_the_coefficients_that_were_fitted(speeds):
    rng = np.random.default_rng(2)
    grid = gaussian_grid(speeds)
    residual = grid._replace(weights=rng.normal(size=grid.weights.shape))
    plate, learned = GliderPlant(PLATE), GliderPlant(glider_with(residual, PLATE))
    for _ in range(5):
        state = rng.normal(size=7) * [1.0, 1.0, 0.5, 0.3, 1.0, 1.0, 1.0]
        state[4] += 6.0
        alpha = np.arctan2(-state[5], state[4]) - state[2]
        values = np.array([[alpha, state[3], np.hypot(state[4], state[5])]])
        added = coefficients_in(learned, state) - coefficients_in(plate, state)
        np.testing.assert_allclose(added, residual_at(residual, values)[0], atol=1e-6)


def coefficients_in(plant, state):
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


def test_a_residual_that_was_flown_is_found_again(monkeypatch):
    """Flights of a glider with known weights give its coefficients back."""
    capture = MotionCapture(position=1e-5, pitch=1e-4, elevator=1e-4)
    monkeypatch.setattr(residual_coefficients, "CAPTURE", capture)
    rng = np.random.default_rng(5)
    grid = gaussian_grid()
    weights = np.zeros((26, 3))
    weights[:, 0] = rng.uniform(-0.3, 0.3, 26)
    weights[:, 1] = rng.uniform(0.0, 0.1, 26)
    true = grid._replace(weights=weights)
    plan = CampaignPlan(flights=10, capture=capture)
    campaign = plan.simulate(glider_with(true, PLATE), rng)
    samples = samples_of(campaign.flights, PLATE)
    found = fit_residual(samples, grid)
    expected, learned = (residual_at(own, samples.variables) for own in (true, found))
    lacking = np.mean(np.abs(expected), axis=0)
    error = np.median(np.abs(learned - expected), axis=0)
    assert np.all(error[:2] < 0.2 * lacking[:2])


@pytest.mark.nightly
def test_a_residual_is_worth_something_in_held_out_flights():
    found = residual_coefficients.main([])
    told = found["Held-out flights, position, the same (RMS)"]
    plate, small, large = (float(own.split()[0]) for own in told.split(", "))
    assert small < 0.5 * plate
    assert large < 0.5 * small
    assert found["Weights of a coefficient"] == "26 and 126"
