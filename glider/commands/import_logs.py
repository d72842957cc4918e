"""The command `import`: convert logs of other software into a campaign."""

import argparse
from pathlib import Path

from glider.commands.output import working
from glider.errors import InputError

DESCRIPTION = """\
Converts logs of other software into a campaign folder: CSV of any dialect, Excel .xlsx,
OptiTrack Motive and Vicon exports, C3D, PX4 ULog, MATLAB .mat, MCAP, ROS bags, Parquet.

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

Formats other than text need pip install 'drake-glider[import]'; docs/import.md has six
maps by example.
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Adds its arguments to a parser."""
    parser.add_argument("files", metavar="FILES", type=Path, nargs="+", help="the logs")
    parser.add_argument(
        "--map",
        type=Path,
        required=True,
        metavar="MAP.yaml",
        help="columns, units and axes of the logs; with --guess: where to write them",
    )
    parser.add_argument(
        "--out",
        type=Path,
        metavar="CAMPAIGN",
        help="the folder to write, without --guess",
    )
    parser.add_argument(
        "--guess",
        action="store_true",
        help="propose a map and draw it, and import nothing",
    )


def run(args: argparse.Namespace) -> int:
    """Runs it; returns the exit code."""
    if args.guess:
        from glider.campaign.importing.guess import guess_mapping
        from glider.files.writing import replace_file, write_text
        from glider.report.import_figure import save_import_figure

        if args.map.exists():
            raise InputError(f"--map {args.map}: exists; --guess writes a new file.")
        with working() as progress:
            progress("comparing axes and signs")
            guess = guess_mapping(args.files)
        figure = args.map.with_suffix(".png")
        campaign = guess.campaign
        replace_file(figure, lambda path: save_import_figure(campaign, path))
        write_text(args.map, guess.text)
        print(guess.text, end="")
        print(f"Map: {args.map}; the flights as it reads them: {figure}")
        print("Check each line, then run the same with --out CAMPAIGN.")
        return 0
    if args.out is None:
        raise InputError("--out is missing; expected the folder to write.")
    from glider.campaign.importing.campaign_import import import_campaign

    with working(is_even=True) as progress:
        imported = import_campaign(args.files, args.map, args.out, progress=progress)
    print(imported.describe())
    count = len(imported.campaign.flights)
    empty = sum(not recording.flights for recording in imported.recordings)
    if empty:
        print(f"{empty} of {len(imported.recordings)} recordings have no flight")
    print(f"Campaign: {args.out}, {count} flight" + "s" * (count != 1))
    return 0
