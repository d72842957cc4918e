"""What all examples do alike: their options, their key figures, their page.

parser = argparse.ArgumentParser(...)
add_options(parser)
args = parser.parse_args(arguments)
check_folders(args.json, args.html, args.figure)
...
write_figures(args, figures)
show(args, tracks, title)

if __name__ == "__main__":
    sys.exit(run(main))
"""

import argparse
import json
import math
import os
import sys
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from matplotlib.backend_bases import FigureCanvasBase
from pydrake.geometry import Meshcat

from diagrams.playback import (
    Track,
    play,
    write_html,
)
from diagrams.scene import Stage
from glider.errors import InputError
from glider.physics.parameters import GliderParameters
from glider.planning.dircol import PlanningError


def add_options(parser: argparse.ArgumentParser) -> None:
    """Adds --json, --html, --rate and --headless."""
    parser.add_argument(
        "--json", metavar="FILE", type=Path, help="where to write the key figures"
    )
    parser.add_argument(
        "--html",
        metavar="FILE",
        type=Path,
        help="where to write the animation, a page that needs no server",
    )
    parser.add_argument(
        "--rate",
        metavar="R",
        type=_rate,
        default=0.25,
        help="of the animation: 1 is real time, 0.25 (the default) four times slower",
    )
    parser.add_argument(
        "--headless",
        action="store_true",
        help="do not serve Meshcat and wait for somebody to look",
    )


def _rate(text: str) -> float:
    try:
        rate = float(text)
    except ValueError:
        rate = math.nan
    if not (math.isfinite(rate) and rate > 0.0):
        raise argparse.ArgumentTypeError(f"{text} is not a positive number")
    return rate


def whole_number(least: int) -> Callable[[str], int]:
    """Returns a `type` of argparse for whole numbers from `least` on."""

    def read(text: str) -> int:
        if not text.isdecimal() or int(text) < least:
            raise argparse.ArgumentTypeError(
                f"{text} is not a whole number from {least} on"
            )
        return int(text)

    return read


def add_launches(parser: argparse.ArgumentParser, count: int, least: int = 1) -> None:
    """Adds --launches, by default `count` and not below `least`, and --seed."""
    parser.add_argument(
        "--launches",
        metavar="N",
        type=whole_number(least),
        default=count,
        help="how many to fly (default: %(default)s)",
    )
    parser.add_argument(
        "--seed",
        metavar="N",
        type=whole_number(0),
        default=0,
        help="of all that is random (default: %(default)s)",
    )


def add_truth(parser: argparse.ArgumentParser, default: str) -> None:
    """Adds --truth, the glider that flies; `load_truth` of the rehearsal reads it."""
    parser.add_argument(
        "--truth",
        default=default,
        help="model file, or a name in models/truths (default: %(default)s)",
    )


def check_folders(
    data: Path | None,
    page: Path | None,
    figure: Path | None = None,
    *others: Path | None,
) -> None:
    """Raises InputError where a file cannot be written: before the work.

    Args:
        data: of --json.
        page: of --html.
        figure: a picture, in a format that Matplotlib writes.
        others: any more files.
    """
    for file in (data, page, figure, *others):
        if file is None:
            continue
        if not file.parent.is_dir():
            raise InputError(f"{file}: the folder {file.parent} does not exist.")
        if file.is_dir():
            raise InputError(f"{file}: is a folder; the name of a file is needed.")
        if not os.access(file if file.exists() else file.parent, os.W_OK):
            raise InputError(f"{file}: cannot be written; permission is denied.")
    formats = FigureCanvasBase.get_supported_filetypes()
    if figure is not None and figure.suffix.lower().removeprefix(".") not in formats:
        raise InputError(
            f"{figure}: '{figure.suffix}' is no format of pictures; one of "
            f"{', '.join(sorted(formats))} is needed."
        )


def write_figures(args: argparse.Namespace, figures: Mapping[str, object]) -> None:
    """Writes the key figures where --json says."""
    if args.json:
        args.json.write_text(json.dumps(figures, indent=2) + "\n", encoding="utf-8")


def start_meshcat(args: argparse.Namespace) -> Meshcat | None:
    """Returns a Meshcat; None where nobody would look (headless and no --html)."""
    return None if args.headless and not args.html else Meshcat()


def finish(
    args: argparse.Namespace,
    meshcat: Meshcat | None,
    tracks: Sequence[Track] = (),
    title: str = "",
) -> None:
    """Writes the page of --html and, unless headless, waits while people look.

    Args:
        args: with the options of `add_options`.
        meshcat: of `start_meshcat`.
        tracks: for the legend of the page.
        title: of the page.
    """
    if meshcat is None:
        return
    if args.html:
        write_html(args.html, meshcat, tracks, title)
        print(f"Animation: {args.html}")
    if not args.headless:
        print(f"Meshcat: {meshcat.web_url()} (Enter to end)", flush=True)
        sys.stdin.readline()


def show(
    args: argparse.Namespace,
    tracks: Sequence[Track],
    title: str,
    *,
    parameters: GliderParameters | None = None,
    stage: Stage | None = None,
) -> None:
    """Plays tracks in Meshcat as the options say; the arguments are those of `play`."""
    meshcat = start_meshcat(args)
    if meshcat is not None:
        play(tracks, meshcat, rate=args.rate, parameters=parameters, stage=stage)
    finish(args, meshcat, tracks, title)


def run(main: Callable[[], None]) -> int:
    """Runs a program and returns its exit code; a user's fault is one sentence."""
    try:
        main()
    except (InputError, PlanningError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    except OSError as error:
        named = error.filename is not None
        words = f"{error.filename}: {error.strerror}." if named else error
        print(f"error: {words}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        return 130
    return 0
