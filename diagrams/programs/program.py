"""Steps that all examples take: options, progress, a page to look at.

def main(arguments=None):
    parser = make_parser(__doc__)
    add_launches(parser, 20)
    args = read_options(parser, arguments)
    with working("plan (compiles once)"):
        planned = plan(GliderModel())
    show(args, [track_of("plan", planned)], "A plan")

if __name__ == "__main__":
    sys.exit(run(main))
"""

import argparse
import sys
import tempfile
import warnings
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backend_bases import FigureCanvasBase
from pydrake.geometry import Meshcat

from diagrams.playback import Track, play, stage_of
from diagrams.programs.page import open_meshcat, page_of
from glider.commands.output import working as working
from glider.commands.parsing import CommandParser
from glider.errors import (
    INTERRUPTED,
    INTERRUPTED_CODE,
    InputError,
    expect,
    os_error_line,
    print_warning,
)
from glider.files.writing import check_writable, write_text
from glider.physics.parameters import GliderParameters
from glider.planning.plan import Plan
from glider.planning.problem import Hook
from glider.progress import Progress as Progress
from glider.progress import Step as Step
from glider.progress import silent as silent
from glider.simulation.flown_flights import FlownFlight

# ------------------------------------------------------------------------ options


def make_parser(words: str | None) -> CommandParser:
    """Returns a parser whose help begins with an example's docstring."""
    return CommandParser(
        description=words, formatter_class=argparse.RawDescriptionHelpFormatter
    )


def add_launches(parser: CommandParser, count: int, least: int = 1) -> None:
    """Adds --launches, by default `count` and not below `least`, and --seed."""
    launches = "how many to fly (default: %(default)s)"
    parser.add_number("--launches", launches, count, least=least)
    parser.add_seed("of all random numbers")


def add_truth(parser: argparse.ArgumentParser, default: str) -> None:
    """Adds --truth, the glider that flies; `GliderModel.load` reads it."""
    parser.add_argument(
        "--truth",
        default=default,
        help="model file, or a name in models/truths (default: %(default)s)",
    )


def read_options(
    parser: CommandParser, arguments: Sequence[str] | None, *, figure: str | None = None
) -> argparse.Namespace:
    """Adds --html, --rate and --headless; reads all options and checks the files.

    Args:
        parser: with an example's own options.
        arguments: of the command line; None for those of the process.
        figure: help of --figure, which an example without a picture lacks.

    Raises:
        InputError: a file cannot be written.
    """
    files = {"--html": "where to write the animation, a page that needs no server"}
    if figure is not None:
        files["--figure"] = figure
    for name, words in files.items():
        parser.add_path(name, "FILE", words)
    words = "of the animation: 1 is real time, 0.25 (the default) four times slower"
    parser.add_number("--rate", words, 0.25, kind=float, least=0.001)
    words = "without --html show no animation"
    parser.add_argument("--headless", action="store_true", help=words)
    args = parser.parse_args(arguments)
    picture = getattr(args, "figure", None)
    check_files(args.html, figure=picture)
    return args


def check_files(*files: Path | None, figure: Path | None = None) -> None:
    """Raises InputError where a file cannot be written: before the work.

    Args:
        files: to be written; None is none.
        figure: one more, a picture in a format that Matplotlib writes.
    """
    for file in (*files, figure):
        if file is None:
            continue
        if file.is_dir() or not file.parent.is_dir():
            raise InputError(
                f"{file}: is a folder, or in none; expected the name of a file in a "
                "folder that exists."
            )
        check_writable(file.parent)
    if figure is not None:
        formats = sorted(FigureCanvasBase.get_supported_filetypes())
        good = figure.suffix.lower().removeprefix(".") in formats
        expected = f"one of {', '.join(formats)}"
        expect(good, f"{figure}: the format", figure.suffix, expected)


# --------------------------------------------------------------------- and after it


def plot_perches(
    ax: Axes,
    plan: Plan,
    flown: Iterable[FlownFlight],
    replayed: Iterable[FlownFlight] = (),
    color: str = "#0072B2",
) -> None:
    """Draws paths to the wire in the vertical plane, one scale on both axes.

    A ring shows the reach of the article's hook.

    Args:
        ax: to draw into.
        plan: that the flights follow.
        flown: flights with feedback.
        replayed: flights without.
        color: of the flights with feedback.
    """
    groups = (
        (replayed, "#D55E00", "without feedback"),
        (flown, color, "with feedback"),
    )
    for flights, shade, words in groups:
        paths = [flight.states[:, :2].T for flight in flights]
        for k, path in enumerate(paths):
            label = f"{len(paths)} flights {words}" if k == 0 else None
            ax.plot(*path, color=shade, lw=0.8, alpha=0.5, label=label)
    ax.plot(*plan.states[:, :2].T, color="k", lw=1.8, ls=(0, (4, 2)), label="plan")
    angle = np.linspace(0.0, 2.0 * np.pi, 60)
    reach = Hook().reach
    ring = reach * np.cos(angle), reach * np.sin(angle)
    ax.plot(*ring, color="k", lw=1.0, label=f"{100 * reach:.0f} cm of the wire")
    ax.set_aspect("equal", adjustable="datalim")
    ax.set(xlabel="x [m]", ylabel="z [m]")
    ax.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0), frameon=False)


def start_meshcat(args: argparse.Namespace) -> Meshcat | None:
    """Returns a Meshcat; None if it is not viewed (headless and no --html)."""
    return None if args.headless and not args.html else open_meshcat()


def finish(
    args: argparse.Namespace,
    meshcat: Meshcat | None,
    tracks: Sequence[Track] = (),
    title: str = "",
) -> None:
    """Writes the page of --html; without one, unless headless, a temporary one.

    Args:
        args: as of `read_options`.
        meshcat: of `start_meshcat`.
        tracks: for the legend of the page.
        title: of the page.
    """
    if meshcat is None:
        return
    page = page_of(meshcat, tracks, title, args.rate)
    if args.html:
        write_text(args.html, page)
        print(f"Animation: {args.html}")
        return
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder, "animation.html")
        write_text(file, page)
        print(f"Animation: {file.as_uri()} (Enter to end)", flush=True)
        sys.stdin.readline()


def show(
    args: argparse.Namespace,
    tracks: Sequence[Track],
    title: str,
    *,
    parameters: GliderParameters | None = None,
    has_wire: bool = True,
) -> None:
    """Plays tracks in Meshcat as the options say.

    Args:
        args: as of `read_options`.
        tracks: as in `play`; the first one's whole flight is in view.
        title: of the page.
        parameters: as in `play`.
        has_wire: whether the flights go to a wire.
    """
    meshcat = start_meshcat(args)
    if meshcat is not None:
        wire = (0.0, 0.0) if has_wire else None
        stage = stage_of(tracks[0], wire)
        play(tracks, meshcat, rate=args.rate, parameters=parameters, stage=stage)
    finish(args, meshcat, tracks, title)


def run(main: Callable[[], None]) -> int:
    """Runs a program and returns its exit code; a user's fault is one sentence."""
    warnings.showwarning = print_warning
    try:
        main()
    except InputError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    except OSError as error:
        print(f"error: {os_error_line(error)}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print(INTERRUPTED, file=sys.stderr)
        return INTERRUPTED_CODE
    return 0
