"""The command `check-funnel`: check a saved funnel, exactly and without a solver."""

import argparse
import math
from pathlib import Path

from glider.commands.output import working
from glider.commands.parsing import CommandParser, check_seed
from glider.errors import InputError, expect
from glider.progress import Step

LEVEL = 0.95
"""Default probability with which the true glider is among those that are flown: that of
`glider.verification.dynamics.confidence`, which takes a second to import."""

FLIGHTS = 9000
"""Flights before the climb: 21,000 with it."""

MOST_FLIGHTS = 1_000_000
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
the funnel. That takes minutes; with --resume FILE an interrupted proof continues.
The size of the inlet is printed; --least-inlet requires one.

The check applies to one glider; --prove covers all gliders of a funnel that was made
for a set of them. If --model has a covariance, that set must contain the model's set
of the same probability. --confidence draws gliders that the data allow, from the
covariance in --model's file (close-the-loop writes it), flies them from the boundary
and climbs to the worst flights and the worst corner of their set. Flights alone prove
nothing.

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
    words = (
        "half-width that its inlet must have: in height [m], or in states that deviate "
        "alone, as z=0.1,pitch=0.05 (default: any)"
    )
    parser.add_argument("--least-inlet", metavar="WIDTH", help=words)
    words = "check every N-th time or interval only, and the last (default: all)"
    parser.add_number("--every", words, 1)
    words = "prove that no flight leaves it, in continuous time; takes minutes"
    parser.add_switch("--prove", words)
    words = "with --prove: record what is proven in FILE, and continue from it"
    parser.add_path("--resume", "FILE", words)
    words = f"fly gliders that the data allow with this probability (default: {LEVEL})"
    parser.add_argument("--confidence", metavar="P", nargs="?", const=LEVEL, help=words)
    words = "with --confidence: a box of intervals instead of an ellipsoid"
    parser.add_switch("--box", words)
    words = (
        "with --confidence: flights before the climb, which adds half as many again "
        f"and more (default: {FLIGHTS})"
    )
    parser.add_number("--flights", words)
    words = (
        "of what is drawn; same seed, same ascents and flights (default: 0 for the "
        "flights of --confidence, for the ascents a new one each time)"
    )
    parser.add_number("--seed", words)
    parser.add_json("JSON instead of sentences")


def run(args: argparse.Namespace) -> int:
    """Runs it; returns the exit code."""
    from glider.verification.funnel.file import read_file

    level, flights = _checked_options(args)
    least_inlet = _least_inlet(args.least_inlet)
    file = read_file(args.funnel)

    # These take a second to import: not before it is known that there is a funnel.
    import numpy as np

    from glider.files.schema import json_text
    from glider.physics.model import GliderModel, load_covariance
    from glider.planning.problem import PerchingProblem
    from glider.verification.check_report import (
        check_report,
        describe_check,
        describe_trial,
        trial_report,
    )
    from glider.verification.funnel.funnel import funnel_of
    from glider.verification.proof.check import check_funnel
    from glider.verification.proof.flight_proof import prove_flights
    from glider.verification.trials.falsify import falsify_funnel

    funnel = funnel_of(args.funnel, *file)
    model = GliderModel.load(args.model) if args.model else None
    problem = PerchingProblem.load(args.problem) if args.problem else PerchingProblem()
    covariance = load_covariance(args.model) if args.model else None
    confidence = None
    if level is not None:
        shape = "box" if args.box else "ellipsoid"
        confidence = _confidence(funnel, args.model, covariance, level, shape)
    proof = trial = None
    with working(is_even=True) as progress:

        def follow(what):
            return lambda share: progress(Step(f"checking the {what}", share))

        verdict = check_funnel(
            funnel,
            args.every,
            follow("certificate"),
            problem=problem,
            model=model,
            covariance=covariance,
            hook=args.hook,
            least_inlet=least_inlet,
            seed=args.seed,
        )
        if args.prove and verdict.holds:
            proof = prove_flights(
                funnel, args.every, resume=args.resume, progress=follow("proof")
            )
        if confidence and verdict.holds:
            rng = np.random.default_rng(seed := args.seed or 0)
            trial = falsify_funnel(
                funnel, flights, rng, confidence=confidence, progress=follow("gliders")
            )
    good = verdict.holds and (trial is None or trial.escapes == 0)
    if args.prove:
        good = good and verdict.is_whole and proof is not None and proof.is_whole
    if args.json:
        report = check_report(funnel, verdict, proof, problem)
        report |= {
            "model_compared": model is not None,
            "set_compared": bool(model and covariance and funnel.gliders),
        }
        if confidence and trial:
            report["gliders"] = trial_report(funnel, confidence, trial, seed)
        print(json_text(report))
    else:
        has_covariance = covariance is not None
        print(
            describe_check(funnel, verdict, proof, problem, args.model, has_covariance)
        )
        if confidence and trial:
            print(describe_trial(funnel, confidence, trial, seed))
    return 0 if good else 1


def _checked_options(args: argparse.Namespace) -> tuple[float | None, int]:
    """Probability of --confidence and number of flights; checks all options."""
    expect(args.every >= 1, "--every", args.every, "a positive number")
    if args.resume and not args.prove:
        raise InputError("--resume has no effect without --prove; expected both.")
    level = _level(args.confidence)
    given = {"box": args.box or None, "flights": args.flights}
    for name, value in given.items():
        if level is None and value is not None:
            words = f"--{name} has no effect without --confidence; expected both."
            raise InputError(words)
    flights = FLIGHTS if args.flights is None else args.flights
    expected = f"a number from 1 to {MOST_FLIGHTS:,}"
    expect(1 <= flights <= MOST_FLIGHTS, "--flights", flights, expected)
    check_seed(args.seed or 0)
    return level, flights


def _least_inlet(text: str | None) -> dict[str, float]:
    """Least half-widths of the inlet by state; of z where a number stands alone."""
    found: dict[str, float] = {}
    for part in (text or "").split(",") if text is not None else ():
        name, _, width = part.rpartition("=")
        try:
            found[name.strip() or "z"] = value = float(width)
        except ValueError:
            value = math.nan
        words = "a positive width, or several as z=0.1,pitch=0.05"
        expect(0.0 < value < math.inf, "--least-inlet", text, words)
    return found


def _level(text: str | None) -> float | None:
    """The probability given by --confidence; None without it."""
    if text is None:
        return None
    try:
        level = float(text)
    except ValueError:
        level = math.nan
    expected = f"a probability between 0 and 1, such as {LEVEL:g}, or no value"
    expect(0.0 < level < 1.0, "--confidence", text, expected)
    return level


def _confidence(funnel, model, covariance, level, shape):
    """The set of gliders to fly, by the model's file or the funnel's own."""
    from glider.verification.dynamics.confidence import make_confidence

    if not model and funnel.gliders:
        covariance = funnel.gliders.confidence.covariance
    if covariance is None:
        raise InputError(
            f"{model or '--confidence'}: the accuracy of the glider's parameters "
            "is unknown; expected a --model with a covariance, as close-the-loop "
            "writes it."
        )
    return make_confidence(funnel.nominal.model, covariance, level, shape)
