"""Flights under a policy of a filter's estimate, many at once."""

import numpy as np

from glider.compiled.flight import Steps, fly_batch, make_tape
from glider.estimation.ekf import Ekf
from glider.estimation.running import Belief, run_ekf
from glider.physics.servo import limited_rate
from glider.physics.state import ELEVATOR
from glider.simulation.fly import Policy


def fly_on_estimate(
    policy: Policy,
    ekf: Ekf,
    starts: np.ndarray,
    prior: Belief,
    errors: np.ndarray,
    ticks: int,
) -> tuple[np.ndarray, np.ndarray]:
    """Flies launches of a filter's own glider, without gusts.

    The loop of `diagrams.estimated_loop`, with the command held between the filter's
    predictions.

    Args:
        policy: the feedback, of the estimate.
        ekf: the filter.
        starts: (B, n) launches.
        prior: what the filter believes of them.
        errors: (B, K, M) of the samples, the first of them `ticks` predictions after
            launch and so on.
        ticks: predictions of the filter to each sample.

    Returns:
        states and estimates, (B, K ticks + 1, n), at the launch and behind each
        prediction.
    """
    model = ekf.model
    servo = model.parameters.servo
    count = ticks * errors.shape[1]
    offset, gain = policy.sample(np.arange(count) * ekf.period)
    batch, n = starts.shape
    states = np.empty((batch, count + 1, n))
    means = np.empty((batch, count + 1, n))
    states[:, 0] = starts
    means[:, 0] = prior.mean
    covariance = prior.covariance
    nothing = np.full((batch, 1, errors.shape[2]), np.nan)
    steps = Steps(ekf.steps, ekf.period / ekf.steps, every=ekf.steps)
    for k in range(count):
        mean = means[:, k]
        command = offset[k] - mean @ gain[k]
        tape = make_tape(command[:, None], ekf.steps)
        truth = fly_batch(model, states[:, k], steps, tape).states[:, 1]
        states[:, k + 1] = truth
        measured = nothing
        if (k + 1) % ticks == 0:
            pose = model.chain.measure(truth.T, model.numbers)
            shown = np.column_stack([*pose, truth[:, ELEVATOR]])
            measured = (shown + errors[:, k // ticks])[:, None]
        angles = model.chain.demanded_angle(mean.T, model.numbers.c)
        commands = zip(command, angles, strict=True)
        rates = [limited_rate(rate, angle, servo) for rate, angle in commands]
        belief = Belief(mean=mean, covariance=covariance)
        inputs = np.reshape(rates, (batch, 1, 1))
        found = run_ekf(ekf, belief, inputs, measured, k * ekf.period)
        means[:, k + 1] = found.means[:, 1]
        covariance = found.covariances[:, 1]
    return states, means
