"""Direct collocation of a perching problem, as a MathematicalProgram of Drake.

Drake's DirectCollocation holds variables, costs and trajectories. Its defect
constraints call the plant through Python three times a segment; here they are
replaced by the same formula over the compiled dynamics with exact Jacobians.
"""

import numpy as np
from pydrake.autodiffutils import (
    AutoDiffXd,
    ExtractGradient,
    ExtractValue,
    InitializeAutoDiff,
)
from pydrake.planning import DirectCollocation, DirectCollocationConstraint
from pydrake.solvers import MathematicalProgramResult

from glider.compiled.collocation import LOOPS as POINTS
from glider.compiled.jacobian import differentiate, stacked
from glider.compiled.kernel import CompileError, UncompilableError
from glider.errors import InputError, expect
from glider.physics.model import GliderModel
from glider.physics.parameters import check_units
from glider.physics.state import STATE_NAMES
from glider.planning.guess import Guess
from glider.planning.problem import PerchingProblem
from glider.systems.plant import GliderPlant


class Dynamics:
    """ẋ = f(x, u) of a glider in still air, at time 0.

    Attributes:
        model: the glider.
        num_states: n, with the effects' own states.
        fast: whether it is compiled; False once a formula turns out not to compile.
            Then it is the formulas as they are, with AutoDiffXd.
    """

    def __init__(self, model: GliderModel, fast: bool = True) -> None:
        self.model, self.num_states, self.fast = model, model.num_states, fast
        self._theta, self._derivatives = model.numbers, model.chain.derivatives
        self._z = stacked(model)
        self._all = np.asfortranarray(np.eye(self.num_states + 1))
        self._none = np.empty((0, 0))

    def evaluate(self, x, u):
        """Returns f, shape (n,)."""
        return self._differentiate(x, u, self._none)[0]

    def linearize(self, x, u):
        """Returns f (n,) and its slopes by state and input (n, n + 1)."""
        return self._differentiate(x, u, self._all)

    def rates(self, points: np.ndarray) -> np.ndarray:
        """Returns f (P, n) at many points (P, n + 1) of state and input."""
        found = np.empty((len(points), self.num_states))
        if self.fast:
            try:
                POINTS.over(self.model.kinds, self.model.has_field).rates_at(
                    np.ascontiguousarray(points), self._theta, found
                )
                return found
            except CompileError:
                self.fast = False
        for k, point in enumerate(points):
            found[k] = self.evaluate(point[:-1], point[-1])
        return found

    def _differentiate(self, x, u, directions):
        n = self.num_states
        if self.fast:
            self._z[:n], self._z[n] = x, u
            try:
                return differentiate(self.model, 0.0, self._z, directions)
            except UncompilableError:
                self.fast = False
        z = InitializeAutoDiff(np.append(x, u))[:, 0]
        rates = np.array(self._derivatives(0.0, z[:-1], z[-1], 0.0, 0.0, self._theta))
        return ExtractValue(rates)[:, 0], ExtractGradient(rates)


def hermite_simpson(linearize, h, x0, x1, u0, u1):
    """Returns the defect of a segment and its Jacobian.

    With f₀, f₁ at the ends, x_c = (x₀ + x₁)/2 + h (f₀ - f₁)/8 and
    u_c = (u₀ + u₁)/2, the cubic through the ends has at its middle the slope
    3 (x₁ - x₀)/(2 h) - (f₀ + f₁)/4, and the defect is this minus f(x_c, u_c).

    `linearize` gives f (n,) and its slopes (n, n + 1) at (x, u); h is the segment's
    length [s]. The Jacobian is by h, x0, x1, u0, u1: (n, 1 + n + n + 1 + 1).
    """
    n = len(x0)
    f0, slopes0 = linearize(x0, u0)
    f1, slopes1 = linearize(x1, u1)
    middle, slopes = linearize(0.5 * (x0 + x1) + h / 8 * (f0 - f1), 0.5 * (u0 + u1))
    a, b = slopes[:, :n], slopes[:, n]
    by_0 = -0.25 * slopes0 - (h / 8) * (a @ slopes0)
    by_1 = -0.25 * slopes1 + (h / 8) * (a @ slopes1)
    own = 1.5 / h * np.eye(n)
    jacobian = np.empty((n, 2 * n + 3))
    jacobian[:, 0] = -1.5 / h**2 * (x1 - x0) - a @ (f0 - f1) / 8
    jacobian[:, 1 : n + 1] = by_0[:, :n] - own - 0.5 * a
    jacobian[:, n + 1 : 2 * n + 1] = by_1[:, :n] + own - 0.5 * a
    jacobian[:, 2 * n + 1] = by_0[:, n] - 0.5 * b
    jacobian[:, 2 * n + 2] = by_1[:, n] - 0.5 * b
    return 1.5 / h * (x1 - x0) - 0.25 * (f0 + f1) - middle, jacobian


def check_plannable(model: GliderModel, problem: PerchingProblem) -> None:
    """Raises InputError where direct collocation cannot take a problem.

    The glider varies in time, its mass and inertia cannot be of one glider, or the
    launch is outside the problem's own limits.
    """
    check_units(vars(model.parameters))
    if model.is_time_varying:
        raise InputError(
            "plan: the glider's motion depends on time, which direct collocation does "
            "not support; expected a field over x instead."
        )
    for i, (name, (low, high)) in enumerate(_limits(model, problem).items()):
        value, between = problem.launch[i], f"a value from {low:g} to {high:g}"
        expect(low <= value <= high, f"plan: the launch's {name}", value, between)


def _limits(model, problem):
    """Returns the bounds of the first states over the whole flight, by name."""
    servo = model.parameters.servo
    return {
        "x": problem.x_limits,
        "z": problem.z_limits,
        "pitch": problem.pitch_limits,
        "elevator": (servo.low, servo.high),
    }


def transcribe(
    dynamics: Dynamics, problem: PerchingProblem, knots: int
) -> DirectCollocation:
    """Builds the program of a problem with equal steps between so many knots.

    Every constraint has a name, which `violated` reports. Where the dynamics are not
    fast, Drake's own defects stay.

    Raises:
        InputError: see `check_plannable`.
    """
    model = dynamics.model
    check_plannable(model, problem)
    low, high = np.array(problem.duration_limits) / knots
    launch = model.initial_state(problem.launch)
    dynamics.linearize(launch, 0.0)  # Shows whether they compile.
    plant = GliderPlant(model, fast=dynamics.fast)
    dc = DirectCollocation(plant, plant.CreateDefaultContext(), knots, low, high)
    dc.AddEqualTimeIntervalsConstraints()
    if dynamics.fast:
        _compile_defects(dc, knots, dynamics)
    else:
        for k, binding in enumerate(_defects(dc)):
            binding.evaluator().set_description(f"defect of segment {k}")
    _add_limits(dc, knots, model, problem)
    _bound(dc, dc.initial_state(), launch, launch, "launch")
    for name, (part, low, high) in _arrival(problem).items():
        _bound(dc, dc.final_state()[part], low, high, name)
    dc.AddRunningCost(problem.rate_cost * dc.input()[0] ** 2)
    final = dc.final_state()[: len(STATE_NAMES)]
    weights = np.diag(problem.goal_weights)
    dc.prog().AddQuadraticErrorCost(weights, np.array(problem.goal), final)
    return dc


def violated(
    dc: DirectCollocation, result: MathematicalProgramResult, tolerance: float
) -> tuple[str, ...]:
    """Returns the names of the constraints that a result does not meet.

    Solvers scale what they test, so ten times their tolerance is allowed, or 1e-4.
    """
    allowed = max(10.0 * tolerance, 1e-4)
    names = result.GetInfeasibleConstraintNames(dc.prog(), tol=allowed)
    return tuple(dict.fromkeys(name.split("[")[0].strip() for name in names))


def to_guess(
    dc: DirectCollocation, result: MathematicalProgramResult, name: str
) -> Guess:
    """A solver's result as a guess, for another number of knots too."""
    return Guess(
        name=name,
        states=dc.ReconstructStateTrajectory(result),
        inputs=dc.ReconstructInputTrajectory(result),
    )


def _defects(dc):
    return [
        binding
        for binding in dc.prog().generic_constraints()
        if isinstance(binding.evaluator(), DirectCollocationConstraint)
    ]


def _compile_defects(dc, knots, dynamics):
    n, program = dynamics.num_states, dc.prog()

    def defect(variables):
        is_float = variables.dtype != object
        z = variables if is_float else ExtractValue(variables)[:, 0]
        value, jacobian = hermite_simpson(
            dynamics.linearize,
            z[0],
            z[1 : n + 1],
            z[n + 1 : 2 * n + 1],
            z[2 * n + 1],
            z[2 * n + 2],
        )
        if is_float:
            return value
        slopes = jacobian @ ExtractGradient(variables)
        return np.fromiter(map(AutoDiffXd, value.tolist(), slopes), object, n)

    for binding in _defects(dc):
        program.RemoveConstraint(binding)
    zero = np.zeros(n)
    for k in range(knots - 1):
        ends = [dc.state(k), dc.state(k + 1), dc.input(k), dc.input(k + 1)]
        variables = np.concatenate([np.ravel(dc.time_step(k)), *ends])
        name = f"defect of segment {k}"
        program.AddConstraint(defect, zero, zero, variables, name)


def _bound(dc, variables, low, high, name):
    size = len(variables)
    binding = dc.prog().AddBoundingBoxConstraint(
        np.broadcast_to(low, size), np.broadcast_to(high, size), variables
    )
    binding.evaluator().set_description(name)


def _add_limits(dc, knots, model, problem):
    for i, (name, (low, high)) in enumerate(_limits(model, problem).items()):
        path = np.array([dc.state(k)[i] for k in range(knots)])
        _bound(dc, path, low, high, f"{name} limits")
    inputs = np.array([dc.input(k)[0] for k in range(knots)])
    rate = model.parameters.servo.rate
    _bound(dc, inputs, -rate, rate, "elevator rate limit")


def _arrival(
    problem: PerchingProblem,
) -> dict[str, tuple[slice, float | list[float], float | list[float]]]:
    """States at the wire and their bounds, by name."""
    place, speed = problem.wire, problem.final_speed_limit
    low, high = problem.final_pitch_limits
    return {
        "position at the wire": (slice(2), place, place),
        "pitch at the wire": (slice(2, 3), low, high),
        "speed at the wire": (slice(4, 6), -speed, speed),
    }


def arrival_violations(problem: PerchingProblem, state: np.ndarray) -> dict[str, float]:
    """By how much a last state (n,) misses the bounds at the wire, where it does."""
    violations = {}
    for name, (part, low, high) in _arrival(problem).items():
        value = state[part]
        excess = np.maximum(value - high, np.asarray(low) - value).max()
        if excess > 1e-4:
            violations[name] = float(excess)
    return violations
