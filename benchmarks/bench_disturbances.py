"""What a command error and wind cost of the inlet of the hook's funnel. Prints a table.

    python -m benchmarks.bench_disturbances [--steps 2]

Each row is the shape of a funnel for so large a command error and wind, in steps that
are so many times as long, before it is scaled and certified, which leaves less. Where
commands are held, their largest error grows from the given one, within each period.
"""

import argparse

import numpy as np
from threadpoolctl import threadpool_limits

from glider import GliderModel, PerchingProblem, funnels, plan, tracking_policy
from glider.paths import models_path
from glider.verification.dynamics.nominal import make_nominal
from glider.verification.funnel.settings import hook_goal
from glider.verification.funnel.shape_flow import FunnelTask, ShapeFlow
from glider.verification.sos.programs import SolverError
from glider.verification.sos.sphere import normalized

ROWS: tuple[dict[str, float], ...] = (
    {},
    *({"wind": wind} for wind in (0.01, 0.02, 0.03, 0.05)),
    *({"command_error": error} for error in (0.5, 1.0, 2.0)),
    *({"command_error": error, "wind": 0.02} for error in (0.5, 0.7, 1.0)),
    {"command_error": 0.5, "elevator_gain": 20.0},
    *(
        {"period": period, "wind": wind, "elevator_gain": gain}
        for period, wind, gain in (
            (0.02, 0.0, 24.0),
            (0.02, 0.02, 24.0),
            (0.02, 0.03, 24.0),
            (0.01, 0.02, 30.0),
            (0.03, 0.02, 20.0),
            (0.02, 0.02, 20.0),
            (0.02, 0.02, 32.0),
        )
    ),
    {"period": 0.02, "wind": 0.02, "command_error": 0.1, "elevator_gain": 24.0},
)
"""Settings of each row; what they lack is that of the shipped funnels."""


def shape_of(model, policy, problem, steps, **settings):
    """Returns a shape's height [m]; the largest error, and what is unknown of it.

    None without one.
    """
    base = {"remainder": 1.6, "elevator_gain": 40.0}
    chosen = funnels.FunnelSettings(
        **base | settings,
        step=steps * funnels.FunnelSettings.step,
        hold=steps * funnels.FunnelSettings.hold,
        launch_sizes=funnels.LAUNCH_SIZES,
    )
    nominal = make_nominal(model, policy, chosen.step, chosen.period)
    end = nominal.states[-1]
    goal = hook_goal(chosen.goal, end, problem)
    chosen = funnels.FunnelSettings(**vars(chosen) | {"goal": goal})
    total = len(end) + (3 if chosen.pushes.any() or chosen.period else 0)
    directions = normalized(np.random.default_rng(0).normal(size=(100, total)))
    try:
        steered = ShapeFlow(FunnelTask(nominal, chosen, directions), steer=True)
        steered.run()
        task = FunnelTask(steered.nominal, chosen, directions)
        S = ShapeFlow(task).run()
    except (SolverError, np.linalg.LinAlgError):
        return None
    errors = task.errors(S, np.arange(len(S)))
    return 1.0 / np.sqrt(S[0, 1, 1]), *errors.max(axis=1)


def main():
    """Prints the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--steps", type=float, default=2.0, help="times as long")
    parser.add_argument("--first", type=int, default=0, help="row to begin with")
    args = parser.parse_args()
    model = GliderModel.load(models_path("vehicles", "perching.yaml"))
    problem = PerchingProblem.load("perching_hook")
    policy = tracking_policy(model, plan(model, problem))
    print("| hold | command error | wind | gain | height | largest error | unknown |")
    print("|---|---|---|---|---|---|---|", flush=True)
    for row in ROWS[args.first :]:
        error, wind = row.get("command_error", 0.0), 100.0 * row.get("wind", 0.0)
        held, gain = 1e3 * row.get("period", 0.0), row.get("elevator_gain", 40)
        start = f"| {held:g} ms | {error:g} rad/s | {wind:g} cm/s | {gain:g} |"
        found = shape_of(model, policy, problem, args.steps, **row)
        words = "none | | |"
        if found:
            words = "{:.1f} cm | {:.2f} rad/s | {:.2f} rad/s |".format(
                100 * found[0], *found[1:]
            )
        print(f"{start} {words}", flush=True)


if __name__ == "__main__":
    with threadpool_limits(limits=1, user_api="blas"):  # Small matrices.
        main()
