"""The article's searches: CEM and MPPI draw command sequences, from many seeds."""

import dataclasses
from collections.abc import Callable

import numpy as np

from glider.paths import models_path
from glider.physics.model import GliderModel
from glider.physics.parameters import load_parameters
from glider.planning.problem import load_problem
from glider.planning.sampling import (
    Search,
    SequenceCost,
    cem,
    flights_per_second,
    mppi,
)
from glider.systems.plant import GliderPlant

METHODS: dict[str, Callable[..., Search]] = {"CEM": cem, "MPPI": mppi}

KEPT = (1, 10, 30, 100)
"""Iterations whose sequences are kept."""

TOLD = (30, 100)
"""Iterations whose costs are described."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Searches:
    """What the searches of each method found."""

    cost: SequenceCost
    """What they minimize."""

    start: np.ndarray
    """(n,) state at launch."""

    found: dict[str, list[Search]]
    """One for each seed, by method."""

    flights_per_second: float
    """How many sampled flights one core flies and weighs."""

    @property
    def costs(self) -> dict[str, np.ndarray]:
        """Cost of each seed and iteration by method, (seeds, iterations + 1)."""
        return {
            name: np.array([search.costs for search in searches])
            for name, searches in self.found.items()
        }

    def fly(self, commands: np.ndarray) -> np.ndarray:
        """Returns states (B, N + 1, n) of command sequences (B, N) [rad/s]."""
        return self.cost.fly(self.start, commands)

    def key_figures(self) -> dict[str, object]:
        """Returns the speed and the costs of each method, for a file."""
        spreads = {name.lower(): spread(runs) for name, runs in self.costs.items()}
        return {"rollouts_per_second": self.flights_per_second, **spreads}

    def describe(self) -> str:
        """Returns a line for each method, and the speed."""
        lines = []
        for name, runs in self.costs.items():
            early, late = (runs[:, k] for k in TOLD)
            lines.append(
                f"{name}: cost {np.median(early):.0f} after {TOLD[0]} iterations and "
                f"{np.median(late):.1f} ({late.min():.1f} to {late.max():.1f}) after "
                f"{TOLD[1]}; {len(runs)} seeds"
            )
        speed = f"{self.flights_per_second:,.0f} sampled flights a second on one core"
        return "\n".join([*lines, speed])


def search_all(
    count: int, seed: int = 0, progress: Callable[[str], None] | None = None
) -> Searches:
    """Searches by each method from some seeds, the same for all methods.

    The glider is vehicles/heavy.yaml of the models, the problem problems/sampling.yaml.

    Args:
        count: searches of each method.
        seed: that their seeds come from.
        progress: told which method is at work.
    """
    heavy = load_parameters(models_path("vehicles", "heavy.yaml"))
    problem = load_problem(models_path("problems", "sampling.yaml"))
    cost = SequenceCost(GliderPlant(GliderModel(parameters=heavy)), problem)
    start = np.array(problem.launch)
    speed, found = flights_per_second(cost, start), {}
    for name, search in METHODS.items():
        if progress:
            progress(f"plan by {name}")
        rngs = np.random.default_rng(seed).spawn(count)
        found[name] = [search(cost, start, rng, keep=KEPT) for rng in rngs]
    return Searches(cost=cost, start=start, found=found, flights_per_second=speed)


def spread(runs: np.ndarray) -> dict[str, list[float]]:
    """Returns the median, the least and the largest cost of each iteration."""
    return {
        "cost": np.median(runs, axis=0).tolist(),
        "lowest": np.min(runs, axis=0).tolist(),
        "highest": np.max(runs, axis=0).tolist(),
    }
