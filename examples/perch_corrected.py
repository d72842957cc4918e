"""What closing the loop is worth: the perch miss with a nominal and a corrected model.

The true glider has an effect that its nominal model lacks, and the planner does not
know it. With the nominal model it plans, flies and logs; the logs are traced; with the
corrected model it plans and flies again. Launches are perturbed as in `perch.py`;
commands come at 50 Hz.

    python examples/perch_corrected.py --truth head_wind
    python examples/perch_corrected.py --truth my_glider.yaml --headless --json out.json
"""

import dataclasses
import sys
from collections.abc import Sequence
from pathlib import Path

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
    Result,
    close_the_loop,
    plan,
    print_summary,
    tracking_regulator,
)

COMMAND_RATE = 50.0
"""Rate of the feedback's commands, held between [Hz]."""

CAPTURE_RATE = 120.0
"""Rate of motion capture [Hz]."""

AFTER = 0.1
"""Time that a flight goes on after the plan's end [s]: it may pass the wire late."""

RED, BLUE = "#D55E00", "#0072B2"


@dataclasses.dataclass(frozen=True, kw_only=True)
class Rehearsal:
    """Flights of a glider under the plan and the feedback of a model."""

    plan: Plan
    """Plan made with the model, as is the feedback."""

    flights: Perches
    """Flights of the true glider, and their logs as motion capture measures them."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Correction:
    """Worth of closing the loop: rehearsals before and after."""

    truth: GliderModel
    """Glider that flies."""

    before: Rehearsal
    """Rehearsal with its nominal model."""

    found: Result
    """What the logs of those flights show."""

    after: Rehearsal
    """Rehearsal with the corrected model."""

    def key_figures(self) -> dict[str, object]:
        """Returns effects, misses and successes, for a file."""
        return {
            "effect_true": name_effects(self.truth),
            "effect_found": [effect.kind for effect in self.found.effects],
            "before": self.before.flights.key_figures(),
            "after": self.after.flights.key_figures(),
            "launches": len(self.before.flights),
        }

    def describe(self) -> str:
        """Returns how launches ended before and after."""
        return (
            f"planned nominal: {self.before.flights.describe()}\n"
            f"planned corrected: {self.after.flights.describe()}"
        )


def name_effects(model: GliderModel) -> str:
    """Returns the kinds of a model's effects and free functions, or "nothing"."""
    kinds = [effect.kind.kind for effect in model.effects]
    kinds += dict.fromkeys(own.kind for own in model.free_functions)
    return " + ".join(kinds) or "nothing"


def rehearse(
    truth: GliderModel,
    model: GliderModel,
    problem: PerchingProblem,
    starts: np.ndarray,
    rng: np.random.Generator,
    progress: program.Progress = program.silent,
) -> Rehearsal:
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
    planned = plan(model, problem, progress=lambda text: progress(f"plan: {text}"))
    progress("feedback along the plan")
    loop = closed_loop(
        truth,
        tracking_regulator(model, planned),
        planned=model,
        command_rate=COMMAND_RATE,
        motion_capture=CAPTURE_RATE,
    )
    flights = simulate_flights(
        loop,
        starts,
        planned.duration + AFTER,
        problem=problem,
        capture_noise=rng,
        progress=lambda text: progress(f"fly: {text}"),
    )
    return Rehearsal(plan=planned, flights=flights)


def fly(
    truth: GliderModel,
    launches: int = 100,
    seed: int = 0,
    progress: program.Progress = program.silent,
) -> Correction:
    """Flies with the nominal model, traces the logs, and flies with what they show.

    Args:
        truth: the glider that flies.
        launches: number of flights, before and after.
        seed: of launches and noise.
        progress: called with a line of text as the work goes on.
    """
    problem, rng = PerchingProblem(), np.random.default_rng(seed)

    def fly_with(model: GliderModel) -> Rehearsal:
        starts = problem.draw_launches(launches, rng)
        return rehearse(truth, model, problem, starts, rng, progress)

    before = fly_with(GliderModel(parameters=truth.parameters))
    found = close_the_loop(before.flights.campaign, progress=progress)
    after = fly_with(found.model)
    return Correction(truth=truth, before=before, found=found, after=after)


def save_figure(path: Path, flown: Correction) -> None:
    """Saves the paths before and after, and the distribution of the misses."""
    figure = Figure(figsize=(9.5, 7.0), layout="constrained")
    axes = figure.subplots(3, 1)
    for ax, rehearsal, name, color in (
        (axes[0], flown.before, "nominal", RED),
        (axes[1], flown.after, "corrected", BLUE),
    ):
        program.plot_perches(ax, rehearsal.plan, rehearsal.flights, color=color)
        ax.set_title(f"planned with the {name} model", loc="left")
        misses = 1000.0 * np.sort(rehearsal.flights.misses)
        share = 100.0 * np.arange(1, len(misses) + 1) / len(misses)
        label = f"planned {name}"
        axes[2].step(misses, share, where="post", color=color, label=label)
    reach = 1000.0 * PerchingProblem().hook.reach
    axes[2].axvline(reach, color="k", lw=1.0, label="reach of the hook")
    axes[2].set(xlabel="miss [mm]", ylabel="flights that miss by less [%]")
    axes[2].set_xscale("log")
    axes[2].legend(loc="center left", bbox_to_anchor=(1.01, 0.5), frameon=False)
    figure.savefig(path, dpi=150)


def main(arguments: Sequence[str] | None = None) -> None:
    """Flies as the command line says, prints and shows the result."""
    parser = program.make_parser(__doc__)
    program.add_truth(parser, "head_wind")
    program.add_launches(parser, 100, least=3)
    args = program.read_options(parser, arguments, figure="paths, as PNG")
    truth = GliderModel.load(args.truth)
    with program.working("plan (compiles once)") as progress:
        flown = fly(truth, args.launches, args.seed, progress)
    print_summary(flown.found, Console())
    print(flown.describe())
    program.write_json(args, flown.key_figures() | {"seed": args.seed})
    program.write_figure(args, save_figure, flown)
    tracks = [
        playback.track_of("planned corrected", flown.after.flights[0]),
        playback.track_of("planned nominal", flown.before.flights[0], playback.RED),
        playback.track_of(
            "plan of the nominal model", flown.before.plan, playback.GREY
        ),
    ]
    program.show(args, tracks, f"Before and after: {args.truth}")


if __name__ == "__main__":
    sys.exit(program.run(main))
