"""The article's study: two numbers of the glider, known from nothing in flight."""

import dataclasses

import numpy as np
import pytest

from filter_study import CONSTANTS, draw_wind, slow_nees, watch_cruise, watch_perch
from glider.errors import InputError
from glider.paths import models_path
from glider.physics.effects import THRUST
from glider.physics.model import GliderModel
from glider.physics.parameters import GliderParameters, load_parameters
from glider.systems.plant import GliderPlant
from powered_cruise import cruise_gain, level_flight
from tests.helpers.flights import policy

pytestmark = pytest.mark.nightly

BEHIND = load_parameters(models_path("vehicles", "heavy_ekf.yaml"))


def test_a_perch_teaches_both_numbers():
    """The filter starts wrong about both, and ends far less so."""
    rng = np.random.default_rng(0)
    watched = watch_perch(GliderParameters(), policy(), rng, CONSTANTS)
    errors = np.abs(watched.slow - watched.truth)
    assert np.all(errors[0] > 0.01)
    assert np.all(errors[-1] < 0.35 * errors[0])


def test_slow_nees_is_one_where_errors_are_as_large_as_expected():
    watched = watch_cruise(BEHIND, np.random.default_rng(0), CONSTANTS)
    covariance = watched.estimates.covariances[0, 50, -2:, -2:]
    draws = np.random.default_rng(0).multivariate_normal([0, 0], covariance, 400)

    def erring(error):
        means = watched.estimates.means.copy()
        means[0, 50, -2:] = watched.truth + error
        estimates = dataclasses.replace(watched.estimates, means=means)
        return dataclasses.replace(watched, estimates=estimates)

    assert slow_nees([erring(e) for e in draws], 50) == pytest.approx(1.0, abs=0.1)


def test_the_cruise_is_level_and_held():
    """The trim is Drake's plant's, at rest; the start's 0.5 m are gone after 4 s."""
    trim = level_flight(BEHIND, 9.0)
    assert trim[[4, 5]].tolist() == [9.0, 0.0]
    thrust = THRUST(force=float(trim[7]))
    plant = GliderPlant(GliderModel(parameters=BEHIND, effects=(thrust,)))
    context = plant.CreateDefaultContext()
    context.SetContinuousState(trim[:7])
    plant.GetInputPort("elevator_rate").FixValue(context, [0.0])
    rates = plant.EvalTimeDerivatives(context).CopyToVector()
    np.testing.assert_allclose(rates, [9.0, 0, 0, 0, 0, 0, 0], atol=1e-9)
    watched = watch_cruise(BEHIND, np.random.default_rng(0), CONSTANTS)
    assert abs(watched.flight.states[0, -1, 1]) < 0.1
    assert np.max(np.abs(watched.flight.inputs[0, :, 0])) == BEHIND.elevator_rate_limit


def test_the_gain_stabilizes_what_drake_linearizes():
    """Closed-loop poles of all states but x, by differences of the plant."""
    trim, step = level_flight(BEHIND, 9.0), 1e-6
    gain = cruise_gain(BEHIND, trim)

    def motion(point):
        x = point[:7]
        push = -gain @ (x - trim[:7])
        effects = (THRUST(force=float(trim[7] + push[1])),)
        plant = GliderPlant(GliderModel(parameters=BEHIND, effects=effects))
        context = plant.CreateDefaultContext()
        context.SetContinuousState(x)
        plant.GetInputPort("elevator_rate").FixValue(context, push[:1])
        return plant.EvalTimeDerivatives(context).CopyToVector()

    A = np.array(
        [(motion(trim[:7] + d) - motion(trim[:7] - d)) for d in step * np.eye(7)]
    ).T / (2.0 * step)
    assert np.max(np.linalg.eigvals(A[1:, 1:]).real) < -0.5
    assert np.all(gain[:, 0] == 0.0)


def test_a_glider_without_level_flight_is_refused():
    with pytest.raises(InputError, match="No level flight at 1 m/s"):
        level_flight(GliderParameters(), 1.0)


def test_the_wind_drifts_as_the_article_says():
    wind = draw_wind(20_000, np.random.default_rng(0), (-1.0, 0.5))
    assert wind[0].tolist() == [-1.0, 0.5]
    before, after = wind[:-1].ravel(), wind[1:].ravel()
    assert before @ after / (before @ before) == pytest.approx(0.999, abs=0.001)
    steps = wind[1:] - 0.999 * wind[:-1]
    np.testing.assert_allclose(steps.std(axis=0), 0.01, rtol=0.03)
    np.testing.assert_allclose(steps.mean(axis=0), 0.0, atol=3e-4)
