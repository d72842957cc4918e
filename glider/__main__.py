"""The command line: ``python -m glider close-the-loop CAMPAIGN``."""

import argparse
import importlib.metadata
import json
import sys
from collections.abc import Sequence
from pathlib import Path

from glider.errors import (
    INTERRUPTED,
    INTERRUPTED_CODE,
    InputError,
    os_error_line,
)

_DESCRIPTION = """\
Finds what a glider's model lacks, from logs of its flights.

The logs are smoothed, the residual of the flat-plate model is traced to a physical
effect of the library (wind, a slow servo, attached lift, ...), the effect is added
to the model, and the errors on held-out flights are reported before and after.
"""

_EPILOG = """\
A campaign is a folder with campaign.yaml and flight_*.csv (columns time, x, z, pitch
and, where there is a servo, elevator, elevator_rate_command; SI units, radians,
positive pitch is nose down), or that folder as .zip, or the name of a sample:
python -m glider samples lists them.

examples:
  python -m glider close-the-loop attached_lift
  python -m glider close-the-loop throws --grade A,B --out out/throws
  python -m glider close-the-loop throws --effects wind,servo_lag --json

exit code: 0 when it ran, 2 when the input cannot be used or a file cannot be written,
130 when it was interrupted.
"""


_COMPARE_DESCRIPTION = """\
Compares the reports of two campaigns, number by number: did last week's change to
the glider show? A change is told where it is larger than the standard errors of both
reports allow.

exit code: 0 when it ran, whatever changed; 2 when a report cannot be used.
"""

_CHECK_DESCRIPTION = """\
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


_IMPORT_DESCRIPTION = """\
Makes a campaign folder of logs of other software: CSV of any dialect, OptiTrack Motive
and Vicon exports, PX4 ULog, MATLAB .mat, MCAP, ROS bags, Parquet.

MAP.yaml says which columns are which, in which units and axes, and what is known of
the vehicle. Long recordings are cut into flights, from release to contact. Nothing is
written where the flights contradict the map: they must fall down, nose ahead, and turn
the way their elevator says.
"""

_IMPORT_EPILOG = """\
examples:
  python -m glider import takes/*.csv --guess --map MAP.yaml   # proposes a map
  python -m glider import takes/*.csv --map MAP.yaml --out throws
  python -m glider close-the-loop throws

Formats other than text need pip install 'drake-glider[import]'; docs/import.md has five
maps by example.
"""

_NEXT_DESCRIPTION = """\
Proposes the next throws of a campaign: launches and elevator commands that best tell
apart the explanations that its flights leave, then tighten the coefficients that move
where a flight ends. It says what it expects of them, how many throws of the present
kind would do the same, and when nothing more is to be learned.
"""

_NEXT_EPILOG = """\
Throws stay within what was flown: launch, floor, speed; --limits FILE.yaml has others:

  launch_height: [0.0, 0.4]   # m; launch_speed [m/s], launch_climb, launch_pitch [rad]
  z: [-0.8, 1.5]              # m, floor and ceiling; x [m], pitch [rad]
  speed: 9.0                  # m/s at most; elevator [rad], elevator_rate [rad/s]
  missed_speed: 0.2           # how well a launch is met; missed_height, missed_pitch

examples:
  python -m glider close-the-loop throws --out out/throws
  python -m glider next-throw throws --report out/throws --launches 3

exit code: 0 when it ran, 2 when the input cannot be used.
"""


_SAMPLES_DESCRIPTION = """\
Lists the campaigns that ship with this package: what their logs hold, and how to run
one. With a name and --out, writes one as a folder of CSV files, to look at or to start
from. With --tables, closes the loop on each and prints the README's table of them.
"""

_DOCTOR_DESCRIPTION = """\
Tells what works of this installation and what does not, and what to do then: Python,
libraries and extras, Drake and its solvers, threads, memory, caches, Meshcat, browser.

exit code: 0 when all that is needed works, 1 when something does not.
"""


def main(arguments: Sequence[str] | None = None) -> int:
    """Runs the command line; returns the exit code."""
    parser = _parser()
    args = parser.parse_args(arguments)
    try:
        return args.run(args)
    except InputError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    except OSError as error:
        print(f"error: {os_error_line(error)}", file=sys.stderr)
        return 2
    except ModuleNotFoundError as error:
        if error.name is None or error.name.split(".")[0] in ("glider", "diagrams"):
            raise
        print(f"error: {_not_installed(error.name)}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print(INTERRUPTED, file=sys.stderr)
        return INTERRUPTED_CODE


def _not_installed(module: str) -> str:
    """Returns what to do where a library is missing: mostly, take another Python."""
    return (
        f"{module} is not installed for {sys.executable}; use the Python of the "
        "environment that drake-glider is installed in (.venv/bin/python after make "
        "setup), or install it here with pip install . (python -m glider doctor tells "
        "what is missing)."
    )


class _Version(argparse.Action):
    """Prints the version, which only an installed package has."""

    def __call__(self, parser, *args):
        try:
            print(importlib.metadata.version("drake-glider"))
        except importlib.metadata.PackageNotFoundError:
            parser.exit(2, f"error: {_not_installed('drake-glider')}\n")
        parser.exit()


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="python -m glider",
        description="A toolkit for a perching glider, built on Drake.",
    )
    parser.add_argument("--version", action=_Version, nargs=0)
    commands = parser.add_subparsers(required=True, metavar="COMMAND")
    loop = commands.add_parser(
        "close-the-loop",
        help="find what the model lacks, from logs of flights",
        description=_DESCRIPTION,
        epilog=_EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    loop.add_argument(
        "campaign", type=Path, help="folder of flight logs, its .zip, or a sample"
    )
    loop.add_argument(
        "--out",
        type=Path,
        metavar="DIR",
        help="where to write report.json, report.html, model.yaml and figures/ "
        "(default: out/CAMPAIGN)",
    )
    which = loop.add_mutually_exclusive_group()
    which.add_argument(
        "--flights", metavar="FILE,...", type=_names, help="use only these flights"
    )
    which.add_argument(
        "--grade",
        metavar="A,B",
        type=_names,
        help="use only flights of these grades in index.csv",
    )
    loop.add_argument(
        "--held-out",
        metavar="FRACTION",
        type=float,
        default=0.3,
        help="share of the flights that errors are measured on (default: 0.3)",
    )
    loop.add_argument(
        "--seed",
        metavar="N",
        type=int,
        default=0,
        help="of the split into fitted and held-out flights (default: 0)",
    )
    loop.add_argument(
        "--effects",
        metavar="NAME,...",
        type=_names,
        help="try only these effects; others cannot be found then "
        "(default: the whole library)",
    )
    loop.add_argument(
        "--json", action="store_true", help="print report.json instead of the summary"
    )
    loop.set_defaults(run=_close_the_loop)
    compare = commands.add_parser(
        "compare",
        help="what changed between two campaigns, from their reports",
        description=_COMPARE_DESCRIPTION,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    for name, letter in (("first", "A"), ("second", "B")):
        compare.add_argument(
            name,
            type=Path,
            metavar=letter,
            help="folder that close-the-loop wrote, or its report.json",
        )
    compare.add_argument(
        "--out",
        type=Path,
        metavar="DIR",
        help="where to write comparison.html and comparison.json (default: out/A_B)",
    )
    compare.add_argument(
        "--json", action="store_true", help="print comparison.json, no tables"
    )
    compare.set_defaults(run=_compare)
    after = commands.add_parser(
        "next-throw",
        help="which throws tell the explanations of a campaign apart",
        description=_NEXT_DESCRIPTION,
        epilog=_NEXT_EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    after.add_argument("campaign", type=Path, help="folder of flight logs")
    after.add_argument(
        "--report",
        type=Path,
        metavar="DIR",
        help="folder that close-the-loop wrote of it (default: closes the loop first)",
    )
    after.add_argument(
        "--launches",
        metavar="N",
        type=int,
        default=3,
        help="how many throws to propose (default: 3)",
    )
    after.add_argument(
        "--limits", type=Path, metavar="FILE.yaml", help="limits of the throws"
    )
    after.add_argument(
        "--out",
        type=Path,
        metavar="DIR",
        help="where to write commands_N.csv, next_throw.json and next_throw.png "
        "(default: out/CAMPAIGN/next_throw)",
    )
    after.add_argument(
        "--seed", metavar="N", type=int, default=0, help="of the search (default: 0)"
    )
    after.add_argument(
        "--json", action="store_true", help="print next_throw.json, no sentences"
    )
    after.set_defaults(run=_next_throw)
    logs = commands.add_parser(
        "import",
        help="make a campaign of logs of other software",
        description=_IMPORT_DESCRIPTION,
        epilog=_IMPORT_EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    logs.add_argument("files", metavar="FILES", type=Path, nargs="+", help="the logs")
    logs.add_argument(
        "--map",
        type=Path,
        required=True,
        metavar="MAP.yaml",
        help="columns, units and axes of the logs; with --guess: where to write them",
    )
    logs.add_argument(
        "--out",
        type=Path,
        metavar="CAMPAIGN",
        help="the folder to write; needed without --guess",
    )
    logs.add_argument(
        "--guess",
        action="store_true",
        help="propose a map and draw it, and import nothing",
    )
    logs.set_defaults(run=_import)
    check = commands.add_parser(
        "check-funnel",
        help="check a saved funnel, exactly and without a solver",
        description=_CHECK_DESCRIPTION,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    check.add_argument("funnel", type=Path, help="file of a funnel (.npz)")
    check.add_argument(
        "--model",
        metavar="YAML",
        type=Path,
        help="model or vehicle that it has to be a funnel of (default: any)",
    )
    check.add_argument(
        "--problem",
        metavar="YAML",
        type=Path,
        help="problem that it has to solve (default: the article's)",
    )
    check.add_argument(
        "--every",
        metavar="N",
        type=int,
        default=1,
        help="check every N-th time or interval only, and the last (default: all)",
    )
    check.add_argument(
        "--prove",
        action="store_true",
        help="prove that no flight leaves it, in continuous time; takes minutes",
    )
    check.add_argument(
        "--resume",
        metavar="FILE",
        type=Path,
        help="with --prove: keep there what is proven, and go on from it",
    )
    check.add_argument(
        "--json", action="store_true", help="print JSON instead of sentences"
    )
    check.set_defaults(run=_check_funnel)
    samples = commands.add_parser(
        "samples",
        help="list the campaigns that ship with this package",
        description=_SAMPLES_DESCRIPTION,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    samples.add_argument("name", nargs="?", help="a sample (default: all)")
    what = samples.add_mutually_exclusive_group()
    what.add_argument(
        "--out", type=Path, metavar="DIR", help="write the named sample there, as CSV"
    )
    what.add_argument(
        "--tables",
        action="store_true",
        help="close the loop on each, or on the named one; takes minutes",
    )
    samples.set_defaults(run=_samples)
    doctor = commands.add_parser(
        "doctor",
        help="tell what works of this installation",
        description=_DOCTOR_DESCRIPTION,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    doctor.set_defaults(run=_doctor)
    return parser


def _names(text: str) -> list[str]:
    return [name.strip() for name in text.split(",") if name.strip()]


def _close_the_loop(args: argparse.Namespace) -> int:
    from rich.console import Console

    from glider.files.writing import check_writable

    if args.seed < 0:
        raise InputError(f"--seed is {args.seed}; it must not be negative.")
    name = args.campaign.resolve().name.removesuffix(".zip")
    folder = args.out or Path("out") / name
    if folder.exists() and not folder.is_dir():
        raise InputError(f"--out {folder}: is a file; a folder is needed.")
    check_writable(folder)
    progress_console = Console(stderr=True)
    with progress_console.status("starting") as status:
        from glider.sysid.pipeline import close_the_loop

        result = close_the_loop(
            args.campaign,
            flights=args.flights,
            grades=args.grade,
            held_out=args.held_out,
            seed=args.seed,
            effects=args.effects,
            progress=lambda text: status.update(f"{text} ..."),
        )
    # Matplotlib takes half a second to import: not before the input is read.
    from glider.report.folder import write_report
    from glider.report.json_report import to_json
    from glider.report.terminal import print_summary

    try:
        with progress_console.status("writing the report ..."):
            write_report(result, folder)
    finally:  # What was found is told even where it cannot be kept.
        if args.json:
            print(json.dumps(to_json(result), indent=2), flush=True)
        else:
            print_summary(result, Console())
    if not args.json:
        print(f"Report: {folder / 'report.html'}")
    return 0


def _compare(args: argparse.Namespace) -> int:
    from glider.comparison.saved import load_report

    first, second = load_report(args.first), load_report(args.second)

    from rich.console import Console

    from glider.comparison.as_json import to_json
    from glider.comparison.differences import compare
    from glider.comparison.page import to_html
    from glider.comparison.terminal import print_comparison
    from glider.files.writing import replace_files

    comparison = compare(first, second)
    folder = args.out or Path("out") / f"{first.campaign}_{second.campaign}"
    text = json.dumps(to_json(comparison), indent=2)
    files = {
        "comparison.html": to_html(comparison).encode(),
        "comparison.json": f"{text}\n".encode(),
    }
    replace_files(folder, files, last="comparison.json")
    if args.json:
        print(text)
    else:
        print_comparison(comparison, Console())
        print(f"Page: {folder / 'comparison.html'}")
    return 0


def _next_throw(args: argparse.Namespace) -> int:
    from glider.files.writing import check_writable

    if args.seed < 0:
        raise InputError(f"--seed is {args.seed}; it must not be negative.")
    if args.launches < 1:
        raise InputError(f"--launches is {args.launches}; at least 1 is needed.")
    name = args.campaign.resolve().name.removesuffix(".zip")
    folder = args.out or Path("out") / name / "next_throw"
    if folder.exists() and not folder.is_dir():
        raise InputError(f"--out {folder}: is a file; a folder is needed.")
    check_writable(folder)

    from rich.console import Console

    with Console(stderr=True).status("starting") as status:

        def follow(text: str) -> None:
            status.update(f"{text} ...")

        from glider.design.findings import findings_of, load_findings
        from glider.design.limits import load_limits
        from glider.design.proposal import next_throw

        limits = load_limits(args.limits) if args.limits else None
        if args.report:
            findings = load_findings(args.report)
        else:
            from glider.sysid.pipeline import close_the_loop

            findings = findings_of(close_the_loop(args.campaign, progress=follow))
        proposal = next_throw(
            args.campaign,
            findings,
            launches=args.launches,
            limits=limits,
            seed=args.seed,
            progress=follow,
        )
        from glider.report.next_throw import print_proposal, to_json, write_proposal

        write_proposal(proposal, folder)
    if args.json:
        print(json.dumps(to_json(proposal), indent=2))
    else:
        print_proposal(proposal, folder, Console())
        print(f"Picture: {folder / 'next_throw.png'}")
    return 0


def _import(args: argparse.Namespace) -> int:
    if args.guess:
        from glider.campaign.importing.guess import guess_mapping
        from glider.files.writing import replace_file, write_text
        from glider.report.import_figure import save_import_figure

        if args.map.exists():
            raise InputError(f"--map {args.map}: exists; --guess writes a new file.")
        guess = guess_mapping(args.files)
        figure = args.map.with_suffix(".png")
        campaign = guess.imported.campaign
        replace_file(figure, lambda path: save_import_figure(campaign, path))
        write_text(args.map, guess.text)
        print(guess.text, end="")
        print(f"Map: {args.map}; what it makes of the logs: {figure}")
        print("See that each line is right, then run the same with --out CAMPAIGN.")
        return 0
    if args.out is None:
        raise InputError("--out is missing; the folder to write is needed.")
    from glider.campaign.importing.run import import_campaign

    imported = import_campaign(args.files, args.map, args.out)
    print(imported.describe())
    print(f"Campaign: {args.out}, {len(imported.campaign.flights)} flights")
    return 0


def _check_funnel(args: argparse.Namespace) -> int:
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


def _samples(args: argparse.Namespace) -> int:
    from glider.campaign.samples import copy_sample, list_samples, sample_names

    if args.name is not None and args.name not in sample_names():
        raise InputError(
            f"there is no sample '{args.name}'; there are {', '.join(sample_names())}."
        )
    if args.out is not None:
        if args.name is None:
            raise InputError("--out needs the name of the sample to write.")
        copy_sample(args.name, args.out)
        print(f"Campaign: {args.out}")
        return 0
    names = sample_names() if args.name is None else (args.name,)
    if args.tables:
        from glider.studies.known_truth import HEADING, line_of, trace_samples

        print(HEADING)
        for row in trace_samples(names):
            print(line_of(row), flush=True)
        return 0
    print("sample         flights  what a flat plate in still air lacks")
    for sample in list_samples():
        if sample.name in names:
            print(f"{sample.name:14s} {sample.flights:7d}  {sample.holds}")
    print(f"\nTo run one:        python -m glider close-the-loop {names[0]}")
    print(f"To see its files:  python -m glider samples {names[0]} --out mine")
    return 0


def _doctor(args: argparse.Namespace) -> int:
    del args
    from glider.doctor.examine import examine, lines_of, summary_of

    findings = []
    for finding in examine():
        findings.append(finding)
        print(lines_of(finding), flush=True)
    print(f"\n{summary_of(findings)}")
    return 1 if any(f.state == "fails" for f in findings) else 0


if __name__ == "__main__":
    sys.exit(main())
