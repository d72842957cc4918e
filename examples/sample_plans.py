"""Plans without gradients: draw command sequences, fly them, keep what is cheap.

The cross-entropy method (CEM) fits a normal distribution to the cheapest third of 30
sequences; MPPI moves its mean by all of them, weighted by exp(-cost / temperature).
Both get 100 iterations at the article's problem, from several seeds.

Then canonical MPPI flies: 50 times a second it plans anew from the measured state,
with the drawn glider for its model. The glider that flies has an effect which the
drawing lacks; the same plan replayed, and LQR along it, show what planning anew buys.

    python examples/sample_plans.py
    python examples/sample_plans.py --truth attached_flow --headless --figure s.png
"""

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from rich.console import Console

from diagrams.playback import (
    GREY,
    RED,
)
from diagrams.showing import (
    add_launches,
    add_options,
    add_truth,
    check_folders,
    run,
    show,
    whole_number,
    write_figures,
)
from diagrams.studies.rehearsal import load_truth
from diagrams.studies.sampled import (
    compare,
    save_sampled_figure,
    search_plans,
    spread,
)
from diagrams.tracks import (
    flight_track,
    plan_track,
)
from glider.paths import models_path
from glider.physics.model import GliderModel
from glider.physics.parameters import load_parameters
from glider.planning.problem import load_problem
from glider.planning.sampling import (
    SequenceCost,
    flights_per_second,
)
from glider.simulation.monte_carlo import (
    LaunchSpread,
    draw_launches,
)

SHOWN = (1, 10, 30, 100)  # Iterations whose sampled flights the figure shows.


def main(arguments: Sequence[str] | None = None) -> None:
    """Reads the command line, searches, flies, prints and shows what came out."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    add_truth(parser, "set_wing")
    parser.add_argument(
        "--searches",
        metavar="N",
        type=whole_number(1),
        default=20,
        help="of each method, each with a seed of its own (default: %(default)s)",
    )
    add_launches(parser, 20)
    parser.add_argument("--figure", metavar="FILE", type=Path, help="costs and paths")
    add_options(parser)
    args = parser.parse_args(arguments)
    check_folders(args.json, args.html, args.figure)

    truth, rng = load_truth(args.truth), np.random.default_rng(args.seed)
    heavy = load_parameters(models_path("vehicles", "heavy.yaml"))
    problems = {
        name: load_problem(models_path("problems", f"{name}.yaml"))
        for name in ("sampling", "perching", "replanning")
    }
    launch = np.array(problems["sampling"].launch)
    starts = draw_launches(problems["perching"], LaunchSpread(), args.launches, rng)
    with Console(stderr=True).status("compile (once)") as status:
        cost = SequenceCost(GliderModel(parameters=heavy), problems["sampling"])
        speed = flights_per_second(cost, launch)
        found = search_plans(
            cost, launch, args.searches, args.seed, SHOWN, status.update
        )
        flown = compare(
            truth,
            GliderModel(parameters=truth.parameters),
            problems["perching"],
            problems["replanning"],
            starts,
            seed=args.seed,
            progress=status.update,
        )

    figures: dict = {
        "receding": {"truth": args.truth, **flown.key_figures()},
        "rollouts_per_second": speed,
        "seed": args.seed,
    }
    for name, runs in found.histories().items():
        figures[name.lower()] = costs = spread(runs)
        print(
            f"{name}: cost {costs['cost'][30]:.0f} after 30 iterations and "
            f"{costs['cost'][100]:.1f} ({costs['lowest'][100]:.1f} to "
            f"{costs['highest'][100]:.1f}) after 100; {len(runs)} seeds"
        )
    print(f"{speed:,.0f} sampled flights a second on one core")
    for name, flights in flown.policies.items():
        print(
            f"{args.truth}, {name}: {sum(f.perched for f in flights)} of "
            f"{len(flights)} perch, "
            f"median miss {1000 * np.median([f.miss for f in flights]):.1f} mm"
        )
    print(f"MPPI needs 1 s of one core for {flown.real_time_factor:.1f} s of flight.")
    write_figures(args, figures)
    if args.figure:
        save_sampled_figure(args.figure, cost, launch, found, flown)
    worst = max(flown.replanned, key=lambda flight: flight.miss)
    tracks = [
        flight_track("planned anew", worst),
        flight_track("replayed", flown.replayed[0], RED),
        plan_track("plan of the drawing", flown.plan, GREY),
    ]
    show(args, tracks, f"MPPI: {args.truth}")


if __name__ == "__main__":
    sys.exit(run(main))
