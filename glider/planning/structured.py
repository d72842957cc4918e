"""Direct collocation solved stage by stage, in milliseconds.

The constraints are those of `glider.planning.constraints`, and what is found is a
minimum of Drake's program of them (tests/planning/test_structured.py checks it). The
solver is `glider.compiled.interior_point`. CasADi's fatrop was measured: it takes a
second to build the program and longer to solve it.
"""

import dataclasses
import time
from collections.abc import Sequence

import numpy as np
from pydrake.trajectories import PiecewisePolynomial

from glider.compiled.interior_point import Optimum, Program, optimize
from glider.physics.model import GliderModel
from glider.planning.constraints import constraints_of
from glider.planning.guess import Guess, straight_line
from glider.planning.problem import PerchingProblem

_COLD_BARRIER = 100.0
"""Barrier's weight from a guess. A heavy barrier first leads away from the bounds: of
fifty launches 47 can be planned and all are, 46 at the least cost that is known; with
0.1 the same are planned, but 33 at their least."""

WARM_BARRIER = 1e-2
"""Barrier's weight from a plan that was optimal nearby."""

_STRETCH = 1.4
"""Duration of the straight lines to start from, relative to those of `straight_line`: a
slow flight has margin to brake, and of fast launches' minima it is the better one that
is found."""

_FEW = 25
"""Knots that show whether there is a plan."""

COARSE_TOLERANCE = 1e-2
"""Tolerance of a solution that only leads on to more knots."""


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class CollocatedFlight:
    """A flight on N knots at equal distances, and its multipliers."""

    name: str  #: Of what it is, as a guess.
    optimum: Optimum  #: Knots, duration of a segment and multipliers.
    num_states: int  #: N, with the effects' own states.
    cost: float  #: That was minimized.
    status: str  #: That the solver ended in, with its iterations and error.
    solved: bool  #: Whether the tolerance is met.
    seconds: float  #: That the solver took [s].

    @property
    def knots(self) -> np.ndarray:
        """(N, n + 1) states and command."""
        return self.optimum.w[:-1].reshape(-1, self.num_states + 1)

    @property
    def times(self) -> np.ndarray:
        """(N,) from 0 [s]."""
        return self.optimum.w[-1] * np.arange(len(self.knots))

    def resampled(self, knots: int, elapsed: float = 0.0) -> Optimum:
        """The rest of the flight on so many knots, `elapsed` [s] after the launch."""
        old = self.times
        end = old[-1]
        new = np.linspace(min(elapsed, 0.9 * end), end, knots)
        between = 0.5 * (old[1:] + old[:-1]), 0.5 * (new[1:] + new[:-1])
        values = [np.interp(new, old, column) for column in self.knots.T]
        mu = [np.interp(*between[::-1], row) for row in self.optimum.multipliers.T]
        w = np.append(np.column_stack(values).ravel(), new[1] - new[0])
        return Optimum(
            w=w,
            multipliers=np.ascontiguousarray(np.transpose(mu)),
            pull=self.optimum.pull,
        )


def make_program(
    model: GliderModel, problem: PerchingProblem, knots: int, arrive: bool = True
) -> Program:
    """Computes the bounds and the cost of a problem on so many knots.

    With `arrive` place, pitch and speed at the end are held to what the problem asks;
    else its cost alone draws them to the goal, and there is a plan from everywhere.
    """
    n = model.num_states
    constraints = constraints_of(problem, model.parameters.servo)
    low = np.full((knots, n + 1), -np.inf)
    high = np.full((knots, n + 1), np.inf)
    for bound in constraints.path:
        low[1:, bound.state] = bound.low
        high[1:, bound.state] = bound.high
    low[:, n] = constraints.command.low
    high[:, n] = constraints.command.high
    place = [bound for bound in constraints.arrival if bound.is_equation]
    for bound in place:
        low[-1, bound.state] = -np.inf
        high[-1, bound.state] = np.inf
    for bound in constraints.arrival:
        if arrive and not bound.is_equation:
            low[-1, bound.state] = max(low[-1, bound.state], bound.low)
            high[-1, bound.state] = min(high[-1, bound.state], bound.high)
    own = np.zeros(n - len(problem.goal))
    return Program(
        bounds=np.array(
            [
                np.append(low.ravel(), constraints.duration.low / knots),
                np.append(high.ravel(), constraints.duration.high / knots),
            ]
        ),
        rate_cost=float(problem.rate_cost),
        goal=np.append(problem.goal, own),
        goal_weights=np.append(problem.goal_weights, own),
        place=np.array([bound.low for bound in place]),
        is_held=arrive,
    )


def to_optimum(guess: Guess, knots: int) -> Optimum:
    """The knots of a guess, without multipliers."""
    times = np.linspace(guess.states.start_time(), guess.states.end_time(), knots)
    states = guess.states.vector_values(times)
    inputs = guess.inputs.vector_values(times)
    w = np.append(np.vstack([states, inputs]).T.ravel(), times[1] - times[0])
    return Optimum(
        w=w, multipliers=np.zeros((knots - 1, len(states))), pull=np.zeros(2)
    )


def slow_line(model: GliderModel, problem: PerchingProblem) -> Guess:
    """Straight lines from launch to goal, _STRETCH times as long as usual."""
    way = straight_line(model, problem).states.end_time()
    return straight_line(model, problem, _STRETCH * way)


def to_guess(flight: CollocatedFlight) -> Guess:
    """A flight as a guess for Drake's solvers."""
    columns = flight.knots.T
    return Guess(
        name=flight.name,
        states=PiecewisePolynomial.FirstOrderHold(flight.times, columns[:-1]),
        inputs=PiecewisePolynomial.FirstOrderHold(flight.times, columns[-1:]),
    )


def solve_structured(
    model: GliderModel,
    problem: PerchingProblem,
    knots: int,
    guess: Guess | CollocatedFlight,
    *,
    launch: np.ndarray | None = None,
    arrive: bool = True,
    elapsed: float = 0.0,
    tolerance: float = 1e-6,
    iterations: int = 150,
    name: str = "the plan on fewer knots",
) -> CollocatedFlight:
    """Plans from a guess, or again from a plan, its multipliers included.

    Args:
        model: the glider.
        problem: what to fly; its launch may differ from that of the guess.
        knots: at least 3.
        guess: to start from.
        launch: (n,) all states at the launch; None for the problem's.
        arrive: see `make_program`.
        elapsed: time since the launch of a plan to start from [s].
        tolerance: see `optimize`.
        iterations: see `optimize`; fewer bound the time.
        name: of what is found.

    Raises:
        UncompilableError: a formula is not of what numba compiles.
    """
    begin = time.perf_counter()
    if isinstance(guess, CollocatedFlight):
        start = guess.resampled(knots, elapsed)
        barrier = WARM_BARRIER
    else:
        start = to_optimum(guess, knots)
        barrier = _COLD_BARRIER
    n = model.num_states
    start.w[:n] = model.initial_state(problem.launch) if launch is None else launch
    program = make_program(model, problem, knots, arrive)
    found = optimize(model, program, start, barrier, tolerance, iterations)
    return CollocatedFlight(
        name=name,
        optimum=found.optimum,
        num_states=n,
        cost=found.cost,
        status=f"{found.status} ({found.iterations} iterations, "
        f"error {found.error:.1e})",
        solved=found.status == "solved",
        seconds=time.perf_counter() - begin,
    )


def solve_from_guess(
    model: GliderModel,
    problem: PerchingProblem,
    knots: int,
    guess: Guess | CollocatedFlight,
    tolerance: float = 1e-6,
    arrive: bool = True,
) -> CollocatedFlight:
    """Plans from a guess; if that fails, from a flight that ends where it is cheapest.

    `arrive` is that of `make_program`.

    Raises:
        UncompilableError: a formula is not of what numba compiles.
    """

    def solve(start, arrive=arrive):
        return solve_structured(
            model, problem, knots, start, tolerance=tolerance, arrive=arrive
        )

    flight = solve(guess)
    if flight.solved or not arrive:
        return flight
    free = solve(guess, arrive=False)
    again = solve(free) if free.solved else flight
    return again if again.solved else flight


def can_perch(
    model: GliderModel, problem: PerchingProblem, launch: Sequence[float]
) -> bool:
    """Determines whether our own solver finds a plan from a launch (7,) to the wire.

    Raises:
        InputError: the launch is no state.
        UncompilableError: a formula is not of what numba compiles.
    """
    own = dataclasses.replace(problem, launch=list(launch))
    return solve_from_guess(model, own, _FEW, slow_line(model, own)).solved
