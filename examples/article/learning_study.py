"""A study of the loop of learning: taught in two ways, beside one who knows."""

import dataclasses
import itertools
from collections.abc import Sequence
from typing import Any

import numpy as np

from glider.physics.effects.field import COEFFICIENTS
from glider.physics.model import GliderModel
from learning import Identify, Round, learn


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
    if model.field is None:
        return np.zeros(1)
    return np.array([model.field.weights[name] for name in COEFFICIENTS])
