"""The command `make-funnel`: a funnel of launches from which a glider perches."""

import argparse
import math
import shlex
from pathlib import Path
from typing import TYPE_CHECKING

from glider.commands.output import working
from glider.commands.parsing import CommandParser
from glider.errors import InputError, expect
from glider.paths import models_path

if TYPE_CHECKING:
    from glider.verification.funnel.funnel import Funnel
    from glider.verification.funnel.settings import FunnelSettings

_LEVEL = 0.95
"""Default probability of the set of gliders: that of `glider.physics.confidence`, which
takes a second to import."""

_COMMAND_ERROR = 0.05
"""Default bound of the error of a command that is computed late, in a wind [rad/s]:
that of the shipped funnels of held commands."""

DESCRIPTION = """\
Makes a funnel for a glider: plans its perch, and computes a tube of states about the
plan, with a feedback that keeps every flight inside, from launch to wire. The inlet
says how far a launch may deviate. MODEL is the model.yaml that close-the-loop wrote, or
a vehicle of your own; if the file has a covariance, the funnel is for every glider that
the logs allow.

The certificate is a sum of squares at each of about 200 times. check-funnel checks it
in exact arithmetic; with --prove it proves, in continuous time and for the full
dynamics, that no flight leaves. The proof is for feedback of the true state: the error
of an estimator counts as an error of the command, --command-error.

With --hold each command is held, as by a real servo's link. With --latency it is
computed from the state that long before, by a predictor; --command-error then bounds
what the predictor misses in the wind.
"""

EPILOG = """\
A figure of the tube is written beside FILE; Meshcat shows it where --html is given.

examples:
  glider close-the-loop head_wind --out out/wind
  glider make-funnel out/wind/model.yaml --hook --out out/wind/funnel.npz
  glider check-funnel out/wind/funnel.npz --hook --model out/wind/model.yaml --prove

exit code: 0 when the funnel was made, 2 when there is none for this input.
"""


def add_arguments(parser: CommandParser) -> None:
    """Adds its arguments to a parser."""
    parser.add_argument("model", type=Path, metavar="MODEL", help="model or vehicle")
    parser.add_argument(
        "--out", type=Path, metavar="FILE", required=True, help="funnel to write (.npz)"
    )
    words = "problem to solve (default: the article's; with --hook, its hook's)"
    parser.add_path("--problem", "YAML", words)
    words = "end where the problem's hook accepts every state, by speed and pitch"
    parser.add_switch("--hook", words)
    words = (
        "probability of the set of gliders, by the covariance in MODEL; 0 for MODEL "
        f"alone (default: {_LEVEL}, or 0 without a covariance)"
    )
    parser.add_number("--level", words, kind=float, most=0.9999)
    for name, words in (
        ("--hold", "time that each command is held [s] (default: none)"),
        ("--latency", "time from a state to its command [s] (default: none)"),
        ("--wind", "largest wind beyond the model's own [m/s] (default: 0)"),
    ):
        parser.add_number(name, words, 0.0, kind=float)
    words = (
        "largest error of a command [rad/s] "
        f"(default: {_COMMAND_ERROR} with --latency, else 0)"
    )
    parser.add_number("--command-error", words, kind=float)
    words = "animation of the tube to write, a page that needs no server"
    parser.add_path("--html", "FILE", words)
    parser.add_seed("of the states where the remainder is sampled")


def run(args: argparse.Namespace) -> int:
    """Runs it; returns the exit code."""
    _check(args)
    from glider.control.tvlqr import tracking_policy
    from glider.physics.confidence import describe_set, make_confidence
    from glider.physics.model import GliderModel, load_covariance
    from glider.planning.dircol import plan
    from glider.planning.problem import PerchingProblem
    from glider.verification.funnel.build import make_funnel
    from glider.verification.funnel.funnel import save_funnel
    from glider.verification.sos.programs import SolverError

    model = GliderModel.load(args.model)
    covariance = load_covariance(args.model)
    if args.level and covariance is None:
        raise InputError(
            f"{args.model}: --level {args.level:g} needs the accuracy of the glider's "
            "parameters; expected a 'covariance', as close-the-loop writes it."
        )
    level = _LEVEL if args.level is None else args.level
    confidence = None
    if covariance is not None and level:
        confidence = make_confidence(model, covariance, level)
    path = args.problem
    if path is None and args.hook:
        path = models_path("problems", "perching_hook.yaml")
    problem = PerchingProblem.load(path) if path else PerchingProblem()
    settings = _settings(args)
    try:
        with working() as progress:
            policy = tracking_policy(model, plan(model, problem, progress=progress))
            funnel = make_funnel(
                model,
                policy,
                settings,
                confidence=confidence,
                hook_of=problem if args.hook else None,
                seed=args.seed,
                progress=progress,
            )
    except SolverError as error:
        raise InputError(f"{args.model}: {error}") from None
    _warn_beyond(funnel)
    save_funnel(args.out, funnel)
    figure = args.out.with_suffix(".svg")
    _write_figure(funnel, figure)
    if args.html:
        _write_page(funnel, args.html)
    print(_describe(funnel))
    if funnel.is_of_set:
        print(f"It is for every glider of the {describe_set(funnel.allowed)}.")
    print(f"Written: {args.out}, {figure}" + (f", {args.html}" if args.html else ""))
    print(f"To prove it: {_proof_command(args)}")
    return 0


def _check(args: argparse.Namespace) -> None:
    """Raises InputError where options contradict, or a file cannot be written."""
    from diagrams.programs import program

    words = "less than --hold, the time that a command is held"
    expect(
        not args.latency or args.latency < args.hold, "--latency", args.latency, words
    )
    expect(
        args.out.suffix == ".npz", "--out", str(args.out), "a name that ends in .npz"
    )
    program.check_files(args.out, args.out.with_suffix(".svg"), args.html)


def _settings(args: argparse.Namespace) -> "FunnelSettings":
    """The settings of the widest funnels that are proven in minutes.

    Of held commands, the gain is half of what would undo a deviation within one hold.
    """
    from glider.verification.funnel.settings import LAUNCH_SIZES, FunnelSettings

    error = args.command_error
    if error is None:
        error = _COMMAND_ERROR if args.latency else 0.0
    if not args.hold:
        return FunnelSettings(
            remainder=1.6,
            launch_sizes=LAUNCH_SIZES,
            elevator_gain=40.0,
            command_error=error,
            wind=args.wind,
        )
    return FunnelSettings(
        remainder=2.4,
        launch_sizes=LAUNCH_SIZES,
        elevator_gain=min(40.0, 0.5 / args.hold),
        hold=0.004,
        margin=0.06,
        command_error=error,
        period=args.hold,
        wind=args.wind,
    )


def _warn_beyond(funnel: "Funnel") -> None:
    """Warns where the extremes of the sets leave what the model was traced on."""
    import numpy as np

    from glider.physics.flown_range import warn_beyond

    nominal = funnel.nominal
    shapes = np.linalg.inv(funnel.shape(nominal.times))
    extents = np.sqrt(np.diagonal(shapes, axis1=1, axis2=2))
    extremes = (shapes / extents[:, None, :]).transpose(0, 2, 1)  # One for each state.
    around = np.concatenate([extremes, -extremes], axis=1)
    states = nominal.states[:, None, :] + around
    count = states.shape[1]
    warn_beyond(
        "The funnel",
        nominal.model,
        np.repeat(nominal.times, count),
        states.reshape(-1, funnel.num_states),
        np.repeat(nominal.inputs, count),
    )


def _describe(funnel: "Funnel") -> str:
    """A sentence of the launches that a funnel allows."""
    _, height, pitch, _, speed = funnel.half_widths()[:5]
    return (
        f"A launch may deviate by {100.0 * height:.1f} cm in height, "
        f"{math.degrees(pitch):.1f}° in pitch or {speed:.2f} m/s in speed, one at a "
        f"time (certified at {funnel.nominal.flows.size + 1} times, in "
        f"{funnel.seconds:.0f} s)."
    )


def _proof_command(args: argparse.Namespace) -> str:
    """The command line that proves what was made."""
    words = ["glider", "check-funnel", str(args.out), "--model", str(args.model)]
    words.append("--prove")
    if args.problem:
        words += ["--problem", str(args.problem)]
    if args.hook:
        words.append("--hook")
    for name in ("hold", "latency", "wind"):
        if getattr(args, name):
            words += [f"--{name}", f"{getattr(args, name):g}"]
    if args.command_error and not args.latency:
        words += ["--command-error", f"{args.command_error:g}"]
    return shlex.join(words)  # A name may have blanks.


def _write_figure(funnel: "Funnel", path: Path) -> None:
    """Draws the tube."""
    from matplotlib.figure import Figure

    from diagrams.tube import plot_tube

    figure = Figure(figsize=(10.0, 3.5), layout="constrained")
    plot_tube(figure.subplots(), funnel)
    figure.savefig(path)


def _write_page(funnel: "Funnel", path: Path) -> None:
    """Draws the tube and the nominal flight in Meshcat, and writes its page."""
    from diagrams.playback import play, track_of
    from diagrams.programs.page import open_meshcat, page_of
    from diagrams.tube import draw_tube
    from glider.files.writing import write_text
    from glider.verification.funnel.funnel import funnel_policy

    track = track_of("nominal flight", funnel_policy(funnel, held=True).plan)
    meshcat = open_meshcat()
    draw_tube(meshcat, funnel)
    play([track], meshcat, parameters=funnel.nominal.model.parameters)
    write_text(path, page_of(meshcat, [track], f"Funnel of {path.stem}", 0.25))
