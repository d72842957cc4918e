"""A planned flight: what every planner returns, and its file."""

import dataclasses
import functools
import json
import math
import os
from pathlib import Path
from typing import Any

import numpy as np
from pydrake.trajectories import PiecewisePolynomial

from glider.errors import InputError


@dataclasses.dataclass(frozen=True, kw_only=True)
class Attempt:
    """One call of a solver on the way to a plan."""

    knots: int
    solver: str
    guess: str
    tolerance: float
    solved: bool
    status: str
    seconds: float


@dataclasses.dataclass(frozen=True, kw_only=True)
class Plan:
    """A flight from launch to wire.

    Between knots the state is a cubic Hermite polynomial and the input a
    straight line, as direct collocation has them.
    """

    times: np.ndarray
    """(N,) of the knots, from 0 [s]."""

    states: np.ndarray
    """(N, n) at the knots, in the order of `state_names`."""

    slopes: np.ndarray
    """(N, n) time derivatives of the states at the knots."""

    inputs: np.ndarray
    """(N,) elevator-rate command at the knots [rad/s]."""

    state_names: tuple[str, ...]
    """STATE_NAMES, then the effects' own states."""

    cost: float
    """What the planner minimized."""

    max_defect: float
    """Largest |ẋ - f(x, u)| at the collocation points [m/s, rad/s, m/s², rad/s²]."""

    path_defect: float
    """The same anywhere between the knots, where collocation does not look."""

    drift: float
    """Largest |x_k+1 - flight from x_k| over the segments, over all states."""

    attempts: tuple[Attempt, ...] = ()
    """What the planner tried, the last one with success."""

    def __getstate__(self) -> dict[str, Any]:
        """Returns the numbers without the trajectories, which do not all pickle."""
        return {f.name: getattr(self, f.name) for f in dataclasses.fields(self)}

    @property
    def duration(self) -> float:
        """[s]."""
        return float(self.times[-1])

    @property
    def seconds(self) -> float:
        """Time spent in solvers [s]."""
        return sum(attempt.seconds for attempt in self.attempts)

    @functools.cached_property
    def state_trajectory(self) -> PiecewisePolynomial:
        """States over time, shape (n, 1)."""
        return PiecewisePolynomial.CubicHermite(
            self.times, self.states.T, self.slopes.T
        )

    @functools.cached_property
    def input_trajectory(self) -> PiecewisePolynomial:
        """Elevator-rate command over time, shape (1, 1)."""
        return PiecewisePolynomial.FirstOrderHold(self.times, self.inputs[None, :])


_ARRAYS = ("times", "states", "slopes", "inputs")
_NUMBERS = ("cost", "max_defect", "path_defect", "drift")


def save_plan(path: Path | str, plan: Plan) -> None:
    """Writes a plan as JSON; `load_plan` gives it back unchanged."""
    data = {f.name: getattr(plan, f.name) for f in dataclasses.fields(plan)}
    data |= {name: data[name].tolist() for name in _ARRAYS}
    data["attempts"] = [dataclasses.asdict(attempt) for attempt in plan.attempts]
    part = Path(f"{path}.{os.getpid()}.part")
    part.write_text(json.dumps(data, indent=1) + "\n", encoding="utf-8")
    part.replace(path)


def load_plan(path: Path | str) -> Plan:
    """Loads a plan; a file that is none is an InputError."""
    try:
        data = json.loads(Path(path).read_text(encoding="utf-8"))
        data |= {name: np.array(data[name], dtype=float) for name in _ARRAYS}
        data |= {name: float(data[name]) for name in _NUMBERS}
        data["attempts"] = tuple(Attempt(**attempt) for attempt in data["attempts"])
        data["state_names"] = tuple(data["state_names"])
        plan = Plan(**data)
    except (OSError, ValueError, TypeError, KeyError, AttributeError) as error:
        raise InputError(f"{path}: not a plan: {error}") from None
    knots, n = plan.times.size, len(plan.state_names)
    shapes = {"times": (knots,), "inputs": (knots,)}
    for name in _ARRAYS:
        found, needed = getattr(plan, name), shapes.get(name, (knots, n))
        if found.shape != needed or not np.all(np.isfinite(found)):
            raise InputError(
                f"{path}: '{name}' has shape {found.shape}; finite numbers of shape "
                f"{needed} are needed."
            )
    if knots < 2 or plan.times[0] != 0.0 or not np.all(np.diff(plan.times) > 0.0):
        raise InputError(
            f"{path}: 'times' must increase from 0, over at least two knots."
        )
    for name in _NUMBERS:
        if not math.isfinite(getattr(plan, name)):
            raise InputError(f"{path}: '{name}' must be a finite number.")
    return plan
