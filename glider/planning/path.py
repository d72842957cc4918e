"""A collocated path, and what it lacks of a flight."""

import functools

import numpy as np

from glider.compiled.collocation import rates_along
from glider.physics.model import GliderModel


class Path:
    """States over time: cubics between knots, and straight lines between commands.

    Attributes:
        model: the glider, in still air and at time 0.
        times: (N,) of the knots, from 0 [s].
        states: (N, n) at the knots.
        inputs: (N,) commands at the knots [rad/s].
        slopes: (N, n) f(x, u) at the knots: the slopes of the cubics.
    """

    def __init__(
        self,
        model: GliderModel,
        times: np.ndarray,
        states: np.ndarray,
        inputs: np.ndarray,
        fast: bool = True,
    ) -> None:
        """Evaluates the dynamics at the knots, in compiled code if it is to be fast."""
        self.model = model
        self.times = times
        self.states = states
        self.inputs = inputs
        self._fast = fast
        self.slopes = self._rates(np.column_stack([states, inputs]))

    @functools.cached_property
    def defects(self) -> np.ndarray:
        """(N - 1, n) |x₁ - x₀ - h/6 (f₀ + 4 f_c + f₁)|, in the units of the states."""
        steps = np.diff(self.times)[:, None]
        first = self.slopes[:-1]
        last = self.slopes[1:]
        knots = np.column_stack([self.states, self.inputs])
        middles = 0.5 * (knots[:-1] + knots[1:])
        middles[:, :-1] += 0.125 * steps * (first - last)
        slopes = first + 4.0 * self._rates(middles) + last
        return np.abs(np.diff(self.states, axis=0) - steps / 6.0 * slopes)

    def _rates(self, points: np.ndarray) -> np.ndarray:
        """Returns f (P, n) at points (P, n + 1) of states and command."""
        if self._fast:
            return rates_along(self.model, points)
        theta = self.model.numbers
        derivatives = self.model.chain.derivatives
        return np.array(
            [
                derivatives(0.0, point[:-1], point[-1], 0.0, 0.0, theta)
                for point in points
            ]
        )
