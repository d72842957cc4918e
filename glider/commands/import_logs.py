"""The command `import`: convert logs of other software into a campaign."""

import argparse
import textwrap
from pathlib import Path

from glider.campaign.importing.formats import FORMAT_NAMES
from glider.commands.output import working
from glider.commands.parsing import CommandParser
from glider.errors import InputError

_FORMATS = textwrap.fill(
    f"Converts logs of other software into a campaign folder. Formats: {FORMAT_NAMES}.",
    width=88,
)
DESCRIPTION = f"""\
{_FORMATS}

MAP.yaml specifies which columns are which, in which units and axes, and what is known
of the vehicle. Long recordings are cut into flights, from release to contact. Nothing
is written if the flights contradict the map: they must fall down, nose ahead, and turn
in the direction of their elevator.
"""

EPILOG = """\
examples:
  glider import takes/*.csv --guess --map MAP.yaml   # proposes a map
  glider import takes/*.csv --map MAP.yaml --out throws
  glider close-the-loop throws

Formats other than text need pip install 'drake-glider[import]'; docs/import.md has maps
by example.
"""


def add_arguments(parser: CommandParser) -> None:
    """Adds its arguments to a parser."""
    parser.add_argument("files", metavar="FILES", type=Path, nargs="+", help="the logs")
    parser.add_argument(
        "--map",
        type=Path,
        required=True,
        metavar="MAP.yaml",
        help="columns, units and axes of the logs; with --guess: where to write them",
    )
    parser.add_path("--out", "CAMPAIGN", "the folder to write, without --guess")
    parser.add_switch("--guess", "propose a map and draw it, and import nothing")
    parser.add_switch("--force", "overwrite the map or the campaign that is there")
    parser.add_json("what was done, with the times of all flights, as JSON")


def run(args: argparse.Namespace) -> int:
    """Runs it; returns the exit code."""
    from glider.files.schema import json_text

    if args.guess:
        from glider.campaign.importing.guess import guess_mapping
        from glider.files.writing import replace_file, write_text
        from glider.report.import_figure import save_import_figure

        figure = args.map.with_suffix(".png")
        for file in (args.map, figure):
            if file.exists() and not args.force:
                raise InputError(f"{file}: exists; expected a new name for --map.")
        with working() as progress:
            progress("comparing axes and signs")
            guess = guess_mapping(args.files)
        campaign = guess.campaign
        replace_file(figure, lambda path: save_import_figure(campaign, path))
        write_text(args.map, guess.text)
        if args.json:
            print(json_text({"map": args.map, "figure": figure, "text": guess.text}))
            return 0
        print(guess.text, end="")
        print(f"Map: {args.map}; the flights as it reads them: {figure}")
        print("Check each line, then run the same with --out CAMPAIGN.")
        return 0
    if args.out is None:
        raise InputError("--out is missing; expected the folder to write.")
    from glider.campaign.importing.campaign_import import import_campaign

    with working(is_even=True) as progress:
        imported = import_campaign(
            args.files, args.map, args.out, force=args.force, progress=progress
        )
    if args.json:
        print(json_text({"campaign": args.out} | imported.report()))
        return 0
    print(imported.describe())
    count = len(imported.campaign.flights)
    words = f"{count} flight" + "s" * (count != 1), imported.empty
    print(f"Campaign: {args.out}, {'; '.join(filter(None, words))}")
    return 0
