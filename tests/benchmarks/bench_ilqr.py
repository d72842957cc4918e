"""Times iLQR: the article's goal with a regular cost, and with its own.

Prints processor times of one core; run it on an otherwise idle machine. crocoddyl's
BoxFDDP took 18 ms for the regular cost, which it finds to be 16.731 too.

    python -m tests.benchmarks.bench_ilqr
"""

import os
import time

import numpy as np

from glider.paths import models_path
from glider.physics.model import (
    GliderModel,
    load_model,
)
from glider.physics.parameters import load_parameters
from glider.planning.ilqr import (
    GoalProblem,
    article_problem,
    plan,
)
from glider.systems.plant import GliderPlant


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
    field = load_model(models_path("truths", "low_reynolds.yaml"))
    cases = [
        ("regular, servo's limits", heavy, GoalProblem()),
        (
            "regular, no limits",
            heavy,
            GoalProblem(within_limits=False),
        ),
        (
            "regular, Runge-Kutta",
            heavy,
            GoalProblem(order=4),
        ),
        ("the article's", heavy, article_problem()),
        ("regular, field of 126 weights", field, GoalProblem()),
    ]
    for name, model, problem in cases:
        plant = GliderPlant(model)
        planned = plan(plant, problem)
        seconds = best_seconds(lambda p=plant, q=problem: plan(p, q))
        count = len(planned.costs) - 1
        print(
            f"  {name:30s} cost {planned.cost:8.4f}  {count:4d} iterations  "
            f"{1e3 * seconds:7.2f} ms"
        )


if __name__ == "__main__":
    main()
