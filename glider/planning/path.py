"""A collocated path: the states between its knots, and what it lacks of a flight."""

import functools

import numpy as np

from glider.compiled.collocation import rates_along
from glider.physics.model import GliderModel

POINTS = 20
"""Points in each segment at which a path is evaluated; even, so that the collocation
point is one of them."""


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

    @property
    def _phase(self) -> np.ndarray:
        """(POINTS, 1, 1) share of a segment's time that has passed."""
        return np.linspace(0.0, 1.0, POINTS + 1)[:-1, None, None]

    @functools.cached_property
    def _cubics(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Coefficients (N - 1, n) of the phase, its square and its cube."""
        steps = np.diff(self.times)[:, None]
        rise = np.diff(self.states, axis=0)
        start = steps * self.slopes[:-1]
        end = steps * self.slopes[1:]
        return start, 3.0 * rise - 2.0 * start - end, start + end - 2.0 * rise

    @functools.cached_property
    def between(self) -> np.ndarray:
        """(POINTS, N - 1, n) states in each segment, from its first knot on."""
        start, bend, twist = self._cubics
        phase = self._phase
        return self.states[:-1] + phase * (start + phase * (bend + phase * twist))

    @functools.cached_property
    def faults(self) -> np.ndarray:
        """(POINTS, N - 1, n) |ẋ - f(x, u)| at the same points."""
        start, bend, twist = self._cubics
        phase = self._phase
        steps = np.diff(self.times)[:, None]
        slopes = (start + phase * (2.0 * bend + 3.0 * phase * twist)) / steps
        commands = self.inputs[:-1, None] + phase * np.diff(self.inputs)[:, None]
        points = np.concatenate([self.between, commands], axis=2)
        rates = self._rates(points.reshape(-1, points.shape[2]))
        return np.abs(slopes - rates.reshape(slopes.shape))

    @property
    def defects(self) -> np.ndarray:
        """(N - 1, n) |x₁ - x₀ - h/6 (f₀ + 4 f_c + f₁)|, in the units of the states."""
        return 2.0 / 3.0 * np.diff(self.times)[:, None] * self.faults[POINTS // 2]

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
