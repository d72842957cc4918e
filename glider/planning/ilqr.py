"""Plans by iterative LQR: a fixed number of steps towards a goal, with feedback.

Where `glider.planning.dircol` asks for a flight that arrives, this asks for one
that ends as near to a goal as it can, at a fixed time; it is done in
milliseconds, gives a feedback along with the flight, and so suits loops that plan
again and again.
"""

import dataclasses
import functools
import math
import time
from typing import Any

import numpy as np

from glider.compiled.kernel import compiled
from glider.errors import InputError
from glider.physics.parameters import parameter_vector
from glider.physics.state import NUM_STATES
from glider.systems.plant import initial_state

ITERATIONS = 500
"""A plan that still improves after so many has not converged."""

SHARES = tuple(0.5**k for k in range(10))
"""Of the feed-forward, tried in turn."""

ENOUGH = 1e-4
"""Share of the promised improvement that a flight must bring."""

LEAST_DAMPING, MOST_DAMPING = 1e-6, 1e6
"""Between which the damping goes up and down by tens; below, there is none."""


class DivergedError(InputError):
    """The flight to start from does not stay finite."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class GoalProblem:
    """Fly N steps of equal length and end near a goal.

    minimize   ½ Σ_k ((x_k - goal)ᵀ diag(state_weights) (x_k - goal)
                      + rate_weight u_k²)
               + ½ (x_N - goal)ᵀ diag(goal_weights) (x_N - goal)

    An iteration also pays ½ Σ_k (hold_state |x_k - x̄_k|² + hold_rate (u_k - ū_k)²)
    for leaving the flight x̄, ū of the iteration before. That shortens its steps,
    vanishes where they end, and sets the stiffness of the feedback.

    The defaults have the goal of the article's model-learning loop and a small cost of
    the way, so that there is one best flight; `article_problem` is the article's, whose
    only cost of a step is the one that vanishes. Signs as in `glider.physics.state`:
    nose up is a negative pitch. The effects' own states weigh nothing but hold_state.
    """

    launch: tuple[float, ...] = (-3.5, 0.1, 0.0, 0.0, 7.0, 0.0, 0.0)
    """State at release, in the order of STATE_NAMES [m, rad, m/s, rad/s]."""

    goal: tuple[float, ...] = (0.0, 0.0, -math.pi / 4, 0.0, 2.0, -2.0, 0.0)
    """State to end in, in the same order. Its (x, z) is the wire."""

    goal_weights: tuple[float, ...] = (1000.0, 1000.0, 100.0, 1.0, 1.0, 1.0, 1.0)
    """Of the last state."""

    state_weights: tuple[float, ...] = (0.001,) * NUM_STATES
    """Of the states before."""

    rate_weight: float = 0.1
    """Of the elevator-rate commands."""

    hold_state: float = 0.1
    """Of leaving the states of the iteration before."""

    hold_rate: float = 0.1
    """Of leaving its commands."""

    step: float = 0.01
    """Each command is held so long [s]."""

    steps: int = 75
    """N."""

    order: int = 1
    """Of a step: 1 for explicit Euler, as the article has it, or 4 for classical
    Runge-Kutta."""

    within_limits: bool = True
    """Whether the commands keep the servo's rate limit and its stops."""

    def __post_init__(self):
        """Raises InputError where the problem makes no sense."""
        for name in ("launch", "goal", "goal_weights", "state_weights"):
            values = np.asarray(getattr(self, name), dtype=float)
            if values.shape != (NUM_STATES,) or not np.all(np.isfinite(values)):
                raise InputError(
                    f"GoalProblem: '{name}' is {getattr(self, name)}; {NUM_STATES} "
                    "finite numbers are needed."
                )
        for name in ("goal_weights", "state_weights"):
            if min(getattr(self, name)) < 0.0:
                raise InputError(
                    f"GoalProblem: '{name}' is {getattr(self, name)}; weights must "
                    "not be negative."
                )
        for name in ("rate_weight", "hold_state", "hold_rate"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value >= 0.0):
                raise InputError(
                    f"GoalProblem: '{name}' is {value}; weights must not be negative."
                )
        if self.rate_weight + self.hold_rate <= 0.0:
            raise InputError(
                "GoalProblem: 'rate_weight' and 'hold_rate' are both 0; one of them "
                "must be positive."
            )
        if not (math.isfinite(self.step) and self.step > 0.0) or self.steps < 1:
            raise InputError(
                f"GoalProblem: {self.steps} steps of {self.step} s; at least one, of "
                "a positive duration, is needed."
            )
        if self.order not in (1, 4):
            raise InputError(f"GoalProblem: the order is {self.order}; 1 or 4 needed.")

    @property
    def wire(self) -> tuple[float, float]:
        """Where the center of mass should end, (x, z) [m]."""
        return self.goal[0], self.goal[1]


def article_problem(rate_weight: float = 0.0, order: int = 1) -> GoalProblem:
    """Returns the article's problem: all that counts is where the flight ends.

    Args:
        rate_weight: of the commands; the article has none.
        order: of a step.
    """
    return GoalProblem(
        state_weights=(0.0,) * NUM_STATES, rate_weight=rate_weight, order=order
    )


@dataclasses.dataclass(frozen=True, kw_only=True)
class SteppedPlan:
    """A flight whose commands are held for a step each, and a feedback about it.

    u_k = inputs[k] + gains[k] (x_k - states[k])
    """

    step: float
    """[s]."""

    states: np.ndarray
    """(N + 1, n), in the order of `state_names`."""

    inputs: np.ndarray
    """(N,) elevator-rate commands [rad/s]."""

    gains: np.ndarray
    """(N, n) of the feedback; zero where the command is at the rate limit."""

    state_names: tuple[str, ...]
    """STATE_NAMES, then the effects' own states."""

    costs: tuple[float, ...]
    """Of the first guess and after each iteration, without what holds it near."""

    converged: bool
    """Whether the last iteration changed the cost by less than the tolerance."""

    seconds: float
    """Time spent [s]."""

    @property
    def cost(self) -> float:
        """Of the flight."""
        return self.costs[-1]

    @property
    def duration(self) -> float:
        """[s]."""
        return self.step * len(self.inputs)

    @functools.cached_property
    def times(self) -> np.ndarray:
        """(N + 1,) of the states, from 0 [s]."""
        return self.step * np.arange(len(self.states))


def goal_cost(problem: GoalProblem, states: np.ndarray) -> np.ndarray:
    """Returns the cost of last states, ½ (x - goal)ᵀ diag(goal_weights) (x - goal).

    Args:
        problem: whose goal.
        states: (..., 7 or more).

    Returns:
        of shape (...).
    """
    error = states[..., :NUM_STATES] - np.array(problem.goal)
    return 0.5 * np.sum(np.array(problem.goal_weights) * error**2, axis=-1)


def plan(
    plant: Any,
    problem: GoalProblem,
    *,
    guess: np.ndarray | None = None,
    tolerance: float = 1e-3,
    iterations: int = ITERATIONS,
) -> SteppedPlan:
    """Plans a flight of any GliderPlant in still air.

    Args:
        plant: the glider, effects and residual field included.
        problem: what to fly.
        guess: (N,) commands to start from [rad/s]; None for none at all.
        tolerance: the end is where an iteration changes the cost by less.
        iterations: at most so many; see `SteppedPlan.converged`.

    Raises:
        DivergedError: the guess does not stay finite.
        InputError: a guess or a setting that cannot be used.
    """
    steps = problem.steps
    inputs = np.zeros(steps) if guess is None else np.array(guess, dtype=float)
    if inputs.shape != (steps,) or not np.all(np.isfinite(inputs)):
        raise InputError(
            f"ilqr.plan: the guess has shape {inputs.shape}; ({steps},) finite numbers "
            "are needed."
        )
    if not tolerance > 0.0 or iterations < 1:
        raise InputError(
            f"ilqr.plan: the tolerance is {tolerance} and {iterations} iterations are "
            "allowed; a positive number and at least one are needed."
        )
    begin = time.perf_counter()
    sweep = _Sweep(plant, problem, inputs)
    costs, converged = [sweep.cost], False
    if not math.isfinite(sweep.cost):
        raise DivergedError(
            "ilqr.plan: the guess diverges; a flight that ends somewhere is needed."
        )
    while len(costs) <= iterations and not converged:
        converged = sweep.improve(tolerance)
        costs.append(sweep.cost)
    sweep.backward(damping=0.0)
    return SteppedPlan(
        step=problem.step,
        states=sweep.states,
        inputs=sweep.inputs,
        gains=sweep.gains,
        state_names=tuple(plant.state_names),
        costs=tuple(costs),
        converged=converged,
        seconds=time.perf_counter() - begin,
    )


class _Sweep:
    """A nominal flight, and what an iteration does to it."""

    def __init__(self, plant: Any, problem: GoalProblem, inputs: np.ndarray) -> None:
        """Flies the commands as they are, but for the servo's limits."""
        model, n, steps = plant.model, len(plant.state_names), problem.steps
        self._loops = compiled(plant.kinds, model.field is not None)
        self._problem = problem
        self._weights, self._goal = np.zeros((3, n + 1)), np.zeros(n)
        self._weights[0] = [problem.hold_state] * n + [problem.hold_rate]
        self._weights[1, :NUM_STATES] = problem.state_weights
        self._weights[1, n] = problem.rate_weight
        self._weights[2, :NUM_STATES] = problem.goal_weights
        self._goal[:NUM_STATES] = problem.goal
        drawing = model.parameters
        stops = [*drawing.elevator_limits, drawing.elevator_rate_limit]
        self._limits = np.array(
            stops if problem.within_limits else [-np.inf, np.inf, np.inf]
        )
        self._model = (
            parameter_vector(drawing),
            model.coefficients,
            model.residual_field,
        )
        self._damping = 0.0
        self._jacobian, self._feed = np.empty((steps, n, n + 1)), np.zeros(steps)
        self.gains = np.zeros((steps, n))
        self.inputs, self.states = inputs, np.zeros((steps + 1, n))
        self.states[0] = initial_state(plant, problem.launch)
        self._accept(*self._roll(0.0)[:3])

    def improve(self, tolerance: float) -> bool:
        """Makes one iteration; returns whether it is the last that is worth it.

        Ever smaller shares of the feed-forward are flown until one brings enough of
        what it promises. Where none does, the next iteration is damped more.
        """
        first, second = self.backward(self._damping)
        for share in SHARES:
            states, inputs, cost, hold = self._roll(share)
            promised = -share * (first + share * second)
            if self.cost - cost - hold >= max(ENOUGH * promised, 0.0):
                change = self.cost - cost
                self._accept(states, inputs, cost)
                self._damping *= 0.1 if self._damping > LEAST_DAMPING else 0.0
                return change < tolerance
        is_last = -(first + second) < tolerance or self._damping > MOST_DAMPING
        self._damping = max(10.0 * self._damping, LEAST_DAMPING)
        return is_last

    def backward(self, damping: float) -> tuple[float, float]:
        """Finds the policy about the nominal; returns what it promises."""
        # No physics in it: one serves all gliders.
        return compiled().ilqr_backward(
            damping,
            self._problem.step,
            self.states,
            self.inputs,
            self._jacobian,
            self._weights,
            self._goal,
            self._limits,
            self._feed,
            self.gains,
        )

    def _roll(self, share: float) -> tuple[np.ndarray, np.ndarray, float, float]:
        """Flies the policy: states, commands, their cost and that of leaving."""
        states, inputs = np.empty_like(self.states), np.empty_like(self.inputs)
        states[0] = self.states[0]
        cost, hold = self._loops.ilqr_roll(
            share,
            self._problem.step,
            self._problem.order,
            self.states,
            self.inputs,
            self._feed,
            self.gains,
            self._weights,
            self._goal,
            self._limits,
            *self._model,
            states,
            inputs,
        )
        return states, inputs, cost, hold

    def _accept(self, states: np.ndarray, inputs: np.ndarray, cost: float) -> None:
        """Takes a flight as the nominal and linearizes along it."""
        self.states, self.inputs, self.cost = states, inputs, cost
        if math.isfinite(cost):
            self._loops.ilqr_linearize(
                self._problem.step,
                self._problem.order,
                states,
                inputs,
                *self._model,
                self._jacobian,
            )
