"""Which launches can perch at all?

The article's glider is launched 3.5 m before the wire, anywhere within 0.8 m of its
height, with 4.5 to 9.5 m/s, the nose up or down by up to 0.4 rad. For each launch our
own solver looks for a plan that keeps all limits. All processors work on it.

    python examples/launch_map.py --figure map.png
    python examples/launch_map.py --launches 500 --json map.json
"""

import dataclasses
import sys
import time
from collections.abc import Sequence
from pathlib import Path

import joblib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import QuadMesh
from matplotlib.figure import Figure

from diagrams.programs import program
from glider import GliderModel, PerchingProblem, reach

HEIGHT, SPEED, PITCH = (-0.8, 0.8), (4.5, 9.5), (-0.4, 0.4)

CELLS = 24
"""Number of cells of the map along each axis, at most."""

COLUMNS = {"z": 1, "pitch": 2, "xdot": 4}
"""Columns of a launch state."""

LABELS = {
    "xdot": "launch speed [m/s]",
    "z": "height [m]",
    "pitch": "pitch, nose down [rad]",
}


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class LaunchMap:
    """Launches, and whether each has a plan."""

    launches: np.ndarray
    """(B, 7) states at release."""

    planned: np.ndarray
    """(B,) whether there is a plan."""

    seconds: float
    """Time that it took [s]."""

    def describe(self) -> str:
        """Describes the number that can perch."""
        count = len(self.planned)
        return (
            f"{np.sum(self.planned):,} of {count:,} launches have a plan to the wire "
            f"({self.seconds:.0f} s, {1e3 * self.seconds / count:.1f} ms each)."
        )

    def key_figures(self) -> dict[str, object]:
        """Returns launches and answers, for a file."""
        return {
            "launches": self.launches.tolist(),
            "planned": self.planned.tolist(),
            "seconds": self.seconds,
        }


def run(
    launches: int = 10_000, seed: int = 0, progress: program.Progress = program.silent
) -> LaunchMap:
    """Draws launches from a uniform distribution, and plans from each."""
    rng, model, problem = np.random.default_rng(seed), GliderModel(), PerchingProblem()
    starts = np.tile(problem.launch, (launches, 1))
    for name, limits in (("z", HEIGHT), ("xdot", SPEED), ("pitch", PITCH)):
        starts[:, COLUMNS[name]] = rng.uniform(*limits, launches)
    reach.find_reach(model, problem, starts[:1])  # Compiles, once for all workers.
    begin = time.perf_counter()
    with joblib.parallel_config(n_jobs=-1):
        planned = reach.find_reach(model, problem, starts, progress)
    seconds = time.perf_counter() - begin
    return LaunchMap(launches=starts, planned=planned, seconds=seconds)


def plot_share(ax: Axes, found: LaunchMap, across: str, along: str) -> QuadMesh:
    """Draws the share of launches with a plan over two of their states.

    Args:
        ax: to draw into.
        found: the launches.
        across, along: names of states.
    """
    cells = int(np.clip(np.sqrt(len(found.planned) / 12), 4, CELLS))
    x, y = (found.launches[:, COLUMNS[name]] for name in (across, along))
    total, *edges = np.histogram2d(x, y, cells)
    planned, *_ = np.histogram2d(x[found.planned], y[found.planned], edges)
    share = np.where(total > 0, planned / np.maximum(total, 1), np.nan)
    mesh = ax.pcolormesh(*edges, share.T, vmin=0.0, vmax=1.0, cmap="viridis")
    ax.set(xlabel=LABELS[across], ylabel=LABELS[along])
    return mesh


def save_map(path: Path, found: LaunchMap) -> None:
    """Draws the map over speed and height, and over speed and pitch."""
    figure = Figure(figsize=(8.0, 3.2), layout="constrained")
    by_height, by_pitch = figure.subplots(1, 2)
    plot_share(by_height, found, "xdot", "z")
    mesh = plot_share(by_pitch, found, "xdot", "pitch")
    figure.colorbar(mesh, ax=by_pitch, label="share of launches with a plan")
    figure.savefig(path)


def main(arguments: Sequence[str] | None = None) -> None:
    """Plans as the command line says, prints and draws the result."""
    parser = program.make_parser(__doc__)
    program.add_launches(parser, 10_000)
    program.add_file(parser, "--json", "launches and answers")
    program.add_file(parser, "--figure", "the map")
    parser.add_argument("--headless", action="store_true", help="there is no animation")
    args = parser.parse_args(arguments)
    program.check_files(args.json, figure=args.figure)
    with program.working("plan (compiles once)") as progress:
        found = run(args.launches, args.seed, progress)
    print(found.describe())
    program.write_json(args, found.key_figures() | {"seed": args.seed})
    program.write_figure(args, save_map, found)


if __name__ == "__main__":
    sys.exit(program.run(main))
