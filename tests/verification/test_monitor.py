"""Monitors of a funnel in a diagram, on the true state and on its estimate."""

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import LogVectorOutput

from diagrams.loops import estimated_loop, tape_rows
from glider.errors import InputError
from glider.estimation.ekf import make_ekf
from glider.estimation.perching import CAPTURE, PROCESS
from glider.estimation.running import Belief
from glider.paths import models_path
from glider.systems.funnel_monitor import FunnelMonitor, funnel_regulator
from glider.systems.kalman_filter import ExtendedKalmanFilter
from glider.systems.regulator import policy_regulator
from glider.verification.funnel.funnel import funnel_policy, load_funnel
from glider.verification.trials import boundary_states

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


def test_commands_that_are_held_have_no_regulator_that_acts_at_all_times():
    held = load_funnel(models_path("funnels", "held_hook.npz"))
    with pytest.raises(InputError, match=r"period is 0\.02; expected 0: no hold"):
        policy_regulator(funnel_policy(held, held=True))
