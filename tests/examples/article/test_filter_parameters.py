"""Lesson 4: a cruise that is level and held, a filter that finds two numbers."""

import numpy as np
import pytest

from filter_parameters import (
    CRUISE_SPEED,
    CRUISE_START,
    CRUISE_WIND,
    PERCH_GUESS,
    cruise_gain,
    draw_wind,
    fly_cruise,
    fly_perch,
    least_deviations,
    level_flight,
    run_filter,
    slope_matrix,
    slopes,
)
from glider import GliderModel, GliderPlant, effects
from glider.paths import models_path
from glider.physics.parameters import load_parameters


def glider(name):
    return GliderModel(
        parameters=load_parameters(models_path("vehicles", f"{name}.yaml")),
        effects=(effects.THRUST(),),
    )


BEHIND, AHEAD = glider("heavy_ekf"), glider("heavy")


@pytest.fixture(scope="module")
def cruise():
    return fly_cruise(BEHIND, CRUISE_START, CRUISE_WIND, np.random.default_rng(0))


def test_the_slope_is_the_derivative():
    z = np.array([0.0, 1.0, -0.2, 0.1, 7.0, -1.0, 0.5, -0.03, 0.0147])
    inputs = np.array([1.0, 0.3, -1.0, 0.5])
    exact = slope_matrix(BEHIND, z, inputs)
    for k, unit in enumerate(1e-6 * np.eye(13)):
        up = slopes(BEHIND, z + unit[:9], inputs + unit[9:])
        down = slopes(BEHIND, z - unit[:9], inputs - unit[9:])
        np.testing.assert_allclose(exact[:, k], (up - down) / 2e-6, atol=1e-6)


def test_the_cruise_is_level_and_held(cruise):
    """The trim is that of Drake's plant; 0.5 m are gone after 4 s."""
    trim, thrust = level_flight(BEHIND)
    model = GliderModel(
        parameters=BEHIND.parameters, effects=(effects.THRUST(force=float(thrust)),)
    )
    plant = GliderPlant(model)
    context = plant.CreateDefaultContext()
    context.SetContinuousState(trim)
    plant.GetInputPort("elevator_rate").FixValue(context, [0.0])
    rates = plant.EvalTimeDerivatives(context).CopyToVector()
    np.testing.assert_allclose(rates, [CRUISE_SPEED, 0, 0, 0, 0, 0, 0], atol=1e-9)
    assert abs(cruise.states[-1, 1]) < 0.1
    fastest = BEHIND.parameters.elevator_rate_limit
    assert np.max(np.abs(cruise.inputs[:, 0])) == fastest


def test_the_gain_stabilizes_all_but_x():
    trim, thrust = level_flight(BEHIND)
    p = BEHIND.parameters
    z = np.array([*trim, p.wing_offset, p.elevator_area])
    slope = slope_matrix(BEHIND, z, np.array([0.0, thrust, 0.0, 0.0]))
    gain = cruise_gain(BEHIND, trim, thrust)
    closed = slope[:7, :7] - slope[:7, 9:11] @ gain
    assert np.max(np.linalg.eigvals(closed[1:, 1:]).real) < -0.5
    assert np.all(gain[:, 0] == 0.0)


def test_the_wind_drifts_as_the_article_says():
    wind = draw_wind(np.array([-1.0, 0.5]), 20_000, np.random.default_rng(0))
    assert wind[0].tolist() == [-1.0, 0.5]
    before, after = wind[:-1].ravel(), wind[1:].ravel()
    assert before @ after / (before @ before) == pytest.approx(0.999, abs=0.001)
    steps = wind[1:] - 0.999 * wind[:-1]
    np.testing.assert_allclose(steps.std(axis=0), 0.01, rtol=0.03)
    np.testing.assert_allclose(steps.mean(axis=0), 0.0, atol=3e-4)


def test_the_filter_finds_both_numbers_in_a_cruise(cruise):
    """From zero; and it is neither too sure nor has it learned nothing."""
    means, covariances = run_filter(cruise, (0.0, 0.0))
    stds = np.sqrt(np.diagonal(covariances, axis1=1, axis2=2))
    error = np.abs(means[-1, 7:] - cruise.states[-1, 7:])
    assert np.all(error < 3.0 * stds[-1, 7:])
    assert np.all(stds[-1, 7:] < 0.1 * stds[0, 7:])
    np.testing.assert_allclose(covariances, np.swapaxes(covariances, 1, 2), atol=1e-12)


@pytest.mark.nightly
def test_a_perch_tells_more_than_a_settled_cruise():
    rng = np.random.default_rng(0)
    perch = fly_perch(AHEAD, rng)
    settled = fly_cruise(AHEAD, None, np.zeros(2), rng)
    steps = len(perch.inputs)
    bounds = [least_deviations(flight, steps) for flight in (settled, perch)]
    assert bounds[0][0] > 4.0 * bounds[1][0]
    assert bounds[0][1] > 10.0 * bounds[1][1]
    means, covariances = run_filter(perch, PERCH_GUESS)
    stds = np.sqrt(np.diagonal(covariances[-1]))[7:]
    assert np.all(stds > bounds[1])
    assert np.all(np.abs(means[-1, 7:] - perch.states[-1, 7:]) < 3.0 * stds)
