"""The command `check-funnel`: check a saved funnel, exactly and without a solver."""

from __future__ import annotations

import argparse
import dataclasses
import math
from pathlib import Path
from typing import Any

from glider.commands.output import working
from glider.commands.parsing import CommandParser, check_seed
from glider.errors import InputError, expect
from glider.progress import Step

_LEVEL = 0.95
"""Default probability with which the true glider is among those that are flown: that of
`glider.physics.confidence`, which takes a second to import."""

_FLIGHTS = 9000
"""Flights before the climb: 21,000 with it."""

_MOST_FLIGHTS = 1_000_000
"""Flights that fit the memory of any machine."""

DESCRIPTION = """\
Checks the certificate of a funnel: that its flight leads from a problem's launch to
its wire; at each of its times, in exact arithmetic, that V falls on the boundary and
that the servo stays within its limits; and that it ends in the goal. No solver and no
plan are used: the file holds everything, the glider included. --model compares that
with your glider; --problem names another problem than the article's. --hook also
requires that the hook accepts every state of the last set, by speed and pitch.

This check applies to the third-order Taylor polynomials of the dynamics, with a bound
on their remainder; between the times V is sampled in floating point. --prove proves it
for the full dynamics and in continuous time: no flight that starts in the inlet leaves
the funnel. That takes minutes. The size of the inlet is printed.

The check applies to one glider; --prove covers all gliders of a funnel that was made
for a set of them. If --model has a covariance, that set must contain the model's set
of the same probability, and at least that of 95 %. --confidence draws gliders from the
edge of the set that the data allow, by the covariance in --model's file (close-the-loop
writes it), flies them from the boundary and climbs to the worst flights and gliders.
Flights alone prove nothing.

With --prove, --command-error and --wind are what the funnel must account for, at any
time, and --hold is the time that its commands must be held. With --latency each command
is computed from the state exactly that long before, by a predictor that knows the
glider and the commands on their way: what it misses in the wind is proven to be within
the funnel's command error, together with --command-error. The state is the true one: no
estimator is proven.

exit code: 0 if everything checked holds and no flight leaves; with --prove only if the
whole funnel is proven, which --every excludes; 1 if not; 2 if the file is not a funnel.
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
    words = "check every N-th time or interval only, and the last (default: all)"
    parser.add_number("--every", words, 1)
    words = "prove that no flight leaves it, in continuous time; takes minutes"
    parser.add_switch("--prove", words)
    words = f"fly gliders that the data allow with this probability (default: {_LEVEL})"
    parser.add_argument(
        "--confidence", metavar="P", nargs="?", const=_LEVEL, help=words
    )
    words = (
        "with --confidence: flights before the climb, which adds as many and a fifth "
        f"more (default: {_FLIGHTS})"
    )
    parser.add_number("--flights", words)
    words = (
        "of what is drawn; same seed, same ascents and flights (default: 0 for the "
        "flights of --confidence, for the ascents a new one each time)"
    )
    parser.add_number("--seed", words)
    for name, words, default in (
        ("--hold", "time that a command is held [s]", "the funnel's"),
        ("--latency", "time from a state to its command [s]", "none"),
        ("--command-error", "largest other error of the command [rad/s]", "0"),
        ("--wind", "largest wind beyond the model's own [m/s]", "0"),
    ):
        help_ = f"with --prove: {words} (default: {default})"
        parser.add_argument(name, metavar="X", type=float, help=help_)
    parser.add_json("JSON instead of sentences")


def run(args: argparse.Namespace) -> int:
    """Runs it; returns the exit code."""
    from glider.verification.funnel.file import read_file

    level, flights = _checked_options(args)
    file = args.funnel, *read_file(args.funnel)

    # These take a second to import: not before it is known that there is a funnel.
    import numpy as np

    from glider.physics.model import GliderModel, load_covariance
    from glider.planning.problem import PerchingProblem
    from glider.report.check_funnel import Checked
    from glider.verification.funnel.funnel import funnel_of
    from glider.verification.proof.check import check_funnel
    from glider.verification.proof.latency import check_latency
    from glider.verification.proof.purpose import Purpose
    from glider.verification.trials import falsify_funnel

    funnel = funnel_of(*file)
    model = GliderModel.load(args.model) if args.model else None
    problem = PerchingProblem.load(args.problem) if args.problem else PerchingProblem()
    covariance = load_covariance(args.model) if args.model else None
    confidence = None
    if level is not None:
        confidence = _confidence(funnel, args.model, covariance, level)
    if args.prove and args.latency:
        check_latency(funnel, args.latency)
    if confidence and funnel.settings.period:
        raise InputError(
            "--confidence flies gliders under a feedback that acts at all times; the "
            "commands of this funnel are held: expected --prove instead."
        )
    purpose = Purpose(
        problem=problem,
        hook=args.hook,
        model=model,
        covariance=covariance,
        **_proven_loop(args),
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
        trial = None
        if confidence and checked.holds:
            rng = np.random.default_rng(args.seed or 0)
            trial = falsify_funnel(
                funnel, flights, rng, confidence, progress=follow("flights")
            )
    _print_outcome(args, checked, trial)
    good = checked.is_proven if args.prove else checked.holds
    return 0 if good and not (trial and trial.escapes) else 1


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


def _print_outcome(args, checked, trial):
    """Prints what was checked, proven and flown, in sentences or as JSON."""
    from glider.files.schema import json_text
    from glider.report import check_funnel as words

    funnel = checked.funnel
    seed = args.seed or 0
    if args.json:
        report = words.check_report(checked)
        if trial:
            report["flights"] = words.trial_report(funnel, trial, seed)
        print(json_text(report))
        return
    print(words.describe_check(checked))
    if trial:
        print(words.describe_trial(funnel, trial, seed))


def _checked_options(args: argparse.Namespace) -> tuple[float | None, int]:
    """Probability of --confidence and number of flights; checks all options."""
    expect(args.every >= 1, "--every", args.every, "a positive number")
    latency = args.latency or 0.0
    words = "0 or more, and less than the period"
    expect(0.0 <= latency < math.inf, "--latency", latency, words)
    level = _level(args.confidence)
    needed = dict.fromkeys(("latency", "hold", "command_error", "wind"), "prove")
    needed["flights"] = "confidence"
    for name, other in needed.items():
        if getattr(args, name) is not None and not getattr(args, other):
            own = name.replace("_", "-")
            words = f"--{own} has no effect without --{other}; expected both."
            raise InputError(words)
    flights = _FLIGHTS if args.flights is None else args.flights
    expected = f"a number from 1 to {_MOST_FLIGHTS:,}"
    expect(1 <= flights <= _MOST_FLIGHTS, "--flights", flights, expected)
    check_seed(args.seed or 0)
    return level, flights


def _proven_loop(args: argparse.Namespace) -> dict[str, Any]:
    """Command error, wind and hold that --prove requires, as fields of a `Purpose`."""
    if not args.prove:
        return {}
    for name in ("hold", "command_error", "wind"):
        option = f"--{name.replace('_', '-')}"
        value = getattr(args, name) or 0.0
        expect(0.0 <= value < math.inf, option, value, "zero or a positive number")
    return {
        "command_error": args.command_error or 0.0,
        "wind": args.wind or 0.0,
        "period": args.hold,
    }


def _level(text: str | None) -> float | None:
    """The probability given by --confidence; None without it."""
    if text is None:
        return None
    try:
        level = float(text)
    except ValueError:
        level = math.nan
    expected = f"a probability between 0 and 1, such as {_LEVEL:g}"
    expect(0.0 < level < 1.0, "--confidence", text, expected)
    return level


def _confidence(funnel, model, covariance, level):
    """The set of gliders to fly, by the model's file or the funnel's own."""
    from glider.physics.confidence import make_confidence

    if not model and funnel.is_of_set:
        covariance = funnel.allowed.covariance
    if covariance is None:
        raise InputError(
            f"{model or '--confidence'}: the accuracy of the glider's parameters "
            "is unknown; expected a --model with a covariance, as close-the-loop "
            "writes it."
        )
    return make_confidence(funnel.nominal.model, covariance, level)
