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
    parser.add_json("all numbers as JSON")


def run(args: argparse.Namespace) -> int:
    """Runs it; returns the exit code."""
    from glider.comparison import compare, print_comparison
    from glider.files.schema import json_text
    from glider.sysid.result import read_report

    first, second = read_report(args.first), read_report(args.second)
    comparison = compare(first[0], second[0])
    if args.json:
        print(json_text(comparison))
    else:
        with output() as console:
            print_comparison(comparison, first, second, console)
    return 0
