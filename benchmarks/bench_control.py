"""Times feedback: Drake's pass, the compiled one, and closed-loop flights.

Prints processor times and ratios; run it on an otherwise idle machine.

    python -m benchmarks.bench_control
"""

import os
import time

import numpy as np
from pydrake.systems.controllers import FiniteHorizonLinearQuadraticRegulator

from diagrams.loops import closed_loop
from diagrams.simulate import simulate_flights
from glider.control.tvlqr import tracking_policy
from glider.simulation.fly import AFTER, fly
from glider.systems.plant import GliderPlant
from glider.systems.regulator import regulator_arguments, tracking_regulator
from tests.helpers.drake_gains import policy_of, tracking_gains
from tests.helpers.flights import NOMINAL, PROBLEM, plan_of


def best_seconds(function, rounds=5):
    """Returns the seconds of the fastest of some calls, after a first one."""
    function()
    best = np.inf
    for _ in range(rounds):
        start = time.process_time()
        function()
        best = min(best, time.process_time() - start)
    return best


def plain_gains(plan):
    """Computes gains as `tracking_gains` does, on the plant as it comes."""
    plant = GliderPlant(NOMINAL, fast=False)
    given = regulator_arguments(NOMINAL, plan)
    given |= {"system": plant, "context": plant.CreateDefaultContext()}
    return FiniteHorizonLinearQuadraticRegulator(**given)


def main():
    print(f"load {os.getloadavg()[0]:.2f} (1 minute)")
    plan = plan_of()

    print("\nGains along the article's plan")
    slow_seconds = best_seconds(lambda: plain_gains(plan))
    fast_seconds = best_seconds(lambda: tracking_gains(NOMINAL, plan))
    pass_seconds = best_seconds(lambda: tracking_policy(NOMINAL, plan))
    print(f"  Drake, plain plant     {1e3 * slow_seconds:7.1f} ms")
    for name, seconds in (("Drake", fast_seconds), ("compiled pass", pass_seconds)):
        ratio = seconds / slow_seconds
        print(f"  {name:22s} {1e3 * seconds:7.1f} ms   {ratio:.4f} of it")
    times = np.linspace(0.0, plan.duration, 1000)
    drake = policy_of(tracking_gains(NOMINAL, plan), plan)
    gains = [p.sample(times)[1] for p in (drake, tracking_policy(NOMINAL, plan))]
    difference = np.max(np.abs(gains[0] - gains[1])) / np.max(np.abs(gains[0]))
    print(f"  largest difference of the two gains, of the largest: {difference:.1e}")

    policy, rng = tracking_policy(NOMINAL, plan), np.random.default_rng(0)
    starts = PROBLEM.draw_launches(10_000, rng)
    print("\n10,000 flights, on one core")
    for name, options in (
        ("at once", {}),
        ("commands at 50 Hz", {"command_rate": 50.0}),
        ("with paths", {"keep_paths": True}),
        ("steps of 1 ms", {"step": 0.001}),
    ):
        # The options of this turn: the function is called before the next.
        seconds = best_seconds(lambda o=options: fly(NOMINAL, policy, starts, **o), 3)
        print(f"  {name:22s} {seconds:5.2f} s")
    perched = fly(NOMINAL, policy, starts).perched
    print(f"  perched: {np.mean(perched):.2%}")

    diagram = closed_loop(NOMINAL, tracking_regulator(NOMINAL, plan), command_rate=50.0)
    seconds = best_seconds(
        lambda: simulate_flights(diagram, starts[:10], plan.duration + AFTER), 3
    )
    print(f"\nDrake's diagram at 50 Hz: {seconds / 10:.3f} s a flight")


if __name__ == "__main__":
    main()
