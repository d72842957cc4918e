"""Learning while perching: plan, execute with feedback, identify, plan again.

The true glider is not what its drawing says. Each round plans a perch by iLQR with the
model of the day, flies it (launch speeds between 6.5 and 7.5 m/s are drawn, and
measured before the plan) and identifies the model from all flights so far, in two ways:

    weights   the article's: noisy states are differenced, and ridge regression finds
              26 weights each for what C_L, C_D and C_M lack, starting from zero
    traced    motion capture is traced to an effect of the library, or to a field of
              one variable where none explains it

and a planner that knows the truth says what there is to reach. The default truth is the
article's mismatch: 126 weights a coefficient, over airspeed too, which 26 cannot hold.

    python examples/learn_residual.py --figure learning.png
    python examples/learn_residual.py --truth attached_flow --headless --json out.json

--json: {"rbf": {"terminal_cost", "weight_change", "miss_m"}, "traced":
{"terminal_cost", "miss_m", "effects"}, "oracle_miss_m", ..}, a number for each round.
The entry k is of the model that k rounds, of "launches" flights each, had taught: the
first is of the drawing. The cost is of the round's first flight, ½ (x - goal)ᵀ Qf
(x - goal) at the plan's end; the miss is the median over five launches, the same in
each round.
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
from diagrams.tracks import flight_track
from glider.studies import learning
from glider.studies.plots.learning import save_learning_figure


def main(arguments: Sequence[str] | None = None) -> None:
    """Reads the command line, runs the loops, prints and shows what came out."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    add_truth(parser, "low_reynolds")
    for name, count in (("weights", 20), ("traced", 4)):
        words = f"rounds of the {name} loop (default: %(default)s)"
        parser.add_argument(
            f"--{name}", type=whole_number(2), default=count, help=words
        )
    order_help = "of the planner's steps; 1 is Euler, the article's (default: 4)"
    parser.add_argument("--order", type=int, choices=(1, 4), default=4, help=order_help)
    parser.add_argument("--figure", metavar="FILE", type=Path, help="as PNG")
    add_launches(parser, 3)
    add_options(parser)
    args = parser.parse_args(arguments)
    check_folders(args.json, args.html, args.figure)
    truth = load_truth(args.truth)

    def loop(identify: learning.Identify, rounds: int) -> list[learning.Round]:
        return learning.learn(
            truth,
            identify,
            rounds,
            np.random.default_rng(args.seed),  # The same launches and noise for all.
            launches=args.launches,
            settings=learning.learning_settings(args.order),
            progress=status.update,
        )

    with Console(stderr=True).status("compile (once)") as status:
        oracle = loop(learning.knowing(truth), 2)[1].miss
        weights = loop(learning.fit_weights, args.weights)
        traced = loop(learning.trace_effects, args.traced)

    figures: dict = {"rbf": learning.summary(weights)}
    figures["rbf"]["weight_change"] = learning.weight_changes(weights)
    figures["traced"] = learning.summary(traced)
    figures["traced"]["effects"] = [list(r.identified.effects) for r in traced]
    figures["oracle_miss_m"] = oracle
    figures |= {k: getattr(args, k) for k in ("truth", "launches", "order", "seed")}
    print(f"Planned with the truth, the median miss is {1000 * oracle:.1f} mm.")
    for name in ("rbf", "traced"):
        words = ", ".join(f"{1000 * m:.1f}" for m in figures[name]["miss_m"])
        print(f"{name}, after 0, {args.launches}, .. flights: {words} mm")
    effects = [", ".join(names) or "nothing" for names in figures["traced"]["effects"]]
    print(f"traced to {'; '.join(effects[1:])}")
    write_figures(args, figures)
    if args.figure:
        paths = [turn.flights[0].states for turn in weights]
        save_learning_figure(args.figure, paths, figures)
    tracks = [
        flight_track("traced - last round", traced[-1].flights[0]),
        flight_track("weights - last round", weights[-1].flights[0], GREY),
        flight_track("planned with the drawing", weights[0].flights[0], RED),
    ]
    show(args, tracks, f"Learning: {args.truth}", parameters=truth.parameters)


if __name__ == "__main__":
    sys.exit(run(main))
