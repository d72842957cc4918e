"""The command `check-funnel`: check a saved funnel, exactly and without a solver."""

from __future__ import annotations

import argparse
import dataclasses
from pathlib import Path

from glider.commands.output import working
from glider.commands.parsing import CommandParser
from glider.errors import InputError
from glider.progress import Step

DESCRIPTION = """\
Checks the certificate of a funnel: that its flight leads from a problem's launch to
its wire; at all times, in exact arithmetic, that V falls on the boundary and that the
servo stays within its limits; and that it ends in the goal. No solver and no plan are
used: the file holds everything, the glider included. --model compares that with your
glider; --problem names another problem than the article's. --hook also requires that
the hook accepts every state of the last set, by speed and pitch.

This check applies to the third-order Taylor polynomials of the dynamics, with a bound
on their remainder, which is sampled in floating point. --prove proves the bound, and
so that no flight of the full dynamics that starts in the inlet leaves the funnel. That
takes minutes. The size of the inlet is printed.

The check applies to one glider; --prove covers all gliders of a funnel that was made
for a set of them. If --model has a covariance (close-the-loop writes it), that set must
contain the model's set of the same probability, and at least that of 95 %.

With --prove, --command-error and --wind are what the funnel must account for, at any
time, and --hold is the time that its commands must be held. With --latency each command
is computed from the state exactly that long before, by a predictor that knows the
glider and the commands on their way: what it misses in the wind is proven to be within
the funnel's command error, together with --command-error. The state is the true one: no
estimator is proven.

exit code: 0 if everything checked holds; with --prove only if the whole funnel is
proven, which --every excludes; 1 if not; 2 if the file is not a funnel.
"""


def add_arguments(parser: CommandParser) -> None:
    """Adds its arguments to a parser."""
    parser.add_argument("funnel", type=Path, help="file of a funnel (.npz)")
    words = "model or vehicle that the funnel must be of (default: any)"
    parser.add_path("--model", "YAML", words)
    words = "problem that it must solve (default: the article's)"
    parser.add_path("--problem", "YAML", words)
    words = "the problem's hook must accept every state of its last set"
    parser.add_switch("--hook", words)
    words = "check every N-th interval only, and the last (default: all)"
    parser.add_number("--every", words, 1, least=1)
    words = "prove that no flight leaves it, in continuous time; takes minutes"
    parser.add_switch("--prove", words)
    words = "of the ascents, which it repeats (default: a new one each time)"
    parser.add_number("--seed", words)
    for name, words, default in (
        ("--hold", "time that a command is held [s]", "the funnel's"),
        ("--latency", "time from a state to its command [s]", "none"),
        ("--command-error", "largest other error of the command [rad/s]", "0"),
        ("--wind", "largest wind beyond the model's own [m/s]", "0"),
    ):
        help_ = f"with --prove: {words} (default: {default})"
        parser.add_number(name, help_, kind=float)
    parser.add_json("JSON instead of sentences")


def run(args: argparse.Namespace) -> int:
    """Runs it; returns the exit code."""
    from glider.verification.funnel.file import read_file

    _check_options(args)
    file = args.funnel, *read_file(args.funnel)

    # These take a second to import: not before it is known that there is a funnel.
    from glider.files.schema import json_text
    from glider.physics.model import GliderModel, load_covariance
    from glider.planning.problem import PerchingProblem
    from glider.report.check_funnel import Checked, check_report, describe_check
    from glider.verification.funnel.funnel import funnel_of
    from glider.verification.proof.check import check_funnel
    from glider.verification.proof.latency import check_latency
    from glider.verification.proof.purpose import Purpose

    funnel = funnel_of(*file)
    model = GliderModel.load(args.model) if args.model else None
    problem = PerchingProblem.load(args.problem) if args.problem else PerchingProblem()
    covariance = load_covariance(args.model) if args.model else None
    if args.prove and args.latency:
        check_latency(funnel, args.latency)
    purpose = Purpose(
        problem=problem,
        hook=args.hook,
        model=model,
        covariance=covariance,
        command_error=args.command_error or 0.0,
        wind=args.wind or 0.0,
        period=args.hold,
    )
    with working(is_even=True) as progress:

        def follow(what):
            return lambda share: progress(Step(f"checking the {what}", share))

        verdict = check_funnel(
            funnel,
            args.every,
            purpose=purpose,
            seed=args.seed,
            progress=follow("certificate"),
        )
        checked = Checked(
            path=args.model, purpose=purpose, funnel=funnel, verdict=verdict
        )
        if args.prove and checked.holds:
            checked = _proven(args, checked, follow)
    if args.json:
        print(json_text(check_report(checked)))
    else:
        print(describe_check(checked))
    good = checked.is_proven if args.prove else checked.holds
    return 0 if good else 1


def _proven(args, checked, follow):
    """Returns a check with the proof, and with that of a latency if all else holds."""
    from glider.verification.proof.flight_proof import prove_flights
    from glider.verification.proof.latency import predictions_of, prove_latency

    funnel = checked.funnel
    proof = prove_flights(funnel, args.every, progress=follow("proof"), is_checked=True)
    checked = dataclasses.replace(checked, proof=proof)
    if not (args.latency and checked.is_proven):
        return checked
    latency = prove_latency(
        predictions_of(funnel, args.latency),
        args.command_error or 0.0,
        progress=follow("latency"),
    )
    return dataclasses.replace(checked, latency=latency)


def _check_options(args: argparse.Namespace) -> None:
    """Raises InputError where an option is of a proof that is not asked for."""
    for name in ("latency", "hold", "command_error", "wind"):
        if getattr(args, name) is not None and not args.prove:
            option = f"--{name.replace('_', '-')}"
            raise InputError(f"{option} has no effect without --prove; expected both.")
