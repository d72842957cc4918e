"""A filter is as good as theory allows, and as sure as it may be."""

import dataclasses
import functools

import numpy as np
import pytest
from pydrake.systems.primitives import MatrixGain

from benchmarks.estimated_perches import fly_on_estimate
from diagrams.loops import estimated_loop, tape_rows
from diagrams.simulate import simulate_flights
from glider.errors import InputError
from glider.estimation.ekf import SlowState, make_ekf
from glider.estimation.perching import CAPTURE, LAUNCH_STD, PROCESS, perching_filter
from glider.estimation.running import Belief, make_prior, predict_mean, run_ekf
from glider.physics.effects import (
    GROUND_EFFECT,
    MARKER_OFFSET,
    NO_GAUSSIANS,
    SERVO_LAG,
    WIND,
)
from glider.physics.model import GliderModel
from glider.physics.parameters import GliderParameters, Parameters, Theta
from glider.systems.kalman_filter import ExtendedKalmanFilter
from glider.systems.regulator import tracking_regulator
from tests.helpers.filter_consistency import (
    UNCERTAIN,
    assess,
    chi_square_band,
    squared_errors,
    watch_perches,
)
from tests.helpers.flights import NOMINAL, PROBLEM, QUICK, plan_of, policy
from tests.helpers.noisy_flights import draw_starts, fly_watched, information_bound
from tests.helpers.physics import random_states

NOISE = np.square(CAPTURE.std)
LAUNCH = PROBLEM.launch


@functools.cache
def uncertain_ekf():
    return perching_filter(NOMINAL, LAUNCH, slow=UNCERTAIN)[0]


@functools.cache
def flown(flights=200, samples=100):
    """Flights under a tape, whose parameters are as uncertain as the filter says."""
    ekf, rng = uncertain_ekf(), np.random.default_rng(0)
    prior = make_prior(ekf, LAUNCH, LAUNCH_STD)
    tape = 2.0 * np.sin(np.arange(samples) / 8.0)[:, None]
    flight = fly_watched(ekf, draw_starts(prior, flights, rng), tape, rng)
    return flight, run_ekf(ekf, prior, flight.inputs, flight.measured)


# ------------------------------------------------------------------- the filter


def test_on_a_linear_model_it_is_the_kalman_filter():
    """Without air a glider falls freely: F and the input's matrix are known."""
    vacuum = GliderModel(parameters=GliderParameters(air_density=1e-30))
    variances = (1e-6, 2e-6, 1e-5, 1e-5, 1e-3, 2e-3, 1e-2)
    noise = np.diag(NOISE) + 2e-7  # Correlated, too.
    ekf = make_ekf(vacuum, rate=50.0, process=variances, noise=noise)
    prior = make_prior(ekf, LAUNCH, [0.1] * 7)
    rng = np.random.default_rng(0)
    rates = rng.normal(size=(30, 1))
    flight = fly_watched(ekf, draw_starts(prior, 2, rng), rates, rng)
    found = run_ekf(ekf, prior, flight.inputs, flight.measured)

    T = 1.0 / 50.0
    F, H = np.eye(7), np.eye(4, 7)
    F[[0, 1, 2], [4, 5, 6]] = T
    drop = np.array([0.0, -4.905 * T * T, 0.0, 0.0, 0.0, -9.81 * T, 0.0])
    for b in range(2):
        m, P = prior.mean, prior.covariance
        for k in range(30):
            m = F @ m + drop
            m[3] += T * flight.inputs[b, k, 0]
            P = F @ P @ F.T + np.diag(variances) * T
            S = H @ P @ H.T + noise
            nu = flight.measured[b, k] - H @ m
            K = P @ H.T @ np.linalg.inv(S)
            m, P = m + K @ nu, P - K @ H @ P
            np.testing.assert_allclose(found.means[b, k + 1], m, atol=1e-10)
            np.testing.assert_allclose(found.covariances[b, k + 1], P, atol=1e-12)
            np.testing.assert_allclose(found.innovations[b, k], nu, atol=1e-10)
            np.testing.assert_allclose(
                found.innovation_covariances[b, k], S, atol=1e-12
            )
            square = nu @ np.linalg.solve(S, nu)
            np.testing.assert_allclose(found.nis[b, k], square, rtol=1e-8)


EFFECTS = (
    SERVO_LAG(time_constant=0.03),
    WIND(x=-0.5),
    GROUND_EFFECT(strength=0.3),
    MARKER_OFFSET(ahead=0.1, above=0.02),
)
SLOW = (
    SlowState(name="wing_offset", std=0.01),
    SlowState(name="wind_x", std=1.0, decay=0.7),
    SlowState(name="servo_lag.time_constant", std=0.01),
    SlowState(name="marker_offset.ahead", std=0.01),
)


@functools.cache
def rich_ekf(step=0.01):
    """A filter with extra states, effects, and every sort of slow state."""
    return make_ekf(
        GliderModel(effects=EFFECTS),
        rate=40.0,
        process=PROCESS,
        noise=NOISE,
        slow=SLOW,
        known=("wind_z",),
        step=step,
    )


def rich_points(count):
    ekf = rich_ekf()
    for x in random_states(count):
        prior = make_prior(ekf, x, [0.0] * 7)
        mean = prior.mean + 0.02 * np.random.default_rng(1).normal(size=12)
        mean[-2] = 0.03
        yield mean


def test_the_jacobian_is_the_derivative():
    """Against central differences of the same step: to 1e-7 of its size."""
    ekf = rich_ekf()
    assert ekf.steps == 3
    for mean in rich_points(3):
        _, slopes = predict_mean(ekf, mean, [1.5, 0.2], 0.025, differentiate=True)
        for k in range(len(mean)):
            ahead, behind = mean.copy(), mean.copy()
            ahead[k] += 1e-6
            behind[k] -= 1e-6
            difference = (
                predict_mean(ekf, ahead, [1.5, 0.2], 0.025)[0]
                - predict_mean(ekf, behind, [1.5, 0.2], 0.025)[0]
            ) / 2e-6
            scale = 1.0 + np.max(np.abs(slopes[:, k]))
            np.testing.assert_allclose(slopes[:, k], difference, atol=2e-8 * scale)


def test_only_what_the_motion_depends_on_is_differentiated():
    names = uncertain_ekf().names
    acting = [names[k] for k in uncertain_ekf().estimated.acting]
    assert acting == [name for name in names if name not in ("x", "z")]
    rich = rich_ekf()  # The ground is felt in z; a marker is seen, not felt.
    idle = set(range(len(rich.names))) - set(rich.estimated.acting.tolist())
    assert {rich.names[k] for k in idle} == {"x", "marker_offset.ahead"}
    seen = {rich.names[k] for k in rich.estimated.seen}
    assert seen == {"x", "z", "pitch", "marker_offset.ahead"}


def test_a_prediction_is_the_glider_s_own_motion():
    """Many small steps of the plain dynamics, wind that dies down included."""
    ekf = rich_ekf(step=0.002)
    chain = ekf.model.chain
    for mean in rich_points(2):
        found, _ = predict_mean(ekf, mean, [1.5, 0.2], 0.025)
        x, step, z = mean[:8].copy(), 0.025 / 1000, ekf.z.copy()
        z[ekf.estimated.places] = mean
        for k in range(1000):
            wind = mean[9] * np.exp(-0.7 * (k + 0.5) * step)
            theta = Theta(Parameters(*z[11:20]), z[20:], NO_GAUSSIANS)
            slope = np.array(chain.derivatives(0.0, x, 1.5, wind, 0.2, theta))
            middle = x + 0.5 * step * slope
            slope = np.array(chain.derivatives(0.0, middle, 1.5, wind, 0.2, theta))
            x = x + step * slope
        np.testing.assert_allclose(found[:8], x, atol=1e-6)
        assert found[9] == pytest.approx(mean[9] * np.exp(-0.7 * 0.025), rel=1e-12)
        np.testing.assert_array_equal(found[[8, 10, 11]], mean[[8, 10, 11]])


def test_the_pose_is_corrected_as_the_sensors_show_it():
    """A marker ahead: an update with the exact derivative of what it shows."""
    ekf = rich_ekf()
    mean = next(rich_points(1))
    prior = Belief(mean=mean, covariance=np.diag(np.linspace(1e-4, 1e-3, 12)))

    def show(x):
        z = ekf.z.copy()
        z[ekf.estimated.places] = x
        theta = Theta(Parameters(*z[11:20]), z[20:], NO_GAUSSIANS)
        return np.append(ekf.model.chain.measure(z[:8], theta), x[3])

    inputs = np.array([[[1.5, 0.2]]])
    ahead, F = predict_mean(ekf, mean, inputs[0, 0], 0.025, differentiate=True)
    P = F @ prior.covariance @ F.T + np.diag(ekf.process) * 0.025
    H = np.array(
        [(show(ahead + d) - show(ahead - d)) / 2e-6 for d in 1e-6 * np.eye(12)]
    ).T
    measured = show(ahead) + np.array([0.01, -0.02, 0.01, 0.02])
    S = H @ P @ H.T + ekf.noise
    K = P @ H.T @ np.linalg.inv(S)
    found = run_ekf(ekf, prior, inputs, measured[None, None])
    expected = ahead + K @ (measured - show(ahead))
    np.testing.assert_allclose(found.means[0, 1], expected, atol=1e-9)
    np.testing.assert_allclose(found.covariances[0, 1], P - K @ H @ P, atol=1e-10)
    assert abs(H[0, 11]) > 0.5  # The marker's place is seen, and so estimated.
    assert abs(found.means[0, 1][11] - mean[11]) > 1e-4


def test_a_lost_measurement_only_lets_the_belief_spread():
    flight, found = flown()
    measured = flight.measured[:1].copy()
    measured[0, 40:45, 2] = np.nan
    prior = make_prior(uncertain_ekf(), LAUNCH, LAUNCH_STD)
    gap = run_ekf(uncertain_ekf(), prior, flight.inputs[:1], measured)
    np.testing.assert_array_equal(gap.means[0, :41], found.means[0, :41])
    assert np.all(np.isnan(gap.nis[0, 40:45]) & np.isnan(gap.innovations[0, 40:45, 0]))
    ahead, _ = predict_mean(
        uncertain_ekf(), gap.means[0, 40], flight.inputs[0, 40], uncertain_ekf().period
    )
    np.testing.assert_allclose(gap.means[0, 41], ahead, rtol=1e-12, atol=1e-15)
    assert np.all(np.isfinite(gap.means))
    traces = np.trace(gap.covariances[0], axis1=1, axis2=2)
    assert np.all(np.diff(traces[40:46]) > 0.0)


def test_a_batch_is_its_flights_one_by_one():
    flight, found = flown()
    alone = run_ekf(
        uncertain_ekf(),
        make_prior(uncertain_ekf(), LAUNCH, LAUNCH_STD),
        flight.inputs[7:8],
        flight.measured[7:8],
    )
    np.testing.assert_array_equal(alone.means[0], found.means[7])
    np.testing.assert_array_equal(alone.nis[0], found.nis[7])


# ---------------------------------------------------------------- consistency


def test_covariances_stay_symmetric_and_positive():
    _, found = flown()
    P = found.covariances
    np.testing.assert_array_equal(P, np.swapaxes(P, 2, 3))
    size = np.sqrt(np.diagonal(P, axis1=2, axis2=3))
    correlation = P / (size[..., None] * size[..., None, :])
    assert np.min(np.linalg.eigvalsh(correlation)) > 1e-6


def test_it_is_as_uncertain_as_it_says():
    """NEES and NIS of 200 flights within their bands; 1 is right."""
    flight, found = flown()
    seen = assess(found, flight.states)
    assert seen.nees_inside > 0.85
    assert seen.nis_inside > 0.85
    low, high = chi_square_band(found.nis.size * 4, 0.999)
    assert low < np.mean(seen.nis) < high
    low, high = chi_square_band(200 * 9, 0.999)
    assert low < seen.nees[-1] < high


@pytest.mark.parametrize("factor", [0.5, 2.0])
def test_a_filter_that_is_wrong_about_noise_is_found_out(factor):
    flight, _ = flown()
    wrong = make_ekf(
        NOMINAL,
        rate=CAPTURE.rate,
        process=PROCESS,
        noise=NOISE * factor,
        slow=UNCERTAIN,
    )
    prior = make_prior(wrong, LAUNCH, LAUNCH_STD)
    found = run_ekf(wrong, prior, flight.inputs, flight.measured)
    seen = assess(found, flight.states)
    assert seen.nis_inside < 0.05
    assert (np.mean(seen.nees) > 1.2) if factor < 1.0 else (np.mean(seen.nees) < 0.8)


def test_squared_errors_are_those_of_the_inverse():
    flight, found = flown()
    error = flight.states[3, 50] - found.means[3, 50]
    expected = error @ np.linalg.inv(found.covariances[3, 50]) @ error
    assert squared_errors(found, flight.states)[3, 50] == pytest.approx(expected)
    low, high = chi_square_band(100)
    assert (low, high) == pytest.approx((0.742, 1.296), abs=1e-3)  # A table's.


def test_lost_measurements_do_not_count():
    """A mean over those that are left, in a band of as many; none: no verdict."""
    flight, found = flown()
    nis = found.nis.copy()
    nis[20:, 7] = np.nan
    nis[:, 8] = np.nan
    lossy = dataclasses.replace(found, nis=nis)
    seen, whole = assess(lossy, flight.states), assess(found, flight.states)
    assert seen.nis[7] == pytest.approx(np.mean(found.nis[:20, 7]) / 4)
    assert tuple(seen.nis_bands[7]) == chi_square_band(20 * 4)
    assert tuple(seen.nis_bands[6]) == chi_square_band(200 * 4)
    assert np.isnan(seen.nis[8])
    others = np.delete(np.arange(100), [7, 8])
    np.testing.assert_array_equal(seen.nis[others], whole.nis[others])
    low, high = seen.nis_bands[others].T
    inside = np.sum((seen.nis[others] > low) & (seen.nis[others] < high))
    low, high = chi_square_band(20 * 4)
    inside += low < seen.nis[7] < high
    assert seen.nis_inside == pytest.approx(inside / 99)


def test_certainty_has_no_nees_and_is_said_so():
    flight, found = flown()
    sure = found.covariances[:3].copy()
    sure[:, :, 7] = sure[:, :, :, 7] = 0.0
    few = dataclasses.replace(found, covariances=sure, means=found.means[:3])
    with pytest.raises(InputError, match="positive deviation"):
        squared_errors(few, flight.states[:3])


def test_perches_with_unsure_parameters_are_filtered_consistently():
    seen = watch_perches(NOMINAL, policy(), 200, np.random.default_rng(3))
    assert seen.consistency.nees_inside > 0.85
    assert seen.consistency.nis_inside > 0.85
    prior = [slow.std for slow in UNCERTAIN]
    assert np.all(seen.std[-2:] < 0.4 * np.array(prior))  # It learnt.


def test_the_bound_is_the_inverse_of_the_information():
    """Sensitivities chained along the flight, launch eliminated, prior added."""
    ekf = uncertain_ekf()
    prior = make_prior(ekf, LAUNCH, LAUNCH_STD)
    inputs = flown()[0].inputs[0, :40]
    bound = information_bound(ekf, prior, inputs)
    x, chain = prior.mean, np.eye(9)
    weight = 1.0 / np.sqrt(NOISE)
    rows = [np.diag(1.0 / np.sqrt(np.diag(prior.covariance)))]
    for k in range(40):
        x, F = predict_mean(ekf, x, inputs[k], ekf.period, differentiate=True)
        chain = F @ chain
        rows.append(weight[:, None] * chain[:4])
    table = np.vstack(rows)
    start, _ = np.linalg.qr(table[:, :7])
    left = table[:, 7:] - start @ (start.T @ table[:, 7:])  # What no launch explains.
    expected = np.linalg.inv(left.T @ left)
    np.testing.assert_allclose(bound[-1, 7:, 7:], expected, rtol=1e-5)


def path_of(ekf, mean, inputs):
    """Yields x̄ behind each sample of a flight without noise."""
    for row in inputs:
        mean, _ = predict_mean(ekf, mean, row, ekf.period)
        yield mean


def test_a_quick_servo_is_estimated_as_none():
    """Its state is quicker than the samples come: the filter divides its steps."""
    found = []
    for model in (NOMINAL, QUICK):
        ekf, prior = perching_filter(model, LAUNCH)
        rates = np.random.default_rng(0).uniform(-8.0, 8.0, (1, 60, 1))
        flown = fly_watched(ekf, prior.mean, rates[0])
        found.append(run_ekf(ekf, prior, rates, flown.measured))
        np.testing.assert_allclose(found[-1].means[0], flown.states[0], atol=1e-8)
    near, quick = (f.covariances[0, :, :7, :7] for f in found)
    np.testing.assert_allclose(quick, near, atol=0.02 * np.max(near))


def test_feedback_of_the_estimate_perches():
    """Half a centimetre of the wire, as with the true state, at 1 mm of noise."""
    rng = np.random.default_rng(0)
    starts = PROBLEM.draw_launches(3, rng)
    flown = fly_on_estimate(NOMINAL, plan_of(), starts, rng)
    assert max(flight.miss for flight in flown.on_estimate) < 0.005
    assert max(flight.miss for flight in flown.on_state) < 0.005


def test_the_pose_alone_is_enough_to_perch():
    ekf, prior = perching_filter(NOMINAL, LAUNCH, elevator=False)
    assert ekf.measured_names == ("x", "z", "pitch")
    regulator = tracking_regulator(GliderModel(), plan_of())
    estimator = ExtendedKalmanFilter(ekf, prior)
    loop = estimated_loop(NOMINAL, regulator, estimator, command_rate=50.0)
    # At launch the filter knows no more than its prior: nor does the regulator.
    context = loop.CreateDefaultContext()
    glider, regulator, believed = (
        loop.GetSubsystemByName(name)
        for name in ("glider", "regulator", "believed_servo")
    )
    glider.GetMyMutableContextFromRoot(context).SetContinuousState([0.3] * 7)
    for port in (regulator.get_input_port(), believed.GetInputPort("state")):
        own = port.get_system().GetMyContextFromRoot(context)
        np.testing.assert_array_equal(port.Eval(own), LAUNCH)
    noise = CAPTURE.draw(np.random.default_rng(0), 1, tape_rows(CAPTURE.rate))
    [flight] = simulate_flights(loop, [LAUNCH], plan_of().duration, capture_noise=noise)
    assert flight.perched


# ------------------------------------------------------------------- bad input


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"rate": 0.0}, "'rate' is 0.0"),
        ({"step": np.inf}, "'step' is inf"),
        ({"process": [1e-3] * 5}, "7 finite numbers"),
        ({"process": [-1.0] * 7}, "none negative"),
        ({"noise": [[1.0, 2.0, 3.0], [1.0, 2.0]]}, "M from 3 to 7"),
        ({"process": [[1.0], []]}, "7 finite numbers"),
        ({"noise": [1e-6, 1e-6]}, "M from 3 to 7"),
        ({"noise": [1e-6, 1e-6, 0.0]}, "positive"),
        ({"noise": [[1.0, 2.0], [2.0, 1.0]]}, "M from 3 to 7"),
        ({"known": ("gust",)}, "input is 'gust'; expected one of"),
        ({"known": ("wing_offset",), "slow": UNCERTAIN}, "each name only once"),
        ({"slow": (SlowState(name="mass", std=-1.0),)}, r"'mass' .* is \[-1.0, "),
    ],
)
def test_a_filter_that_makes_no_sense_is_refused(options, message):
    given = {"rate": 120.0, "process": PROCESS, "noise": NOISE} | options
    with pytest.raises(InputError, match=message):
        make_ekf(NOMINAL, **given)


@pytest.mark.parametrize("shape", [(5, 1, 8), (4, 1, 7), (5, 2, 7), (5, 7)])
def test_a_gain_that_does_not_fit_reaches_no_compiled_code(shape):
    prior = make_prior(uncertain_ekf(), LAUNCH, LAUNCH_STD)
    with pytest.raises(InputError, match=r"\(5, f, 7\) with f at most 1"):
        fly_watched(uncertain_ekf(), prior.mean, np.zeros((5, 1)), gain=np.zeros(shape))


def test_what_does_not_fit_the_filter_is_refused():
    ekf = uncertain_ekf()
    prior = make_prior(ekf, LAUNCH, LAUNCH_STD)
    with pytest.raises(InputError, match=r"\(B, K, 1\) and \(B, K, 4\)"):
        run_ekf(ekf, prior, np.zeros((1, 5, 1)), np.zeros((1, 4, 4)))
    with pytest.raises(InputError, match=r"\(B, 9\)"):
        fly_watched(ekf, np.zeros((1, 7)), np.zeros((5, 1)))
    other = Belief(mean=np.zeros(7), covariance=np.eye(7))
    with pytest.raises(InputError, match=r"run_ekf: .* \[\[7\], \[7, 7\]\]"):
        run_ekf(ekf, other, np.zeros((1, 4, 1)), np.zeros((1, 4, 4)))
    with pytest.raises(InputError, match=r"\(9,\) and \(1,\)"):
        predict_mean(ekf, prior.mean, [0.0, 1.0], 0.1)
    with pytest.raises(InputError, match=r"\(9,\) and \(1,\)"):
        predict_mean(ekf, prior.mean[:8], [0.0], 0.1)
    with pytest.raises(InputError, match="finite numbers"):
        make_prior(ekf, [np.nan, *LAUNCH[1:]], [0.1] * 7)
    with pytest.raises(InputError, match="none negative"):
        make_prior(ekf, LAUNCH, [-1.0] * 7)
    with pytest.raises(InputError, match=r"\[3\]; expected"):
        make_prior(ekf, LAUNCH, [1.0] * 3)
    with pytest.raises(InputError, match=r"mean and covariance is \[\[7\]"):
        ExtendedKalmanFilter(ekf, Belief(mean=np.zeros(7), covariance=np.eye(7)))
    full = make_ekf(NOMINAL, rate=120.0, process=PROCESS, noise=[1e-4] * 7)
    gain = MatrixGain(np.zeros((1, 7)))
    estimator = ExtendedKalmanFilter(full, make_prior(full, LAUNCH, [0.1] * 7))
    with pytest.raises(InputError, match="input 'measured' is 7; expected 3 or 4"):
        estimated_loop(NOMINAL, gain, estimator)
    gain = MatrixGain(np.zeros((1, 8)))
    with pytest.raises(InputError, match="output 'state' is 7; expected 8"):
        estimated_loop(NOMINAL, gain, ExtendedKalmanFilter(ekf, prior))
