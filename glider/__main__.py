"""The command line: ``python -m glider close-the-loop CAMPAIGN``."""

import argparse
import importlib.metadata
import json
import sys
from collections.abc import Sequence
from pathlib import Path

from glider.errors import InputError, os_error_line

_DESCRIPTION = """\
Finds what a glider's model lacks, from logs of its flights.

The logs are smoothed, the residual of the flat-plate model is traced to a physical
effect of the library (wind, a slow servo, attached lift, ...), the effect is added
to the model, and the errors on held-out flights are reported before and after.
"""

_EPILOG = """\
A campaign is a folder with campaign.yaml and flight_*.csv (columns time, x, z, pitch
and, where there is a servo, elevator, elevator_rate_command; SI units, radians,
positive pitch is nose down). The sample that ships with the project is
models/campaigns/attached_lift.

examples:
  python -m glider close-the-loop models/campaigns/attached_lift
  python -m glider close-the-loop throws --grade A,B --out out/throws
  python -m glider close-the-loop throws --effects wind,servo_lag --json

exit code: 0 when it ran, 2 when the input cannot be used.
"""


_COMPARE_DESCRIPTION = """\
Compares the reports of two campaigns, number by number: did last week's change to
the glider show? A change is told where it is larger than the standard errors of both
reports allow.

exit code: 0 when it ran, whatever changed; 2 when a report cannot be used.
"""

_CHECK_DESCRIPTION = """\
Checks the certificate of a funnel: at each of its times, in exact arithmetic, that no
deviation leaves it, that the servo stays within its limits, and that it ends in the
goal. Needs no solver and no plan: all is in the file, the glider too.

The certificate is of the third-order Taylor polynomials of the dynamics, with a bound
of their remainder. With --prove, the remainder is proven to be within that bound, at
the same times.

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
    except KeyboardInterrupt:
        return 130


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="python -m glider",
        description="A toolkit for a perching glider, built on Drake.",
    )
    parser.add_argument(
        "--version",
        action="version",
        version=importlib.metadata.version("drake-glider"),
    )
    commands = parser.add_subparsers(required=True, metavar="COMMAND")
    loop = commands.add_parser(
        "close-the-loop",
        help="find what the model lacks, from logs of flights",
        description=_DESCRIPTION,
        epilog=_EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    loop.add_argument("campaign", type=Path, help="folder of flight logs")
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
        help="try only these effects (default: the whole library)",
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
        "--every",
        metavar="N",
        type=int,
        default=1,
        help="check every N-th time only, and the last (default: all)",
    )
    check.add_argument(
        "--prove",
        action="store_true",
        help="prove the bound of the Taylor remainder too; takes minutes",
    )
    check.add_argument(
        "--json", action="store_true", help="print JSON instead of sentences"
    )
    check.set_defaults(run=_check_funnel)
    return parser


def _names(text: str) -> list[str]:
    return [name.strip() for name in text.split(",") if name.strip()]


def _close_the_loop(args: argparse.Namespace) -> int:
    from rich.console import Console

    if args.seed < 0:
        raise InputError(f"--seed is {args.seed}; it must not be negative.")
    folder = args.out or Path("out") / args.campaign.resolve().name
    if folder.exists() and not folder.is_dir():
        raise InputError(f"--out {folder}: is a file; a folder is needed.")
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
        status.update("writing the report ...")
        # Matplotlib takes half a second to import: not before the input is read.
        from glider.report.folder import write_report
        from glider.report.json_report import to_json
        from glider.report.terminal import print_summary

        write_report(result, folder)
    if args.json:
        print(json.dumps(to_json(result), indent=2))
    else:
        print_summary(result, Console())
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
    from glider.report.folder import make_folder, write_text

    comparison = compare(first, second)
    folder = args.out or Path("out") / f"{first.campaign}_{second.campaign}"
    text = json.dumps(to_json(comparison), indent=2)
    make_folder(folder)
    write_text(folder / "comparison.html", to_html(comparison))
    write_text(folder / "comparison.json", text + "\n")
    if args.json:
        print(text)
    else:
        print_comparison(comparison, Console())
        print(f"Page: {folder / 'comparison.html'}")
    return 0


def _import(args: argparse.Namespace) -> int:
    if args.guess:
        from glider.campaign.importing.guess import guess_mapping
        from glider.report.import_figure import save_import_figure

        if args.map.exists():
            raise InputError(f"--map {args.map}: exists; --guess writes a new file.")
        guess = guess_mapping(args.files)
        args.map.write_text(guess.text, encoding="utf-8")
        figure = args.map.with_suffix(".png")
        save_import_figure(guess.imported.campaign, figure)
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
    import dataclasses

    from glider.verification.funnel.file import read_file

    if args.every < 1:
        raise InputError(f"--every is {args.every}; a positive number is needed.")
    file = read_file(args.funnel)

    # These take a second to import: not before it is known that there is a funnel.
    from rich.console import Console
    from rich.progress import Progress

    from glider.verification.funnel.funnel import funnel_of
    from glider.verification.proof.check import check_funnel
    from glider.verification.proof.remainder_proof import (
        describe_proof,
        prove_remainder,
        remainder_status,
    )

    funnel = funnel_of(file, args.funnel)
    proof = None
    with Progress(transient=True, console=Console(stderr=True)) as bar:

        def follow(words):
            task = bar.add_task(words, total=1.0)
            return lambda share: bar.update(task, completed=share)

        verdict = check_funnel(funnel, args.every, follow("certificate"))
        if args.prove and verdict.holds:
            proof = prove_remainder(funnel, args.every, progress=follow("remainder"))
    good = verdict.holds and (proof is None or proof.complete)
    if args.json:
        report = dataclasses.asdict(verdict) | {"holds": verdict.holds}
        report["remainder"] = remainder_status(funnel, proof)
        if proof:
            report |= {
                "remainder_until": proof.until,
                "remainder_proven": proof.complete,
                "remainder_times": len(proof.times),
                "boxes": proof.boxes,
            }
        print(json.dumps(report, indent=2))
        return 0 if good else 1
    for fault in verdict.faults:
        print(fault)
    if verdict.holds:
        print(
            f"The certificate holds: on the boundary, at all {verdict.times} times, "
            f"exactly, V̇/V <= {-verdict.slack:.2g} 1/s; between them, in floating "
            f"point, V̇/V <= {verdict.between:.2g} 1/s."
        )
    else:
        print(f"The certificate does not hold: {len(verdict.faults)} faults.")
    if proof:
        print(describe_proof(funnel, proof))
    return 0 if good else 1


if __name__ == "__main__":
    sys.exit(main())
