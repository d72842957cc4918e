"""The command error |K ε| of feedback on an extended Kalman filter. Prints a table.

    python -m benchmarks.bench_command_errors [FUNNEL] [--flights 200]

ε is the error of the estimate that the feedback of a funnel acts on, K its gains. A
funnel that was made for a command error of κ accounts for the filter where |K ε| <= κ.
Launches are uniform in the inlet; the filter knows them but for a share of their
deviation. The largest |K ε| of each flight, to the funnel's end, is sorted.
"""

import argparse

import numpy as np
from threadpoolctl import threadpool_limits

from glider import funnels
from glider.paths import models_path
from glider.verification.trials.estimated import study_estimates

NOISES = (0.0005, 0.001, 0.003)
"""Standard deviations of a measured position [m], at the motion capture's 120 Hz."""

UNKNOWN = (0.0, 0.1, 0.5)
"""Shares of a launch's deviation that the filter does not know."""


def main():
    """Prints the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    funnel = models_path("funnels", "disturbed_hook.npz")
    parser.add_argument("funnel", nargs="?", default=funnel, help="file of a funnel")
    parser.add_argument("--flights", type=int, default=200, help="flights of a row")
    args = parser.parse_args()
    given = funnels.load_funnel(args.funnel)
    found = study_estimates(
        given, args.flights, np.random.default_rng(0), noises=NOISES, unknown=UNKNOWN
    )
    bound = given.settings.command_error
    print(
        "| noise | unknown share of the launch | median | 95 % | most | "
        f"flights within {bound:g} rad/s | that leave |"
    )
    print("|---|---|---|---|---|---|---|")
    for row in found:
        largest = row.command_errors.max(axis=1)
        median, high = np.quantile(largest, [0.5, 0.95])
        within = np.mean(largest <= bound)
        print(
            f"| {1e3 * row.noise:g} mm | {100 * row.unknown:g} % | {median:.2f} | "
            f"{high:.2f} | {largest.max():.2f} | {100 * within:.0f} % | "
            f"{np.sum(row.escaped)} |"
        )


if __name__ == "__main__":
    with threadpool_limits(limits=1, user_api="blas"):  # Small matrices.
        main()
