"""Plans a perch by direct collocation: first on few knots, then on more.

A ladder of attempts: first our own solver, which takes the stages one by one. Where it
fails, a search from many guesses determines whether the wire can be reached at all; if
so, Drake's solvers, other guesses and a looser tolerance are tried. The plan records
what was tried, and by how much the path that is found differs from a flight.
"""

import contextlib
import logging
import time
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from pydrake.planning import DirectCollocation
from pydrake.solvers import (
    IpoptSolver,
    MathematicalProgramResult,
    SnoptSolver,
    SolverInterface,
    SolverOptions,
)

from glider.compiled.kernel import UncompilableError
from glider.errors import expect
from glider.physics.model import GliderModel, as_model
from glider.planning.guess import Guess, straight_line, swoop
from glider.planning.plan import Attempt, Plan
from glider.planning.problem import PerchingProblem
from glider.planning.reach import Closest, find_closest
from glider.planning.structured import (
    COARSE_TOLERANCE,
    CollocatedFlight,
    slow_line,
    solve_structured,
)
from glider.planning.structured import to_guess as flight_to_guess
from glider.planning.transcription import (
    Dynamics,
    arrival_violations,
    check_plannable,
    to_guess,
    transcribe,
    violated,
)
from glider.progress import Progress, silent

TOLERANCE, LOOSE = 1e-6, 1e-3
"""Tolerances of constraints and optimality, as the solvers scale them: of a plan, and
of an attempt whose result is only a better guess."""

ELASTIC_WEIGHT = 100.0
"""Weight of SNOPT's infeasibilities against the cost. Its own default, 1e4, makes five
times as many iterations of this problem."""

POINTS = 20
"""Points in each segment at which the path is compared with the dynamics; even, so that
the collocation point is one of them."""

Solution = tuple[DirectCollocation, MathematicalProgramResult]
Found = Solution | CollocatedFlight


class PlanningError(RuntimeError):
    """No attempt found a plan.

    Attributes:
        violations: constraint at the wire to the amount by which the closest flight
            violates it [m, rad or m/s]; empty where no flight was found.
        attempts: what was tried.
        closest: result of a search from many guesses, None where there was none.
    """

    def __init__(
        self,
        violations: dict[str, float],
        attempts: tuple[Attempt, ...],
        closest: Closest | None = None,
    ):
        """Composes the message of the attributes."""
        self.violations, self.attempts, self.closest = violations, attempts, closest
        left = [f"{name} by {amount:.3g}" for name, amount in violations.items()]
        what = "no flight within the limits was found at all"
        if left:
            what = f"the closest flight violates {', '.join(left)}"
        meshes = " and ".join(dict.fromkeys(str(a.knots) for a in attempts))
        text = f"No plan in {len(attempts)} attempts on {meshes} knots; {what}."
        if closest:
            text += f" Most probably there is none: {closest.describe()}."
        super().__init__(text)

    def __reduce__(self):
        """Pickles by what `PlanningError` holds, not by its message."""
        return type(self), (self.violations, self.attempts, self.closest)


def plan(
    model: GliderModel | Path | str,
    problem: PerchingProblem | None = None,
    knots: Sequence[int] = (25, 41),
    *,
    guess: Guess | None = None,
    progress: Progress | None = None,
    fast: bool = True,
    structured: bool = True,
) -> Plan:
    """Plans a flight of a glider from the launch to the wire.

    Args:
        model: the glider, or the path of its file. Effects' own states start at rest
            in still air.
        problem: what to fly, None for the article's perch; the elevator's limits
            are the vehicle's.
        knots: numbers of knots; each plan is the guess for the next.
        guess: to start from instead of straight lines.
        progress: called with a description of each attempt.
        fast: whether to compile the dynamics.
        structured: whether our own solver goes first, where the dynamics compile; else
            it is Drake's alone.

    Raises:
        InputError: where the glider or the problem cannot be planned for.
        PlanningError: where no attempt succeeds.
    """
    listed = list(knots) if np.iterable(knots) else []
    good = listed and all(isinstance(k, (int, np.integer)) and k >= 3 for k in listed)
    expected = "a list of one whole number or more, each at least 3"
    expect(good, "plan: 'knots'", knots, expected)
    model = as_model(model)
    problem = PerchingProblem() if problem is None else problem
    check_plannable(model, problem)
    dynamics = Dynamics(model, fast)
    if progress and fast:
        progress("the dynamics of this glider (compiled once, then kept on disk)")
        dynamics.rates(np.append(model.initial_state(problem.launch), 0.0)[None])
    ladder = _Ladder(dynamics, problem, max(knots), progress)
    start: Guess | CollocatedFlight | None = guess
    found: Found | None = None
    may_climb = True
    for count in knots:
        found = None
        if structured and dynamics.fast:
            found = ladder.go_first(count, start, is_last=count == knots[-1])
        if found is None and may_climb:
            found = ladder.climb(count, start)
            # Our own solver alone looks at more knots: Drake's take seconds to fail.
            may_climb = found is not None or not (structured and dynamics.fast)
        if isinstance(found, tuple):
            start = to_guess(*found, "the plan on fewer knots")
        else:
            start = found or guess
    if found is None:
        raise PlanningError(ladder.violations(), tuple(ladder.attempts))
    return _finish(dynamics, found, tuple(ladder.attempts))


class _Ladder:
    """Tries one solver and guess after another and records the attempts."""

    def __init__(
        self,
        dynamics: Dynamics,
        problem: PerchingProblem,
        finest: int,
        progress: Progress | None,
    ):
        self._dynamics, self._problem, self._finest = dynamics, problem, finest
        self._progress = progress or silent
        self._near: CollocatedFlight | None = None
        self.attempts: list[Attempt] = []

    def go_first(
        self, knots: int, start: Guess | CollocatedFlight | None, is_last: bool
    ) -> CollocatedFlight | None:
        """Tries our own solver, then again from the flight that comes closest.

        Raises:
            PlanningError: no flight comes to the wire.
        """
        model, problem = self._dynamics.model, self._problem
        tolerance = TOLERANCE if is_last else COARSE_TOLERANCE
        try:
            flight = self._solve_own(
                knots, start or slow_line(model, problem), tolerance
            )
        except UncompilableError:
            self._dynamics.fast = False
            return None
        if flight.solved:
            return flight
        self._progress(f"{self._finest} knots, how close a flight can come")
        closest = find_closest(model, problem, self._finest)
        if closest.is_out_of_reach:
            short = {"position at the wire": float(closest.misses[0])}
            raise PlanningError(short, tuple(self.attempts), closest)
        self._near = closest.flight
        if closest.flight is None:
            return None
        flight = self._solve_own(knots, closest.flight, tolerance)
        return flight if flight.solved else None

    def climb(
        self, knots: int, start: Guess | CollocatedFlight | None
    ) -> Solution | None:
        """Tries Drake's solvers from one guess after another."""
        program = transcribe(self._dynamics, self._problem, knots)
        model = self._dynamics.model
        line = straight_line(model, self._problem)
        way = line.states.end_time()
        if isinstance(start, CollocatedFlight):
            start = flight_to_guess(start)
        for guess in [start, line] if start else [line]:
            for solver in (SnoptSolver, IpoptSolver):
                if found := self._solve(program, knots, solver, guess):
                    return found
        if found := self._solve(program, knots, SnoptSolver, line, LOOSE):
            guess = to_guess(*found, f"{line.name}, solved loosely")
            if found := self._solve(program, knots, SnoptSolver, guess):
                return found
        for dip, stretch in ((0.3, 1.2), (0.0, 0.9), (0.6, 1.4)):
            guess = swoop(model, self._problem, dip, stretch * way)
            if found := self._solve(program, knots, SnoptSolver, guess):
                return found
        return None

    def violations(self) -> dict[str, float]:
        """Violations at the wire by a flight that keeps all other limits, if any."""
        near, problem = self._near, self._problem
        if near is None and self._dynamics.fast:
            line = slow_line(self._dynamics.model, problem)
            near = solve_structured(
                self._dynamics.model, problem, self._finest, line, arrive=False
            )
        if near is None or not near.solved:
            return {}
        return arrival_violations(problem, near.knots[-1])

    def _solve_own(
        self, knots: int, start: Guess | CollocatedFlight, tolerance: float
    ) -> CollocatedFlight:
        self._progress(f"{knots} knots, interior point, from {start.name}")
        flight = solve_structured(
            self._dynamics.model, self._problem, knots, start, tolerance=tolerance
        )
        self.attempts.append(
            Attempt(
                knots=knots,
                solver="interior point",
                guess=start.name,
                tolerance=tolerance,
                solved=flight.solved,
                status=flight.status,
                seconds=flight.seconds,
            )
        )
        return flight

    def _solve(
        self,
        program: DirectCollocation,
        knots: int,
        solver: type[SolverInterface],
        guess: Guess,
        tolerance: float = TOLERANCE,
    ) -> Solution | None:
        name = solver.__name__.removesuffix("Solver").upper()
        self._progress(f"{knots} knots, {name}, from {guess.name}")
        program.SetInitialTrajectory(guess.inputs, guess.states)
        start = time.perf_counter()
        with _quiet():
            result = solver().Solve(program.prog(), None, _options(solver, tolerance))
        seconds = time.perf_counter() - start
        # A solver's own verdict is not enough.
        solved = result.is_success() and not violated(program, result, tolerance)
        self.attempts.append(
            Attempt(
                knots=knots,
                solver=name,
                guess=guess.name,
                tolerance=tolerance,
                solved=solved,
                status=_status(result),
                seconds=seconds,
            )
        )
        return (program, result) if solved else None


@contextlib.contextmanager
def _quiet() -> Iterator[None]:
    """Silences Drake's warnings of failed attempts."""
    log = logging.getLogger("drake")
    level = log.level
    log.setLevel(logging.ERROR)
    try:
        yield
    finally:
        log.setLevel(level)


def _options(solver: type[SolverInterface], tolerance: float) -> SolverOptions:
    options, own = SolverOptions(), solver.id()
    if solver is SnoptSolver:
        options.SetOption(own, "Major feasibility tolerance", tolerance)
        options.SetOption(own, "Major optimality tolerance", tolerance)
        options.SetOption(own, "Elastic weight", ELASTIC_WEIGHT)
        options.SetOption(own, "Major iterations limit", 300)
    else:
        options.SetOption(own, "tol", tolerance)
        options.SetOption(own, "max_iter", 200)
    return options


def _status(result: MathematicalProgramResult) -> str:
    details = result.get_solver_details()
    code = getattr(details, "info", getattr(details, "status", "unknown"))
    return f"{result.get_solution_result().name.lstrip('k')} ({code})"


def _finish(dynamics: Dynamics, found: Found, attempts: tuple[Attempt, ...]) -> Plan:
    if isinstance(found, CollocatedFlight):
        states, inputs = found.knots[:, :-1].copy(), found.knots[:, -1].copy()
        times, cost = found.times, found.cost
    else:
        dc, result = found
        times, states = dc.GetSampleTimes(result), dc.GetStateSamples(result).T
        times, inputs = times - times[0], dc.GetInputSamples(result)[0]
        cost = result.get_optimal_cost()
    slopes = dynamics.rates(np.column_stack([states, inputs]))
    defects = path_defects(dynamics, times, states, slopes, inputs)
    return Plan(
        times=times,
        states=states,
        slopes=slopes,
        inputs=inputs,
        state_names=dynamics.model.state_names,
        cost=cost,
        max_defect=float(defects[POINTS // 2].max()),
        path_defect=float(defects.max()),
        attempts=attempts,
    )


def path_defects(
    dynamics: Dynamics,
    times: np.ndarray,
    states: np.ndarray,
    slopes: np.ndarray,
    inputs: np.ndarray,
) -> np.ndarray:
    """|ẋ - f(x, u)| at POINTS places in each segment of a path, (POINTS, N - 1, n).

    The path is given at its knots: times (N,) [s], states and their slopes (N, n), with
    cubics between, and inputs (N,), with straight lines between.
    """
    s = np.linspace(0.0, 1.0, POINTS + 1)[:-1, None, None]
    h = np.diff(times)[:, None]
    rise, start, end = np.diff(states, axis=0), h * slopes[:-1], h * slopes[1:]
    bend, twist = 3.0 * rise - 2.0 * start - end, start + end - 2.0 * rise
    path = states[:-1] + s * (start + s * (bend + s * twist))
    slope = (start + s * (2.0 * bend + 3.0 * s * twist)) / h
    commands = inputs[:-1, None] + s * np.diff(inputs)[:, None]
    points = np.concatenate([path, commands], axis=2)
    rates = dynamics.rates(points.reshape(-1, points.shape[2]))
    return np.abs(slope - rates.reshape(path.shape))
