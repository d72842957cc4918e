"""Direct collocation solved stage by stage, in milliseconds.

The problem is that of `glider.planning.transcription`, knot by knot, and what is found
is a minimum of Drake's program (tests/planning/test_structured.py checks it). The
solver is `glider.compiled.interior_point`. CasADi's fatrop was measured: it takes a
second to build the program and longer to solve it.
"""

import dataclasses
import time

import numpy as np
from pydrake.trajectories import PiecewisePolynomial

from glider.compiled.barrier import Optimum, Program
from glider.compiled.interior_point import optimize
from glider.physics.model import GliderModel
from glider.planning.guess import Guess, straight_line
from glider.planning.problem import PerchingProblem

COLD_BARRIER = 100.0
"""Barrier's weight from a guess. A heavy barrier first leads away from the bounds: of
fifty launches 47 can be planned and all are, 46 at the least cost that is known; with
0.1 the same are planned, but 33 at their least."""

WARM_BARRIER = 1e-2
"""Barrier's weight from a plan that was optimal nearby."""

STRETCH = 1.4
"""Duration of the straight lines to start from, relative to those of `straight_line`: a
slow flight has margin to brake, and of fast launches' minima it is the better one that
is found."""

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
            forces=np.zeros((2, w.size)),
        )


def make_program(
    model: GliderModel, problem: PerchingProblem, knots: int, arrive: bool = True
) -> Program:
    """Computes the bounds and the cost of a problem on so many knots.

    With `arrive` place, pitch and speed at the end are held to what the problem asks;
    else its cost alone draws them to the goal, and there is a plan from everywhere.
    """
    n, servo = model.num_states, model.parameters.servo
    low = np.full((knots, n + 1), -np.inf)
    high = -low
    travel = [problem.x_limits, problem.z_limits, problem.pitch_limits]
    for i, limits in enumerate([*travel, (servo.low, servo.high)]):
        low[1:, i], high[1:, i] = limits
    low[:, n], high[:, n] = -servo.rate, servo.rate
    low[-1, :2], high[-1, :2] = -np.inf, np.inf  # The wire's place is an equation.
    if arrive:
        final = problem.final_pitch_limits
        low[-1, 2], high[-1, 2] = max(low[-1, 2], final[0]), min(high[-1, 2], final[1])
        low[-1, 4:6] = -problem.final_speed_limit
        high[-1, 4:6] = problem.final_speed_limit
    shortest, longest = np.array(problem.duration_limits) / knots
    own = np.zeros(n - len(problem.goal))
    return Program(
        low=np.append(low.ravel(), shortest),
        high=np.append(high.ravel(), longest),
        rate_cost=float(problem.rate_cost),
        goal=np.append(problem.goal, own),
        goal_weights=np.append(problem.goal_weights, own),
        place=np.array(problem.wire, dtype=float),
        is_held=arrive,
    )


def to_optimum(guess: Guess, knots: int) -> Optimum:
    """The knots of a guess, without multipliers."""
    times = np.linspace(guess.states.start_time(), guess.states.end_time(), knots)
    states = guess.states.vector_values(times)
    inputs = guess.inputs.vector_values(times)
    w = np.append(np.vstack([states, inputs]).T.ravel(), times[1] - times[0])
    return Optimum(
        w=w,
        multipliers=np.zeros((knots - 1, len(states))),
        pull=np.zeros(2),
        forces=np.zeros((2, w.size)),
    )


def slow_line(model: GliderModel, problem: PerchingProblem) -> Guess:
    """Straight lines from launch to goal, STRETCH times as long as usual."""
    way = straight_line(model, problem).states.end_time()
    return straight_line(model, problem, STRETCH * way)


def to_guess(flight: CollocatedFlight) -> Guess:
    """A flight as a guess for Drake's solvers."""
    n = flight.num_states
    return Guess(
        name=flight.name,
        states=PiecewisePolynomial.FirstOrderHold(flight.times, flight.knots[:, :n].T),
        inputs=PiecewisePolynomial.FirstOrderHold(flight.times, flight.knots[:, n:].T),
    )


def solve_structured(
    model: GliderModel,
    problem: PerchingProblem,
    knots: int,
    guess: Guess | CollocatedFlight,
    *,
    launch: np.ndarray | None = None,
    arrive: bool = True,
    program: Program | None = None,
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
        program: to solve instead of that of the problem.
        elapsed: time since the launch of a plan to start from [s].
        tolerance: see `optimize`.
        iterations: see `optimize`; fewer bound the time.
        name: of what is found.

    Raises:
        UncompilableError: a formula is not of what numba compiles.
    """
    begin = time.perf_counter()
    if isinstance(guess, CollocatedFlight):
        start, barrier = guess.resampled(knots, elapsed), WARM_BARRIER
    else:
        start, barrier = to_optimum(guess, knots), COLD_BARRIER
    n = model.num_states
    start.w[:n] = model.initial_state(problem.launch) if launch is None else launch
    program = program or make_program(model, problem, knots, arrive)
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
