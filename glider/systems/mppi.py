"""Model-predictive path-integral control as a Drake System."""

import numpy as np
from pydrake.systems.framework import BasicVector, Context, DiscreteValues, LeafSystem

from glider.control.mppi import (
    COMMAND_RATE,
    HORIZON,
    SETTINGS,
    replanning_cost,
    sequence_of,
    shifted,
)
from glider.physics.model import GliderModel
from glider.planning.plan import Plan
from glider.planning.problem import PerchingProblem
from glider.planning.sampling import MppiSettings, mppi_step


class MppiController(LeafSystem):
    """Samples again from each measured state and applies the first command.

    At each update it shifts its sequence of commands by one, draws sequences about
    it, flies them from the measured state with the model, and moves the sequence as
    `mppi_step` does; then it holds the first command. The horizon recedes.

    The discrete state is the sequence (N,), then the number of updates so far. The
    random numbers of an update follow from the seed and that number, so that a
    context determines all future commands. A simulation that begins later begins with
    a later part of the sequence. It is updated at each period, and by a forced event.

    Input ports:
        state (n): measured or estimated state; with the effects' own.

    Output ports:
        elevator_rate (1): command [rad/s].

    Args:
        model: the glider that flights are predicted with.
        problem: whose goal and weights, such as `replanning` of the models.
        plan: whose commands the sequence is at first; None for zero.
        command_rate: of updates [Hz].
        steps: number of commands N in a sequence.
        settings: of the algorithm.
        seed: of the random numbers.
    """

    def __init__(
        self,
        model: GliderModel,
        problem: PerchingProblem,
        plan: Plan | None = None,
        *,
        command_rate: float = COMMAND_RATE,
        steps: int = HORIZON,
        settings: MppiSettings = SETTINGS,
        seed: int = 0,
    ) -> None:
        super().__init__()
        self.set_name("mppi")
        self._cost = replanning_cost(model, problem, command_rate, steps)
        self._settings = settings
        self._seed = seed
        self._state = self.DeclareVectorInputPort("state", model.num_states)
        step = self._cost.step
        sequence = np.zeros(steps) if plan is None else sequence_of(plan, step, steps)
        # The first update shifts as well.
        self.DeclareDiscreteState(np.concatenate([[0.0], sequence[:-1], [0.0]]))
        self.DeclareInitializationDiscreteUpdateEvent(self._begin)
        self.DeclarePeriodicDiscreteUpdateEvent(step, 0.0, self._update)
        self.DeclareForcedDiscreteUpdateEvent(self._update)
        self.DeclareVectorOutputPort(
            "elevator_rate", 1, self._calc_rate, {self.xd_ticket()}
        )

    def _begin(self, context: Context, discrete_state: DiscreteValues) -> None:
        held = context.get_discrete_state_vector().CopyToVector()
        if held[-1] == 0.0:  # No update yet.
            for _ in range(round(context.get_time() / self._cost.step)):
                held[:-1] = shifted(held[:-1])
        discrete_state.set_value(held)

    def _update(self, context: Context, discrete_state: DiscreteValues) -> None:
        start = self._state.Eval(context)
        held = context.get_discrete_state_vector().CopyToVector()
        mean = shifted(held[:-1])
        updates = int(held[-1])
        rng = np.random.default_rng([self._seed, updates])
        mean, _, _ = mppi_step(self._cost, start, mean, rng, self._settings)
        discrete_state.set_value(np.append(mean, updates + 1.0))

    def _calc_rate(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(context.get_discrete_state_vector().CopyToVector()[:1])
