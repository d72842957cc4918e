"""Model-predictive path-integral control: its settings, cost and sequences."""

import numpy as np

from glider.control.tvlqr import sample_plan
from glider.physics.model import GliderModel
from glider.planning.plan import Plan
from glider.planning.problem import PerchingProblem
from glider.planning.sampling import MppiSettings, SequenceCost

COMMAND_RATE = 50.0
"""Rate of the updates [Hz]."""

HORIZON = 40
"""Number of commands in a sequence: 0.8 s."""

SETTINGS = MppiSettings(
    samples=1024, temperature=0.1, deviation=4.0, likelihood_ratio=True
)
"""Settings found by trying on perches, with models/problems/replanning.yaml."""


def replanning_cost(
    model: GliderModel,
    problem: PerchingProblem,
    command_rate: float = COMMAND_RATE,
    steps: int = HORIZON,
) -> SequenceCost:
    """Returns the cost, of so many commands, that a controller plans with.

    The servo's limits hold, and the end is free: a glider that a model predicts
    wrongly comes early or late.
    """
    return SequenceCost(
        model,
        problem,
        step=1.0 / command_rate,
        steps=steps,
        order=4,
        within_limits=True,
        free_end=True,
    )


def shifted(sequence: np.ndarray) -> np.ndarray:
    """Returns a sequence without its first command and with a zero at its end."""
    return np.append(sequence[1:], 0.0)


def sequence_of(plan: Plan, step: float, steps: int) -> np.ndarray:
    """Returns a plan's commands, each at the middle of its step, then zeros."""
    times = step * (np.arange(steps) + 0.5)
    return np.where(times < plan.duration, sample_plan(plan, times)[2], 0.0)
