"""Plans a perch, replays it without feedback, and flies it from many launches.

Direct collocation finds the flight (25 knots, then 41), finite-horizon LQR tracks
it. Launches are perturbed: standard deviations of 0.04 m in height, 0.1 m/s in speed
and 0.02 rad in pitch. A flight perches if a hook can take it at the wire: within
5 cm, not faster than 2.8 m/s, nose up by 20° to 67°.

    python examples/perch.py
    python examples/perch.py --headless --json perch.json --figure perch.png
"""

import dataclasses
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from diagrams import closed_loop, open_loop, playback, simulate_flights
from diagrams.programs import program
from glider import GliderModel, Perches, PerchingProblem, Plan, plan, tracking_regulator

AFTER = 0.1
"""Time that a flight goes on after the plan's end [s]: it may pass the wire late."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class PerchStudy:
    """A plan, flown with and without feedback."""

    problem: PerchingProblem
    """Problem that the plan solves."""

    plan: Plan
    """Plan that was flown."""

    replayed: Perches
    """One flight of its commands without feedback, from the planned launch."""

    blind: Perches
    """The same from perturbed launches."""

    flights: Perches
    """Flights from those launches, with feedback."""

    def key_figures(self) -> dict[str, object]:
        """Returns the plan's numbers, misses and successes, for a file."""
        return {
            "cost": self.plan.cost,
            "duration": self.plan.duration,
            "knots": len(self.plan.times),
            "plan_seconds": self.plan.seconds,
            "max_defect": self.plan.max_defect,
            "path_defect": self.plan.path_defect,
            "open_loop_miss_m": self.replayed.misses[0],
            "open_loop_from_launches": self.blind.key_figures(),
            "closed_loop": self.flights.key_figures(),
            "launches": len(self.flights),
        }

    def describe(self) -> str:
        """Returns the plan, its replay and its flights in a few sentences."""
        plan = self.plan
        return (
            f"The plan costs {plan.cost:.2f} and takes {plan.duration:.4f} s "
            f"({len(plan.times)} knots, solved in {plan.seconds:.2f} s).\n"
            f"Replayed without feedback it misses by "
            f"{1000 * self.replayed.misses[0]:.2f} mm; from perturbed launches: "
            f"{self.blind.describe()}.\n"
            f"With feedback {self.flights.describe()}; the largest miss is "
            f"{1000 * max(self.flights.misses):.1f} mm."
        )


def fly(
    launches: int = 20,
    seed: int = 0,
    progress: program.Progress = program.silent,
    problem: PerchingProblem | None = None,
) -> PerchStudy:
    """Plans, replays the plan, and flies it from perturbed launches.

    Args:
        launches: number of flights.
        seed: of the launches.
        progress: called with a line of text as the work goes on.
        problem: what to fly, None for the article's perch.
    """
    model = GliderModel()
    problem = PerchingProblem() if problem is None else problem
    rng = np.random.default_rng(seed)
    starts = problem.draw_launches(launches, rng)

    # The problem holds launch, wire, limits and weights; the plan holds states,
    # elevator rates and times at its knots.
    planned = plan(model, problem, progress=progress)
    duration = planned.duration + AFTER

    # A Drake diagram each: the plan's commands to the servo of a glider, ...
    replay = open_loop(model, planned)
    # ... and time-varying LQR about the plan, u = u*(t) - K(t) (x - x*(t)).
    loop = closed_loop(model, tracking_regulator(model, planned))

    options: dict[str, Any] = {"progress": progress, "problem": problem}
    return PerchStudy(
        problem=problem,
        plan=planned,
        replayed=simulate_flights(replay, planned.states[:1], duration, **options),
        blind=simulate_flights(replay, starts, duration, **options),
        flights=simulate_flights(loop, starts, duration, **options),
    )


def save_figure(path: Path, study: PerchStudy) -> None:
    """Saves the paths and the elevator of the plan and its flights."""
    plan = study.plan
    figure = Figure(figsize=(9.5, 5.6), layout="constrained")
    top, bottom = figure.subplots(2, 1, height_ratios=[3, 2])
    program.plot_perches(top, plan, study.flights, study.blind)
    for flight in study.flights:
        elevator = np.degrees(flight.states[:, 3])
        bottom.plot(flight.times, elevator, color="#0072B2", lw=0.7, alpha=0.5)
    elevator = np.degrees(plan.states[:, 3])
    bottom.plot(plan.times, elevator, color="k", lw=1.8, ls=(0, (4, 2)))
    bottom.set(xlabel="time [s]", ylabel="elevator, up > 0 [°]")
    figure.savefig(path, dpi=150)


def main(arguments: Sequence[str] | None = None) -> None:
    """Flies as the command line says, prints and shows the result."""
    parser = program.make_parser(__doc__)
    program.add_launches(parser, 20)
    parser.add_argument(
        "--problem",
        default="perching",
        help="problem file, or the name of one in models/problems (perching_hook)",
    )
    args = program.read_options(parser, arguments, figure="paths, as PNG")
    problem = PerchingProblem.load(args.problem)
    with program.working("plan (compiles once)") as progress:
        flown = fly(args.launches, args.seed, progress, problem)
    print(flown.describe())
    program.write_json(args, flown.key_figures() | {"seed": args.seed})
    program.write_figure(args, save_figure, flown)
    worst = playback.track_of("worst launch", flown.flights.worst)
    planned = playback.track_of("plan", flown.plan, playback.GREY)
    program.show(args, [worst, planned], "Perch")


if __name__ == "__main__":
    sys.exit(program.run(main))
