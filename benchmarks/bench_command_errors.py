"""The command error |K ε| of feedback on an extended Kalman filter. Prints a table.

    python -m benchmarks.bench_command_errors [FUNNEL] [--flights 200]

ε is the error of the estimate that the feedback of a funnel acts on, K its gains. A
funnel that was made for a command error of κ accounts for the filter where |K ε| <= κ.
Launches are uniform in the inlet; the filter knows them but for a share of their
deviation. The largest |K ε| of each flight, to the funnel's end, is sorted.
"""

import argparse
import itertools
import math

import numpy as np
from threadpoolctl import threadpool_limits

from benchmarks.on_estimate import fly_on_estimate
from glider import funnels
from glider.estimation.ekf import make_ekf
from glider.estimation.perching import CAPTURE, PROCESS
from glider.estimation.running import Belief
from glider.paths import models_path
from glider.simulation.fly import AFTER
from glider.verification.funnel.funnel import funnel_policy
from glider.verification.trials import draw_inside

NOISES = (0.0005, 0.001, 0.003)
"""Standard deviations of a measured position [m], at the motion capture's 120 Hz."""

UNKNOWN = (0.0, 0.1, 0.5)
"""Shares of a launch's deviation that the filter does not know."""


TICKS = 4
"""Predictions of the filter, each followed by a command, to each sample."""


def flown(funnel, starts, noise, unknown, draws):
    """Flies launches (B, n) on an estimate; returns V and |K ε|, (B, T) each.

    The filter's covariance of a launch is that of launches uniform in the inlet,
    S⁻¹ / (n + 2), times the square of the share that it does not know.
    """
    std = CAPTURE.std * (noise / CAPTURE.position)
    rate = TICKS * CAPTURE.rate
    policy = funnel_policy(funnel)
    ekf = make_ekf(funnel.nominal.model, rate=rate, process=PROCESS, noise=std**2)
    spread = np.linalg.inv(funnel.shape(0.0)) / (funnel.num_states + 2)
    mean = starts - unknown * (starts - funnel.center(0.0))
    prior = Belief(mean=mean, covariance=unknown**2 * spread)
    states, means = fly_on_estimate(policy, ekf, starts, prior, draws * std, TICKS)
    times = np.arange(states.shape[1]) / rate
    kept = times <= funnel.nominal.times[-1]
    errors = means[:, kept] - states[:, kept]
    levels = funnel.level(times[kept], states[:, kept])
    off = np.einsum("bki,ki->bk", errors, policy.sample(times[kept])[1])
    return levels, np.abs(off)


def main():
    """Prints the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    funnel = models_path("funnels", "disturbed_hook.npz")
    parser.add_argument("funnel", nargs="?", default=funnel, help="file of a funnel")
    parser.add_argument("--flights", type=int, default=200, help="flights of a row")
    args = parser.parse_args()
    given = funnels.load_funnel(args.funnel)
    rng = np.random.default_rng(0)
    starts = draw_inside(given, args.flights, rng)
    samples = math.ceil((given.nominal.times[-1] + AFTER) * CAPTURE.rate)
    draws = rng.normal(size=(args.flights, samples, len(CAPTURE.std)))
    bound = given.settings.command_error
    print(
        "| noise | unknown share of the launch | median | 95 % | most | "
        f"flights within {bound:g} rad/s | that leave |"
    )
    print("|---|---|---|---|---|---|---|")
    for unknown, noise in itertools.product(UNKNOWN, NOISES):
        levels, errors = flown(given, starts, noise, unknown, draws)
        largest = errors.max(axis=1)
        median, high = np.quantile(largest, [0.5, 0.95])
        within = np.mean(largest <= bound)
        escapes = np.sum(~(levels.max(axis=1) <= 1.0))
        print(
            f"| {1e3 * noise:g} mm | {100 * unknown:g} % | {median:.2f} | "
            f"{high:.2f} | {largest.max():.2f} | {100 * within:.0f} % | {escapes} |"
        )


if __name__ == "__main__":
    with threadpool_limits(limits=1, user_api="blas"):  # Small matrices.
        main()
