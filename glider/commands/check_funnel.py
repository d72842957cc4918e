"""The command `check-funnel`: check a saved funnel, exactly and without a solver."""

from __future__ import annotations

import argparse
import math
from itertools import zip_longest
from pathlib import Path

from glider.commands.output import working
from glider.commands.parsing import CommandParser, check_seed
from glider.errors import InputError, expect
from glider.progress import Step

_LEVEL = 0.95
"""Default probability with which the true glider is among those that are flown: that of
`glider.physics.confidence`, which takes a second to import."""

_FLIGHTS = 9000
"""Flights before the climb: 21,000 with it."""

_HOLD, _LATENCY = 0.02, 0.01
"""Defaults of --as-flown [s]."""

_MOST_FLIGHTS = 1_000_000
"""Flights that fit the memory of any machine."""

DESCRIPTION = """\
Checks the certificate of a funnel: that its flight leads from a problem's launch to
its wire; at each of its times, in exact arithmetic, that V falls on the boundary and
that the servo stays within its limits; and that it ends in the goal. No solver and no
plan are used: the file holds everything, the glider included. --model compares that
with your glider; --problem names another problem than the article's, one without
obstacles, as those are not proven. --hook also requires that the hook accepts every
state of the last set, by speed and pitch.

This check applies to the third-order Taylor polynomials of the dynamics, with a bound
on their remainder; between the times V is sampled in floating point. --prove proves it
for the full dynamics and in continuous time: no flight that starts in the inlet leaves
the funnel. That takes minutes; with --resume FILE an interrupted proof continues.
The size of the inlet is printed; --least-inlet requires one.

The check applies to one glider; --prove covers all gliders of a funnel that was made
for a set of them. If --model has a covariance, that set must contain the model's set
of the same probability, and at least that of 95 %; --least-level requires another, also
of a funnel of one glider, which has no set. --confidence draws gliders that the data
allow, from the covariance in --model's file (close-the-loop writes it), flies them from
the boundary and climbs to the worst flights and the worst corner of their set. Flights
alone prove nothing.

With --prove, --command-error and --wind are what the funnel must account for, at any
time, and --hold is the time that its commands must be held, also with --as-flown. With
--latency each command is computed from the state exactly that long before, by a
predictor that knows the glider and the commands on their way: what it misses in the
wind is proven to be within the funnel's command error, together with --command-error.
The state is the true one: no estimator is proven.

--as-flown flies what the theorem leaves out: commands from a clock at any phase, held,
computed from a state of some time ago, other command errors and wind; from the inlet's
boundary, climbing to the worst starts, phases and winds. With --confidence, gliders of
that set fly. A funnel of held commands is flown by its own clock, and by a predictor
where there is a latency.

A funnel of held commands is for a clock that starts with the launch. --phases is for
any clock: the funnel is then that of the launch, until the first command acts, and the
files are those of the rest of the flight, for commands that begin to act at different
times. --model, --every, --command-error and --wind apply to each, --least-inlet to the
launch's, --hold and --hook to the others; --latency is their common one, and
--least-level is of each. Whenever the
first command acts, the flight must be inside one of them.

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
    words = (
        "the funnel's set must contain the model's set of this probability; needs a "
        f"--model with a covariance (default: {_LEVEL} of a funnel that has a set)"
    )
    parser.add_argument("--least-level", metavar="P", help=words)
    words = "funnels after a launch funnel, for a clock of any phase (after its name)"
    parser.add_argument("--phases", metavar="NPZ", nargs="+", type=Path, help=words)
    words = "check every N-th time or interval only, and the last (default: all)"
    parser.add_number("--every", words, 1)
    words = "prove that no flight leaves it, in continuous time; takes minutes"
    parser.add_switch("--prove", words)
    words = "with --prove: record what is proven in FILE, and continue from it"
    parser.add_path("--resume", "FILE", words)
    words = "with --prove: write the proof to FILE, for tools/verify_proof.py"
    parser.add_path("--write-proof", "FILE", words)
    words = f"fly gliders that the data allow with this probability (default: {_LEVEL})"
    parser.add_argument(
        "--confidence", metavar="P", nargs="?", const=_LEVEL, help=words
    )
    words = "with --confidence: a box of intervals instead of an ellipsoid"
    parser.add_switch("--box", words)
    words = (
        "with --confidence or --as-flown: flights before the climb, which adds as many "
        f"and a fifth more (default: {_FLIGHTS})"
    )
    parser.add_number("--flights", words)
    words = (
        "of what is drawn; same seed, same ascents and flights (default: 0 for the "
        "flights of --confidence, for the ascents a new one each time)"
    )
    parser.add_number("--seed", words)
    words = "fly held and late commands; states how many flights leave the funnel"
    parser.add_switch("--as-flown", words)
    both = "--as-flown or --prove"
    for name, option, words, default in (
        (
            "--hold",
            both,
            "time that a command is held [s]",
            f"the funnel's, or {_HOLD}",
        ),
        (
            "--latency",
            "--as-flown, --phases or --prove",
            "time from a state to its command [s]",
            f"as flown the funnel's, half of its hold, or {_LATENCY}; none to prove",
        ),
        ("--command-error", both, "largest other error of the command [rad/s]", "0"),
        ("--wind", both, "largest wind beyond the model's own [m/s]", "0"),
    ):
        help_ = f"with {option}: {words} (default: {default})"
        parser.add_argument(name, metavar="X", type=float, help=help_)
    words = (
        "with --as-flown: a predictor makes up for the latency and, of a feedback that "
        "acts at all times, half of the hold"
    )
    parser.add_switch("--predict", words)
    parser.add_json("JSON instead of sentences")


def run(args: argparse.Namespace) -> int:
    """Runs it; returns the exit code."""
    from glider.verification.funnel.file import read_file

    level, flights = _checked_options(args)
    least_inlet = _least_inlet(args.least_inlet)
    files = [(path, *read_file(path)) for path in (args.funnel, *(args.phases or ()))]

    # These take a second to import: not before it is known that there is a funnel.
    import numpy as np

    from glider.physics.model import GliderModel, load_covariance
    from glider.planning.problem import PerchingProblem
    from glider.verification.funnel.funnel import funnel_of
    from glider.verification.proof.latency import check_latency
    from glider.verification.proof.written import expect_writable, write_proof
    from glider.verification.trials.as_flown import check_clock, fly_loop
    from glider.verification.trials.falsify import falsify_funnel

    funnel, *rests = (funnel_of(*file) for file in files)
    seed = args.seed or 0
    model = GliderModel.load(args.model) if args.model else None
    problem = PerchingProblem.load(args.problem) if args.problem else PerchingProblem()
    covariance = load_covariance(args.model) if args.model else None
    least_level = _level("--least-level", args.least_level)
    confidence = None
    if level is not None:
        shape = "box" if args.box else "ellipsoid"
        confidence = _confidence(funnel, args.model, covariance, level, shape)
    loop = _flown_loop(args, funnel, rests, confidence) if args.as_flown else None
    if args.prove and args.latency and not rests:
        check_latency(funnel, args.latency)
    if loop:
        check_clock(funnel, loop.hold, rests)
    elif confidence and (rests or funnel.settings.period):
        raise InputError(
            "--confidence flies gliders under a feedback that acts at all times; the "
            "commands of these funnels are held: expected --as-flown, too."
        )
    trial = flown = None
    if args.write_proof:
        expect_writable(funnel)
    with working(is_even=True) as progress:

        def follow(what):
            return lambda share: progress(Step(f"checking the {what}", share))

        given = {
            "problem": problem,
            "model": model,
            "covariance": covariance,
            "least_level": least_level,
        }
        checked = _check(args, (funnel, *rests), least_inlet, given, follow)
        if confidence and checked.holds and not (rests or funnel.settings.period):
            rng = np.random.default_rng(seed)
            say = follow("gliders")
            trial = falsify_funnel(
                funnel, flights, rng, confidence=confidence, progress=say
            )
        if loop and checked.holds:
            rng = np.random.default_rng(seed)
            say = follow("flights")
            flown = fly_loop(funnel, loop, flights, rng, say, rests=rests)
    _print_outcome(args, checked, trial, flown)
    if args.write_proof and checked.is_proven:
        with working(is_even=True) as progress:
            write_proof(
                args.write_proof,
                funnel,
                problem,
                lambda share: progress(Step("writing the proof", share)),
            )
    left = any(t.escapes for t in (trial, flown) if t)
    good = checked.is_proven if args.prove else checked.holds
    return 0 if good and not left else 1


def _check(args, funnels, least_inlet, given, follow):
    """Checks all funnels, and proves them where that is asked for and they hold.

    What is given applies to each, but for the problem, which is not the launch's own.
    """
    from glider.report.check_funnel import Checked
    from glider.verification.proof.check import check_funnel
    from glider.verification.proof.flight_proof import prove_flights
    from glider.verification.proof.phases import phase_faults

    if given["least_level"] and given["covariance"] is None:
        raise InputError(
            "--least-level has no effect without a --model with a covariance, as "
            "close-the-loop writes it; expected both."
        )
    (first, *rests), inlet = funnels, {"least_inlet": least_inlet}
    pushes = _least_pushes(args) if args.prove else (0.0, 0.0)
    period = args.hold if args.prove else None
    problem = given["problem"]
    end = {"hook": args.hook, "period": period}
    needs = [inlet | end]
    faults = []
    if rests:
        needs = [inlet | {"problem": None}]
        needs += [end | {"from_launch": False}] * len(rests)
        faults = phase_faults(first, rests, problem, args.latency)
    verdicts = [
        check_funnel(
            own,
            args.every,
            follow("certificate"),
            least_pushes=pushes,
            seed=args.seed,
            **given | needed,
        )
        for own, needed in zip(funnels, needs, strict=True)
    ]
    covariance = given["covariance"]
    checked = Checked(problem, covariance, funnels, verdicts, faults, [], None)
    if not (args.prove and checked.holds):
        return checked
    for own in funnels:
        proof = prove_flights(
            own,
            args.every,
            resume=args.resume,
            progress=follow("proof"),
            is_checked=True,
        )
        checked.proofs.append(proof)
        if not proof.complete:
            break
    if not checked.is_proven:
        return checked
    return checked._replace(latency=_prove_latency(args, funnels, follow("latency")))


def _prove_latency(args, funnels, progress):
    """Returns what a latency leaves of the command's error; None where there is none.

    All else must be proven. Of one funnel the latency has to be given; a launch funnel
    has its own.
    """
    from glider.verification.proof.latency import (
        first_predictions,
        predictions_of,
        prove_latency,
    )
    from glider.verification.proof.phases import GRID_ROOM, first_commands

    first, *rests = funnels
    latency = first_commands(first, rests)[0] if rests else args.latency or 0.0
    if latency <= GRID_ROOM:
        return None
    found = first_predictions(first, rests, latency) if rests else []
    for own in rests or [first]:
        found += predictions_of(own, latency)
    return prove_latency(found, args.command_error or 0.0, progress=progress)


def _print_outcome(args, checked, trial, flown):
    """Prints what was checked, proven and flown, in sentences or as JSON."""
    from glider.files.schema import json_text
    from glider.report import check_funnel as words

    problem, covariance, funnels, verdicts, _, proofs, latency = checked
    (funnel, *rests), seed = funnels, args.seed or 0
    # The end of a launch funnel is no perch.
    ends = [None if rests else problem] + [problem] * len(rests)
    parts = [*zip_longest(funnels, verdicts, proofs, ends)]
    if args.json:
        report, *others = (words.check_report(*part, covariance) for part in parts)
        report |= {
            "model_compared": args.model is not None,
            "set_compared": None not in (covariance, funnel.gliders),
        }
        if rests:
            report["phases"] = others
            report["any_phase"] = words.phases_report(checked)
        if latency:
            report["latency"] = words.latency_report(checked)
        if trial:
            report["gliders"] = words.trial_report(funnel, trial, seed)
        if flown:
            report["as_flown"] = words.flown_report(flown, seed)
        print(json_text(report))
        return
    for path, part in zip((args.funnel, *(args.phases or ())), parts, strict=True):
        if rests:
            print(f"{path}:")
        print(words.describe_check(*part, args.model, covariance))
    if rests:
        print(words.describe_phases(checked))
    if latency:
        print(words.describe_latency(checked))
    if trial:
        print(words.describe_trial(funnel, trial, seed))
    if flown:
        print(words.describe_flown(flown, seed))


def _checked_options(args: argparse.Namespace) -> tuple[float | None, int]:
    """Probability of --confidence and number of flights; checks all options."""
    expect(args.every >= 1, "--every", args.every, "a positive number")
    if args.resume and not args.prove:
        raise InputError("--resume has no effect without --prove; expected both.")
    if args.write_proof and not args.prove:
        words = "--write-proof has no effect without --prove; expected both."
        raise InputError(words)
    for name in ("resume", "write-proof") if args.phases else ():
        if getattr(args, name.replace("-", "_")) is not None:
            raise InputError(
                f"--{name} is of one funnel; expected it without --phases."
            )
    latency = args.latency or 0.0
    words = "0 or more, and less than the period"
    expect(0.0 <= latency < math.inf, "--latency", latency, words)
    level = _level("--confidence", args.confidence)
    names = ("hold", "command_error", "wind")
    late = {name.replace("_", "-"): getattr(args, name) for name in names}
    given = [
        ("--confidence", level is not None, {"box": args.box or None}),
        ("--as-flown", args.as_flown, {"predict": args.predict or None}),
        (
            "--as-flown, --phases or --prove",
            args.as_flown or args.phases or args.prove,
            {"latency": args.latency},
        ),
        ("--as-flown or --prove", args.as_flown or args.prove, late),
        (
            "--confidence or --as-flown",
            level is not None or args.as_flown,
            {"flights": args.flights},
        ),
    ]
    for option, is_given, of_it in given:
        for name, value in of_it.items():
            if not is_given and value is not None:
                words = f"--{name} has no effect without {option}; expected both."
                raise InputError(words)
    flights = _FLIGHTS if args.flights is None else args.flights
    expected = f"a number from 1 to {_MOST_FLIGHTS:,}"
    expect(1 <= flights <= _MOST_FLIGHTS, "--flights", flights, expected)
    check_seed(args.seed or 0)
    return level, flights


def _least_pushes(args: argparse.Namespace) -> tuple[float, float]:
    """Command error and wind that --prove requires; checks --hold."""
    for name in ("hold", "command_error", "wind"):
        option = f"--{name.replace('_', '-')}"
        value = getattr(args, name) or 0.0
        expect(0.0 <= value < math.inf, option, value, "zero or a positive number")
    return args.command_error or 0.0, args.wind or 0.0


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


def _level(option: str, text: str | None) -> float | None:
    """The probability given by an option; None without it."""
    if text is None:
        return None
    try:
        level = float(text)
    except ValueError:
        level = math.nan
    expected = f"a probability between 0 and 1, such as {_LEVEL:g}"
    expect(0.0 < level < 1.0, option, text, expected)
    return level


def _flown_loop(args, funnel, rests, gliders):
    """The loop of --as-flown: of held commands that of their clock, predicted."""
    from glider.control.predictor import Hold
    from glider.verification.proof.phases import first_commands
    from glider.verification.trials.as_flown import FlownLoop

    period = (rests or [funnel])[0].settings.period
    latency = _LATENCY
    if period:
        latency = first_commands(funnel, rests)[0] if rests else 0.5 * period
    latency = latency if args.latency is None else args.latency
    predicts = args.predict or (period > 0.0 and latency > 0.0)
    hold = args.hold if args.hold is not None else period or _HOLD
    return FlownLoop(
        hold=Hold(period=hold, latency=latency, predicts=predicts),
        wind=args.wind or 0.0,
        command_error=args.command_error or 0.0,
        gliders=gliders,
    )


def _confidence(funnel, model, covariance, level, shape):
    """The set of gliders to fly, by the model's file or the funnel's own."""
    from glider.physics.confidence import make_confidence

    if not model and funnel.gliders:
        covariance = funnel.gliders.confidence.covariance
    if covariance is None:
        raise InputError(
            f"{model or '--confidence'}: the accuracy of the glider's parameters "
            "is unknown; expected a --model with a covariance, as close-the-loop "
            "writes it."
        )
    return make_confidence(funnel.nominal.model, covariance, level, shape)
