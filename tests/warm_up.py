"""Compiles what many tests share, so that no two workers compile the same.

`make test` runs it before there are workers: python -m tests.warm_up
"""

from concurrent.futures import ProcessPoolExecutor

import numpy as np


def compile_tracer() -> None:
    """Compiles the loops that trace effects."""
    from glider.compiled.theta import warm_up

    warm_up()


def compile_flights() -> None:
    """Compiles the planner, the feedback and the flights of the nominal glider."""
    from glider import GliderModel, PerchingProblem, fly, plan, tracking_policy

    model, problem = GliderModel(), PerchingProblem()
    policy = tracking_policy(model, plan(model, problem))
    fly(model, policy, problem.draw_launches(2, np.random.default_rng(0)))


if __name__ == "__main__":
    with ProcessPoolExecutor() as pool:  # Compilers of one process wait in turn.
        for job in [pool.submit(compile_tracer), pool.submit(compile_flights)]:
            job.result()
