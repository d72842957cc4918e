"""Learning while perching: plan, execute with feedback, identify, plan again.

The true glider is not its nominal model. Each round plans a perch by iLQR with the
model of the day, flies it (launch speeds between 6.5 and 7.5 m/s are drawn, and
measured before the plan) and identifies the model from all flights so far, in two ways:

    weights   the article's: noisy states are differenced, and ridge regression finds
              26 weights each for what C_L, C_D and C_M lack, starting from zero
    traced    motion capture is traced to an effect of the library, or to a field of
              one variable where none explains it

and a planner that knows the truth says what there is to reach. The default truth is the
article's mismatch: 126 weights a coefficient, over airspeed too, which 26 cannot hold.

    python examples/article/learn_residual.py --figure learning.png
    python examples/article/learn_residual.py --truth attached_flow --headless

--json: {"rbf": {"terminal_cost", "weight_change", "miss_m"}, "traced":
{"terminal_cost", "miss_m", "effects"}, "oracle_miss_m", ..}, a number for each round.
The entry k is of the model that k rounds, of "launches" flights each, had taught: the
first is of the nominal model. The cost is of the round's first flight, ½ (x - goal)ᵀ Qf
(x - goal) at the plan's end; the miss is the median over five launches, the same in
each round.
"""

import sys
from collections.abc import Sequence
from typing import Any

import learning
from diagrams import playback, program
from glider.physics.model import GliderModel
from learning_figures import save_learning_study
from learning_study import LearningStudy, learn_from_seed


def run(
    truth: GliderModel, weights: int = 20, traced: int = 4, **options: Any
) -> LearningStudy:
    """Learns in both ways beside the oracle; the options are of `learn_from_seed`."""
    oracle = learn_from_seed(truth, learning.knowing(truth), 2, **options)
    return LearningStudy(
        oracle=oracle[-1].miss,
        weights=learn_from_seed(truth, learning.fit_weights, weights, **options),
        traced=learn_from_seed(truth, learning.trace_effects, traced, **options),
    )


def main(arguments: Sequence[str] | None = None) -> None:
    """Learns as the command line says, prints and shows the result."""
    parser = program.make_parser(__doc__)
    program.add_truth(parser, "low_reynolds")
    for name, count in (("weights", 20), ("traced", 4)):
        words = f"rounds of the {name} loop (default: %(default)s)"
        program.add_count(parser, f"--{name}", count, words, least=2)
    words = "of the planner's steps; 1 is Euler, the article's (default: 4)"
    parser.add_argument("--order", type=int, choices=(1, 4), default=4, help=words)
    program.add_launches(parser, 3)
    args = program.read_options(parser, arguments, figure="as PNG")
    truth, settings = (
        program.load_truth(args.truth),
        learning.learning_settings(args.order),
    )
    options = {"launches": args.launches, "seed": args.seed, "settings": settings}
    with program.working("compile (once)") as progress:
        found = run(truth, args.weights, args.traced, progress=progress, **options)
    print(found.describe())
    asked = {name: getattr(args, name) for name in ("truth", "order", "seed")}
    program.write_json(args, found.key_figures() | asked)
    program.write_figure(args, save_learning_study, found)
    tracks = [
        playback.track_of("traced - last round", found.traced[-1].flights[0]),
        playback.track_of(
            "weights - last round", found.weights[-1].flights[0], playback.GREY
        ),
        playback.track_of(
            "nominal - first round", found.weights[0].flights[0], playback.RED
        ),
    ]
    program.show(args, tracks, f"Learning: {args.truth}", parameters=truth.parameters)


if __name__ == "__main__":
    sys.exit(program.run(main))
