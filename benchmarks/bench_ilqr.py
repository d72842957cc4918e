"""Times iLQR: the article's goal with a regular cost, and with its own.

Prints processor times of one core; run it on an otherwise idle machine. crocoddyl's
BoxFDDP took 18 ms for the regular cost, which it finds to be 16.731 too.

    python -m benchmarks.bench_ilqr
"""

import os
import time

import numpy as np

from glider.paths import models_path
from glider.physics.model import GliderModel
from glider.physics.parameters import load_parameters
from ilqr import ARTICLE, IlqrSettings, goal_problem, ilqr


def best_seconds(function, rounds=10):
    """Returns the seconds of the fastest of some calls, after a first one."""
    function()
    best = np.inf
    for _ in range(rounds):
        start = time.process_time()
        function()
        best = min(best, time.process_time() - start)
    return best


def main():
    print(f"load {os.getloadavg()[0]:.2f} (1 minute)")
    heavy = GliderModel(
        parameters=load_parameters(models_path("vehicles", "heavy.yaml"))
    )
    learned = GliderModel.load(models_path("truths", "low_reynolds.yaml"))
    regular, settings = goal_problem(), IlqrSettings()
    cases = [
        ("regular, servo's limits", heavy, regular, settings),
        ("regular, no limits", heavy, regular, IlqrSettings(within_limits=False)),
        ("regular, Runge-Kutta", heavy, regular, IlqrSettings(order=4)),
        ("the article's", heavy, goal_problem(rate_cost=0.0), ARTICLE),
        ("regular, free functions", learned, regular, settings),
    ]
    for name, *given in cases:
        planned = ilqr(*given)
        seconds = best_seconds(lambda g=given: ilqr(*g))
        count = len(planned.costs) - 1
        print(
            f"  {name:30s} cost {planned.cost:8.4f}  {count:4d} iterations  "
            f"{1e3 * seconds:7.2f} ms"
        )


if __name__ == "__main__":
    main()
