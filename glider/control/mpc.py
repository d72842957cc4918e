"""Model-predictive control by direct collocation, as a Drake System."""

import dataclasses
from collections.abc import Callable
from typing import Any

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.systems.framework import Context, LeafSystem, State

from glider.control.mppi import COMMAND_RATE
from glider.errors import expect
from glider.physics.model import GliderModel
from glider.physics.state import POSITION
from glider.planning.constraints import check_plannable
from glider.planning.guess import straight_line
from glider.planning.problem import PerchingProblem
from glider.planning.structured import CollocatedFlight, solve_structured

RATE_COST = 0.1
"""Weight of the elevator's squared rate [1/(rad²/s)] beside the goal's weights of
models/problems/replanning.yaml."""

SPACING = 0.022
"""Time between knots [s], as the article's plan has them."""

FEWEST = 5
"""Knots of the shortest plan."""

LAST = 0.04
"""Rest of a plan that is not planned again but flown to its end [s]."""

ITERATIONS, TOLERANCE = 25, 1e-4
"""Of a plan that is flown for one command; iterations bound its time."""


@dataclasses.dataclass(frozen=True, eq=False)
class ReplanResult:
    """State of the controller: its last plan, and statistics of planning."""

    flight: CollocatedFlight  #: The last plan that was found.
    begin: float  #: When its time began [s].
    time: float = 0.0  #: Of the last update [s].
    plans: int = 0  #: Number of plans that were tried.
    failures: int = 0  #: Number of those that failed.
    failed: bool = False  #: Whether the last did.
    seconds: float = 0.0  #: Time that the last took [s].
    slowest: float = 0.0  #: Time that the slowest took [s].

    def command(self, time: float, period: float) -> float:
        """Returns the plan's mean command over a period, zero after its end."""
        times = self.flight.times
        middle = time - self.begin + 0.5 * period
        if middle > times[-1]:
            return 0.0
        return float(np.interp(middle, times, self.flight.knots[:, -1]))


class ModelPredictiveController(LeafSystem):
    """Plans again from each measured state and applies the plan's first command.

    state -> [ ModelPredictiveController ] -> elevator_rate, timing

    At each command it plans from the measured state to the wire, by the solver of
    `glider.planning.structured`, warm from the last plan, and holds the plan's mean
    command until the next. The end is free in time, and no constraint: the cost draws
    to it, so that there is a plan from everywhere. Where a solve fails the last plan
    goes on, and so does the rest of a plan that is all but over. A simulation may begin
    at any time: the first plan counts from the knot that is nearest to its launch.

    The abstract state is a `ReplanResult`, so that a context determines
    all future commands. It is updated at each period, and by a forced event: a station
    whose commands have a clock of their own runs it without a Simulator.

    Args:
        model: the glider that is planned with; its effects' own states are fed back.
        problem: whose launch, goal, weights and limits; its rate_cost is replaced
            where it is zero, because a plan of no cost is not unique.
        command_rate: of updates [Hz].
        watch: called with the state after each plan.

    Output ports:
        elevator_rate: the command [rad/s].
        timing: (4,) plans, failures, seconds of the last and of the slowest.

    Raises:
        InputError: the glider or the problem cannot be planned for.
    """

    def __init__(
        self,
        model: GliderModel,
        problem: PerchingProblem,
        command_rate: float = COMMAND_RATE,
        watch: Callable[[ReplanResult], None] | None = None,
    ) -> None:
        """Plans once from the launch; declares ports, state and periodic update."""
        super().__init__()
        good = np.isfinite(command_rate) and command_rate > 0.0
        what = "ModelPredictiveController: the command rate"
        expect(good, what, command_rate, "a positive number of Hz")
        check_plannable(model, problem)
        self.set_name("mpc")
        self._model, self._period, self._watch = model, 1.0 / command_rate, watch
        rate_cost = problem.rate_cost or RATE_COST
        self._problem = dataclasses.replace(problem, rate_cost=rate_cost)
        self._state = self.DeclareVectorInputPort("state", model.num_states)
        first = ReplanResult(flight=self._plan_first(), begin=0.0)
        index = self.DeclareAbstractState(AbstractValue.Make(first))
        self.DeclareInitializationUnrestrictedUpdateEvent(self._begin)
        self.DeclarePeriodicUnrestrictedUpdateEvent(self._period, 0.0, self._update)
        self.DeclareForcedUnrestrictedUpdateEvent(self._update)
        ticket = {self.abstract_state_ticket(index)}
        self.DeclareVectorOutputPort("elevator_rate", 1, self._calc_rate, ticket)
        self.DeclareVectorOutputPort("timing", 4, self._calc_timing, ticket)

    def _plan_first(self) -> CollocatedFlight:
        line = straight_line(self._model, self._problem)
        knots = max(FEWEST, round(line.states.end_time() / SPACING))
        flight = solve_structured(
            self._model, self._problem, knots, line, arrive=False, name="the first plan"
        )
        what = "ModelPredictiveController: the first plan's status"
        expect(flight.solved, what, flight.status, "a launch with a plan")
        return flight

    def _begin(self, context: Context, state: State) -> None:
        now, known = context.get_time(), context.get_abstract_state(0).get_value()
        if known.plans:  # A flight goes on.
            return
        here = self._state.Eval(context)[POSITION]
        away = np.linalg.norm(known.flight.knots[:, POSITION] - here, axis=1)
        begin = now - float(known.flight.times[np.argmin(away)])
        known = dataclasses.replace(known, begin=begin, time=now)
        state.get_mutable_abstract_state(0).set_value(known)

    def _update(self, context: Context, state: State) -> None:
        now, known = context.get_time(), context.get_abstract_state(0).get_value()
        known = self.plan_again(known, now, self._state.Eval(context))
        state.get_mutable_abstract_state(0).set_value(known)

    def plan_again(
        self, known: ReplanResult, now: float, state: np.ndarray
    ) -> ReplanResult:
        """The next state, by a plan from the measured state (n,) at `now` [s]."""
        elapsed, known = now - known.begin, dataclasses.replace(known, time=now)
        rest = known.flight.times[-1] - elapsed
        if rest < LAST:
            return known
        near = dataclasses.replace(
            self._problem, duration_limits=[0.5 * rest, 1.5 * rest + self._period]
        )
        flight = solve_structured(
            self._model,
            near,
            max(FEWEST, 1 + round(rest / SPACING)),
            known.flight,
            launch=state,
            arrive=False,
            elapsed=elapsed,
            tolerance=TOLERANCE,
            iterations=ITERATIONS,
            name="the last plan",
        )
        again = dataclasses.replace(
            known,
            plans=known.plans + 1,
            failures=known.failures + (not flight.solved),
            failed=not flight.solved,
            seconds=flight.seconds,
            slowest=max(known.slowest, flight.seconds),
        )
        if flight.solved:
            again = dataclasses.replace(again, flight=flight, begin=now)
        if self._watch is not None:
            self._watch(again)
        return again

    def _calc_rate(self, context: Context, output: Any) -> None:
        known = context.get_abstract_state(0).get_value()
        output.SetFromVector([known.command(known.time, self._period)])

    def _calc_timing(self, context: Context, output: Any) -> None:
        known = context.get_abstract_state(0).get_value()
        output.SetFromVector(
            [known.plans, known.failures, known.seconds, known.slowest]
        )
