"""Plans a perch by Drake's direct collocation: first on few knots, then on more."""

import contextlib
import dataclasses
import logging
import time
from collections.abc import Iterator, Sequence
from pathlib import Path as FilePath

import numpy as np
from pydrake.solvers import MathematicalProgramResult, SnoptSolver, SolverOptions

from glider.errors import expect
from glider.physics.flown_range import warn_beyond
from glider.physics.model import GliderModel, as_model
from glider.planning.constraints import Violation, constraints_of, find_violations
from glider.planning.path import Path
from glider.planning.plan import Attempt, Plan
from glider.planning.problem import PerchingProblem
from glider.planning.program import perching_program
from glider.progress import Progress, silent

_TOLERANCE = 1e-6
"""Tolerance of constraints and optimality, as the solver scales them."""

_KEPT = 1e-4
"""Amount by which a plan may violate a constraint [SI]: SNOPT scales what it tests, so
its own verdict is not enough."""

_ELASTIC_WEIGHT = 100.0
"""Weight of SNOPT's infeasibilities against the cost. Its own default, 1e4, makes five
times as many iterations of this problem."""

_FEW = 25
"""Knots that show whether there is a plan."""


class PlanningError(RuntimeError):
    """No attempt found a plan.

    Attributes:
        attempts: what was tried.
        violations: what the best path found violates, the largest amount in SI units
            first.
    """

    def __init__(self, attempts: tuple[Attempt, ...], violations: list[Violation]):
        """Composes the message of the attributes."""
        self.attempts = attempts
        self.violations = violations
        tried = [f"{a.solver} on {a.knots} knots: {a.status}" for a in attempts]
        text = f"No plan ({'; '.join(tried)}). "
        if violations:
            worst = violations[0]
            text += f"The best path found violates '{worst.name}' the most, "
            text += f"by {worst.size}."
        super().__init__(text)

    def __reduce__(self):
        """Pickles by what `PlanningError` holds, not by its message."""
        return type(self), (self.attempts, self.violations)


def plan(
    model: GliderModel | FilePath | str,
    problem: PerchingProblem | None = None,
    knots: Sequence[int] = (25, 41),
    *,
    progress: Progress = silent,
) -> Plan:
    """Plans a flight of a glider from the launch to the wire.

    Args:
        model: the glider, or the path of its file. Effects' own states start at rest
            in still air.
        problem: what to fly, None for the article's perch; the elevator's limits
            are the vehicle's.
        knots: numbers of knots; each plan is the guess for the next.
        progress: called with a description of each attempt.

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
    attempts: list[Attempt] = []
    reached: list[list[Violation]] = []
    start: Plan | None = None
    for count in listed:
        progress(f"{count} knots, from {_name(start)}")
        found, violations = _solve(model, problem, count, start)
        attempts += found.attempts
        reached.append(violations)
        if found.attempts[-1].solved:
            start = found
    if not attempts[-1].solved:
        best = min(reached, key=lambda found: found[0].amount if found else 0.0)
        raise PlanningError(tuple(attempts), best)
    warn_beyond("The plan", model, found.times, found.states, found.inputs)
    return dataclasses.replace(found, attempts=tuple(attempts))


def can_perch(
    model: GliderModel, problem: PerchingProblem, launch: Sequence[float]
) -> bool:
    """Determines whether `plan` finds a plan from a launch (7,) to the wire.

    Raises:
        InputError: the launch is no state, or outside the problem's limits.
    """
    own = dataclasses.replace(problem, launch=list(launch))
    found, _ = _solve(model, own, _FEW)
    return found.attempts[-1].solved


def _solve(
    model: GliderModel, problem: PerchingProblem, knots: int, start: Plan | None = None
) -> tuple[Plan, list[Violation]]:
    """Solves Drake's program once; returns the path found and what it violates."""
    begin = time.perf_counter()
    dc = perching_program(model, problem, knots)
    if start is not None:
        dc.SetInitialTrajectory(start.input_trajectory, start.state_trajectory)
    with _quiet():
        result = SnoptSolver().Solve(dc.prog(), None, _options())
    times = dc.GetSampleTimes(result)
    states = dc.GetStateSamples(result).T
    inputs = dc.GetInputSamples(result)[0]
    path = Path(model, times - times[0], states, inputs)
    constraints = constraints_of(problem, model.parameters.servo)
    violations = find_violations(constraints, path)
    worst = violations[0].amount if violations else 0.0
    attempt = Attempt(
        knots=knots,
        solver="SNOPT",
        guess=_name(start),
        tolerance=_TOLERANCE,
        solved=result.is_success() and worst <= _KEPT,
        status=_status(result),
        seconds=time.perf_counter() - begin,
    )
    found = Plan(
        times=path.times,
        states=states.copy(),
        slopes=path.slopes,
        inputs=inputs.copy(),
        state_names=model.state_names,
        cost=result.get_optimal_cost(),
        attempts=(attempt,),
    )
    return found, violations


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


def _name(start: Plan | None) -> str:
    return "a straight line" if start is None else "the plan on fewer knots"


def _options() -> SolverOptions:
    options = SolverOptions()
    own = SnoptSolver.id()
    options.SetOption(own, "Major feasibility tolerance", _TOLERANCE)
    options.SetOption(own, "Major optimality tolerance", _TOLERANCE)
    options.SetOption(own, "Elastic weight", _ELASTIC_WEIGHT)
    options.SetOption(own, "Major iterations limit", 300)
    return options


def _status(result: MathematicalProgramResult) -> str:
    code = result.get_solver_details().info
    return f"{result.get_solution_result().name.lstrip('k')} ({code})"
