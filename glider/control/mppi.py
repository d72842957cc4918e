"""Model-predictive path-integral control as a Drake System."""

from typing import Any

import numpy as np
from pydrake.systems.framework import Context, DiscreteValues, LeafSystem

from glider.control.tvlqr import sample_plan
from glider.errors import expect
from glider.physics.model import GliderModel
from glider.planning.plan import Plan
from glider.planning.problem import PerchingProblem
from glider.planning.sampling import MppiSettings, SequenceCost, mppi_step

COMMAND_RATE, HORIZON = 50.0, 40
"""Rate of the updates [Hz], and commands in a sequence: 0.8 s."""

SETTINGS = MppiSettings(
    samples=1024, temperature=0.1, deviation=4.0, likelihood_ratio=True
)
"""Settings found by trying on perches, with models/problems/replanning.yaml."""


class MppiController(LeafSystem):
    """Plans again from each measured state and applies the plan's first command.

    state -> [ MppiController ] -> elevator_rate

    Each `cost.step` it shifts its sequence by one command, draws sequences about
    it, flies them from the measured state with the model, and moves the sequence
    as `mppi_step` does; then it holds the first command. The horizon recedes.

    The discrete state is the sequence (N,), then the number of updates so far. The
    random numbers of an update follow from the seed and that number, so that a
    context determines all future commands. A simulation that begins later begins with
    a later part of the sequence. It is updated at each step, and by a forced event.

    Args:
        cost: of a sequence, as `replanning_cost` makes it.
        sequence: (N,) to start from; None for zero [rad/s].
        settings: of the algorithm.
        seed: of the random numbers.
    """

    def __init__(
        self,
        cost: SequenceCost,
        sequence: np.ndarray | None = None,
        settings: MppiSettings = SETTINGS,
        seed: int = 0,
    ) -> None:
        """Declares the ports, the state and its periodic update."""
        super().__init__()
        sequence = np.zeros(cost.steps) if sequence is None else sequence
        shape, needed = np.shape(sequence), f"({cost.steps},)"
        what = "MppiController: the shape of 'sequence'"
        expect(shape == (cost.steps,), what, shape, needed)
        self.set_name("mppi")
        self._cost, self._settings, self._seed = cost, settings, seed
        self._state = self.DeclareVectorInputPort("state", cost.num_states)
        # The first update shifts as well.
        self.DeclareDiscreteState(np.concatenate([[0.0], sequence[:-1], [0.0]]))
        self.DeclareInitializationDiscreteUpdateEvent(self._begin)
        self.DeclarePeriodicDiscreteUpdateEvent(cost.step, 0.0, self._update)
        self.DeclareForcedDiscreteUpdateEvent(self._update)
        self.DeclareVectorOutputPort(
            "elevator_rate", 1, self._calc_rate, {self.xd_ticket()}
        )

    @classmethod
    def from_plan(
        cls,
        model: GliderModel,
        plan: Plan,
        problem: PerchingProblem,
        *,
        command_rate: float = COMMAND_RATE,
        seed: int = 0,
    ) -> "MppiController":
        """Makes a controller that starts from the commands of a plan.

        Args:
            model: that flights are predicted with.
            plan: to start from.
            problem: whose goal and weights to use, such as `replanning` of the models.
            command_rate: of updates [Hz].
            seed: of the random numbers.
        """
        cost = replanning_cost(model, problem, command_rate)
        return cls(cost, sequence_of(plan, cost.step, cost.steps), seed=seed)

    def _begin(self, context: Context, discrete_state: DiscreteValues) -> None:
        held = context.get_discrete_state_vector().CopyToVector()
        if held[-1] == 0.0:  # No update yet.
            for _ in range(round(context.get_time() / self._cost.step)):
                held[:-1] = shifted(held[:-1])
        discrete_state.set_value(held)

    def _update(self, context: Context, discrete_state: DiscreteValues) -> None:
        start = self._state.Eval(context)
        held = context.get_discrete_state_vector().CopyToVector()
        mean, updates = shifted(held[:-1]), int(held[-1])
        rng = np.random.default_rng([self._seed, updates])
        mean, _, _ = mppi_step(self._cost, start, mean, rng, self._settings)
        discrete_state.set_value(np.append(mean, updates + 1.0))

    def _calc_rate(self, context: Context, output: Any) -> None:
        output.SetFromVector(context.get_discrete_state_vector().CopyToVector()[:1])


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
