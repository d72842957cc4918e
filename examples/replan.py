"""Tracking a plan or planning again? TVLQR, MPPI and MPC from perturbed launches.

Three controllers with the same model fly the same launches, at 50 commands a second:

    TVLQR   follows one plan by time-varying linear-quadratic feedback
    MPPI    draws 1024 command sequences from each measured state, and weighs them
    MPC     improves its plan from each measured state by one quadratic program

The glider that flies (--truth) may have an effect that the model (--model, by default
its nominal one) lacks. With --estimated the controllers get what a Kalman filter makes
of motion capture (120 Hz, 1 mm) in place of the true state.

    python examples/replan.py
    python examples/replan.py --truth head_wind --model out/head_wind/model.yaml
    python examples/replan.py --truth set_wing --launches 20 --width 2 --figure r.png
"""

import sys
from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from diagrams import closed_loop, estimated_loop, playback, simulate_flights
from diagrams.programs import program
from glider import (
    ExtendedKalmanFilter,
    GliderModel,
    ModelPredictiveController,
    MppiController,
    Perches,
    PerchingProblem,
    Plan,
    perching_filter,
    plan,
    tracking_regulator,
)

COMMAND_RATE = 50.0
"""Rate of the commands, held between [Hz]."""

AFTER = 0.2
"""Time that a flight goes on after the plan's end [s]: a controller that plans again
may reach the wire later than its first plan."""

CONTROLLERS = ("TVLQR", "MPPI", "MPC")
"""Names of the controllers."""


def race(
    truth: GliderModel,
    model: GliderModel,
    problem: PerchingProblem,
    starts: np.ndarray,
    *,
    seed: int = 0,
    unsure: float | None = None,
    progress: program.Progress = program.silent,
) -> tuple[Plan, dict[str, Perches], list]:
    """Flies launches of a glider under three controllers made with a model of it.

    MPPI and MPC plan with the goal and the weights of models/problems/replanning.yaml.

    Args:
        truth: the glider that flies.
        model: what is believed of it.
        problem: of the plan that TVLQR follows and MPPI starts from.
        starts: (B, 7) launch states.
        seed: of MPPI and of motion capture's noise, which is the same for each
            controller.
        unsure: how wide the filter's prior of a launch is, in usual deviations; None
            for no filter.
        progress: called with a line of text as the work goes on.

    Returns:
        the plan, the flights by controller, and what MPC reports of each of its plans.

    Raises:
        PlanningError: where the model cannot do what the problem asks.
    """
    planned = plan(model, problem, progress=progress)
    goal = PerchingProblem.load("replanning")
    rate = COMMAND_RATE
    plans = []
    controllers = {
        "TVLQR": tracking_regulator(model, planned),
        "MPPI": MppiController(model, goal, planned, command_rate=rate, seed=seed),
        "MPC": ModelPredictiveController(model, goal, rate, plans.append),
    }
    flights = {}
    for name, controller in controllers.items():
        progress(f"fly by {name}")
        # MPPI and MPC hold their commands themselves.
        held = {"planned": model, "command_rate": rate if name == "TVLQR" else None}
        noise = None
        if unsure is None:
            loop = closed_loop(truth, controller, **held)
        else:
            ekf, prior = perching_filter(model, planned.states[0], unsure)
            estimator = ExtendedKalmanFilter(ekf, prior)
            loop = estimated_loop(truth, controller, estimator, **held)
            noise = np.random.default_rng(seed)
        flights[name] = simulate_flights(
            loop,
            starts,
            planned.duration + AFTER,
            problem=problem,
            capture_noise=noise,
            progress=progress,
        )
    return planned, flights, plans


def main(arguments: Sequence[str] | None = None) -> None:
    """Flies all three, and shows the launch that each misses by most."""
    parser = program.make_parser(__doc__)
    program.add_truth(parser, "set_wing")
    words = "model that is planned with (default: the truth without its effects)"
    parser.add_argument("--model", help=words)
    program.add_launches(parser, 10)
    words = "of the launch errors, in usual standard deviations (default: %(default)s)"
    parser.add_argument("--width", type=float, default=1.0, help=words)
    words = "give the controllers a Kalman filter's estimate"
    parser.add_argument("--estimated", action="store_true", help=words)
    args = program.read_options(parser, arguments, figure="paths, as PNG")

    truth = GliderModel.load(args.truth)
    model = GliderModel(parameters=truth.parameters)
    if args.model:
        model = GliderModel.load(args.model)
    problem = PerchingProblem()
    rng = np.random.default_rng(args.seed)
    starts = problem.draw_launches(args.launches, rng, scale=args.width)
    unsure = args.width if args.estimated else None
    with program.working("plan (compiles once)") as progress:
        planned, flights, plans = race(
            truth, model, problem, starts, unsure=unsure, progress=progress
        )
    for name, flown in flights.items():
        print(f"{name}: {flown.describe()}")
    took = [1e3 * again.seconds for again in plans]
    failed = sum(again.failed for again in plans)
    print(
        f"MPC made {len(plans)} plans, {failed} failed; median {np.median(took):.1f} "
        f"ms, slowest {max(took):.1f} ms, of {1e3 / COMMAND_RATE:.0f}"
    )

    if args.figure:
        figure = Figure(figsize=(9.5, 7.0), layout="constrained")
        axes = figure.subplots(3, 1)
        for ax, (name, flown) in zip(axes, flights.items(), strict=True):
            program.plot_perches(ax, planned, flown)
            ax.set_title(f"{name}: {flown.perched} of {len(flown)} perch", loc="left")
        figure.savefig(args.figure, dpi=150)
    colors = {"TVLQR": playback.RED, "MPPI": playback.GREEN, "MPC": None}
    tracks = []
    for name, flown in reversed(flights.items()):
        track = playback.track_of(f"worst by {name}", flown.worst, colors[name])
        tracks.append(track)
    program.show(args, tracks, f"Tracking or planning again: {args.truth}")


if __name__ == "__main__":
    sys.exit(program.run(main))
