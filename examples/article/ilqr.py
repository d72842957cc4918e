"""Plans by iterative LQR: a fixed number of steps towards a goal, with feedback.

Where `glider.planning.dircol` asks for a flight that arrives, this asks for one
that ends as near to a goal as it can, at a fixed time; it is done in
milliseconds, gives a feedback along with the flight, and so suits loops that plan
again and again.
"""

import dataclasses
import math
import time

import numpy as np

from glider.errors import InputError, show
from glider.physics.model import GliderModel
from glider.physics.servo import NO_LIMITS
from glider.physics.state import NUM_STATES
from glider.planning.plan import Plan
from glider.planning.problem import PerchingProblem
from ilqr_kernels import GoalCosts, improve_policy, linearize_steps, roll
from tapes import held_plan

ITERATIONS = 500
"""Number of iterations after which a plan that still improves has not converged."""

SHARES = tuple(0.5**k for k in range(10))
"""Shares of the feed-forward, tried in turn."""

LEAST_SHARE = 1e-4
"""Share of the promised improvement that a flight must bring."""

LEAST_DAMPING, MOST_DAMPING = 1e-6, 1e6
"""Bounds between which the damping goes up and down by tens; below, there is none."""


def goal_problem(rate_cost: float = 5.0) -> PerchingProblem:
    """Returns the article's problem of the model-learning loop: a goal, no bounds.

    Its planner flies a given number of steps and ends as near to the goal as it can.

    Args:
        rate_cost: of the commands; the article has none.
    """
    return PerchingProblem(
        goal=[0.0, 0.0, -math.pi / 4, 0.0, 2.0, -2.0, 0.0],
        goal_weights=[500.0, 500.0, 50.0, 0.5, 0.5, 0.5, 0.5],
        rate_cost=rate_cost,
    )


def goal_cost(problem: PerchingProblem, states: np.ndarray) -> np.ndarray:
    """Returns the cost of last states, (x - goal)ᵀ diag(goal_weights) (x - goal).

    Args:
        problem: whose goal.
        states: (..., 7 or more).

    Returns:
        of shape (...).
    """
    error = states[..., :NUM_STATES] - np.array(problem.goal)
    return np.sum(np.array(problem.goal_weights) * error**2, axis=-1)


class DivergedError(InputError):
    """The flight to start from does not stay finite."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class IlqrSettings:
    """Settings with which iterative LQR takes a problem: N steps of equal length.

    minimize   Σ_k ((x_k - goal)ᵀ diag(state_weights) (x_k - goal)
                    + rate_cost u_k² step)
               + (x_N - goal)ᵀ diag(goal_weights) (x_N - goal)

    with goal, goal_weights and rate_cost of the problem, whose bounds are not looked
    at. An iteration also pays Σ_k (hold_state |x_k - x̄_k|² + hold_rate (u_k - ū_k)²)
    for leaving the flight x̄, ū of the iteration before. That shortens its steps,
    vanishes where they end, and sets the stiffness of the feedback. The effects' own
    states weigh nothing but hold_state.

    The defaults have a small cost of the way, so that there is one best flight; the
    article has none, ARTICLE.
    """

    state_weights: tuple[float, ...] = (0.0005,) * NUM_STATES
    """Weights of the states before the last, in the order of STATE_NAMES."""

    hold_state: float = 0.05
    """Weight of leaving the states of the iteration before."""

    hold_rate: float = 0.05
    """Weight of leaving its commands."""

    step: float = 0.01
    """Time that each command is held [s]."""

    steps: int = 75
    """Number of steps N."""

    order: int = 1
    """Order of a step: 1 for explicit Euler, as the article has it, or 4 for classical
    Runge-Kutta."""

    within_limits: bool = True
    """Whether the commands keep the servo's rate limit and its stops."""

    def __post_init__(self):
        """Raises InputError where a setting makes no sense."""
        values = np.asarray(self.state_weights, dtype=float)
        good = values.shape == (NUM_STATES,) and np.all(np.isfinite(values))
        if not good or np.any(values < 0.0):
            raise InputError(
                f"IlqrSettings: 'state_weights' is {show(self.state_weights)}; "
                f"{NUM_STATES} "
                "finite numbers, none negative, are needed."
            )
        for name in ("hold_state", "hold_rate"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value >= 0.0):
                raise InputError(
                    f"IlqrSettings: '{name}' is {show(value)}; weights must not be "
                    "negative."
                )
        if not (math.isfinite(self.step) and self.step > 0.0) or self.steps < 1:
            raise InputError(
                f"IlqrSettings: {self.steps} steps of {show(self.step)} s; expected "
                "at least one, of a positive duration."
            )
        if self.order not in (1, 4):
            raise InputError(
                f"IlqrSettings: the order is {self.order}; expected 1 or 4."
            )


ARTICLE = IlqrSettings(state_weights=(0.0,) * NUM_STATES)
"""The article's settings: all that counts is where the flight ends."""


def ilqr(
    model: GliderModel,
    problem: PerchingProblem,
    settings: IlqrSettings | None = None,
    *,
    guess: np.ndarray | None = None,
    tolerance: float = 1e-3,
    iterations: int = ITERATIONS,
) -> Plan:
    """Plans a flight of a glider in still air.

    Args:
        model: the glider, effects and free functions included.
        problem: whose launch, goal and weights to use.
        settings: None for the defaults.
        guess: (N,) commands to start from [rad/s]; None for none at all.
        tolerance: the end is where an iteration changes the cost by less.
        iterations: at most so many; see `Plan.converged`.

    Returns:
        a plan with held commands and gains. Its costs are those of the first guess
        and after each iteration, without what holds it near.

    Raises:
        DivergedError: the guess does not stay finite.
        InputError: a guess or a setting that cannot be used.
    """
    settings = IlqrSettings() if settings is None else settings
    steps = settings.steps
    inputs = np.zeros(steps) if guess is None else np.array(guess, dtype=float)
    if inputs.shape != (steps,) or not np.all(np.isfinite(inputs)):
        raise InputError(
            f"ilqr: the guess has shape {inputs.shape}; ({steps},) finite numbers "
            "are needed."
        )
    if not tolerance > 0.0 or iterations < 1:
        raise InputError(
            f"ilqr: the tolerance is {show(tolerance)} and {iterations} iterations are "
            "allowed; a positive number and at least one are needed."
        )
    if problem.rate_cost + settings.hold_rate <= 0.0:
        raise InputError(
            "ilqr: 'rate_cost' and 'hold_rate' are both 0; one of them must be "
            "positive."
        )
    begin = time.perf_counter()
    sweep = _Sweep(model, problem, settings, inputs)
    costs, converged = [sweep.cost], False
    if not math.isfinite(sweep.cost):
        raise DivergedError("ilqr: the guess diverges; expected a finite flight.")
    while len(costs) <= iterations and not converged:
        converged = sweep.improve(tolerance)
        costs.append(sweep.cost)
    sweep.backward(damping=0.0)
    return held_plan(
        model,
        settings.step,
        sweep.states,
        sweep.inputs,
        gains=sweep.gains,
        cost=costs[-1],
        costs=tuple(costs),
        converged=converged,
        search_seconds=time.perf_counter() - begin,
    )


class _Sweep:
    """A nominal flight, and what an iteration does to it."""

    def __init__(
        self,
        model: GliderModel,
        problem: PerchingProblem,
        settings: IlqrSettings,
        inputs: np.ndarray,
    ) -> None:
        """Flies the commands as they are, but for the servo's limits."""
        n, steps = model.num_states, settings.steps
        self._model, self._settings = model, settings
        self._costs = _costs_of(problem, settings, n)
        self._servo = model.parameters.servo if settings.within_limits else NO_LIMITS
        self._damping = 0.0
        self._policy = np.zeros(steps), np.zeros((steps, n))
        self.inputs, self.states = inputs, np.zeros((steps + 1, n))
        self.states[0] = model.initial_state(problem.launch)
        self._accept(*self._roll(0.0)[:3])

    @property
    def gains(self) -> np.ndarray:
        """(N, n) K of the last policy."""
        return self._policy[1]

    def improve(self, tolerance: float) -> bool:
        """Makes one iteration; returns whether it is the last one worthwhile.

        Ever smaller shares of the feed-forward are flown until one brings enough of
        what it promises. Where none does, the next iteration is damped more.
        """
        first, second = self.backward(self._damping)
        for share in SHARES:
            states, inputs, cost, hold = self._roll(share)
            promised = -share * (first + share * second)
            if self.cost - cost - hold >= max(LEAST_SHARE * promised, 0.0):
                change = self.cost - cost
                self._accept(states, inputs, cost)
                self._damping *= 0.1 if self._damping > LEAST_DAMPING else 0.0
                return change < tolerance
        is_last = -(first + second) < tolerance or self._damping > MOST_DAMPING
        self._damping = max(10.0 * self._damping, LEAST_DAMPING)
        return is_last

    def backward(self, damping: float) -> tuple[float, float]:
        """Finds the policy about the nominal; returns its predicted improvement."""
        nominal, step = (self.states, self.inputs), self._settings.step
        self._policy, promise = improve_policy(
            damping, step, nominal, self._jacobian, self._costs, self._servo
        )
        return promise

    def _roll(self, share: float) -> tuple[np.ndarray, np.ndarray, float, float]:
        """Flies the policy: states, commands, their cost and that of leaving."""
        return roll(
            self._model,
            share,
            self._settings.step,
            self._settings.order,
            (self.states, self.inputs),
            self._policy,
            self._costs,
            self._servo,
        )

    def _accept(self, states: np.ndarray, inputs: np.ndarray, cost: float) -> None:
        """Takes a flight as the nominal and linearizes along it."""
        self.states, self.inputs, self.cost = states, inputs, cost
        if math.isfinite(cost):
            self._jacobian = linearize_steps(
                self._model, self._settings.step, self._settings.order, states, inputs
            )


def _costs_of(problem: PerchingProblem, settings: IlqrSettings, n: int) -> GoalCosts:
    """Returns the weights as the compiled loops have them, of half the squares."""
    own = np.zeros(n - NUM_STATES)
    rate = problem.rate_cost * settings.step
    return GoalCosts(
        hold=2.0 * np.array([settings.hold_state] * n + [settings.hold_rate]),
        stage=2.0 * np.concatenate([settings.state_weights, own, [rate]]),
        final=2.0 * np.append(problem.goal_weights, own),
        goal=np.append(problem.goal, own),
    )
