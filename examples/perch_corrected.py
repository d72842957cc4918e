"""What closing the loop is worth: the perch miss with a nominal and a corrected model.

The true glider has an effect that its nominal model lacks, and the planner does not
know it. With the nominal model it plans, flies and logs; the logs are traced; with the
corrected model it plans and flies again. Launches are perturbed as in `perch.py`;
commands come at 50 Hz, motion capture logs at 120 Hz.

    python examples/perch_corrected.py --truth head_wind
    python examples/perch_corrected.py --truth my_glider.yaml --headless --figure p.png
"""

import sys
from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure
from rich.console import Console

from diagrams import closed_loop, playback, simulate_flights
from diagrams.programs import program
from glider import (
    GliderModel,
    Perches,
    PerchingProblem,
    Plan,
    close_the_loop,
    plan,
    print_summary,
    tracking_regulator,
)


def rehearse(
    truth: GliderModel,
    model: GliderModel,
    problem: PerchingProblem,
    starts: np.ndarray,
    rng: np.random.Generator,
    progress: program.Progress = program.silent,
) -> tuple[Plan, Perches]:
    """Plans and makes the feedback with a model, and flies the truth with both.

    The feedback gets the rigid body's true states; states that the model's effects
    have of their own run in an observer. Motion capture logs with noise.

    Args:
        truth: the glider that flies.
        model: what is believed of it.
        problem: what to fly.
        starts: (B, 7) launch states.
        rng: draws the noise of motion capture.
        progress: called with a line of text as the work goes on.

    Raises:
        PlanningError: where the model cannot do what the problem asks.
    """
    planned = plan(model, problem, progress=progress)
    regulator = tracking_regulator(model, planned)
    loop = closed_loop(
        truth, regulator, planned=model, command_rate=50.0, motion_capture=120.0
    )
    end = planned.duration + 0.1  # A glider may pass the wire late.
    flown = simulate_flights(
        loop, starts, end, problem=problem, capture_noise=rng, progress=progress
    )
    return planned, flown


def main(arguments: Sequence[str] | None = None) -> None:
    """Flies, traces and flies again; shows a flight of both."""
    parser = program.make_parser(__doc__)
    program.add_truth(parser, "head_wind")
    program.add_launches(parser, 100, least=3)
    args = program.read_options(parser, arguments, figure="paths, as PNG")

    truth = GliderModel.load(args.truth)
    nominal = GliderModel(parameters=truth.parameters)
    problem = PerchingProblem()
    rng = np.random.default_rng(args.seed)
    with program.working("plan (compiles once)") as progress:
        starts = problem.draw_launches(args.launches, rng)
        known = problem, starts, rng, progress
        first_plan, before = rehearse(truth, nominal, *known)
        found = close_the_loop(before.campaign, progress=progress)
        starts = problem.draw_launches(args.launches, rng)
        known = problem, starts, rng, progress
        second_plan, after = rehearse(truth, found.model, *known)
    print_summary(found, Console())
    print(f"planned nominal: {before.describe()}")
    print(f"planned corrected: {after.describe()}")

    if args.figure:
        figure = Figure(figsize=(9.5, 5.0), layout="constrained")
        top, bottom = figure.subplots(2, 1)
        program.plot_perches(top, first_plan, before, color="#D55E00")
        program.plot_perches(bottom, second_plan, after)
        top.set_title("planned with the nominal model", loc="left")
        bottom.set_title("planned with the corrected model", loc="left")
        figure.savefig(args.figure, dpi=150)
    tracks = [
        playback.track_of("planned corrected", after[0]),
        playback.track_of("planned nominal", before[0], playback.RED),
        playback.track_of("plan of the nominal model", first_plan, playback.GREY),
    ]
    program.show(args, tracks, f"Before and after: {args.truth}")


if __name__ == "__main__":
    sys.exit(program.run(main))
