"""Compiles what many tests share, so that no two workers compile the same.

`make test` runs it before there are workers: python -m tests.warm_up
"""

from concurrent.futures import ProcessPoolExecutor

import numpy as np

from tests.helpers.legs import IS_LEFT_OUT


def compile_tracer() -> None:
    """Compiles the loops that trace effects."""
    from glider.compiled.warm_up import warm_up
    from glider.sysid.replay.log_space import LIBRARY_SPACE

    warm_up(LIBRARY_SPACE)


def compile_flights(*kinds: str) -> None:
    """Compiles the planner, the feedback and the flights of a glider."""
    from glider import PerchingProblem, fly, plan, tracking_policy

    model, problem = _model(*kinds), PerchingProblem()
    policy = tracking_policy(model, plan(model, problem))
    fly(model, policy, problem.draw_launches(2, np.random.default_rng(0)))


def compile_filter(*kinds: str) -> None:
    """Compiles the Kalman filter of a glider."""
    from glider.estimation.perching import perching_filter
    from glider.estimation.running import run_ekf
    from glider.planning.problem import PerchingProblem

    ekf, prior = perching_filter(_model(*kinds), PerchingProblem().launch)
    measured = np.zeros((1, 2, 4)) + prior.mean[:4]
    run_ekf(ekf, prior, np.zeros((1, 2, 1)), measured)


def compile_samples(*kinds: str) -> None:
    """Compiles the costs of a glider's sampled commands."""
    from glider.planning.problem import PerchingProblem
    from glider.planning.sampling import MppiSettings, SequenceCost, mppi_step

    model, problem = _model(*kinds), PerchingProblem()
    cost = SequenceCost(model, problem)
    start = np.zeros(model.num_states)
    start[: len(problem.launch)] = problem.launch
    mean, rng = np.zeros(cost.steps), np.random.default_rng(0)
    mppi_step(cost, start, mean, rng, MppiSettings(samples=2))


def compile_taylor() -> None:
    """Compiles the arithmetic of Taylor models, of which proofs are made."""
    from glider.paths import models_path
    from glider.verification.dynamics.defect import defect_bounds
    from glider.verification.funnel.funnel import load_funnel

    funnel = load_funnel(models_path("funnels", "drawn.npz"))
    defect_bounds(funnel.between(0, 1).nominal)


def _model(*kinds):
    from glider.physics.model import GliderModel
    from tests.helpers.tasks import typical

    return GliderModel(effects=tuple(typical(kind) for kind in kinds))


JOBS = (
    (compile_tracer,),  # The longest first.
    (compile_flights,),
    (compile_flights, "servo_lag"),
    (compile_filter,),
    (compile_filter, "servo_lag"),
    (compile_samples,),
    (compile_samples, "servo_lag", "ground_effect"),
)
PROOFS = () if IS_LEFT_OUT else ((compile_taylor,),)
"""Jobs of tests that one of two interpreters leaves out."""

if __name__ == "__main__":
    with ProcessPoolExecutor() as pool:  # Compilers of one process wait in turn.
        for job in [pool.submit(*job) for job in (*PROOFS, *JOBS)]:
            job.result()
