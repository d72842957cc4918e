"""What a funnel bears of an estimate: batches, and one flight in a diagram."""

import dataclasses

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import LogVectorOutput

from diagrams.loops import estimated_loop
from diagrams.wiring import tape_rows
from examples.perching_funnel import estimate_figures
from glider.errors import InputError
from glider.estimation.ekf import make_ekf
from glider.estimation.perching import CAPTURE, PROCESS
from glider.estimation.running import Belief
from glider.paths import models_path
from glider.systems.funnel_monitor import FunnelMonitor, funnel_regulator
from glider.systems.kalman_filter import ExtendedKalmanFilter
from glider.systems.regulator import policy_regulator
from glider.verification.funnel.funnel import funnel_policy, load_funnel
from glider.verification.trials.estimated import fly_estimated, study_estimates
from glider.verification.trials.falsify import boundary_states, fly_from

NOISE = 0.003
UNKNOWN = 0.5
SAMPLES = 118
"""Number of samples of motion capture until after the wire."""


@pytest.fixture(scope="module")
def launch(funnel):
    """Near the inlet's boundary."""
    z = np.random.default_rng(3).normal(size=7)
    z *= 0.9 / np.linalg.norm(z)
    return boundary_states(funnel, 0, z[None])


@pytest.fixture(scope="module")
def draws():
    return np.random.default_rng(4).normal(size=(1, SAMPLES, 4))


@pytest.fixture(scope="module")
def watched(funnel, launch, draws):
    """One flight in a diagram: the logs of two monitors, on "state" and "estimate".

    At twice the rate of motion capture.
    """
    model = funnel.nominal.model
    std = CAPTURE.std * (NOISE / CAPTURE.position)
    ekf = make_ekf(model, rate=CAPTURE.rate, process=PROCESS, noise=std**2)
    prior = Belief(
        mean=launch[0] - UNKNOWN * (launch[0] - funnel.center(0.0)),
        covariance=UNKNOWN**2 / 9.0 * np.linalg.inv(funnel.shape(0.0)),
    )
    estimator = ExtendedKalmanFilter(ekf, prior)
    loop = estimated_loop(model, funnel_regulator(funnel), estimator)
    builder, logs = DiagramBuilder(), {}
    builder.AddSystem(loop)
    for name in ("state", "estimate"):
        port = loop.GetOutputPort(name)
        monitor = builder.AddNamedSystem(f"{name}_funnel", FunnelMonitor(funnel))
        builder.Connect(port, monitor.get_input_port())
        signals = {"x": port} | {
            output: monitor.GetOutputPort(output) for output in ("margin", "inside")
        }
        for signal, output in signals.items():
            log = LogVectorOutput(output, builder, 0.5 / CAPTURE.rate)
            logs[name, signal] = log
    simulator = Simulator(builder.Build())
    context = simulator.get_mutable_context()
    glider, capture = (
        loop.GetSubsystemByName(name) for name in ("glider", "motion_capture")
    )
    own = glider.GetMyMutableContextFromRoot(context)
    own.SetContinuousState(launch[0])
    tape = np.zeros((tape_rows(CAPTURE.rate), 4))
    tape[1 : SAMPLES + 1] = draws[0] * std
    capture.set_tape(capture.GetMyMutableContextFromRoot(context), tape)
    simulator.AdvanceTo(funnel.nominal.times[-1])
    found = {key: log.FindLog(context).data().T for key, log in logs.items()}
    times = logs["state", "x"].FindLog(context).sample_times()
    return {"times": times} | found


def test_monitors_in_a_loop_watch_the_truth_and_the_estimate(funnel, watched):
    for name in ("state", "estimate"):
        levels = funnel.level(watched["times"], watched[name, "x"])
        assert 1.0 - watched[name, "margin"][:, 0] == pytest.approx(np.sqrt(levels))
        assert np.array_equal(watched[name, "inside"][:, 0], levels <= 1.0)
    # This flight leaves the funnel, and its estimate does not notice.
    assert np.any(watched["state", "inside"] == 0.0)
    assert np.all(watched["estimate", "inside"] == 1.0)


def test_the_batch_flies_as_the_diagram_does(funnel, launch, draws, watched):
    """Between the samples: at one the log has what was believed before it."""
    found = fly_estimated(funnel, launch, NOISE, UNKNOWN, draws)
    between = slice(1, 2 * 105, 2)
    for name, levels in (("state", found.levels), ("estimate", found.believed)):
        expected = (1.0 - watched[name, "margin"][between, 0]) ** 2
        assert levels[0, 2::4][:105] == pytest.approx(expected, abs=0.02)
    assert found.escaped.all()
    assert not found.believed_escaped.any()
    assert found.perched.all()


def test_a_good_estimate_flies_as_the_state_does(funnel, launch, draws):
    found = fly_estimated(funnel, launch, 1e-6, 0.0, draws)
    levels, _ = fly_from(funnel, 0, launch)
    expected = np.interp(found.times, funnel.nominal.times, levels[0])
    assert found.levels[0] == pytest.approx(expected, abs=0.01)
    assert found.errors.max() < 0.01


def test_the_error_is_measured_by_the_funnel(funnel, launch, draws):
    """At launch the estimate lacks a share of what is 0.9 of the way out."""
    for share in (0.0, 0.4, 1.0):
        found = fly_estimated(funnel, launch, NOISE, share, draws)
        assert found.errors[0, 0] == pytest.approx(0.9 * share, abs=1e-9)
        assert found.believed[0, 0] == pytest.approx((0.9 * (1.0 - share)) ** 2)
        assert found.levels[0, 0] == pytest.approx(0.81)


@pytest.fixture(scope="module")
def found(funnel):
    return study_estimates(
        funnel, 12, np.random.default_rng(0), noises=(0.001, 0.02), unknown=(0.2, 1.0)
    )


def test_more_noise_and_less_knowledge_make_flights_leave(found):
    quiet, noisy, ignorant, both = (level.escaped.mean() for level in found)
    assert quiet == 0.0
    assert quiet < noisy < both
    assert ignorant < both
    assert found[0].errors.max() < found[1].errors.max()


def test_what_is_borne_is_the_level_before_the_first_escape(found):
    figures = estimate_figures(found)
    assert figures["flights"] == 12
    assert figures["bears"][0] == {
        "unknown": 0.2,
        "noise_m": 0.001,
        "first_escape_m": 0.02,
    }
    for level, flown in zip(figures["levels"], found, strict=True):
        left = sum(path.max() > 1.0 for path in flown.levels)
        assert level["escaped"] == pytest.approx(left / 12)
        assert level["perched"] == pytest.approx(np.mean(flown.perched))
    never = dataclasses.replace(found[0], levels=0.5 * found[0].levels)
    assert estimate_figures([never])["bears"][0]["first_escape_m"] is None
    always = dataclasses.replace(found[0], levels=found[0].levels + 1.0)
    assert estimate_figures([always])["bears"][0]["noise_m"] is None
    lost = dataclasses.replace(found[0], levels=np.nan * found[0].levels)
    assert lost.escaped.all()


def test_bad_levels_are_refused(funnel, launch, draws):
    for noise, share in ((0.0, 0.5), (np.nan, 0.5), (0.001, 1.5), (0.001, -0.1)):
        with pytest.raises(InputError, match=r"fly_estimated: the .*expected a"):
            fly_estimated(funnel, launch, noise, share, draws)


def test_commands_that_are_held_have_no_regulator_that_acts_at_all_times():
    held = load_funnel(models_path("funnels", "held_hook.npz"))
    with pytest.raises(InputError, match=r"period is 0\.02; expected 0: no hold"):
        policy_regulator(funnel_policy(held, held=True))
