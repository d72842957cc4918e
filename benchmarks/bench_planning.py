"""Times planning against a plain Python plant, and plans from fifty launches.

Run as `python -m benchmarks.bench_planning`; ratios are of one run. The
reference is the same DirectCollocation and guess with SNOPT as it comes, on the plant
whose AutoDiffXd twin takes value and slopes from compiled code.
"""

import dataclasses
import os
import subprocess
import sys
import tempfile
import time

import numpy as np
from pydrake.solvers import SnoptSolver

from glider.control.mpc import Replanner
from glider.physics.model import GliderModel
from glider.planning.dircol import PlanningError, plan
from glider.planning.problem import PerchingProblem
from glider.planning.program import perching_program

KNOTS = 41
REPEATS = 5
LAUNCHES = 50
REPLANS = 300
PERIOD = 0.02

COMPILED = (
    "first plan (at most 10)",
    "first plan of a glider with other effects",
    "what close-the-loop compiles",
)
"""What COMPILE times."""

COMPILE = """
import os
from glider import GliderModel, plan
from glider.physics.effects import KINDS
from glider.compiled.warm_up import warm_up
from glider.sysid.replay.log_space import LIBRARY_SPACE

lagging = GliderModel(effects=(KINDS["servo_lag"](time_constant=0.04),))
work = (
    lambda: plan(GliderModel()),
    lambda: plan(lagging),
    lambda: warm_up(LIBRARY_SPACE),
)
for do in work:
    begin = os.times()
    do()
    *used, elapsed = (b - a for a, b in zip(begin, os.times()))
    print(elapsed, sum(used))
"""
"""First plans of a session, of a glider and of one with other effects, and what
`close-the-loop` compiles: seconds, and the processor's of all processes."""


def plan_plainly(problem: PerchingProblem) -> float:
    """Builds and solves as any user of Drake would; returns the cost."""
    dc = perching_program(GliderModel(), problem, KNOTS)
    return SnoptSolver().Solve(dc.prog()).get_optimal_cost()


def best_time(function) -> float:
    """Returns the least of some timings [s]."""
    times = []
    for _ in range(REPEATS):
        start = time.perf_counter()
        function()
        times.append(time.perf_counter() - start)
    return min(times)


def time_compiling() -> None:
    """Prints the times of what compiles, without and with what is kept."""
    with tempfile.TemporaryDirectory() as folder:
        fresh = {"XDG_CACHE_HOME": folder, "NUMBA_CACHE_DIR": folder}
        for what in ("nothing kept", "kept on disk"):
            told = subprocess.check_output(
                [sys.executable, "-c", COMPILE], env=os.environ | fresh, text=True
            )
            print(f"{what}: seconds (of processor)")
            for name, line in zip(COMPILED, told.splitlines(), strict=True):
                elapsed, used = map(float, line.split())
                print(f"  {name} {elapsed:.2f} ({used:.2f})")


def time_replanning(rng: np.random.Generator) -> tuple[np.ndarray, int]:
    """Plans again and again on the way, from a state beside the plan.

    Off by 2 cm, 0.03 rad, 0.1 m/s and 0.3 rad/s (one sigma), at the rate of the
    commands; each new plan is what the next starts from, on fewer knots.

    Returns:
        times [s] and how many of them found a plan.
    """
    problem = PerchingProblem.load("replanning")
    problem = dataclasses.replace(problem, x_limits=[-4.0, 1.0])
    sigma = np.array([0.02, 0.02, 0.03, 0.0, 0.1, 0.1, 0.3])
    replanner = Replanner(GliderModel(), problem, 1.0 / PERIOD)
    first = replanner.plan_first()
    times, solved = [], 0
    while len(times) < REPLANS:
        known, now = first, 0.0
        while known.flight.duration > 0.3 and len(times) < REPLANS:
            now += PERIOD
            state = known.flight.state_trajectory.value(PERIOD)[:, 0]
            state += sigma * rng.normal(size=7)
            known = replanner.plan_again(known, now, state)
            times.append(known.seconds)
            solved += not known.failed
            if known.failed:
                break
    return np.array(times), solved


def draw_launches(rng: np.random.Generator, count: int) -> list[list[float]]:
    """Returns launches as wide as the issue asks for, uniform."""
    middle = np.array([-3.5, 0.1, 0.0, 0.0, 7.0, 0.0, 0.0])
    half = np.array([0.3, 0.2, 0.1, 0.0, 1.0, 0.0, 0.0])
    return (middle + half * rng.uniform(-1, 1, (count, 7))).tolist()


def main() -> None:
    """Prints the table."""
    time_compiling()
    problem = PerchingProblem()
    model = GliderModel()
    plan(model, problem, KNOTS)  # Compiles.
    plain = best_time(lambda: plan_plainly(problem))
    ours = best_time(lambda: plan(model, problem, KNOTS))
    print(f"{KNOTS} knots: plain {plain:.3f} s, ours {ours:.4f} s")
    print(f"ratio {ours / plain:.2f}")
    times, solved = time_replanning(np.random.default_rng(0))
    half, most = np.percentile(1e3 * times, [50, 99])
    print(f"planned again {solved} of {REPLANS} times: median {half:.1f} ms (at most")
    print(f"5), 99th percentile {most:.1f} ms (at most 15)")

    solved, slow, failed = 0, 0.0, []
    for launch in draw_launches(np.random.default_rng(0), LAUNCHES):
        trial = dataclasses.replace(problem, launch=launch, x_limits=[-4.0, 1.0])
        start = time.perf_counter()
        try:
            plan(model, trial, KNOTS)
            solved += 1
        except PlanningError as error:
            failed.append((trial, error))
        slow = max(slow, time.perf_counter() - start)
    print(f"{solved} of {LAUNCHES} launches planned, the slowest in {slow:.1f} s")
    for trial, error in failed:
        x, z, pitch, _, speed, *_ = trial.launch
        print(f"x {x:.3f} z {z:.3f} pitch {pitch:.3f} speed {speed:.3f}: {error}")


if __name__ == "__main__":
    main()
