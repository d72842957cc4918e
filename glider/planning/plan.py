"""A planned flight: what every planner returns, and its file."""

import dataclasses
import functools
import json
import os
from pathlib import Path

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
        data["attempts"] = tuple(Attempt(**attempt) for attempt in data["attempts"])
        data["state_names"] = tuple(data["state_names"])
        plan = Plan(**data)
    except (OSError, ValueError, TypeError, KeyError, AttributeError) as error:
        raise InputError(f"{path}: not a plan: {error}") from None
    shape = (len(plan.times), len(plan.state_names))
    if plan.states.shape != shape or plan.slopes.shape != shape:
        raise InputError(
            f"{path}: 'states' is {plan.states.shape} and 'slopes' is "
            f"{plan.slopes.shape}; {shape} is needed."
        )
    return plan
