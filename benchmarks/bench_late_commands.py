"""Flights whose commands act later than their predictor assumes. Prints a table.

    python -m benchmarks.bench_late_commands [FUNNEL] [--flights 2000]

The proof of a latency is for one that is always the same. Here the clock of a funnel of
held commands samples the state, and the predictor flies it on, as the proof has it, for
10 ms; but each command after the first acts later, until the next one does. Flights
start on the inlet's boundary, in the funnel's wind, with gliders of its set's edge.
"""

import argparse

import numpy as np
from threadpoolctl import threadpool_limits

from glider import funnels
from glider.paths import models_path
from tests.helpers.held_flights import HeldFlights, Launches, count_escapes

LATENCY = 0.01
"""That the predictor assumes [s]."""

DELAYS = (0.0, 0.001, 0.002, 0.004, 0.008)
"""By how much later each command acts [s]."""


def main():
    """Prints the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    funnel = models_path("funnels", "held_head_wind_95_hook.npz")
    parser.add_argument("funnel", nargs="?", default=funnel, help="file of a funnel")
    parser.add_argument("--flights", type=int, default=2000, help="flights a row")
    args = parser.parse_args()
    given = funnels.load_funnel(args.funnel)
    wind = given.settings.wind
    print("| late by | flights that leave | most V | V(T) |")
    print("|---|---|---|---|")
    for delay in DELAYS:
        rng = np.random.default_rng(0)
        launches = Launches.draw(given, args.flights, rng, wind=wind)
        largest, ends = HeldFlights(given, launches, LATENCY, delay).levels()
        left = count_escapes(largest)
        print(
            f"| {1e3 * delay:g} ms | {left:,} of {args.flights:,} | "
            f"{largest.max():.2f} | {ends.max():.2f} |",
            flush=True,
        )


if __name__ == "__main__":
    with threadpool_limits(limits=1, user_api="blas"):  # Small matrices.
        main()
