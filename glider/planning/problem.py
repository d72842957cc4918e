"""The problem of a perch, apart from whoever solves it."""

import dataclasses
import math
from pathlib import Path

import numpy as np

from glider.errors import InputError, show
from glider.files import schema
from glider.paths import models_path
from glider.physics.state import NUM_STATES, STATE_NAMES
from glider.planning.hook import Hook


@dataclasses.dataclass(frozen=True, kw_only=True)
class PerchingProblem:
    """Fly from a launch to a wire and arrive slowly, nose up.

    minimize   rate_cost ∫ u² dt + (x(T) - goal)ᵀ diag(goal_weights) (x(T) - goal)
    subject to the glider's dynamics, its launch, the bounds below, and the
               travel and rate limits of the vehicle's elevator.

    The defaults are the article's problem. Signs as in `glider.physics.state`: a pitch
    of -π/4 is nose up.
    """

    launch: list[float] = dataclasses.field(
        default_factory=lambda: [-3.5, 0.1, 0.0, 0.0, 7.0, 0.0, 0.0]
    )
    """State at release, in the order of STATE_NAMES [m, rad, m/s, rad/s]."""

    wire: list[float] = dataclasses.field(default_factory=lambda: [0.0, 0.0])
    """Place where the center of mass must end, (x, z) [m]."""

    x_limits: list[float] = dataclasses.field(default_factory=lambda: [-3.5, 1.0])
    """Bounds of x over the whole flight [m]."""

    z_limits: list[float] = dataclasses.field(default_factory=lambda: [-1.0, 1.0])
    """Bounds of z over the whole flight [m]."""

    pitch_limits: list[float] = dataclasses.field(
        default_factory=lambda: [-math.pi / 2, math.pi / 2]
    )
    """Bounds of the pitch over the whole flight [rad]."""

    final_pitch_limits: list[float] = dataclasses.field(
        default_factory=lambda: [-1.0, -math.pi / 6]
    )
    """Bounds of the pitch at the wire [rad]."""

    final_speed_limit: float = 2.0
    """Bound of |ẋ| and of |ż| at the wire [m/s]."""

    rate_cost: float = 100.0
    """Weight of the elevator's squared rate [1/(rad²/s)]."""

    goal: list[float] = dataclasses.field(
        default_factory=lambda: [0.0, 0.0, -math.pi / 4, 0.0, 0.0, 0.0, 0.0]
    )
    """State that the final cost draws to."""

    goal_weights: list[float] = dataclasses.field(
        default_factory=lambda: [10.0, 10.0, 1.0, 10.0, 1.0, 1.0, 1.0]
    )
    """Diagonal of the final cost's weight."""

    duration_limits: list[float] = dataclasses.field(default_factory=lambda: [0.5, 2.0])
    """Bounds of the step between knots, times the number of knots [s]."""

    hook: Hook = dataclasses.field(default_factory=Hook)
    """Hook at the glider: no part of the plan, it tells which flights perch."""

    def __post_init__(self):
        """Raises InputError where the problem makes no sense."""
        check_problem(self)


_STATES = ("launch", "goal", "goal_weights")
_INTERVALS = (
    "x_limits",
    "z_limits",
    "pitch_limits",
    "final_pitch_limits",
    "duration_limits",
    "hook.pitch_limits",
)
_POSITIVE = ("final_speed_limit", "hook.reach", "hook.speed_limit")


def check_problem(problem: PerchingProblem) -> None:
    """Raises InputError, naming the field, where a value cannot be."""
    values = dataclasses.asdict(problem)
    hook = {f"hook.{name}": value for name, value in values.pop("hook").items()}
    for name, value in (values | hook).items():
        size = NUM_STATES if name in _STATES else np.size(value)
        if name in (*_INTERVALS, "wire"):
            size = 2
        numbers = np.asarray(value, dtype=object).ravel()
        if len(numbers) != size or not all(_is_number(v) for v in numbers):
            needed = "a finite number" if size == 1 else f"{size} finite numbers"
            if name in _STATES:
                needed += f" ({', '.join(STATE_NAMES)})"
            raise InputError(f"field '{name}' is {show(value)}; {needed} needed.")
        if name in _INTERVALS and not value[0] < value[1]:
            raise InputError(
                f"field '{name}' is {show(value)}; [lower, upper] with "
                "lower < upper is needed."
            )
        if name in ("goal_weights", "rate_cost") and min(numbers) < 0.0:
            raise InputError(
                f"field '{name}' is {show(value)}; weights must not be negative."
            )
        if name in _POSITIVE and value <= 0.0:
            raise InputError(
                f"field '{name}' is {show(value)}; a positive number is needed."
            )
    if problem.duration_limits[0] <= 0.0:
        raise InputError(
            f"field 'duration_limits' is {show(problem.duration_limits)}; "
            "a flight "
            "takes more than 0 s."
        )
    if not any(problem.launch[4:6]):
        raise InputError(
            "field 'launch' has xdot = zdot = 0; a glider is needed that moves."
        )
    for name, place in zip(("x_limits", "z_limits"), problem.wire, strict=True):
        low, high = getattr(problem, name)
        if not low <= place <= high:
            raise InputError(
                f"field 'wire' is {show(problem.wire)}, outside '{name}', "
                f"{show([low, high])}."
            )


def _is_number(value: object) -> bool:
    return isinstance(value, (int, float)) and math.isfinite(value)


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


def load_problem(path: Path | str) -> PerchingProblem:
    """Loads a problem; a misspelt field or a value that cannot be is an InputError.

    A file gives only the fields that differ from the article's problem.

    Args:
        path: of the file, or the name of one in models/problems.
    """
    if not Path(path).suffix:
        path = models_path("problems", f"{path}.yaml")
    return schema.load_yaml(PerchingProblem, path, "a perching problem")
