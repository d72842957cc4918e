"""What a command error and wind cost of the inlet of the hook's funnel. Prints a table.

    python -m tests.benchmarks.bench_disturbances [--steps 2]

Each row is the shape of a funnel for so large a command error and wind, in steps that
are so many times as long, before it is scaled and certified, which leaves less. The
largest rate of the feedback's command is of the nominal glider's linear part; with it,
(h + L) is the hold and latency that the command error allows.
"""

import argparse

import numpy as np
from threadpoolctl import threadpool_limits

from glider import GliderModel, PerchingProblem, funnels, plan, tracking_policy
from glider.paths import models_path
from glider.verification.dynamics.nominal import make_nominal
from glider.verification.funnel.settings import hook_goal
from glider.verification.funnel.shape_flow import FunnelTask, ShapeFlow
from glider.verification.sos.forms import linear_part
from glider.verification.sos.programs import SolverError
from glider.verification.sos.sphere import normalized

ROWS: tuple[dict[str, float], ...] = (
    {},
    *({"wind": wind} for wind in (0.01, 0.02, 0.03, 0.05)),
    *({"command_error": error} for error in (0.5, 1.0, 2.0)),
    *({"command_error": error, "wind": 0.02} for error in (0.5, 0.7, 1.0)),
    {"command_error": 0.5, "elevator_gain": 20.0},
)
"""Settings of each row; what they lack is that of the shipped funnels."""


def shape_of(model, policy, problem, steps, **settings):
    """Returns height [m] and largest rate [rad/s²] of a shape; None without one."""
    base = {"remainder": 1.6, "elevator_gain": 40.0}
    chosen = funnels.FunnelSettings(
        **base | settings,
        step=steps * funnels.FunnelSettings.step,
        hold=steps * funnels.FunnelSettings.hold,
        launch_sizes=funnels.LAUNCH_SIZES,
    )
    nominal = make_nominal(model, policy, chosen.step)
    end = nominal.states[-1]
    goal = hook_goal(chosen.goal, end, problem)
    chosen = funnels.FunnelSettings(**vars(chosen) | {"goal": goal})
    total = len(end) + (3 if chosen.pushes.any() else 0)
    directions = normalized(np.random.default_rng(0).normal(size=(100, total)))
    try:
        steered = ShapeFlow(FunnelTask(nominal, chosen, directions), steer=True)
        steered.run()
        S = ShapeFlow(FunnelTask(steered.nominal, chosen, directions)).run()
    except (SolverError, np.linalg.LinAlgError):
        return None
    nominal = steered.nominal
    turn = np.diff(nominal.gains, axis=0) / np.diff(nominal.times)[:, None]
    rates = np.einsum("ti,tij->tj", nominal.gains, linear_part(nominal.closed_loop))
    rates = rates[:-1] + turn
    reach = np.einsum("ti,tij,tj->t", rates, np.linalg.inv(S[:-1]), rates)
    drift = np.abs(np.diff(nominal.inputs) / np.diff(nominal.times))
    return 1.0 / np.sqrt(S[0, 1, 1]), float((np.sqrt(reach) + drift).max())


def main():
    """Prints the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--steps", type=float, default=2.0, help="times as long")
    args = parser.parse_args()
    model = GliderModel.load(models_path("vehicles", "perching.yaml"))
    problem = PerchingProblem.load("perching_hook")
    policy = tracking_policy(model, plan(model, problem))
    print("| command error | wind | gain | height | largest rate | h + L |")
    print("|---|---|---|---|---|---|", flush=True)
    for row in ROWS:
        error, wind = row.get("command_error", 0.0), 100.0 * row.get("wind", 0.0)
        start = (
            f"| {error:g} rad/s | {wind:g} cm/s | {row.get('elevator_gain', 40):g} |"
        )
        found = shape_of(model, policy, problem, args.steps, **row)
        if found is None:
            print(f"{start} none | | |", flush=True)
            continue
        height, rate = found
        delay = f"{1e3 * error / rate:.1f} ms"
        print(
            f"{start} {100 * height:.1f} cm | {rate:.0f} rad/s² | {delay} |", flush=True
        )


if __name__ == "__main__":
    with threadpool_limits(limits=1, user_api="blas"):  # Small matrices.
        main()
