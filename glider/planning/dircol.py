"""Plans a perch by direct collocation: first on few knots, then on more.

A ladder of attempts: first our own solver, which takes the stages one by one. Where it
fails, a search from many guesses determines whether the wire can be reached at all; if
so, Drake's solvers, other guesses and a looser tolerance are tried. The plan records
what was tried.
"""

import contextlib
import logging
import time
from collections.abc import Callable, Iterator, Sequence
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
from glider.planning.audit import path_defect, segment_drift
from glider.planning.guess import Guess, straight_line, swoop
from glider.planning.plan import Attempt, Plan
from glider.planning.point_dynamics import Dynamics
from glider.planning.problem import PerchingProblem
from glider.planning.reach import Closest, find_closest
from glider.planning.structured import (
    COARSE_TOLERANCE,
    STRETCH,
    CollocatedFlight,
    solve_structured,
)
from glider.planning.structured import to_guess as flight_to_guess
from glider.planning.transcription import (
    arrival_violations,
    check_plannable,
    to_guess,
    transcribe,
    violated,
)

TOLERANCE = 1e-6
"""Tolerance of constraints and optimality, as the solvers scale them."""

LOOSE = 1e-3
"""Tolerance of an attempt whose result is only a better guess."""

ELASTIC_WEIGHT = 100.0
"""Weight of SNOPT's infeasibilities against the cost. Its own default, 1e4, makes five
times as many iterations of this problem."""

Progress = Callable[[str], None]
Solution = tuple[DirectCollocation, MathematicalProgramResult]
Found = Solution | CollocatedFlight


class PlanningError(RuntimeError):
    """No attempt found a plan.

    Attributes:
        violations: the constraints at the wire that the closest flight found
            violates, and by how much [m, rad or m/s]; empty where there is none.
        attempts: what was tried.
        arrived: whether some flight kept every constraint, but no solver went on
            from it to one of least cost. If not, and without violations, no flight
            within the limits was found at all.
        closest: result of a search from many guesses, None where there was none.
    """

    def __init__(
        self,
        violations: dict[str, float],
        attempts: tuple[Attempt, ...],
        arrived: bool = False,
        closest: Closest | None = None,
    ):
        """Composes the message of the attributes."""
        self.closest = closest
        self.violations = violations
        self.attempts = attempts
        self.arrived = arrived
        left = [f"{name} by {amount:.3g}" for name, amount in violations.items()]
        if arrived:
            what = "a flight that arrives was found, but no solver finished from it"
        elif left:
            what = f"the closest flight violates {', '.join(left)}"
        else:
            what = "no flight within the limits was found at all"
        meshes = " and ".join(dict.fromkeys(str(a.knots) for a in attempts))
        text = f"No plan in {len(attempts)} attempts on {meshes} knots; {what}."
        if closest:
            text += f" Most probably there is none: {closest.describe()}."
        super().__init__(text)

    def __reduce__(self):
        """Pickles by what `PlanningError` holds, not by its message."""
        return type(self), (self.violations, self.attempts, self.arrived, self.closest)


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
    good = knots and min(knots) >= 3
    expect(good, "plan: 'knots'", tuple(knots), "one number or more, each at least 3")
    model = as_model(model)
    problem = PerchingProblem() if problem is None else problem
    check_plannable(model, problem)
    dynamics = Dynamics(model, fast)
    if progress and fast:
        progress("the dynamics of this glider (compiled once, then kept on disk)")
        dynamics.rates(np.append(model.initial_state(problem.launch), 0.0)[None])
    ladder = _Ladder(dynamics, problem, max(knots), progress)
    found: Found | None = None
    for count in knots:
        flight = None
        if structured and dynamics.fast:
            is_last = count == knots[-1]
            start = found if isinstance(found, CollocatedFlight) else guess
            flight = ladder.go_first(count, start, is_last)
            if flight is None and dynamics.fast:
                near = ladder.come_close()
                flight = ladder.go_first(count, near, is_last) if near else None
        if flight is not None:
            found = flight
        elif isinstance(found, CollocatedFlight):
            found = ladder.climb(count, flight_to_guess(found))
        else:
            warm = guess
            if found is not None:
                warm = to_guess(*found, "the plan on fewer knots")
            found = ladder.climb(count, warm)
    assert found is not None
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
        self._progress = progress or (lambda text: None)
        self.attempts: list[Attempt] = []

    def go_first(
        self, knots: int, start: Guess | CollocatedFlight | None, is_last: bool
    ) -> CollocatedFlight | None:
        """Tries our own solver; returns None where it fails."""
        if start is None:
            model, problem = self._dynamics.model, self._problem
            way = straight_line(model, problem).states.end_time()
            start = straight_line(model, problem, STRETCH * way)
        tolerance = TOLERANCE if is_last else COARSE_TOLERANCE
        self._progress(f"{knots} knots, interior point, from {start.name}")
        try:
            flight = solve_structured(
                self._dynamics.model, self._problem, knots, start, tolerance=tolerance
            )
        except UncompilableError:
            self._dynamics.fast = False
            return None
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
        return flight if flight.solved else None

    def come_close(self) -> CollocatedFlight | None:
        """Returns the flight that comes closest to the wire, on the most knots.

        Raises:
            PlanningError: no flight comes to the wire.
        """
        self._progress(f"{self._finest} knots, how close a flight can come")
        model, problem = self._dynamics.model, self._problem
        closest = find_closest(model, problem, self._finest)
        if closest.is_out_of_reach:
            short = {"position at the wire": float(closest.misses[0])}
            raise PlanningError(short, tuple(self.attempts), closest=closest)
        return closest.flight

    def climb(self, knots: int, warm: Guess | None) -> Solution:
        """Returns a solved program; raises PlanningError after the last rung."""
        program = transcribe(self._dynamics, self._problem, knots)
        model = self._dynamics.model
        line = straight_line(model, self._problem)
        way = line.states.end_time()
        arcs = [
            swoop(model, self._problem, dip, stretch * way)
            for dip, stretch in ((0.3, 1.2), (0.0, 0.9), (0.6, 1.4))
        ]
        for guess in [line] if warm is None else [warm, line]:
            for solver in (SnoptSolver, IpoptSolver):
                if found := self._solve(program, knots, solver, guess):
                    return found
        if found := self._solve(program, knots, SnoptSolver, line, LOOSE):
            guess = to_guess(*found, f"{line.name}, solved loosely")
            if found := self._solve(program, knots, SnoptSolver, guess):
                return found
        for guess in arcs:
            if found := self._solve(program, knots, SnoptSolver, guess):
                return found
        return self._arrive_first(program, knots, [line, *arcs])

    def _arrive_first(
        self,
        program: DirectCollocation,
        knots: int,
        guesses: list[Guess],
        violations: dict[str, float] | None = None,
    ) -> Solution:
        """Looks for any flight that arrives; if one does, starts from there.

        If none does on few knots, goes on from the closest on the most of them.
        `violations` are those of the closest flight before.
        """
        relaxed = transcribe(self._dynamics, self._problem, knots, arrive=False)
        closest: Guess | None = None
        least = np.inf
        for guess in guesses:
            near = self._solve(relaxed, knots, SnoptSolver, guess, LOOSE)
            if near is None:
                continue
            total = near[1].get_optimal_cost()
            if violations and abs(total - least) < 0.01 * least:
                break  # Two guesses lead to the same place, short of the wire.
            if total >= least:
                continue
            least, violations = total, arrival_violations(*near, self._problem)
            closest = to_guess(*near, "the flight that comes closest")
            if not violations:
                feasible = to_guess(*near, "a flight that arrives")
                for solver in (SnoptSolver, IpoptSolver):
                    if found := self._solve(program, knots, solver, feasible):
                        return found
                raise PlanningError({}, tuple(self.attempts), arrived=True)
        if knots < self._finest:
            finest = self._finest
            program = transcribe(self._dynamics, self._problem, finest)
            guesses = guesses if closest is None else [closest]
            return self._arrive_first(program, finest, guesses, violations)
        raise PlanningError(violations or {}, tuple(self.attempts))

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
    """Silences Drake's warnings of failed attempts, which the ladder handles."""
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


def _path_of(found: Found) -> tuple[np.ndarray, np.ndarray, np.ndarray, float]:
    """Returns times (N,), states (N, n), inputs (N,) and cost of either solver's."""
    if isinstance(found, CollocatedFlight):
        states, inputs = found.knots[:, :-1].copy(), found.knots[:, -1].copy()
        return found.times, states, inputs, found.cost
    dc, result = found
    times, states = dc.GetSampleTimes(result), dc.GetStateSamples(result).T
    inputs = dc.GetInputSamples(result)[0]
    return times - times[0], states, inputs, result.get_optimal_cost()


def _finish(dynamics: Dynamics, found: Found, attempts: tuple[Attempt, ...]) -> Plan:
    times, states, inputs, cost = _path_of(found)
    slopes = dynamics.rates(np.column_stack([states, inputs]))
    middle = np.array([0.5])
    at_middle = path_defect(dynamics, times, states, slopes, inputs, middle)
    return Plan(
        times=times,
        states=states,
        slopes=slopes,
        inputs=inputs,
        state_names=dynamics.model.state_names,
        cost=cost,
        max_defect=float(at_middle.max()),
        path_defect=float(path_defect(dynamics, times, states, slopes, inputs).max()),
        drift=float(segment_drift(dynamics, times, states, inputs).max()),
        attempts=attempts,
    )
