"""The command `samples`: list the campaigns that ship with this package."""

import argparse
from pathlib import Path

from glider.commands.parsing import CommandParser
from glider.errors import InputError

DESCRIPTION = """\
Lists the campaigns that ship with this package, with their contents and how to run one.
With a name and --out, writes that campaign as a folder of CSV files, to look at or to
start from.
"""


def add_arguments(parser: CommandParser) -> None:
    """Adds its arguments to a parser."""
    parser.add_argument("name", nargs="?", help="a sample (default: all)")
    what = parser.add_mutually_exclusive_group()
    words = "write the named sample there, as CSV"
    what.add_argument("--out", type=Path, metavar="DIR", help=words)
    what.add_argument("--json", action="store_true", help="print the list as JSON")


def run(args: argparse.Namespace) -> int:
    """Runs it; returns the exit code."""
    from glider.campaign.samples import copy_sample, list_samples, sample_names
    from glider.files.schema import json_text

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
    samples = [sample for sample in list_samples() if sample.name in names]
    if args.json:
        print(json_text([sample._asdict() for sample in samples]))
        return 0
    print("sample         flights  what a flat plate in still air lacks")
    for sample in samples:
        print(f"{sample.name:14s} {sample.flights:7d}  {sample.holds}")
    print(f"\nTo run one:        glider close-the-loop {names[0]}")
    print(f"To see its files:  glider samples {names[0]} --out mine")
    return 0
