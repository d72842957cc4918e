"""Tracking a plan or planning again? TVLQR, MPPI and MPC from perturbed launches.

Three controllers with the same model fly the same launches, at 50 commands a second:

    TVLQR   follows one plan by time-varying linear-quadratic feedback
    MPPI    draws 1024 command sequences from each measured state, and weighs them
    MPC     plans again from each measured state by direct collocation, in milliseconds

The glider that flies (--truth) may have an effect that its nominal model lacks. With
--corrected its flights are traced first, and the corrected model is used. With
--estimated the controllers get what a Kalman filter makes of motion capture (120 Hz,
1 mm) in place of the true state.

    python examples/replan.py
    python examples/replan.py --truth head_wind --corrected --headless --json out.json
    python examples/replan.py --truth set_wing --launches 20 --width 2 --figure r.png

--json: {"truth", "corrected", "estimated", "width", "seed", "launches",
"controllers": {name: {"miss_m", "speed_at_wire_m_s", "pitch_at_wire_rad", "perched"}},
"replanning": {"plans", "failed", "median_s", "slowest_s"}} of MPC's plans.
"""

import dataclasses
import sys
from collections.abc import Sequence
from pathlib import Path

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
    close_the_loop,
    perching_filter,
    plan,
    tracking_regulator,
)

COMMAND_RATE = 50.0
"""Rate of the commands, held between [Hz]."""

CAPTURE_RATE = 120.0
"""Rate of motion capture [Hz]."""

AFTER = 0.2
"""Time that a flight goes on after the plan's end [s]: a controller that plans again
may reach the wire later than its first plan."""

TRACED = 100
"""Number of flights that the corrected model is traced from."""

CONTROLLERS = ("TVLQR", "MPPI", "MPC")
"""Names of the controllers."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Comparison:
    """The same launches of one glider under each controller."""

    plan: Plan
    """Plan that TVLQR follows and MPPI starts from."""

    flights: dict[str, Perches]
    """Flights by the controller's name."""

    seconds: np.ndarray
    """Times that MPC's plans took [s]."""

    failures: int
    """How many of these plans failed; the last one then goes on."""

    def key_figures(self) -> dict[str, object]:
        """Returns misses and successes, and what planning again took, for a file."""
        return {
            "launches": len(self.flights["MPC"]),
            "controllers": {
                name: flights.key_figures() for name, flights in self.flights.items()
            },
            "replanning": {
                "plans": len(self.seconds),
                "failed": self.failures,
                "median_s": float(np.median(self.seconds)),
                "slowest_s": float(np.max(self.seconds)),
            },
        }

    def describe(self) -> str:
        """Returns a line for each controller, and how long MPC's plans took."""
        lines = [f"{name}: {f.describe()}" for name, f in self.flights.items()]
        half, slowest = 1e3 * np.median(self.seconds), 1e3 * np.max(self.seconds)
        return "\n".join(
            [
                *lines,
                f"MPC made {len(self.seconds)} plans, {self.failures} failed; median "
                f"{half:.1f} ms, slowest {slowest:.1f} ms, of {1e3 / COMMAND_RATE:.0f}",
            ]
        )


def race(
    truth: GliderModel,
    model: GliderModel,
    problem: PerchingProblem,
    starts: np.ndarray,
    *,
    seed: int = 0,
    unsure: float | None = None,
    progress: program.Progress = program.silent,
) -> Comparison:
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

    Raises:
        PlanningError: where the model cannot do what the problem asks.
    """
    planned = plan(model, problem, progress=lambda text: progress(f"plan: {text}"))
    replanning = PerchingProblem.load("replanning")
    plans = []  # What MPC reports after each of its plans.
    controllers = {
        "TVLQR": tracking_regulator(model, planned),
        "MPPI": MppiController(
            model, replanning, planned, command_rate=COMMAND_RATE, seed=seed
        ),
        "MPC": ModelPredictiveController(model, replanning, COMMAND_RATE, plans.append),
    }
    flights = {}
    for name, controller in controllers.items():
        progress(f"fly by {name}")
        # MPPI and MPC hold their commands themselves.
        rate = COMMAND_RATE if name == "TVLQR" else None
        noise = None
        if unsure is None:
            loop = closed_loop(truth, controller, planned=model, command_rate=rate)
        else:
            ekf, prior = perching_filter(model, planned.states[0], unsure)
            estimator = ExtendedKalmanFilter(ekf, prior)
            loop = estimated_loop(
                truth, controller, estimator, planned=model, command_rate=rate
            )
            noise = np.random.default_rng(seed)
        flights[name] = simulate_flights(
            loop,
            starts,
            planned.duration + AFTER,
            problem=problem,
            capture_noise=noise,
            progress=progress,
        )
    return Comparison(
        plan=planned,
        flights=flights,
        seconds=np.array([again.seconds for again in plans]),
        failures=sum(again.failed for again in plans),
    )


def corrected_model(
    truth: GliderModel,
    flights: int,
    rng: np.random.Generator,
    progress: program.Progress = program.silent,
) -> GliderModel:
    """Traces flights that were planned with the nominal model; returns what is found.

    Args:
        truth: the glider that flies.
        flights: how many.
        rng: of the launches and of the noise of motion capture.
        progress: called with a line of text as the work goes on.
    """
    problem, nominal = PerchingProblem(), GliderModel(parameters=truth.parameters)
    starts = problem.draw_launches(flights, rng)
    planned = plan(nominal, problem, progress=progress)
    loop = closed_loop(
        truth,
        tracking_regulator(nominal, planned),
        planned=nominal,
        command_rate=COMMAND_RATE,
        motion_capture=CAPTURE_RATE,
    )
    flown = simulate_flights(
        loop, starts, planned.duration + 0.1, capture_noise=rng, progress=progress
    )
    return close_the_loop(flown.campaign, progress=progress).model


def run(
    truth: GliderModel,
    launches: int = 10,
    seed: int = 0,
    *,
    width: float = 1.0,
    corrected: bool = False,
    estimated: bool = False,
    progress: program.Progress = program.silent,
) -> Comparison:
    """Draws launches and flies them with the nominal or the corrected model.

    Args:
        truth: the glider that flies.
        launches: number of flights by each controller.
        seed: of all that is random.
        width: of the launch errors, in usual standard deviations.
        corrected: whether the model is traced from flights first.
        estimated: whether the controllers get a filter's estimate.
        progress: called with a line of text as the work goes on.
    """
    problem, model = PerchingProblem(), GliderModel(parameters=truth.parameters)
    if corrected:
        rng = np.random.default_rng(seed)
        model = corrected_model(truth, TRACED, rng, progress)
    rng = np.random.default_rng([1 + seed, round(width)])
    starts = problem.draw_launches(launches, rng, scale=width)
    unsure = width if estimated else None
    return race(truth, model, problem, starts, unsure=unsure, progress=progress)


def save_figure(path: Path, found: Comparison) -> None:
    """Saves the paths under each controller."""
    figure = Figure(figsize=(9.5, 7.0), layout="constrained")
    for ax, (name, flights) in zip(
        figure.subplots(3, 1), found.flights.items(), strict=True
    ):
        program.plot_perches(ax, found.plan, flights)
        ax.set_title(f"{name}: {flights.perched} of {len(flights)} perch", loc="left")
    figure.savefig(path, dpi=150)


def main(arguments: Sequence[str] | None = None) -> None:
    """Flies as the command line says, prints and shows the result."""
    parser = program.make_parser(__doc__)
    program.add_truth(parser, "set_wing")
    program.add_launches(parser, 10)
    words = "of the launch errors, in usual standard deviations (default: %(default)s)"
    parser.add_argument("--width", type=float, default=1.0, help=words)
    words = "trace flights first and use the corrected model"
    parser.add_argument("--corrected", action="store_true", help=words)
    words = "give the controllers a Kalman filter's estimate"
    parser.add_argument("--estimated", action="store_true", help=words)
    args = program.read_options(parser, arguments, figure="paths, as PNG")
    truth = GliderModel.load(args.truth)
    asked = {name: getattr(args, name) for name in ("width", "corrected", "estimated")}
    with program.working("plan (compiles once)") as progress:
        found = run(truth, args.launches, args.seed, **asked, progress=progress)
    print(found.describe())
    asked |= {"truth": args.truth, "seed": args.seed}
    program.write_json(args, asked | found.key_figures())
    program.write_figure(args, save_figure, found)
    colors = {"TVLQR": playback.RED, "MPPI": playback.GREEN, "MPC": None}
    tracks = [
        playback.track_of(f"worst by {name}", flights.worst, colors[name])
        for name, flights in reversed(found.flights.items())
    ]
    program.show(args, tracks, f"Tracking or planning again: {args.truth}")


if __name__ == "__main__":
    sys.exit(program.run(main))
