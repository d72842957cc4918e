"""A perching problem as a program of Drake, for costs and constraints of one's own."""

import numpy as np
from pydrake.planning import DirectCollocation
from pydrake.trajectories import PiecewisePolynomial

from glider.errors import expect
from glider.physics.model import GliderModel, as_model
from glider.physics.state import NUM_STATES
from glider.planning.constraints import check_plannable, constraints_of
from glider.planning.problem import PerchingProblem
from glider.systems.plant import GliderPlant


def perching_program(
    model: GliderModel, problem: PerchingProblem | None = None, knots: int = 41
) -> DirectCollocation:
    """Builds Drake's direct collocation of a problem, with equal steps between knots.

    It holds the problem's costs, its constraints and straight lines as a guess: add
    what else you ask for, and hand its `prog()` to a solver of Drake. Every constraint
    of the problem has a description, as `GetInfeasibleConstraintNames` shows it.

    Args:
        model: the glider, in still air.
        problem: what to fly, None for the article's perch; the elevator's limits are
            the vehicle's.
        knots: number of knots, at least 2.

    Raises:
        InputError: where the glider or the problem cannot be planned for.
    """
    model = as_model(model)
    problem = PerchingProblem() if problem is None else problem
    check_plannable(model, problem)
    expect(knots >= 2, "perching_program: 'knots'", knots, "2 or more")
    constraints = constraints_of(problem, model.parameters.servo)
    plant = GliderPlant(model)
    shortest = constraints.duration.low / knots
    longest = constraints.duration.high / knots
    dc = DirectCollocation(
        plant, plant.CreateDefaultContext(), knots, shortest, longest
    )
    dc.AddEqualTimeIntervalsConstraints()
    launch = model.initial_state(problem.launch)
    _bound(dc, dc.initial_state(), launch, launch, "launch")
    states = np.array([dc.state(k) for k in range(knots)])
    inputs = np.array([dc.input(k)[0] for k in range(knots)])
    for bound in constraints.path:
        _bound(dc, states[:, bound.state], bound.low, bound.high, bound.name)
    for bound in constraints.arrival:
        _bound(dc, states[-1:, bound.state], bound.low, bound.high, bound.name)
    rate = constraints.command
    _bound(dc, inputs, rate.low, rate.high, rate.name)
    dc.AddRunningCost(problem.rate_cost * dc.input()[0] ** 2)
    weights = np.diag(problem.goal_weights)
    final = dc.final_state()[:NUM_STATES]
    dc.prog().AddQuadraticErrorCost(weights, np.array(problem.goal), final)
    ends = [0.0, straight_duration(problem)]
    goal = model.initial_state(problem.goal)
    line = PiecewisePolynomial.FirstOrderHold(ends, np.column_stack([launch, goal]))
    dc.SetInitialTrajectory(
        PiecewisePolynomial.FirstOrderHold(ends, np.zeros((1, 2))), line
    )
    return dc


def straight_duration(problem: PerchingProblem) -> float:
    """Time from the launch straight to the wire, at 5/8 of the speed [s]."""
    x, z = np.subtract(problem.wire, problem.launch[:2])
    xdot, zdot = problem.launch[4:6]
    duration = 1.6 * np.hypot(x, z) / np.hypot(xdot, zdot)
    shortest, longest = problem.duration_limits
    return float(np.clip(duration, shortest, longest))


def _bound(dc, variables, low, high, name):
    size = len(variables)
    binding = dc.prog().AddBoundingBoxConstraint(
        np.broadcast_to(low, size), np.broadcast_to(high, size), variables
    )
    binding.evaluator().set_description(name)
