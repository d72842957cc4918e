"""Learning while perching: plan, execute with feedback, identify, plan again.

The true glider is not its nominal model. Each round plans a perch by iLQR with the
model of the day, flies it (launch speeds between 6.5 and 7.5 m/s are drawn, and
measured before the plan) and identifies the model from all flights so far, in two ways:

    weights   the article's: noisy states are differenced, and ridge regression finds
              26 weights each for what C_L, C_D and C_M lack, starting from zero
    traced    motion capture is traced to an effect of the library, or to a free
              function where none explains it

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

import dataclasses
import itertools
import sys
from collections.abc import Sequence
from typing import Any

import numpy as np

import learning
from diagrams import playback
from diagrams.programs import program
from glider.physics.effects.free_functions import COEFFICIENTS
from glider.physics.model import GliderModel
from learning import Identify, Round, learn
from learning_figures import save_learning_figure


@dataclasses.dataclass(frozen=True, kw_only=True)
class LearningStudy:
    """The same launches planned with what each way of learning had taught by then."""

    oracle: float
    """Median miss of a planner that knows the truth [m]."""

    weights: list[Round]
    """Rounds that give the model 26 weights a coefficient."""

    traced: list[Round]
    """Rounds that give it the effects that logs are traced to."""

    @property
    def launches(self) -> int:
        """Number of flights in a round."""
        return len(self.weights[0].flights)

    def key_figures(self) -> dict[str, object]:
        """Returns numbers of each round, for a file."""
        changes = {"weight_change": weight_changes(self.weights)}
        effects = {"effects": [list(r.identified.effects) for r in self.traced]}
        return {
            "rbf": summary(self.weights) | changes,
            "traced": summary(self.traced) | effects,
            "oracle_miss_m": self.oracle,
            "launches": self.launches,
        }

    def describe(self) -> str:
        """Returns the misses of each round, and what was found."""
        oracle = 1000 * self.oracle
        lines = [f"Planned with the truth, the median miss is {oracle:.1f} mm."]
        for name, rounds in (("rbf", self.weights), ("traced", self.traced)):
            misses = ", ".join(f"{1000 * turn.miss:.1f}" for turn in rounds)
            lines.append(f"{name}, after 0, {self.launches}, .. flights: {misses} mm")
        found = [", ".join(r.identified.effects) or "nothing" for r in self.traced]
        return "\n".join([*lines, f"traced to {'; '.join(found[1:])}"])


def learn_from_seed(
    truth: GliderModel, identify: Identify, rounds: int, seed: int = 0, **options: Any
) -> list[Round]:
    """Runs the loop: from one seed, all that identify get the same launches and noise.

    Args:
        truth: as in `learn`, like what is not named here.
        identify: as in `learn`.
        rounds: as in `learn`.
        seed: of the launches and the noise.
        **options: as in `learn`.
    """
    return learn(truth, identify, rounds, np.random.default_rng(seed), **options)


def summary(rounds: Sequence[Round]) -> dict[str, list[float]]:
    """Returns the terminal cost and the median miss [m] of each round."""
    return {
        "terminal_cost": [r.terminal_cost for r in rounds],
        "miss_m": [r.miss for r in rounds],
    }


def weight_changes(rounds: Sequence[Round]) -> list[float]:
    """Returns ‖w_j+1 - w_j‖ between the models of successive rounds.

    A model without weights counts as one whose weights are zero.
    """
    weights = [_weights(r.identified.model) for r in rounds]
    return [
        float(np.linalg.norm(after - before))
        for before, after in itertools.pairwise(weights)
    ]


def _weights(model: GliderModel) -> np.ndarray:
    if not model.free_functions:
        return np.zeros(1)
    [residual] = model.free_functions
    return np.array([residual.weights[name] for name in COEFFICIENTS])


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
        GliderModel.load(args.truth),
        learning.learning_settings(args.order),
    )
    options = {"launches": args.launches, "seed": args.seed, "settings": settings}
    with program.working("compile (once)") as progress:
        found = run(truth, args.weights, args.traced, progress=progress, **options)
    print(found.describe())
    asked = {name: getattr(args, name) for name in ("truth", "order", "seed")}
    program.write_json(args, found.key_figures() | asked)
    paths = [turn.flights[0].states for turn in found.weights]
    program.write_figure(args, save_learning_figure, paths, found.key_figures())
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
