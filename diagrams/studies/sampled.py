"""Searches that sample, and a controller that does, against a plan replayed."""

import dataclasses
import time
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from diagrams.closed_loop import closed_loop
from diagrams.open_loop import open_loop
from diagrams.simulate import (
    SimulatedFlight,
    simulate_flights,
)
from diagrams.studies.rehearsal import COMMAND_RATE
from glider.control.mppi import (
    MppiController,
    replanning_cost,
    sequence_of,
)
from glider.control.tvlqr_drake import tracking_regulator
from glider.physics.model import GliderModel
from glider.planning.dircol import (
    Progress,
    plan,
)
from glider.planning.plan import Plan
from glider.planning.problem import PerchingProblem
from glider.planning.sampling import (
    Search,
    SequenceCost,
)
from glider.studies.plots.sampling import save_sampling_figure
from glider.systems.plant import GliderPlant

AFTER = 0.2
"""How long a flight goes on after the plan's end [s]: who plans anew may come later
than the plan."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Comparison:
    """The same launches of one glider under three policies."""

    plan: Plan
    """By collocation, for the glider that is believed in."""

    replayed: list[SimulatedFlight]
    """The plan's commands without feedback."""

    tracked: list[SimulatedFlight]
    """Linear-quadratic feedback along the plan, at COMMAND_RATE."""

    replanned: list[SimulatedFlight]
    """MPPI from each measured state, at COMMAND_RATE; its first sequence is the
    plan's."""

    real_time_factor: float
    """Time flown over processor time, of the flights of MPPI, plant included."""

    @property
    def policies(self) -> dict[str, list[SimulatedFlight]]:
        """What was flown, in words, and its flights."""
        return {
            "the plan replayed": self.replayed,
            "LQR along the plan": self.tracked,
            "MPPI, planning anew": self.replanned,
        }

    def key_figures(self) -> dict[str, object]:
        """Returns misses and successes, for a file."""
        return {
            "miss_m": [flight.miss for flight in self.replanned],
            "perched": sum(flight.perched for flight in self.replanned),
            "open_loop_miss_m": [flight.miss for flight in self.replayed],
            "tracking_miss_m": [flight.miss for flight in self.tracked],
            "real_time_factor": self.real_time_factor,
        }


def compare(
    truth: GliderModel,
    model: GliderModel,
    problem: PerchingProblem,
    replanning: PerchingProblem,
    starts: np.ndarray,
    *,
    seed: int = 0,
    warm: bool = True,
    progress: Progress | None = None,
) -> Comparison:
    """Flies launches of a glider under three policies made with a model of it.

    Args:
        truth: the glider that flies.
        model: what is believed of it.
        problem: of the plan.
        replanning: whose goal and weights MPPI uses.
        starts: (B, 7) launch states.
        seed: of MPPI; every flight meets the same random numbers.
        warm: whether MPPI starts from the plan, or from no command at all.
        progress: told what is being done.

    Raises:
        PlanningError: where the model cannot do what the problem asks.
    """
    say = progress or (lambda text: None)
    plant = GliderPlant(model)
    planned = plan(plant, problem, progress=lambda text: say(f"plan: {text}"))
    cost = replanning_cost(plant, replanning, COMMAND_RATE)
    sequence = sequence_of(planned, cost.step, cost.steps) if warm else None
    tracking = tracking_regulator(plant, planned)
    duration = planned.duration + AFTER
    flights, seconds = [], 0.0
    controller = MppiController(cost, sequence, seed=seed)
    for diagram in (
        open_loop(truth, planned),
        closed_loop(truth, tracking, planned=model, command_rate=COMMAND_RATE),
        closed_loop(truth, controller, planned=model),
    ):
        begin = time.process_time()
        flights.append(
            simulate_flights(
                diagram,
                starts,
                duration,
                wire=(problem.wire[0], problem.wire[1]),
                progress=say,
            )
        )
        seconds = time.process_time() - begin
    return Comparison(
        plan=planned,
        replayed=flights[0],
        tracked=flights[1],
        replanned=flights[2],
        real_time_factor=len(starts) * duration / seconds,
    )


def histories(found: Mapping[str, Sequence[Search]]) -> dict[str, np.ndarray]:
    """Returns the costs of some searches by each method, (seeds, iterations + 1)."""
    return {
        name: np.array([search.costs for search in searches])
        for name, searches in found.items()
    }


def spread(runs: np.ndarray) -> dict[str, list[float]]:
    """Returns the median, the least and the largest cost of each iteration."""
    return {
        "cost": np.median(runs, axis=0).tolist(),
        "lowest": np.min(runs, axis=0).tolist(),
        "highest": np.max(runs, axis=0).tolist(),
    }


def save_sampled_figure(
    path: Path,
    cost: SequenceCost,
    start: np.ndarray,
    found: Mapping[str, Sequence[Search]],
    flown: Comparison,
) -> None:
    """Saves costs, the flights that the first searches drew, and the comparison.

    Args:
        path: of the picture.
        cost: that was searched with.
        start: (n,) state at launch.
        found: method to its searches.
        flown: the comparison.
    """
    drawn = {}
    for name, (first, *_) in found.items():
        samples = {k: cost.fly(start, tried) for k, tried in first.drawn.items()}
        drawn[name] = samples, cost.fly(start, first.mean[None])[0]
    save_sampling_figure(
        path,
        histories(found),
        drawn,
        flown.plan.states,
        [flight.states for flight in flown.replanned],
        [flight.states for flight in flown.replayed],
    )
