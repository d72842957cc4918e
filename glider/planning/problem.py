"""The problem of a perch, independent of its solvers."""

import dataclasses
import math
from pathlib import Path
from typing import Any

import numpy as np

from glider.errors import expect, show
from glider.files import schema
from glider.paths import shipped_path
from glider.physics.parameters import is_number
from glider.physics.state import (
    ELEVATOR,
    NUM_STATES,
    PITCH,
    POSITION,
    STATE_NAMES,
    VELOCITY,
)

_HEIGHT = POSITION[1]


def _list(*values: float) -> Any:
    """Field of a dataclass whose default is a list."""
    return dataclasses.field(default_factory=lambda: list(values))


@dataclasses.dataclass(frozen=True, kw_only=True)
class Hook:
    """Limits within which a glider that passes a wire is held by it.

    Their sources are in models/problems/perching.yaml.
    """

    reach: float = 0.05  #: Largest distance of the center of mass from the wire [m].
    speed_limit: float = 2.8  #: Largest speed that it stops the glider from [m/s].
    #: Pitch between which its mouth meets the wire [rad].
    pitch_limits: list[float] = _list(-1.17, -0.35)

    def takes(self, miss: np.ndarray, arrivals: np.ndarray) -> np.ndarray:
        """Whether it holds gliders that pass the wire, (...).

        Args:
            miss: (...) least distances of the center of mass from the wire [m].
            arrivals: (..., 7 or more) the states there.
        """
        low, high = self.pitch_limits
        speed = np.linalg.norm(arrivals[..., VELOCITY], axis=-1)
        pitch = arrivals[..., PITCH]
        is_slow = speed <= self.speed_limit
        return (miss < self.reach) & is_slow & (low <= pitch) & (pitch <= high)


@dataclasses.dataclass(frozen=True, kw_only=True)
class PerchingProblem:
    """Fly from a launch to a wire and arrive slowly, nose up.

    minimize   rate_cost ∫ u² dt + (x(T) - goal)ᵀ diag(goal_weights) (x(T) - goal)
    subject to the glider's dynamics, its launch, the bounds below, and the
               travel and rate limits of the vehicle's elevator
               (`glider.planning.constraints`).

    The defaults are the article's problem. Signs as in `glider.physics.state`: a pitch
    of -π/4 is nose up.

    Attributes:
        launch: state at release, in the order of STATE_NAMES [m, rad, m/s, rad/s].
        wire: place where the center of mass must end, (x, z) [m].
        x_limits: bounds of x over the whole flight [m].
        z_limits: bounds of z over the whole flight [m].
        pitch_limits: bounds of the pitch over the whole flight [rad].
        final_pitch_limits: bounds of the pitch at the wire [rad].
        final_speed_limit: bound of |ẋ| and of |ż| at the wire [m/s].
        rate_cost: weight of the elevator's squared rate [1/(rad²/s)].
        goal: state that the final cost draws to.
        goal_weights: diagonal of the final cost's weight.
        duration_limits: bounds of the number of knots times the step between them [s].
        hook: at the glider; no part of the plan, it determines which flights perch.
    """

    launch: list[float] = _list(-3.5, 0.1, 0.0, 0.0, 7.0, 0.0, 0.0)
    wire: list[float] = _list(0.0, 0.0)
    x_limits: list[float] = _list(-3.5, 1.0)
    z_limits: list[float] = _list(-1.0, 1.0)
    pitch_limits: list[float] = _list(-math.pi / 2, math.pi / 2)
    final_pitch_limits: list[float] = _list(-1.0, -math.pi / 6)
    final_speed_limit: float = 2.0
    rate_cost: float = 100.0
    goal: list[float] = _list(0.0, 0.0, -math.pi / 4, 0.0, 0.0, 0.0, 0.0)
    goal_weights: list[float] = _list(10.0, 10.0, 1.0, 10.0, 1.0, 1.0, 1.0)
    duration_limits: list[float] = _list(0.5, 2.0)
    hook: Hook = dataclasses.field(default_factory=Hook)

    def __post_init__(self):
        """Raises InputError, naming the field, where a value is out of range."""
        _check(self)

    def draw_launches(
        self,
        count: int,
        rng: np.random.Generator,
        *,
        height: float = 0.04,
        speed: float = 0.1,
        pitch: float = 0.02,
        scale: float = 1.0,
    ) -> np.ndarray:
        """Draws launch states with normally distributed errors, (count, 7).

        Args:
            count: number of launches.
            rng: of the errors.
            height: standard deviation of the height [m].
            speed: that of the speed along the launch velocity [m/s].
            pitch: that of the pitch [rad].
            scale: factor on all three.
        """
        expect(count >= 1, "draw_launches: 'count'", count, "at least 1")
        deviations = {"height": height, "speed": speed, "pitch": pitch, "scale": scale}
        for name, value in deviations.items():
            good = is_number(value) and value >= 0.0
            expect(good, f"draw_launches: '{name}'", value, "a number not negative")
        sizes = np.multiply(scale, [height, speed, pitch])
        errors = rng.normal(size=(count, 3)) * sizes
        starts = np.tile(np.array(self.launch, dtype=float), (count, 1))
        velocity = starts[:, VELOCITY]
        along = velocity / np.linalg.norm(velocity[0])
        starts[:, _HEIGHT] += errors[:, 0]
        starts[:, VELOCITY] += errors[:, 1:2] * along
        starts[:, PITCH] += errors[:, 2]
        return starts

    @classmethod
    def load(cls, path: Path | str) -> "PerchingProblem":
        """Loads a problem; a misspelt field or a bad value is an InputError.

        A file gives only the fields that differ from the article's problem.

        Args:
            path: of the file, or the name of one in models/problems.
        """
        return schema.load_yaml(
            cls, shipped_path(path, "problems"), "a perching problem"
        )


_STATES = ("launch", "goal", "goal_weights")
_POSITIVE = ("final_speed_limit", "hook.reach", "hook.speed_limit")


def _check(problem: PerchingProblem) -> None:
    values = dataclasses.asdict(problem)
    hook = {f"hook.{name}": value for name, value in values.pop("hook").items()}
    for name, value in (values | hook).items():
        numbers = np.asarray(value, dtype=object).ravel()
        is_interval = name.endswith("_limits")
        what = f"field '{name}'"
        size = 1
        needed = "a finite number"
        if name in _STATES:
            size = NUM_STATES
            needed = f"{size} finite numbers ({', '.join(STATE_NAMES)})"
        elif is_interval or name == "wire":
            size = 2
            needed = "2 finite numbers"
        good = len(numbers) == size and all(map(is_number, numbers))
        expect(good, what, value, needed)
        if is_interval:
            expect(value[0] < value[1], what, value, "[lower, upper], lower < upper")
        if name in ("launch", "goal"):
            angles = max(abs(value[PITCH]), abs(value[ELEVATOR]))
            expect(angles <= math.pi, what, value, "pitch and elevator within ±π rad")
        if name in ("goal_weights", "rate_cost"):
            expect(min(numbers) >= 0.0, what, value, "nothing negative")
        if name in _POSITIVE:
            expect(value > 0.0, what, value, "a positive number")
    shortest = problem.duration_limits[0]
    expect(shortest > 0.0, "field 'duration_limits'", shortest, "more than 0 s")
    moves = any(problem.launch[4:6])
    expect(moves, "field 'launch'", problem.launch, "xdot or zdot other than 0")
    for name, place in zip(("x_limits", "z_limits"), problem.wire, strict=True):
        low, high = getattr(problem, name)
        inside = f"a place within '{name}', {show([low, high])}"
        expect(low <= place <= high, "field 'wire'", problem.wire, inside)
