"""Flights under a policy of a filter's estimate, many at once."""

import numpy as np

from glider.estimation.ekf import Ekf
from glider.estimation.running import Belief, run_ekf
from glider.physics.servo import limited_rates
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
    steps = ticks * errors.shape[1]
    numbers = model.numbers
    offset, gain = policy.sample(np.arange(steps) * ekf.period)
    (batch, n), size = starts.shape, errors.shape[2]
    states, means = np.empty((2, batch, steps + 1, n))
    states[:, 0], means[:, 0] = starts, prior.mean
    certain = np.zeros((n, n))
    covariance = prior.covariance
    nothing = np.full((batch, 1, size), np.nan)

    def step(k, mean, covariance, measured):
        """Returns mean and covariance one prediction later."""
        command = offset[k] - means[:, k] @ gain[k]
        angle = model.chain.demanded_angle(mean.T, numbers.c)
        rates = limited_rates(command, angle, model.parameters.servo)
        before = Belief(mean=mean, covariance=covariance)
        time = k * ekf.period
        found = run_ekf(ekf, before, rates[:, None, None], measured, time)
        return found.means[:, 1], found.covariances[:, 1]

    for k in range(steps):
        # Without a measurement a filter predicts: it flies its own glider.
        states[:, k + 1], _ = step(k, states[:, k], certain, nothing)
        measured = nothing
        if (k + 1) % ticks == 0:
            pose = model.chain.measure(states[:, k + 1].T, numbers)
            shown = np.column_stack([*pose, states[:, k + 1, ELEVATOR]])
            measured = (shown + errors[:, k // ticks])[:, None]
        means[:, k + 1], covariance = step(k, means[:, k], covariance, measured)
    return states, means
