"""The command `check-funnel`: check a saved funnel, exactly and without a solver."""

import argparse
import json
from pathlib import Path

from glider.commands.parsing import Commands, add_command
from glider.errors import InputError

_DESCRIPTION = """\
Checks the certificate of a funnel: that it is of a flight from a problem's launch to
its wire; at each of its times, in exact arithmetic, that V falls on the boundary and
that the servo stays within its limits; and that it ends in the goal. Needs no solver
and no plan: all is in the file, the glider too. Whether that is your glider, --model
tells; --problem names another problem than the article's.

That is of the third-order Taylor polynomials of the dynamics, with a bound of their
remainder, and between the times V is looked at in floating point only. --prove proves
it of the full dynamics and in continuous time: that no flight that starts in the inlet
leaves the funnel. It takes minutes; with --resume FILE one that is broken off goes on.

exit code: 0 when what was checked holds, 1 when it does not, 2 when the file is none.
"""


def add(commands: Commands) -> None:
    """Adds the command to a parser's."""
    parser = add_command(
        commands,
        "check-funnel",
        run,
        help="check a saved funnel, exactly and without a solver",
        description=_DESCRIPTION,
    )
    parser.add_argument("funnel", type=Path, help="file of a funnel (.npz)")
    parser.add_argument(
        "--model",
        metavar="YAML",
        type=Path,
        help="model or vehicle that it has to be a funnel of (default: any)",
    )
    parser.add_argument(
        "--problem",
        metavar="YAML",
        type=Path,
        help="problem that it has to solve (default: the article's)",
    )
    parser.add_argument(
        "--every",
        metavar="N",
        type=int,
        default=1,
        help="check every N-th time or interval only, and the last (default: all)",
    )
    parser.add_argument(
        "--prove",
        action="store_true",
        help="prove that no flight leaves it, in continuous time; takes minutes",
    )
    parser.add_argument(
        "--resume",
        metavar="FILE",
        type=Path,
        help="with --prove: keep there what is proven, and go on from it",
    )
    parser.add_argument(
        "--json", action="store_true", help="print JSON instead of sentences"
    )


def run(args: argparse.Namespace) -> int:
    """Runs it; returns the exit code."""
    from glider.verification.funnel.file import read_file

    if args.every < 1:
        raise InputError(f"--every is {args.every}; a positive number is needed.")
    if args.resume and not args.prove:
        raise InputError("--resume is of no use without --prove, which is needed.")
    file = read_file(args.funnel)

    # These take a second to import: not before it is known that there is a funnel.
    from rich.console import Console
    from rich.progress import Progress

    from glider.physics.model import load_glider
    from glider.planning.problem import PerchingProblem, load_problem
    from glider.verification.funnel.funnel import funnel_of
    from glider.verification.proof.check import check_funnel
    from glider.verification.proof.flight_proof import prove_flights
    from glider.verification.proof.words import check_report, describe_check

    funnel = funnel_of(file, args.funnel)
    model = load_glider(args.model) if args.model else None
    problem = load_problem(args.problem) if args.problem else PerchingProblem()
    proof = None
    with Progress(transient=True, console=Console(stderr=True)) as bar:

        def follow(words):
            task = bar.add_task(words, total=1.0)
            return lambda share: bar.update(task, completed=share)

        verdict = check_funnel(
            funnel, args.every, follow("certificate"), problem=problem, model=model
        )
        if args.prove and verdict.holds:
            proof = prove_flights(
                funnel, args.every, resume=args.resume, progress=follow("flights")
            )
    good = verdict.holds and (proof is None or proof.complete)
    if args.json:
        report = check_report(funnel, verdict, proof, problem)
        print(json.dumps(report | {"model_compared": model is not None}, indent=2))
    else:
        print(describe_check(funnel, verdict, proof, problem, args.model))
    return 0 if good else 1
