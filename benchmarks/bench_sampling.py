"""Times the planners that sample and the controller that does.

Prints processor times on one core; run it on an otherwise idle machine.

    python -m benchmarks.bench_sampling
"""

import os
import time

import numpy as np

from glider.control.mppi import SETTINGS, replanning_cost
from glider.paths import models_path
from glider.physics.model import GliderModel
from glider.planning.problem import PerchingProblem
from glider.planning.sampling import MppiSettings, mppi_step
from sampling_planners import LAUNCH, article_cost, cem, mppi


def seconds(function, rounds=5):
    """Returns the seconds of each of some calls, after a first one."""
    function()
    found = []
    for _ in range(rounds):
        start = time.process_time()
        function()
        found.append(time.process_time() - start)
    return np.array(found)


def main():
    print(f"load {os.getloadavg()[0]:.2f} (1 minute)")
    cost, rng = article_cost(), np.random.default_rng(0)
    commands = np.zeros((10_000, cost.steps))
    many = len(commands) / seconds(lambda: cost.to_go(LAUNCH, commands)).min()
    print(f"{many:,.0f} flights of 75 Euler steps a second")
    for method in (cem, mppi):
        few = seconds(lambda m=method: m(cost, rng)).min()
        print(f"{method.__name__:5s} 100 iterations of 30: {1e3 * few:5.1f} ms")
    settings = MppiSettings(samples=10_000)
    mean = np.zeros(cost.steps)
    one = seconds(lambda: mppi_step(cost, LAUNCH, mean, rng, settings)).min()
    print(f"mppi  an iteration of 10,000: {1e3 * one:5.1f} ms")
    replanning = PerchingProblem.load(models_path("problems", "replanning.yaml"))
    cost = replanning_cost(GliderModel(), replanning)
    mean = np.zeros(cost.steps)
    found = 1e3 * seconds(
        lambda: mppi_step(cost, LAUNCH, mean, rng, SETTINGS), rounds=200
    )
    print(
        f"an update of the controller: {np.median(found):.1f} ms, at most "
        f"{found.max():.1f} ms, of {1e3 * cost.step:.0f} ms"
    )


if __name__ == "__main__":
    main()
