"""A planned flight: what every planner returns."""

import dataclasses
import functools
from typing import Any

import numpy as np
from pydrake.trajectories import PiecewisePolynomial


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class Plan:
    """A flight from a launch, and what every planner returns.

    Between knots the state is a cubic Hermite polynomial. The input is a straight line,
    as direct collocation has it; or it is held from knot to knot, as planners over
    explicit steps have it.

    Attributes:
        times: (N,) of the knots, from 0 [s].
        states: (N, n) at the knots, in the order of `state_names`.
        slopes: (N, n) time derivatives of the states at the knots.
        inputs: elevator-rate commands [rad/s]: (N,) at the knots; or (N - 1,), each
            held.
        state_names: STATE_NAMES, then the effects' own states.
        cost: that the planner minimized.
        seconds: time that planning took [s].
    """

    times: np.ndarray
    states: np.ndarray
    slopes: np.ndarray
    inputs: np.ndarray
    state_names: tuple[str, ...]
    cost: float
    seconds: float = 0.0

    def __repr__(self) -> str:
        """Returns one line, as a notebook shows it."""
        return (
            f"Plan(cost={self.cost:.6g}, duration={self.duration:.4f} s, "
            f"{self.times.size} knots)"
        )

    def __getstate__(self) -> dict[str, Any]:
        """Returns the numbers without the trajectories, which do not all pickle."""
        return {f.name: getattr(self, f.name) for f in dataclasses.fields(self)}

    @property
    def duration(self) -> float:
        """Time from launch to end [s]."""
        return float(self.times[-1])

    @property
    def is_held(self) -> bool:
        """Whether each command is held until the next knot."""
        return self.inputs.size == self.times.size - 1

    @functools.cached_property
    def state_trajectory(self) -> PiecewisePolynomial:
        """States over time, shape (n, 1)."""
        return PiecewisePolynomial.CubicHermite(
            self.times, self.states.T, self.slopes.T
        )

    @functools.cached_property
    def input_trajectory(self) -> PiecewisePolynomial:
        """Elevator-rate command over time, shape (1, 1)."""
        if self.is_held:
            held = np.append(self.inputs, self.inputs[-1:])
            return PiecewisePolynomial.ZeroOrderHold(self.times, held[None, :])
        return PiecewisePolynomial.FirstOrderHold(self.times, self.inputs[None, :])
