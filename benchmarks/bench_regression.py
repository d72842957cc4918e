"""Times the search for the best features and the basis model's refinement.

Run it on an otherwise idle machine.

    python -m benchmarks.bench_regression
"""

import os
import time

import numpy as np

from basis_model import CONFIGURATIONS, CONSISTENT, best_choice, fit, fly_exercise
from basis_refinement import refine


def best_seconds(function, rounds=20):
    """Returns the seconds of the fastest of some calls."""
    function()
    best = np.inf
    for _ in range(rounds):
        start = time.perf_counter()
        function()
        best = min(best, time.perf_counter() - start)
    return best


def main():
    print(f"load {os.getloadavg()[0]:.2f} (1 minute)")
    states, rates = fly_exercise()
    flights = states[1:], rates[1:]
    seconds = best_seconds(lambda: best_choice(*flights, 3))
    print(f"best 3 of 20 features, 700 rows, 3 targets: {1000 * seconds:.1f} ms")
    model, _ = fit(*flights, CONFIGURATIONS[6], CONSISTENT)
    seconds = best_seconds(lambda: refine(model, *flights), 5)
    print(f"refinement of 7 coefficients on 14 flights: {1000 * seconds:.0f} ms")


if __name__ == "__main__":
    main()
