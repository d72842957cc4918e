"""Certifies a perch: how large may launch errors be, nominal and corrected model?

A funnel is a tube of states about the plan that the closed loop never leaves and that
ends at the wire. Sums of squares prove it for the third-order dynamics, the servo's
rate and travel limits inside; every proof is then checked in exact arithmetic. Flights
of the full dynamics from its boundary try to leave it. With --remainder the funnel
accounts for what the polynomials omit; --prove proves, in continuous time, that no
flight leaves; --confidence makes the second for all gliders that the logs allow; with
--hook the hook takes every state at its end.

The true glider has an effect that its nominal model lacks. It flies with that model's
plan, its logs are traced, and a second funnel is made with the corrected model. Does
the true glider stay in the first funnel, and in the second?

    python examples/perching_funnel.py
    python examples/perching_funnel.py --truth slow_servo --figure funnels.png
    python examples/perching_funnel.py --hook --remainder 1.1 --prove --json f.json
    python examples/perching_funnel.py --load models/funnels
"""

import argparse
import dataclasses
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from pydrake.geometry import Meshcat, Rgba
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import LogVectorOutput

from diagrams import closed_loop, playback, simulate_flights
from diagrams.programs import program
from glider import (
    GliderModel,
    InputError,
    PerchingProblem,
    Result,
    close_the_loop,
    funnels,
    plan,
    tracking_policy,
    tracking_regulator,
)

WORDS = {"drawn": "nominal model", "corrected": "corrected model"}
"""Name of a funnel in files to that for people."""

STATES = ("x", "z", "pitch", "elevator", "xdot", "zdot", "pitchdot")

SHOWN = 40
"""Number of flights from inside that are kept to look at."""

RED, BLUE = "#D55E00", "#0072B2"


# ------------------------------------------------------------------------ settings


@dataclasses.dataclass(frozen=True, kw_only=True)
class FunnelTrials:
    """Settings by which funnels are made and tried."""

    settings: funnels.FunnelSettings = funnels.FunnelSettings()
    """Settings of a funnel that is made."""

    samples: int = 8000
    """Number of flights from a boundary."""

    every: int = 1
    """Step between the intervals in which a certificate is checked."""

    prove: bool = False
    """Whether to prove that no flight leaves, where a remainder is accounted for."""

    problem: PerchingProblem = dataclasses.field(default_factory=PerchingProblem)
    """Problem that a funnel is made for and compared with."""

    hook: bool = False
    """Whether the problem's hook has to take every state of the last set."""

    confidence: float | None = None
    """Probability with which the gliders that a funnel is made for include the true
    one, as far as logs determine it; None: the model alone."""


def read_options(arguments: Sequence[str] | None) -> argparse.Namespace:
    """Reads the options, and checks the files to write.

    Returns:
        The options: `trials` is how to try funnels, `load` and `save` are the files
        of the nominal model and the corrected one, none where not asked for.

    Raises:
        InputError: a file cannot be written, or there are no such trials.
    """
    parser = program.make_parser(__doc__)
    program.add_truth(parser, "head_wind")
    program.add_count(parser, "--samples", 8000, "flights", least=8)
    program.add_count(parser, "--every", 1, "exact checks")
    program.add_count(parser, "--flights", 20, "that are traced", least=3)
    words = "times the largest found"
    parser.add_argument("--remainder", type=float, default=0.0, help=words)
    words = "share of it that its bound keeps where it is small; 1: faster to prove"
    floor = funnels.FunnelSettings.floor
    parser.add_argument("--floor", type=float, default=floor, help=words)
    words = "account for a command error of this size, at any time [rad/s]"
    parser.add_argument("--command-error", type=float, default=0.0, help=words)
    words = "account for wind of this speed, at any time [m/s]"
    parser.add_argument("--wind", type=float, default=0.0, help=words)
    words = "make the feedback with the funnel's shape, up to this gain [1/s], e.g. 40"
    parser.add_argument("--elevator-gain", type=float, default=0.0, help=words)
    words = "shape the funnels for errors of the launch, above all in height"
    parser.add_argument("--for-launches", action="store_true", help=words)
    words = "make the second for the gliders that the logs allow with it"
    parser.add_argument("--confidence", metavar="P", type=float, help=words)
    words = "for models/problems/perching_hook.yaml: the hook takes all of the last set"
    parser.add_argument("--hook", action="store_true", help=words)
    words = "prove that no flight leaves; takes minutes"
    parser.add_argument("--prove", action="store_true", help=words)
    program.add_count(parser, "--seed", 0, "of flights", least=0)
    parser.add_argument("--load", metavar="DIR", type=Path, help="funnels saved there")
    parser.add_argument("--save", metavar="DIR", type=Path, help="where to save them")
    args = program.read_options(parser, arguments, figure="tubes, as PNG")
    if args.prove and not (args.remainder or args.load):
        parser.error("--prove: there is nothing to prove without --remainder.")
    if args.confidence is not None and (args.load or not args.remainder):
        parser.error("--confidence: it takes a --remainder, and no --load.")
    if args.confidence is not None and not 0.0 < args.confidence < 1.0:
        parser.error("--confidence: expected a probability between 0 and 1.")
    args.load, args.save = (
        () if folder is None else (folder / "drawn.npz", folder / f"{name}.npz")
        for name in [Path(args.truth).stem]
        for folder in (args.load, args.save)
    )
    args.trials = FunnelTrials(
        problem=PerchingProblem.load("perching_hook")
        if args.hook
        else PerchingProblem(),
        hook=args.hook,
        settings=funnels.FunnelSettings(
            remainder=args.remainder,
            floor=args.floor,
            command_error=args.command_error,
            wind=args.wind,
            elevator_gain=args.elevator_gain,
            launch_sizes=funnels.LAUNCH_SIZES if args.for_launches else None,
        ),
        samples=args.samples,
        every=args.every,
        prove=args.prove,
        confidence=args.confidence,
    )
    program.check_files(*args.save)
    return args


# -------------------------------------------------------- one funnel, made and tried


@dataclasses.dataclass(frozen=True, kw_only=True)
class FunnelStudy:
    """A funnel, and how it stood check and trials."""

    funnel: funnels.Funnel
    """Funnel that was made or loaded."""

    verdict: funnels.Verdict
    """Outcome of the check in exact arithmetic."""

    falsification: funnels.Trial
    """Flights of its own glider from its boundary."""

    proof: funnels.FlightProof | None
    """Proof that no flight leaves it, where asked for."""

    flights: np.ndarray
    """Paths (SHOWN, T, n) of launches from inside."""

    on_truth: funnels.Trial | None
    """Flights of the true glider; None where their states differ."""

    on_set: funnels.Trial | None = None
    """Flights of the gliders that it was made for; None where it is one alone."""

    least_margin: float | None = None
    """Least margin of the true glider in it, launched as planned: 1 at the nominal
    flight, negative outside; None where their states differ."""


def certify_perch(
    model: GliderModel,
    trials: FunnelTrials,
    progress: program.Progress = program.silent,
    confidence: funnels.ConfidenceSet | None = None,
) -> funnels.Funnel:
    """Plans a perch with a model and computes the funnel of its feedback.

    Args:
        model: the glider.
        trials: the problem, whether its hook is the goal, and the settings.
        progress: called with a line of text as the work goes on.
        confidence: set of gliders that it is for; None for the model alone.

    Raises:
        InputError: there is no certified funnel.
        PlanningError: there is no plan.
    """
    problem = trials.problem
    planned = plan(model, problem, progress=progress)
    try:
        return funnels.make_funnel(
            model,
            tracking_policy(model, planned),
            trials.settings,
            confidence=confidence,
            hook_of=problem if trials.hook else None,
            progress=progress,
        )
    except funnels.SolverError as error:
        raise InputError(f"There is no funnel for this glider: {error}") from None


def study_funnel(
    source: GliderModel | Result | Path,
    truth: GliderModel,
    trials: FunnelTrials,
    rng: np.random.Generator,
    progress: program.Progress = program.silent,
) -> FunnelStudy:
    """Makes a funnel for a model or loads one from a file, checks it and tries it.

    Args:
        source: the model, the result of tracing logs, or a file of a funnel.
        truth: a glider that flies in it too.
        trials: how.
        rng: of the flights.
        progress: called with a line of text as the work goes on.
    """
    if isinstance(source, Path):
        funnel = funnels.load_funnel(source)
    elif isinstance(source, GliderModel):
        funnel = certify_perch(source, trials, progress)
    else:
        allowed = None
        if trials.confidence is not None and source.covariance is not None:
            allowed = funnels.make_confidence(
                source.model, source.covariance, trials.confidence
            )
        funnel = certify_perch(source.model, trials, progress, allowed)

    progress("checking the certificate in exact arithmetic")
    purpose = funnels.Purpose(problem=trials.problem, hook=trials.hook)
    verdict = funnels.check_funnel(funnel, trials.every, purpose=purpose)
    progress("trying to falsify the funnel by flights")
    falsification = funnels.falsify_funnel(funnel, trials.samples, rng)
    on_set = None
    if funnel.is_of_set:
        allowed = funnel.allowed
        on_set = funnels.falsify_funnel(funnel, trials.samples, rng, allowed)
    proof = None
    if trials.prove and verdict.holds and funnel.beta.any():
        proof = funnels.prove_flights(
            funnel,
            trials.every,
            progress=lambda share: progress(f"funnel: proof, {100.0 * share:.0f} %"),
        )
    flights = funnels.fly_inside(funnel, SHOWN, rng)
    progress("the funnel, flown by the true glider")
    try:
        on_truth = funnels.falsify_funnel(funnel, trials.samples, rng, model=truth)
        margin = least_margin(funnel, truth)
    except InputError:  # The funnel's model has states that the true glider lacks.
        on_truth = margin = None
    return FunnelStudy(
        funnel=funnel,
        verdict=verdict,
        falsification=falsification,
        proof=proof,
        flights=flights,
        on_truth=on_truth,
        on_set=on_set,
        least_margin=margin,
    )


def least_margin(funnel: funnels.Funnel, truth: GliderModel) -> float:
    """Flies a glider as planned, a FunnelMonitor watching it in its Drake diagram.

    Returns:
        the least margin until the plan's end.
    """
    model = funnel.nominal.model
    loop = closed_loop(truth, funnels.funnel_regulator(funnel), planned=model)
    builder = DiagramBuilder()
    builder.AddSystem(loop)
    monitor = builder.AddNamedSystem("monitor", funnels.FunnelMonitor(funnel))
    builder.Connect(loop.GetOutputPort("state"), monitor.get_input_port())
    log = LogVectorOutput(monitor.GetOutputPort("margin"), builder, 0.005)
    simulator = Simulator(builder.Build())
    context = simulator.get_mutable_context()
    glider = loop.GetSubsystemByName("glider").GetMyMutableContextFromRoot(context)
    glider.SetContinuousState(funnel.nominal.states[0])
    simulator.AdvanceTo(funnel.nominal.times[-1])
    return float(log.FindLog(context).data().min())


# --------------------------------------------------- both funnels, before and after


@dataclasses.dataclass(frozen=True, kw_only=True)
class FunnelComparison:
    """Funnels of a nominal model, and of the model which its flights' logs show."""

    nominal: FunnelStudy
    """Funnel of the nominal model."""

    corrected: FunnelStudy
    """Funnel of the corrected model."""

    @property
    def studies(self) -> dict[str, FunnelStudy]:
        """Both studies, by their names in files."""
        return {"drawn": self.nominal, "corrected": self.corrected}


def trace_flights(
    truth: GliderModel,
    flights: int,
    rng: np.random.Generator,
    progress: program.Progress = program.silent,
) -> Result:
    """Flies perches planned with the nominal model, logs them and traces the logs.

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
        command_rate=50.0,
        motion_capture=120.0,
    )
    flown = simulate_flights(
        loop, starts, planned.duration + 0.1, capture_noise=rng, progress=progress
    )
    return close_the_loop(flown.campaign, progress=progress)


def run(
    truth: GliderModel,
    trials: FunnelTrials,
    seed: int = 0,
    *,
    load: tuple[Path, ...] = (),
    flights: int = 20,
    progress: program.Progress = program.silent,
) -> FunnelComparison:
    """Certifies perches with the nominal and with the corrected model; tries both.

    Args:
        truth: the glider that flies.
        trials: how funnels are made and tried.
        seed: of all flights.
        load: files of both funnels; none are made then.
        flights: number of flights that are traced.
        progress: called with a line of text as the work goes on.
    """
    nominal, rng = GliderModel(parameters=truth.parameters), np.random.default_rng(seed)
    sources = load or (nominal, trace_flights(truth, flights, rng, progress))
    nominal, corrected = (
        study_funnel(source, truth, trials, rng, progress) for source in sources
    )
    return FunnelComparison(nominal=nominal, corrected=corrected)


# ------------------------------------------------------------------ what came of it


def inlet_of(funnel: funnels.Funnel) -> dict[str, float]:
    """Returns how far one state alone may deviate at the launch, by state."""
    return dict(zip(STATES, map(float, funnel.half_widths()), strict=False))


def key_figures(found: FunnelComparison) -> dict[str, object]:
    """Returns the figures of the nominal and the corrected model, and of the flights.

    Escapes of the true glider are null where its states are not the funnel's.
    """
    figures = figures_of(found.nominal)
    figures["corrected"] = figures_of(found.corrected)
    for name, study in found.studies.items():
        flown = study.on_truth
        figures[f"{name}_on_truth_escapes"] = flown and flown.escapes
        figures[f"{name}_on_truth_samples"] = flown and flown.samples
        figures[f"{name}_on_truth_least_margin"] = study.least_margin
    return figures


def figures_of(study: FunnelStudy) -> dict[str, object]:
    """Returns the key figures of a funnel: inlet, check, escapes, proof of remainder.

    The inlet is given by the half-widths of its slices: how far one state alone may
    deviate at the launch.
    """
    funnel, proof = study.funnel, study.proof
    inlet = inlet_of(funnel)
    return {
        "inlet": {
            "z_m": inlet["z"],
            "x_m": inlet["x"],
            "pitch_deg": float(np.degrees(inlet["pitch"])),
            "xdot": inlet["xdot"],
            "zdot": inlet["zdot"],
        },
        "seconds": funnel.seconds,
        "samples": study.falsification.samples,
        "escapes": study.falsification.escapes,
        "largest_end": float(study.falsification.ends.max()),
        "goal": list(funnel.settings.goal_axes(funnel.num_states)),
        "states": list(funnel.nominal.model.state_names),
        "effects": [effect.kind.kind for effect in funnel.nominal.model.effects],
        "remainder_inflation": funnel.settings.remainder,
        "remainder_proof": funnels.describe_proof(funnel, proof) if proof else None,
        "every_flight": bool(study.verdict.holds and proof and proof.is_whole),
        "solver": funnel.solver,
        "certificate_checked": study.verdict.holds,
        "checked_intervals": study.verdict.intervals,
        "faults": list(study.verdict.faults),
        "made_for": funnels.describe_set(funnel.allowed) if funnel.is_of_set else None,
        "on_set_samples": study.on_set and study.on_set.samples,
        "on_set_escapes": study.on_set and study.on_set.escapes,
    }


def describe(found: FunnelComparison, truth: str) -> str:
    """Returns a few sentences about both funnels.

    Args:
        found: the funnels.
        truth: what the true glider is called.
    """
    lines = []
    for name, study in found.studies.items():
        lines.append(describe_funnel(WORDS[name], study))
        if flown := study.on_truth:
            lines.append(
                f"  Flown by {truth}, {flown.escapes} of {flown.samples} flights leave "
                "it."
            )
            if study.least_margin is not None:
                lines.append(
                    "  Launched as planned, its least margin is "
                    f"{study.least_margin:.2f} (1 at the nominal flight, negative "
                    "outside)."
                )
        else:
            lines.append(f"  Flown by {truth}, it has no meaning: their states differ.")
    return "\n".join(lines)


def describe_funnel(name: str, study: FunnelStudy) -> str:
    """Returns the inlet of a funnel, its check and the flights that try to leave."""
    funnel, inlet = study.funnel, inlet_of(study.funnel)
    verdict, flown, proof = study.verdict, study.falsification, study.proof
    checked = "holds" if verdict.holds else "DOES NOT HOLD"
    text = (
        f"{name}: launch errors of up to {100 * inlet['z']:.1f} cm in height, "
        f"{np.degrees(inlet['pitch']):.1f}° in pitch or {inlet['xdot']:.2f} m/s in "
        f"speed ({funnel.seconds:.0f} s).\n"
        f"  Its certificate {checked} in {verdict.intervals} of {verdict.of_intervals} "
        f"intervals; {flown.escapes} of {flown.samples} flights from its boundary "
        "leave it."
    )
    if proof:
        text += f"\n  {funnels.describe_proof(funnel, proof)}"
    if funnel.is_of_set and study.on_set:
        gliders = funnels.describe_set(funnel.allowed)
        text += (
            f"\n  It was made for the gliders of a {gliders}: {study.on_set.escapes} "
            f"of their {study.on_set.samples} flights from its boundary leave it."
        )
    return text


# -------------------------------------------------------------------------- figures


def save_figures(path: Path, found: FunnelComparison) -> None:
    """Saves the figure of both funnels."""
    studies = {WORDS[name]: study for name, study in found.studies.items()}
    save_funnel_figure(path, studies)


def save_funnel_figure(path: Path, studies: dict[str, FunnelStudy]) -> None:
    """Saves the tubes in the vertical plane and their half-widths over time.

    Args:
        path: of the picture.
        studies: name to funnel and flights, two at most.
    """
    scales = {"z": (1.0, "m"), "pitch": (180.0 / np.pi, "°")}
    scales |= {"xdot": (1.0, "m/s"), "zdot": (1.0, "m/s")}
    figure = Figure(figsize=(10.0, 2.9 * len(studies) + 3.0), layout="constrained")
    grid = figure.add_gridspec(len(studies) + 1, len(scales))
    bands = [figure.add_subplot(grid[row, :]) for row in range(len(studies))]
    widths = {state: figure.add_subplot(grid[-1, k]) for k, state in enumerate(scales)}
    for ax, (name, study), color in zip(
        bands, studies.items(), (RED, BLUE), strict=False
    ):
        draw_band(ax, study.funnel, color)
        for k, flown in enumerate(study.flights):
            count = len(study.flights)
            label = f"{count} flight{'s' if count > 1 else ''}" if k == 0 else None
            ax.plot(*flown[:, :2].T, color="k", lw=0.5, alpha=0.35, label=label)
        ax.set_title(name, loc="left")
        ax.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0), frameon=False)
        times = study.funnel.nominal.times
        half_widths = study.funnel.half_widths(times)
        for state, (factor, _) in scales.items():
            width = factor * half_widths[:, STATES.index(state)]
            widths[state].plot(times, width, color=color)
    for state, (_, unit) in scales.items():
        widths[state].set_ylim(bottom=0.0)
        widths[state].set_xlabel("time [s]")
        widths[state].set_ylabel(f"± {state} alone, a slice [{unit}]")
    figure.savefig(path, dpi=120)


def tube_radii(
    funnel: funnels.Funnel, times: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Returns unit normals of the path in the plane (K, 2) and radii (K,) [m].

    A radius is how far a state of the funnel may be from the path, across it.
    """
    place = np.linalg.inv(funnel.shape(times))[:, :2, :2]
    along = funnel.nominal.path(times, 1)[:, :2]
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    normals = np.stack([-along[:, 1], along[:, 0]], axis=1)
    return normals, np.sqrt(np.einsum("ki,kij,kj->k", normals, place, normals))


def tube_outline(funnel: funnels.Funnel) -> np.ndarray:
    """Returns the tube's edge as a polygon (2 T, 2) of x, z [m]."""
    normals, radii = tube_radii(funnel, funnel.nominal.times)
    centers, across = funnel.nominal.states[:, :2], radii[:, None] * normals
    return np.concatenate([centers + across, (centers - across)[::-1]])


def draw_band(ax: Axes, funnel: funnels.Funnel, color: str) -> None:
    """Draws the positions that a funnel allows."""
    outline = tube_outline(funnel)
    ax.fill(*outline.T, color=color, alpha=0.25, lw=0.0, label="funnel, projected")
    ax.plot(*funnel.nominal.states[:, :2].T, color=color, lw=1.5)
    ax.set_aspect("equal", adjustable="datalim")
    ax.set(xlabel="x [m]", ylabel="z [m]")


# -------------------------------------------------------------------------- Meshcat


def draw_tube(
    meshcat: Meshcat, funnel: funnels.Funnel, rings: int = 90, sides: int = 24
) -> None:
    """Draws the positions that a funnel allows as a tube of revolution.

    Args:
        meshcat: where to draw.
        funnel: the funnel.
        rings: number of vertices of the mesh along the flight.
        sides: number of vertices round it.
    """
    nominal = funnel.nominal
    times = np.linspace(nominal.times[0], nominal.times[-1], rings)
    normals, radii = tube_radii(funnel, times)
    centers = funnel.center(times)[:, :2]
    angles = np.linspace(0.0, 2.0 * np.pi, sides, endpoint=False)
    across = radii[:, None] * np.cos(angles)
    vertices = np.zeros((rings, sides, 3))
    vertices[..., 0] = centers[:, :1] + across * normals[:, :1]
    vertices[..., 1] = radii[:, None] * np.sin(angles)
    vertices[..., 2] = centers[:, 1:] + across * normals[:, 1:]
    ring, side = np.meshgrid(np.arange(rings - 1), np.arange(sides), indexing="ij")
    here, next_one = ring * sides + side, ring * sides + (side + 1) % sides
    first = np.stack([here, next_one, here + sides], axis=-1)
    second = np.stack([next_one, next_one + sides, here + sides], axis=-1)
    faces = np.concatenate([first.reshape(-1, 3), second.reshape(-1, 3)])
    meshcat.SetTriangleMesh(
        "/funnel",
        vertices.reshape(-1, 3).T,
        faces.T,
        Rgba(0.2, 0.45, 0.85, 0.25),
        False,
    )


def show_funnel(
    args: argparse.Namespace, study: FunnelStudy, title: str, count: int = 3
) -> None:
    """Plays a few flights inside a funnel and its nominal one, as the options say."""
    nominal = study.funnel.nominal
    paths = {"nominal": (nominal.states, None)}
    for k, path in enumerate(study.flights[:count]):
        paths[f"flight {k + 1}"] = path, playback.GREY
    tracks = [
        playback.Track(name=name, times=nominal.times, poses=path[:, :4], color=color)
        for name, (path, color) in paths.items()
    ]
    meshcat = program.start_meshcat(args)
    if meshcat is not None:
        draw_tube(meshcat, study.funnel)
        playback.play(tracks, meshcat, rate=args.rate)
    program.finish(args, meshcat, tracks, title)


def main(arguments: Sequence[str] | None = None) -> None:
    """Certifies as the command line says, prints and shows the result."""
    args = read_options(arguments)
    truth = GliderModel.load(args.truth)
    options = {"load": args.load, "flights": args.flights}
    with program.working("plan (compiles once)") as progress:
        found = run(truth, args.trials, args.seed, **options, progress=progress)
    for file, study in zip(args.save, found.studies.values(), strict=False):
        funnels.save_funnel(file, study.funnel)
    print(describe(found, args.truth))
    asked = {"truth": args.truth, "seed": args.seed}
    program.write_json(args, key_figures(found) | asked)
    program.write_figure(args, save_figures, found)
    show_funnel(args, found.corrected, f"A certified perch: {args.truth}")


if __name__ == "__main__":
    sys.exit(program.run(main))
