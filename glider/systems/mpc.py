"""Model-predictive control, a new plan at each command, as a Drake System."""

from collections.abc import Callable

from pydrake.common.value import AbstractValue
from pydrake.systems.framework import BasicVector, Context, LeafSystem, State

from glider.control.mpc import Replanner, ReplanResult
from glider.control.mppi import COMMAND_RATE
from glider.physics.model import GliderModel
from glider.planning.problem import PerchingProblem


class ModelPredictiveController(LeafSystem):
    """Plans again from each measured state and applies the plan's first command.

    At each update it plans from the measured state to the wire, as `Replanner` does,
    and holds the plan's mean command until the next. A simulation may begin at any
    time: the first plan counts from the knot that is nearest to its launch.

    The abstract state is a `ReplanResult`, so that a context determines all future
    commands. It is updated at each period, and by a forced event: a station whose
    commands have a clock of their own runs it without a Simulator.

    Input ports:
        state (n): measured or estimated state; with the effects' own.

    Output ports:
        elevator_rate (1): command [rad/s].
        timing (4): number of plans, number of failures, time that the last plan took
            and the slowest [s].

    Args:
        model: as in `Replanner`.
        problem: as in `Replanner`.
        command_rate: of updates [Hz].
        watch: called with the state after each plan.

    Raises:
        InputError: the glider or the problem cannot be planned for.
        PlanningError: there is no plan from the problem's launch.
    """

    def __init__(
        self,
        model: GliderModel,
        problem: PerchingProblem,
        command_rate: float = COMMAND_RATE,
        watch: Callable[[ReplanResult], None] | None = None,
    ) -> None:
        super().__init__()
        self.set_name("mpc")
        self._replanner = Replanner(model, problem, command_rate)
        self._watch = watch
        self._state = self.DeclareVectorInputPort("state", model.num_states)
        first = self._replanner.plan_first()
        index = self.DeclareAbstractState(AbstractValue.Make(first))
        self.DeclareInitializationUnrestrictedUpdateEvent(self._begin)
        period = self._replanner.period
        self.DeclarePeriodicUnrestrictedUpdateEvent(period, 0.0, self._update)
        self.DeclareForcedUnrestrictedUpdateEvent(self._update)
        ticket = {self.abstract_state_ticket(index)}
        self.DeclareVectorOutputPort("elevator_rate", 1, self._calc_rate, ticket)
        self.DeclareVectorOutputPort("timing", 4, self._calc_timing, ticket)

    def _begin(self, context: Context, state: State) -> None:
        known = _known(context)
        if known.plans == 0:  # Else a flight goes on.
            here = self._state.Eval(context)
            known = self._replanner.begin(known, context.get_time(), here)
            state.get_mutable_abstract_state(0).set_value(known)

    def _update(self, context: Context, state: State) -> None:
        known = _known(context)
        here = self._state.Eval(context)
        again = self._replanner.plan_again(known, context.get_time(), here)
        state.get_mutable_abstract_state(0).set_value(again)
        if self._watch is not None and again.plans > known.plans:
            self._watch(again)

    def _calc_rate(self, context: Context, output: BasicVector) -> None:
        known = _known(context)
        output.SetFromVector([known.command(known.time, self._replanner.period)])

    def _calc_timing(self, context: Context, output: BasicVector) -> None:
        known = _known(context)
        timing = [known.plans, known.failures, known.seconds, known.slowest]
        output.SetFromVector(timing)


def _known(context: Context) -> ReplanResult:
    return context.get_abstract_state(0).get_value()
