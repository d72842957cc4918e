"""Which launches can perch at all?

The article's glider is launched 3.5 m before the wire, anywhere within 0.8 m of its
height, with 4.5 to 9.5 m/s, the nose up or down by up to 0.4 rad. For each launch there
is either a plan that keeps all limits, or the flight that keeps all but the place at
the end and comes nearest to the wire. All processors work on it.

    python examples/launch_map.py --figure map.png
    python examples/launch_map.py --launches 500 --json map.json
"""

import sys
from collections.abc import Sequence

import joblib
import numpy as np

from diagrams import showing
from glider.physics.model import GliderModel
from glider.planning.problem import PerchingProblem
from glider.planning.reach import Reach, find_reach
from glider.studies.plots.reach import save_reach_figure

HEIGHT, SPEED, PITCH = (-0.8, 0.8), (4.5, 9.5), (-0.4, 0.4)


def run(
    launches: int = 10_000, seed: int = 0, progress: showing.Progress = showing.silent
) -> Reach:
    """Draws launches, all as probable, and plans from each."""
    rng, model, problem = np.random.default_rng(seed), GliderModel(), PerchingProblem()
    starts = np.tile(problem.launch, (launches, 1))
    for column, limits in ((1, HEIGHT), (4, SPEED), (2, PITCH)):
        starts[:, column] = rng.uniform(*limits, launches)
    find_reach(model, problem, starts[:1])  # Compiles, once for all workers.
    with joblib.parallel_config(n_jobs=-1):
        return find_reach(model, problem, starts, progress)


def main(arguments: Sequence[str] | None = None) -> None:
    """Plans as the command line says, prints and draws what came out."""
    parser = showing.make_parser(__doc__)
    showing.add_launches(parser, 10_000)
    showing.add_file(parser, "--json", "launches and answers")
    showing.add_file(parser, "--figure", "the map")
    parser.add_argument("--headless", action="store_true", help="there is no animation")
    args = parser.parse_args(arguments)
    showing.check_files(args.json, figure=args.figure)
    with showing.working("plan (compiles once)") as progress:
        found = run(args.launches, args.seed, progress)
    print(found.describe())
    showing.write_json(args, found.key_figures() | {"seed": args.seed})
    showing.write_figure(args, save_reach_figure, found)


if __name__ == "__main__":
    sys.exit(showing.run(main))
