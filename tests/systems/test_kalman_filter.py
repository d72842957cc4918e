"""The filter as a Drake System is the filter along flights, at any time."""

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import ConstantVectorSource, TrajectorySource
from pydrake.trajectories import PiecewisePolynomial

from glider.estimation.ekf import make_ekf
from glider.estimation.perching import PROCESS
from glider.estimation.running import make_prior, predict_mean, run_ekf
from glider.physics.model import GliderModel
from glider.systems.kalman_filter import ExtendedKalmanFilter
from tests.estimation.test_estimation import EFFECTS, LAUNCH, NOISE, path_of, rich_ekf


def line(samples, period):
    """Returns a source that passes through samples (K, m), one a period from 0."""
    times = period * np.arange(len(samples))
    return TrajectorySource(PiecewisePolynomial.FirstOrderHold(times, samples.T))


def test_the_system_is_the_loop_step_by_step():
    """And between samples it is the loop's prediction; inputs vary all the time."""
    ekf, rng, samples = rich_ekf(), np.random.default_rng(0), 12
    prior = make_prior(ekf, LAUNCH, [0.02] * 7)
    rates = 3.0 * rng.normal(size=(samples + 2, 1))
    wind = 0.3 * rng.normal(size=(samples + 2, 1))
    means = 0.5 * (rates[:-1] + rates[1:])
    inputs = np.hstack([means, wind[1:]])
    measured = np.empty((samples, 4))
    for k, mean in enumerate(path_of(ekf, prior.mean, inputs[:samples])):
        measured[k] = mean[:4] + 0.01 * rng.normal(size=4)
    expected = run_ekf(ekf, prior, inputs[None, :samples], measured[None])

    builder = DiagramBuilder()
    estimator = builder.AddSystem(ExtendedKalmanFilter(ekf, prior))
    seen = np.vstack([np.zeros((1, 4)), measured, np.zeros((1, 4))])
    for name, values in (("measured", seen), ("elevator_rate", rates), ("known", wind)):
        source = builder.AddSystem(line(values, ekf.period))
        builder.Connect(source.get_output_port(), estimator.GetInputPort(name))
    simulator = Simulator(builder.Build())
    context = estimator.GetMyContextFromRoot(simulator.get_context())

    def read(name):
        return estimator.GetOutputPort(name).Eval(context)

    np.testing.assert_array_equal(read("estimate"), prior.mean)
    for k in range(samples):
        simulator.AdvanceTo((k + 0.5) * ekf.period)
        mean_rate = 0.75 * rates[k] + 0.25 * rates[k + 1]
        held = np.append(mean_rate, wind[k])
        now = k * ekf.period
        ahead, _ = predict_mean(ekf, expected.means[0, k], held, 0.5 * ekf.period, now)
        np.testing.assert_allclose(read("state"), ahead[:8], rtol=1e-8, atol=1e-9)
        simulator.AdvanceTo((k + 1.0 + 1e-9) * ekf.period)
        for name, value in (
            ("estimate", expected.means[0, k + 1]),
            ("covariance", expected.covariances[0, k + 1].ravel()),
            ("innovation", expected.innovations[0, k]),
            ("innovation_covariance", expected.innovation_covariances[0, k].ravel()),
        ):
            np.testing.assert_allclose(read(name), value, rtol=1e-6, atol=1e-9)


@pytest.mark.parametrize("begin", [2.0, 2.01])
def test_a_flight_at_any_time_is_filtered_alike(begin):
    """On the clock's ticks; between them the first sample comes sooner."""
    ekf = make_ekf(GliderModel(), rate=40.0, process=PROCESS[:7], noise=NOISE)
    prior, measured = make_prior(ekf, LAUNCH, [0.02] * 7), np.array(LAUNCH[:4]) + 0.05

    def outputs(begin, duration):
        builder = DiagramBuilder()
        estimator = builder.AddSystem(ExtendedKalmanFilter(ekf, prior))
        for name, values in (("measured", measured), ("elevator_rate", [0.3])):
            source = builder.AddSystem(ConstantVectorSource(values))
            builder.Connect(source.get_output_port(), estimator.GetInputPort(name))
        simulator = Simulator(builder.Build())
        simulator.get_mutable_context().SetTime(begin)
        context = estimator.GetMyContextFromRoot(simulator.get_context())
        names = "state", "estimate", "covariance"
        before = estimator.GetOutputPort("state").Eval(context)
        np.testing.assert_array_equal(before, prior.mean)
        simulator.Initialize()
        simulator.AdvanceTo(begin + duration)
        simulator.Initialize()  # As who goes on with a context does.
        return [estimator.GetOutputPort(name).Eval(context) for name in names]

    duration = 3.5 * ekf.period
    if begin == 2.0:
        for found, expected in zip(
            outputs(begin, duration), outputs(0.0, duration), strict=True
        ):
            np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-12)
        return
    first = ekf.period - 0.01
    _, mean, covariance = outputs(begin, first + 0.2 * ekf.period)
    rates, shown = [[[0.3]]], measured[None, None]
    expected = run_ekf(ekf, prior, rates, shown, period=first)
    np.testing.assert_allclose(mean, expected.means[0, 1], rtol=1e-9, atol=1e-12)
    size = expected.covariances[0, 1].ravel()
    np.testing.assert_allclose(covariance, size, rtol=1e-9, atol=1e-14)


def test_without_its_known_inputs_they_are_the_model_s():
    """No wind blows, but the effect's own wind and its coefficients stay."""
    ekf = make_ekf(
        GliderModel(effects=EFFECTS),
        rate=40.0,
        process=PROCESS,
        noise=NOISE,
        known=("ground_effect.strength", "wind_z"),
    )
    strength = EFFECTS[2].values[0]
    prior = make_prior(ekf, LAUNCH, [0.02] * 7)
    builder = DiagramBuilder()
    estimator = builder.AddSystem(ExtendedKalmanFilter(ekf, prior))
    for name, size in (("measured", 4), ("elevator_rate", 1)):
        source = builder.AddSystem(ConstantVectorSource(np.full(size, 0.1)))
        builder.Connect(source.get_output_port(), estimator.GetInputPort(name))
    simulator = Simulator(builder.Build())
    simulator.AdvanceTo(1.5 * ekf.period)
    context = estimator.GetMyContextFromRoot(simulator.get_context())
    found = run_ekf(ekf, prior, [[[0.1, strength, 0.0]]], np.full((1, 1, 4), 0.1))
    np.testing.assert_allclose(
        estimator.GetOutputPort("estimate").Eval(context), found.means[0, 1], atol=1e-9
    )
