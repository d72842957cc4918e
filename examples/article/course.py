"""What all lessons share: their options, the table that they end with, and pictures.

A lesson begins with ARTICLE, the figures and numbers of the article that it reproduces,
and its `main` returns our own under the same names. `python -m benchmarks.tables
article` writes them beside each other into docs/article.md.
"""

import contextlib
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from diagrams.programs import program
from glider import GliderModel
from glider.planning.problem import Hook
from glider.report.plots.style import STYLE

SHOWN = "figure"
"""What stands in the table where the article has a figure, and so does a lesson."""


def read_options(words: str | None, arguments: Sequence[str] | None) -> Path | None:
    """Reads the command line of a lesson; returns the picture to write, if any."""
    parser = program.make_parser(words)
    parser.add_path("--figure", "FILE", "picture to write, for example lesson.png")
    args = parser.parse_args(arguments)
    program.check_files(figure=args.figure)
    return args.figure


def compare(article: Mapping[str, str], *ours: str) -> dict[str, str]:
    """Prints the article's numbers beside ours, given in their order; returns ours."""
    rows = [("", "article", "ours")]
    rows += [(*item, own) for item, own in zip(article.items(), ours, strict=True)]
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    for row in rows:
        cells = [cell.ljust(width) for cell, width in zip(row, widths, strict=True)]
        print("  ".join(cells).rstrip())
    return dict(zip(article, ours, strict=True))


def rates_of(
    model: GliderModel, states: np.ndarray, commands: np.ndarray
) -> np.ndarray:
    """Returns ẋ (7, N) of states (7, N) under elevator rates (N,), in still air.

    Each plate with normal n and velocity v through the air is pushed by
    f = -ρ S (n·v) |v| along n; `glider/physics/chain.py` has the rest.
    """
    time, wind_x, wind_z = 0.0, 0.0, 0.0
    rates = model.chain.derivatives(
        time, states, commands, wind_x, wind_z, model.numbers
    )
    return np.array(np.broadcast_arrays(*rates))


def start(main: Callable[[], object]) -> None:
    """Runs a lesson from the command line; a user's fault is one sentence."""
    sys.exit(program.run(main))


@contextlib.contextmanager
def picture(path: Path, width: float, height: float) -> Iterator[Figure]:
    """Yields an empty figure of a size [inch], and saves what is drawn into it."""
    with rc_context(STYLE):
        figure = Figure(figsize=(width, height), layout="constrained")
        yield figure
        figure.savefig(path, dpi=100)


def draw_attitudes(
    ax: Axes, states: np.ndarray, every: int = 5, color: str = "k"
) -> None:
    """Draws a flight (N, 7) as a line, with bars that show how the glider points.

    Their angles are true on the page, whatever the scales of the axes.
    """
    ax.plot(*states[:, :2].T, color=color, lw=0.8)
    x, z, pitch = states[::every, :3].T
    look = {"headwidth": 0.0, "headlength": 0.0, "headaxislength": 0.0, "width": 0.003}
    nose = np.cos(pitch), -np.sin(pitch)
    length = {"scale": 4.0, "scale_units": "inches"}  # Four bars fill an inch.
    ax.quiver(x, z, *nose, pivot="middle", color=color, **look, **length)


def draw_wire(ax: Axes) -> None:
    """Draws the wire as a ring: within it, a hook at the glider reaches the wire."""
    angle = np.linspace(0.0, 2.0 * np.pi, 60)
    reach = Hook().reach
    ax.plot(reach * np.cos(angle), reach * np.sin(angle), color="k", lw=1.0)
    ax.set(xlabel="x [m]", ylabel="z [m]")


def legend_beside(ax: Axes) -> None:
    """Puts the legend to the right of the axes, where it covers nothing."""
    ax.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0), borderaxespad=0.0)
