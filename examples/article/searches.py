"""The article's searches: CEM and MPPI draw command sequences, from many seeds."""

import dataclasses
import math
import time
from collections.abc import Callable, Sequence

import numpy as np

from glider.paths import models_path
from glider.physics.model import GliderModel
from glider.physics.parameters import load_parameters
from glider.planning.plan import Plan
from glider.planning.problem import PerchingProblem
from glider.planning.sampling import SequenceCost
from sampling_planners import cem, mppi

Progress = Callable[[str], None]

SHOWN = (1, 10, 30, 100)
"""Iterations whose sequences are kept."""

REPORTED = (30, 100)
"""Iterations whose costs are described."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Searches:
    """Searches by each method: what all found, and what the first of each drew."""

    cost: SequenceCost
    """Cost that they minimize."""

    start: np.ndarray
    """State (n,) at launch."""

    plans: dict[str, list[Plan]]
    """Plans by method, one a seed."""

    drawn: dict[str, dict[int, np.ndarray]]
    """Sequences (B, N) [rad/s] by method and number of the iteration, from 1."""

    flights_per_second: float
    """Number of sampled flights that one core flies and weighs in a second."""

    def histories(self) -> dict[str, np.ndarray]:
        """Returns the costs by each method, (seeds, iterations + 1)."""
        return {
            name: np.array([plan.costs for plan in plans])
            for name, plans in self.plans.items()
        }

    def fly(self, commands: np.ndarray) -> np.ndarray:
        """Returns states (B, N + 1, n) of command sequences (B, N) [rad/s]."""
        return self.cost.fly(self.start, commands)

    def key_figures(self) -> dict[str, object]:
        """Returns the speed and the costs of each method, for a file."""
        spreads = {
            name.lower(): spread(runs) for name, runs in self.histories().items()
        }
        return {"rollouts_per_second": self.flights_per_second, **spreads}

    def describe(self) -> str:
        """Returns a line for each method, and the speed."""
        lines = []
        for name, runs in self.histories().items():
            early, late = (runs[:, k] for k in REPORTED)
            lines.append(
                f"{name}: cost {np.median(early):.0f} after {REPORTED[0]} iterations "
                f"and {np.median(late):.1f} ({late.min():.1f} to {late.max():.1f}) "
                f"after {REPORTED[1]}; {len(runs)} seeds"
            )
        speed = f"{self.flights_per_second:,.0f} sampled flights a second on one core"
        return "\n".join([*lines, speed])


def search_article(
    count: int, seed: int = 0, progress: Progress | None = None
) -> Searches:
    """Searches for the article's plan: vehicles/heavy and problems/sampling."""
    heavy = load_parameters(models_path("vehicles", "heavy.yaml"))
    problem = PerchingProblem.load(models_path("problems", "sampling.yaml"))
    cost = SequenceCost(GliderModel(parameters=heavy), problem)
    return search_plans(cost, np.array(problem.launch), count, seed, progress=progress)


def search_plans(
    cost: SequenceCost,
    start: np.ndarray,
    count: int,
    seed: int,
    shown: Sequence[int] = SHOWN,
    progress: Progress | None = None,
) -> Searches:
    """Searches for plans by CEM and by MPPI.

    Args:
        cost: to search with.
        start: (n,) state at launch.
        count: searches by each method, each with a seed of its own.
        seed: of these seeds; both methods get the same.
        shown: iterations, from 1, whose sequences to keep.
        progress: called with a line of text as the work goes on.
    """
    speed = flights_per_second(cost, start)
    plans: dict[str, list[Plan]] = {}
    drawn: dict[str, dict[int, np.ndarray]] = {}
    for name, search in (("CEM", cem), ("MPPI", mppi)):
        if progress:
            progress(f"plan by {name}")
        kept: dict[int, np.ndarray] = {}

        def keep(iteration, commands, kept=kept):
            if iteration in shown:
                kept.setdefault(iteration, commands)

        rngs = np.random.default_rng(seed).spawn(count)
        plans[name] = [search(cost, start, rng, watch=keep) for rng in rngs]
        drawn[name] = kept
    return Searches(
        cost=cost, start=start, plans=plans, drawn=drawn, flights_per_second=speed
    )


def spread(runs: np.ndarray) -> dict[str, list[float]]:
    """Returns the median, the least and the largest cost of each iteration."""
    return {
        "cost": np.median(runs, axis=0).tolist(),
        "lowest": np.min(runs, axis=0).tolist(),
        "highest": np.max(runs, axis=0).tolist(),
    }


def flights_per_second(
    cost: SequenceCost, start: np.ndarray, batch: int = 10_000, rounds: int = 5
) -> float:
    """Measures how many flights, with their costs, one core makes in a second."""
    commands = np.zeros((batch, cost.steps))
    cost.to_go(start, commands)
    best = math.inf
    for _ in range(rounds):
        begin = time.perf_counter()
        cost.to_go(start, commands)
        best = min(best, time.perf_counter() - begin)
    return batch / best
