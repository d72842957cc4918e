"""Model-predictive control by direct collocation: a new plan from each state."""

import dataclasses

import numpy as np

from glider.control.mppi import COMMAND_RATE
from glider.errors import expect
from glider.physics.model import GliderModel
from glider.physics.state import POSITION
from glider.planning.constraints import check_plannable
from glider.planning.guess import straight_line
from glider.planning.problem import PerchingProblem
from glider.planning.structured import (
    CollocatedFlight,
    solve_from_guess,
    solve_structured,
)

_RATE_COST = 0.1
"""Weight of the elevator's squared rate [1/(rad²/s)] beside the goal's weights of
models/problems/replanning.yaml."""

_SPACING = 0.022
"""Time between knots [s], as the article's plan has them."""

_FEWEST = 5
"""Knots of the shortest plan."""

_LAST = 0.04
"""Rest of a plan that is not planned again but flown to its end [s]."""

_ITERATIONS = 25
"""Most iterations of a plan that is flown for one command: they bound its time."""

_TOLERANCE = 1e-4
"""Tolerance of such a plan."""


@dataclasses.dataclass(frozen=True, eq=False)
class ReplanResult:
    """The last plan that was found, and statistics of planning."""

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


class Replanner:
    """Plans from any state to the wire, warm from the last plan.

    The end is free in time, and no constraint: the cost draws to it, so that there is
    a plan from everywhere. Where a solve fails the last plan goes on, and so does the
    rest of a plan that is all but over.

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
        check_plannable(model, problem)
        rate_cost = problem.rate_cost or _RATE_COST
        self.period = 1.0 / command_rate  #: Time between plans [s].
        self._model = model
        self._problem = dataclasses.replace(problem, rate_cost=rate_cost)

    def plan_first(self) -> ReplanResult:
        """Returns the plan from the problem's launch, which begins at time 0."""
        line = straight_line(self._model, self._problem)
        knots = max(_FEWEST, round(line.states.end_time() / _SPACING))
        flight = solve_from_guess(self._model, self._problem, knots, line, arrive=False)
        what = "ModelPredictiveController: the first plan's status"
        expect(flight.solved, what, flight.status, "a launch with a plan")
        return ReplanResult(flight=flight, begin=0.0)

    def begin(self, first: ReplanResult, now: float, state: np.ndarray) -> ReplanResult:
        """Lets the first plan count from its knot nearest to a state (n,) [s]."""
        away = first.flight.knots[:, POSITION] - state[POSITION]
        nearest = np.argmin(np.linalg.norm(away, axis=1))
        begin = now - float(first.flight.times[nearest])
        return dataclasses.replace(first, begin=begin, time=now)

    def plan_again(
        self, known: ReplanResult, now: float, state: np.ndarray
    ) -> ReplanResult:
        """Returns what is known after a plan from a state (n,) at `now` [s]."""
        known = dataclasses.replace(known, time=now)
        elapsed = now - known.begin
        rest = known.flight.times[-1] - elapsed
        if rest < _LAST:
            return known
        longest = 1.5 * rest + self.period
        near = dataclasses.replace(self._problem, duration_limits=[0.5 * rest, longest])
        flight = solve_structured(
            self._model,
            near,
            max(_FEWEST, 1 + round(rest / _SPACING)),
            known.flight,
            launch=state,
            arrive=False,
            elapsed=elapsed,
            tolerance=_TOLERANCE,
            iterations=_ITERATIONS,
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
        return again
