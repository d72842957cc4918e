"""Plans without gradients: draw command sequences, fly them, keep what is cheap.

The cross-entropy method (CEM) fits a normal distribution to the cheapest third of 30
sequences; MPPI moves its mean by all of them, weighted by exp(-cost / temperature).
Both get 100 iterations at the article's problem, from several seeds.

Then canonical MPPI flies: 50 times a second it replans from the measured state, with
the nominal model. The glider that flies has an effect which the nominal model lacks;
the same plan replayed, and LQR along it, show what replanning is worth.

    python examples/article/sample_plans.py
    python examples/article/sample_plans.py --truth attached_flow --figure s.png
"""

import dataclasses
import sys
from collections.abc import Sequence

import numpy as np

from diagrams import playback
from diagrams.programs import program
from glider.physics.model import GliderModel
from glider.planning.problem import PerchingProblem
from sampled import Comparison, compare
from sampling_figures import save_searches_figure
from searches import Searches, search_article


@dataclasses.dataclass(frozen=True, kw_only=True)
class Result:
    """What searches found, and what replanning in flight is worth."""

    searches: Searches
    flown: Comparison


def fly(
    truth: GliderModel,
    searches: int = 20,
    launches: int = 20,
    seed: int = 0,
    progress: program.Progress = program.silent,
) -> Result:
    """Searches from many seeds; then flies a plan, and replans in flight."""
    problem, rng = PerchingProblem(), np.random.default_rng(seed)
    starts = problem.draw_launches(launches, rng)
    found = search_article(searches, seed, progress)
    flown = compare(truth, problem, starts, seed=seed, progress=progress)
    return Result(searches=found, flown=flown)


def main(arguments: Sequence[str] | None = None) -> None:
    """Flies as the command line says, prints and shows the result."""
    parser = program.make_parser(__doc__)
    program.add_truth(parser, "set_wing")
    words = "of each method, each with a seed of its own (default: %(default)s)"
    program.add_count(parser, "--searches", 20, words, metavar="N")
    program.add_launches(parser, 20)
    args = program.read_options(parser, arguments, figure="costs and paths")
    truth = GliderModel.load(args.truth)
    with program.working("compile (once)") as progress:
        found = fly(truth, args.searches, args.launches, args.seed, progress)
    print(f"{found.searches.describe()}\n{found.flown.describe(args.truth)}")
    figures = {"receding": found.flown.key_figures(args.truth), "seed": args.seed}
    program.write_json(args, figures | found.searches.key_figures())
    program.write_figure(args, save_searches_figure, found.searches, found.flown)
    tracks = [
        playback.track_of("replanned", found.flown.replanned.worst),
        playback.track_of("replayed", found.flown.replayed[0], playback.RED),
        playback.track_of("plan of the nominal model", found.flown.plan, playback.GREY),
    ]
    program.show(args, tracks, f"MPPI: {args.truth}")


if __name__ == "__main__":
    sys.exit(program.run(main))
