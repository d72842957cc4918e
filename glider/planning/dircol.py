"""Plans a perch by Drake's direct collocation."""

import contextlib
import dataclasses
import logging
import time
from collections.abc import Iterator, Sequence
from pathlib import Path as FilePath

import numpy as np
from pydrake.solvers import MathematicalProgramResult, SnoptSolver, SolverOptions

from glider.errors import InputError, expect, show
from glider.physics.flown_range import warn_beyond
from glider.physics.model import GliderModel, as_model
from glider.physics.parameters import GliderParameters
from glider.planning.constraints import Violation, constraints_of, find_violations
from glider.planning.path import Path
from glider.planning.plan import Plan
from glider.planning.problem import PerchingProblem
from glider.planning.program import perching_program
from glider.progress import Progress, silent

_SAME = 1e-3  # Difference of two angles of an elevator that is rounding [rad].
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


class PlanningError(InputError):
    """No plan was found.

    Attributes:
        status: of the solver, and what may be the cause, if that is known.
        violations: what the path found violates, the largest amount in SI units first.
    """

    def __init__(self, status: str, violations: list[Violation]):
        """Composes the message of the attributes."""
        self.status = status
        self.violations = violations
        text = f"No plan (SNOPT: {status}). "
        if violations:
            worst = violations[0]
            text += f"The path found violates '{worst.name}' the most, "
            text += f"by {worst.size}."
        super().__init__(text)

    def __reduce__(self):
        """Pickles by what `PlanningError` holds, not by its message."""
        return type(self), (self.status, self.violations)


def plan(
    model: GliderModel | FilePath | str,
    problem: PerchingProblem | None = None,
    knots: int = 41,
    *,
    progress: Progress = silent,
) -> Plan:
    """Plans a flight of a glider from the launch to the wire.

    Args:
        model: the glider, or the path of its file. Effects' own states start at rest
            in still air.
        problem: what to fly, None for the article's perch; the elevator's limits
            are the vehicle's.
        knots: number of knots, at least 3.
        progress: called with a line of text when the work begins.

    Raises:
        InputError: where the glider or the problem cannot be planned for.
        PlanningError: where no plan is found.
    """
    good = isinstance(knots, (int, np.integer)) and knots >= 3
    expect(good, "plan: 'knots'", knots, "a whole number, at least 3")
    model = as_model(model)
    problem = PerchingProblem() if problem is None else problem
    progress(f"planning on {knots} knots")
    begin = time.perf_counter()
    dc = perching_program(model, problem, knots)
    with _quiet():
        result = SnoptSolver().Solve(dc.prog(), None, _options())
    times = dc.GetSampleTimes(result)
    states = dc.GetStateSamples(result).T
    inputs = dc.GetInputSamples(result)[0]
    path = Path(model, times - times[0], states, inputs)
    constraints = constraints_of(problem, model.parameters.servo)
    violations = find_violations(constraints, path)
    worst = violations[0].amount if violations else 0.0
    if not result.is_success() or worst > _KEPT:
        raise PlanningError(_status(result) + _cause(model), violations)
    warn_beyond("The plan", model, path.times, states, inputs)
    return Plan(
        times=path.times,
        states=states.copy(),
        slopes=path.slopes,
        inputs=inputs.copy(),
        state_names=model.state_names,
        cost=result.get_optimal_cost(),
        seconds=time.perf_counter() - begin,
    )


def can_perch(
    model: GliderModel, problem: PerchingProblem, launch: Sequence[float]
) -> bool:
    """Determines whether `plan` finds a plan from a launch (7,) to the wire.

    On fewer knots than it, in half the time.

    Raises:
        InputError: the launch is no state, or outside the problem's limits.
    """
    own = dataclasses.replace(problem, launch=list(launch))
    try:
        plan(model, own, _FEW)
    except PlanningError:
        return False
    return True


@contextlib.contextmanager
def _quiet() -> Iterator[None]:
    """Silences Drake's warnings of solves that fail."""
    log = logging.getLogger("drake")
    level = log.level
    log.setLevel(logging.ERROR)
    try:
        yield
    finally:
        log.setLevel(level)


def _options() -> SolverOptions:
    options = SolverOptions()
    own = SnoptSolver.id()
    options.SetOption(own, "Major feasibility tolerance", _TOLERANCE)
    options.SetOption(own, "Major optimality tolerance", _TOLERANCE)
    options.SetOption(own, "Elastic weight", _ELASTIC_WEIGHT)
    options.SetOption(own, "Major iterations limit", 300)
    return options


def _cause(model: GliderModel) -> str:
    """What may be why a glider has no plan: that its elevator turns little."""
    own, usual = model.parameters.servo, GliderParameters().servo
    if own.low < usual.low + _SAME and own.high > usual.high - _SAME:
        return ""
    limits = show(own[:2])
    return (
        f"; the glider's elevator_limits, {limits} rad, are narrower than the default "
        "glider's"
    )


def _status(result: MathematicalProgramResult) -> str:
    code = result.get_solver_details().info
    return f"{result.get_solution_result().name.lstrip('k')} ({code})"
