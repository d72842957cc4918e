"""A controller that samples, against feedback along a plan and the plan replayed."""

import dataclasses
import time

import numpy as np

from diagrams.loops import closed_loop, open_loop
from diagrams.simulate import simulate_flights
from glider.paths import models_path
from glider.physics.model import GliderModel
from glider.planning.dircol import Progress, plan
from glider.planning.plan import Plan
from glider.planning.problem import PerchingProblem
from glider.simulation.flown_flights import Perches
from glider.systems.mppi import MppiController
from glider.systems.regulator import tracking_regulator

COMMAND_RATE = 50.0
"""Rate of the commands, held between [Hz]."""

AFTER = 0.2
"""Time that a flight goes on after the plan's end [s]: a controller that replans may
reach the wire later than the plan."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Comparison:
    """The same launches of one glider under three policies."""

    plan: Plan
    """Plan by collocation, for the glider that is believed in."""

    replayed: Perches
    """The plan's commands without feedback."""

    tracked: Perches
    """Linear-quadratic feedback along the plan, at COMMAND_RATE."""

    replanned: Perches
    """MPPI from each measured state, at COMMAND_RATE; its first sequence is the
    plan's."""

    real_time_factor: float
    """Time flown over processor time, of the flights of MPPI, plant included."""

    @property
    def policies(self) -> dict[str, Perches]:
        """Name of each policy for people, and its flights."""
        return {
            "the plan replayed": self.replayed,
            "LQR along the plan": self.tracked,
            "MPPI, replanning": self.replanned,
        }

    def key_figures(self, truth: str) -> dict[str, object]:
        """Returns misses and successes, for a file.

        Args:
            truth: what the glider that flies is called.
        """
        return {
            "truth": truth,
            **self.replanned.key_figures(),
            "open_loop_miss_m": self.replayed.misses,
            "open_loop_perched": self.replayed.perched,
            "tracking_miss_m": self.tracked.misses,
            "tracking_perched": self.tracked.perched,
            "real_time_factor": self.real_time_factor,
        }

    def describe(self, truth: str) -> str:
        """Returns a line for each policy, and how fast replanning is.

        Args:
            truth: what the glider that flies is called.
        """
        lines = [
            f"{truth}, {name}: {flights.describe()}"
            for name, flights in self.policies.items()
        ]
        speed = f"{self.real_time_factor:.1f} s of flight."
        return "\n".join([*lines, f"MPPI needs 1 s of one core for {speed}"])


def compare(
    truth: GliderModel,
    problem: PerchingProblem,
    starts: np.ndarray,
    *,
    model: GliderModel | None = None,
    replanning: PerchingProblem | None = None,
    seed: int = 0,
    warm: bool = True,
    progress: Progress | None = None,
) -> Comparison:
    """Flies launches of a glider under three policies made with a model of it.

    Args:
        truth: the glider that flies.
        problem: of the plan.
        starts: (B, 7) launch states.
        model: what is believed of the glider; None for its nominal model.
        replanning: whose goal and weights MPPI uses; None for replanning.yaml of the
            models.
        seed: of MPPI; every flight meets the same random numbers.
        warm: whether MPPI starts from the plan, or from no command at all.
        progress: called with a line of text as the work goes on.

    Raises:
        PlanningError: where the model cannot do what the problem asks.
    """
    say = progress or (lambda text: None)
    model = GliderModel(parameters=truth.parameters) if model is None else model
    planned = plan(model, problem, progress=lambda text: say(f"plan: {text}"))
    if replanning is None:
        replanning = PerchingProblem.load(models_path("problems", "replanning.yaml"))
    tracking = tracking_regulator(model, planned)
    duration = planned.duration + AFTER
    flights, seconds = [], 0.0
    first = planned if warm else None
    controller = MppiController(
        model, replanning, first, command_rate=COMMAND_RATE, seed=seed
    )
    for diagram in (
        open_loop(truth, planned),
        closed_loop(truth, tracking, planned=model, command_rate=COMMAND_RATE),
        closed_loop(truth, controller, planned=model),
    ):
        begin = time.process_time()
        flights.append(
            simulate_flights(diagram, starts, duration, problem=problem, progress=say)
        )
        seconds = time.process_time() - begin
    return Comparison(
        plan=planned,
        replayed=flights[0],
        tracked=flights[1],
        replanned=flights[2],
        real_time_factor=len(starts) * duration / seconds,
    )
