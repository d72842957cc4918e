"""What all examples do alike: their options, their key figures, their page.

parser = argparse.ArgumentParser(...)
add_options(parser)
args = parser.parse_args(arguments)
...
write_figures(args, figures)
show(args, tracks, title)

if __name__ == "__main__":
    sys.exit(run(main))
"""

import argparse
import json
import math
import sys
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from pydrake.geometry import Meshcat

from diagrams.playback import Track, play, write_html
from diagrams.scene import Stage
from glider.errors import InputError
from glider.parameters import GliderParameters
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
    rate = float(text)
    if not (math.isfinite(rate) and rate > 0.0):
        raise argparse.ArgumentTypeError(f"{text} is not a positive number")
    return rate


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
        print(f"error: {error.filename}: {error.strerror}.", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        return 130
    return 0
