"""Model-predictive control: for each command, one quadratic program of Drake.

The dynamics are linearized about the last plan: a real-time iteration.

Source: Diehl, Bock, Schlöder, "A real-time iteration scheme for nonlinear optimization
in optimal feedback control", SIAM J. Control Optim. 43 (2005).
"""

import dataclasses
import time

import numpy as np
from pydrake.solvers import ClarabelSolver, MathematicalProgram

from glider.control.mppi import COMMAND_RATE
from glider.errors import expect
from glider.physics.model import GliderModel
from glider.physics.state import NUM_STATES, POSITION
from glider.planning.constraints import constraints_of
from glider.planning.dircol import plan
from glider.planning.path import Path
from glider.planning.plan import Plan
from glider.planning.problem import PerchingProblem
from glider.planning.program import straight_duration

_RATE_COST = 0.1
"""Weight of the elevator's squared rate [1/(rad²/s)] beside the goal's weights of
models/problems/replanning.yaml."""

_SPACING = 0.022
"""Time between knots [s], as the article's plan has them."""

_FEWEST = 5
"""Knots of the shortest plan."""

_LAST = 0.04
"""Rest of a plan that is not planned again but flown to its end [s]."""


@dataclasses.dataclass(frozen=True, eq=False)
class ReplanResult:
    """The last plan that was found, and statistics of planning."""

    flight: Plan  #: The last plan that was found.
    begin: float  #: When its time began [s].
    time: float = 0.0  #: Of the last update [s].
    plans: int = 0  #: Number of plans that were tried.
    failures: int = 0  #: Number of those that failed.
    failed: bool = False  #: Whether the last did.
    seconds: float = 0.0  #: Time that the last took [s].
    slowest: float = 0.0  #: Time that the slowest took [s].

    def command(self, time: float, period: float) -> float:
        """Returns the plan's mean command over a period, zero after its end."""
        middle = time - self.begin + 0.5 * period
        if middle > self.flight.duration:
            return 0.0
        return float(np.interp(middle, self.flight.times, self.flight.inputs))


class Replanner:
    """Plans from any state to the wire, by one quadratic program about the last plan.

    The end is free in time, and no constraint: the cost draws to it, so that there is
    a plan from everywhere. Where the program has no solution the last plan goes on,
    and so does the rest of a plan that is all but over.

    Args:
        model: the glider that is planned with.
        problem: whose launch, goal, weights and limits; its rate_cost is replaced
            where it is zero, because a plan of no cost is not unique.
        command_rate: of plans [Hz].

    Raises:
        InputError: the glider or the problem cannot be planned for.
    """

    def __init__(
        self,
        model: GliderModel,
        problem: PerchingProblem,
        command_rate: float = COMMAND_RATE,
    ) -> None:
        good = np.isfinite(command_rate) and command_rate > 0.0
        what = "ModelPredictiveController: the command rate"
        expect(good, what, command_rate, "a positive number of Hz")
        rate_cost = problem.rate_cost or _RATE_COST
        self.period = 1.0 / command_rate  #: Time between plans [s].
        self._model = model
        self._problem = dataclasses.replace(problem, rate_cost=rate_cost)

    def plan_first(self) -> ReplanResult:
        """Returns the plan from the problem's launch, which begins at time 0.

        Raises:
            PlanningError: there is none to the wire.
        """
        knots = max(_FEWEST, round(straight_duration(self._problem) / _SPACING))
        return ReplanResult(plan(self._model, self._problem, knots), begin=0.0)

    def begin(self, first: ReplanResult, now: float, state: np.ndarray) -> ReplanResult:
        """Lets the first plan count from its knot nearest to a state (n,) [s]."""
        away = first.flight.states[:, POSITION] - state[POSITION]
        nearest = np.argmin(np.linalg.norm(away, axis=1))
        begin = now - float(first.flight.times[nearest])
        return dataclasses.replace(first, begin=begin, time=now)

    def plan_again(
        self, known: ReplanResult, now: float, state: np.ndarray
    ) -> ReplanResult:
        """Returns what is known after a plan from a state (n,) at `now` [s].

        Raises:
            UncompilableError: a formula is not of what numba compiles.
        """
        known = dataclasses.replace(known, time=now)
        elapsed = now - known.begin
        rest = known.flight.duration - elapsed
        if rest < _LAST:
            return known
        started = time.perf_counter()
        flight = self._improve(self._rest_of(known.flight, elapsed), state)
        seconds = time.perf_counter() - started
        again = dataclasses.replace(
            known,
            plans=known.plans + 1,
            failures=known.failures + (flight is None),
            failed=flight is None,
            seconds=seconds,
            slowest=max(known.slowest, seconds),
        )
        if flight is not None:
            again = dataclasses.replace(again, flight=flight, begin=now)
        return again

    def _rest_of(self, flight: Plan, elapsed: float) -> Path:
        """Returns the rest of a flight on knots at the usual distance."""
        rest = flight.duration - elapsed
        knots = max(_FEWEST, 1 + round(rest / _SPACING))
        times = np.linspace(0.0, rest, knots)
        states = flight.state_trajectory.vector_values(elapsed + times).T
        [inputs] = flight.input_trajectory.vector_values(elapsed + times)
        return Path(self._model, times, states, inputs)

    def _improve(self, path: Path, state: np.ndarray) -> Plan | None:
        """Returns the best flight from a state near a path, None if there is none.

        The dynamics are linearized about the path. The cost is that of the problem
        where the length of the segments varies little.
        """
        problem = self._problem
        constraints = constraints_of(problem, self._model.parameters.servo)
        count, width = path.knots.shape
        n = width - 1
        step = path.times[1]
        rest = path.times[-1]
        program = MathematicalProgram()
        knots = program.NewContinuousVariables(count, width, "knots")
        length = program.NewContinuousVariables(1, "step")
        program.AddBoundingBoxConstraint(state, state, knots[0, :n])
        for bound in constraints.path:
            program.AddBoundingBoxConstraint(
                bound.low, bound.high, knots[1:, bound.state]
            )
        rate = constraints.command
        program.AddBoundingBoxConstraint(rate.low, rate.high, knots[:, n])
        shortest, longest = 0.5 * rest, 1.5 * rest + self.period
        program.AddBoundingBoxConstraint(shortest / count, longest / count, length)
        slopes = path.defect_slopes()
        for k, defect in enumerate(path.defects):
            here = np.concatenate([path.knots[k], path.knots[k + 1], [step]])
            free = np.concatenate([knots[k], knots[k + 1], length])
            right = slopes[k] @ here - defect
            program.AddLinearEqualityConstraint(slopes[k], right, free)
        shares = np.ones(count)
        shares[[0, -1]] = 0.5
        weights = 2.0 * problem.rate_cost * shares
        program.AddQuadraticCost(
            np.diag(step * weights), np.zeros(count), knots[:, n], is_convex=True
        )
        per_step = 0.5 * weights @ path.inputs**2
        program.AddLinearCost([per_step], -per_step * step, length)
        final = knots[-1, :NUM_STATES]
        goal = np.array(problem.goal)
        program.AddQuadraticErrorCost(np.diag(problem.goal_weights), goal, final)
        result = ClarabelSolver().Solve(program)
        if not result.is_success():
            return None
        found = result.GetSolution(knots)
        times = result.GetSolution(length)[0] * np.arange(count)
        flown = Path(self._model, times, found[:, :n], found[:, n])
        return Plan(
            times=times,
            states=flown.states,
            slopes=flown.slopes,
            inputs=flown.inputs,
            state_names=self._model.state_names,
            cost=result.get_optimal_cost(),
        )
