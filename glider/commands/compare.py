"""The command `compare`: show what changed between the reports of two campaigns."""

import argparse
from pathlib import Path

from glider.commands.output import output
from glider.commands.parsing import CommandParser

DESCRIPTION = """\
Compares the reports of two campaigns value by value: did last week's change to the
glider make a difference? A change is reported if it is larger than the standard errors
of both reports explain.

exit code: 0 when it ran, whatever changed; 2 when a report cannot be used.
"""


def add_arguments(parser: CommandParser) -> None:
    """Adds its arguments to a parser."""
    for name, letter in (("first", "A"), ("second", "B")):
        parser.add_argument(
            name,
            type=Path,
            metavar=letter,
            help="folder that close-the-loop wrote, or its report.json",
        )
    parser.add_out("comparison.html and comparison.json", "out/A_B")
    parser.add_json("comparison.json, no tables")


def run(args: argparse.Namespace) -> int:
    """Runs it; returns the exit code."""
    from glider.comparison.differences import compare, load_report
    from glider.files.writing import check_writable, replace_files

    first, second = load_report(args.first), load_report(args.second)
    folder = args.out or Path("out") / f"{first.campaign}_{second.campaign}"
    check_writable(folder)

    from glider.comparison.as_text import print_comparison, to_json
    from glider.comparison.comparison_page import to_html

    comparison = compare(first, second)
    text = to_json(comparison)
    files = {
        "comparison.html": to_html(comparison).encode(),
        "comparison.json": f"{text}\n".encode(),
    }
    replace_files(folder, files, last="comparison.json")
    if args.json:
        print(text)
    else:
        with output() as console:
            print_comparison(comparison, console)
        print(f"Page: {folder / 'comparison.html'}")
    return 0
