"""Times the search for the best features and the basis model's refinement.

Run it on an otherwise idle machine.

    python -m benchmarks.bench_regression
"""

import os
import time

import numpy as np

from basis_dynamics import fit_basis, fly_again, plane_accelerations, sampled_features
from basis_exercise import load_exercise
from basis_features import FEATURES, PAPER
from basis_refinement import refine
from regression import best_subsets


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
    exercise = load_exercise()
    flights, frame = exercise.fitted, exercise.frame("nose_down")
    targets = plane_accelerations(flights, frame)
    for name, features in (("the paper's", PAPER), ("all", FEATURES)):
        columns = sampled_features(flights, frame, tuple(features))
        seconds = best_seconds(lambda c=columns: best_subsets(c, targets))
        rows, count = columns.shape
        print(
            f"best subsets of {name} {count} features, {rows} rows, 3 targets: "
            f"{1000 * seconds:.1f} ms"
        )
    model = fit_basis(flights, frame, exercise.configurations["6"]).model
    seconds = best_seconds(lambda: fly_again(model, flights))
    print(f"14 flights of 50 steps: {1000 * seconds:.1f} ms")
    seconds = best_seconds(lambda: refine(model, flights), 5)
    print(f"refinement of 7 coefficients on them: {1000 * seconds:.0f} ms")


if __name__ == "__main__":
    main()
