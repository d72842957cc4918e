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
    from glider.comparison import compare, load_report, print_comparison, to_json

    comparison = compare(load_report(args.first), load_report(args.second))
    if args.json:
        print(to_json(comparison))
    else:
        with output() as console:
            print_comparison(comparison, console)
    return 0
