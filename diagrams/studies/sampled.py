"""Searches that sample, and a controller that does, against a plan replayed."""

import dataclasses
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from diagrams.closed_loop import closed_loop
from diagrams.open_loop import open_loop
from diagrams.simulate import (
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
from glider.planning.sampling import SequenceCost, cem, mppi
from glider.simulation.flights import FlownFlight
from glider.studies.plots.sampling import save_sampling_figure

AFTER = 0.2
"""How long a flight goes on after the plan's end [s]: who plans anew may come later
than the plan."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Comparison:
    """The same launches of one glider under three policies."""

    plan: Plan
    """By collocation, for the glider that is believed in."""

    replayed: list[FlownFlight]
    """The plan's commands without feedback."""

    tracked: list[FlownFlight]
    """Linear-quadratic feedback along the plan, at COMMAND_RATE."""

    replanned: list[FlownFlight]
    """MPPI from each measured state, at COMMAND_RATE; its first sequence is the
    plan's."""

    real_time_factor: float
    """Time flown over processor time, of the flights of MPPI, plant included."""

    @property
    def policies(self) -> dict[str, list[FlownFlight]]:
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
    planned = plan(model, problem, progress=lambda text: say(f"plan: {text}"))
    cost = replanning_cost(model, replanning, COMMAND_RATE)
    sequence = sequence_of(planned, cost.step, cost.steps) if warm else None
    tracking = tracking_regulator(model, planned)
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


@dataclasses.dataclass(frozen=True, kw_only=True)
class Searches:
    """Some searches by each method, and what the first of each drew."""

    plans: dict[str, list[Plan]]
    """Method to its plans, one a seed."""

    drawn: dict[str, dict[int, np.ndarray]]
    """Method to number of the iteration, from 1, to sequences (B, N) [rad/s]."""

    def histories(self) -> dict[str, np.ndarray]:
        """Returns the costs by each method, (seeds, iterations + 1)."""
        return {
            name: np.array([plan.costs for plan in plans])
            for name, plans in self.plans.items()
        }


def search_plans(
    cost: SequenceCost,
    start: np.ndarray,
    count: int,
    seed: int,
    shown: Sequence[int] = (),
    progress: Progress | None = None,
) -> Searches:
    """Searches for plans by CEM and by MPPI.

    Args:
        cost: to search with.
        start: (n,) state at launch.
        count: searches by each method, each with a seed of its own.
        seed: of these seeds; both methods get the same.
        shown: iterations, from 1, whose sequences to keep.
        progress: told what is being done.
    """
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
    return Searches(plans=plans, drawn=drawn)


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
    found: Searches,
    flown: Comparison,
) -> None:
    """Saves costs, the flights that the first searches drew, and the comparison.

    Args:
        path: of the picture.
        cost: that was searched with.
        start: (n,) state at launch.
        found: the searches.
        flown: the comparison.
    """
    drawn = {}
    for name, kept in found.drawn.items():
        samples = {k: cost.fly(start, tried) for k, tried in kept.items()}
        drawn[name] = samples, found.plans[name][0].states
    save_sampling_figure(
        path,
        found.histories(),
        drawn,
        flown.plan.states,
        [flight.states for flight in flown.replanned],
        [flight.states for flight in flown.replayed],
    )
