"""A plan held against Drake's own program: feasible, and a minimum as far as slopes go.

The defects are those of Drake's DirectCollocationConstraint over `GliderPlant`, whose
compiled slopes tests/systems/test_plant.py holds against the plain formulas.
"""

import dataclasses

import numpy as np
from pydrake.autodiffutils import ExtractGradient, ExtractValue, InitializeAutoDiff
from pydrake.planning import DirectCollocation
from scipy.optimize import lsq_linear

from glider.physics.model import GliderModel
from glider.planning.plan import Plan
from glider.planning.problem import PerchingProblem
from glider.planning.program import perching_program

ACTIVE = 1e-3
"""Distance from a bound within which it may push. Where an interior-point method
ends, the product of distance and push is 1e-7."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Optimality:
    """Karush-Kuhn-Tucker conditions of Drake's program at a plan."""

    violation: float
    """Largest violation of a constraint, defects as Drake writes them."""

    slope: float
    """Largest entry of the Lagrangian's slope, relative to the cost's, with the
    multipliers that make its square least; those of bounds push inwards alone."""

    cost: float
    """Cost in Drake's program."""


def check_optimality(
    model: GliderModel, problem: PerchingProblem, plan: Plan
) -> Optimality:
    """Evaluates Drake's program of a problem at a plan of it.

    Args:
        model: the glider.
        problem: that was planned for.
        plan: by direct collocation.
    """
    knots = len(plan.times)
    dc = perching_program(model, problem, knots)
    program = dc.prog()
    point = _values_of(dc, plan)
    slope, cost = np.zeros(len(point)), 0.0
    for binding in program.GetAllCosts():
        value, gradient, at = _linearize(program, binding, point)
        cost += value[0]
        slope[at] += gradient[0]
    rows, lows, highs, violation = [], [], [], 0.0
    for binding in program.GetAllConstraints():
        value, gradient, at = _linearize(program, binding, point)
        low = binding.evaluator().lower_bound()
        high = binding.evaluator().upper_bound()
        violation = max(violation, float(np.max(value - high)))
        violation = max(violation, float(np.max(low - value)))
        for i in np.flatnonzero((value < low + ACTIVE) | (value > high - ACTIVE)):
            row = np.zeros(len(point))
            row[at] += gradient[i]
            rows.append(row)
            lows.append(0.0 if value[i] < high[i] - ACTIVE else -np.inf)
            highs.append(0.0 if value[i] > low[i] + ACTIVE else np.inf)
    fit = lsq_linear(np.array(rows).T, slope, (lows, highs), method="bvls")
    left = np.abs(fit.fun).max() / np.abs(slope).max()
    return Optimality(violation=violation, slope=float(left), cost=float(cost))


def _values_of(dc: DirectCollocation, plan: Plan) -> np.ndarray:
    program, steps = dc.prog(), np.diff(plan.times)
    point = np.empty(program.num_vars())
    parts = [(dc.time_step(k), steps[k]) for k in range(len(steps))]
    parts += [(dc.state(k), x) for k, x in enumerate(plan.states)]
    parts += [(dc.input(k), u) for k, u in enumerate(plan.inputs)]
    for variables, values in parts:
        at = program.FindDecisionVariableIndices(np.ravel(variables))
        point[at] = values
    return point


def _linearize(program, binding, point):
    """Returns value and slopes of a cost or constraint and where its variables are."""
    at = program.FindDecisionVariableIndices(binding.variables())
    value = binding.evaluator().Eval(InitializeAutoDiff(point[at])[:, 0])
    slopes = ExtractGradient(value)
    if slopes.shape[1] == 0:
        slopes = np.zeros((len(value), len(at)))
    return ExtractValue(value)[:, 0], slopes, at
