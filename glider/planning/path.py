"""A collocated path, and what it lacks of a flight."""

import functools

import numpy as np

from glider.compiled.jacobian import differentiate, stacked
from glider.physics.model import GliderModel


class Path:
    """States over time: cubics between knots, and straight lines between commands.

    Attributes:
        model: the glider, in still air and at time 0.
        times: (N,) of the knots, equally spaced from 0 [s].
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
    ) -> None:
        """Evaluates the dynamics at the knots."""
        self.model = model
        self.times = times
        self.states = states
        self.inputs = inputs
        self.slopes = self._rates(self.knots)

    @functools.cached_property
    def knots(self) -> np.ndarray:
        """(N, n + 1) states and commands."""
        return np.column_stack([self.states, self.inputs])

    @functools.cached_property
    def middles(self) -> np.ndarray:
        """(N - 1, n + 1) states and commands in the middles of the segments.

        x_c = (x₀ + x₁)/2 + h (f₀ - f₁)/8 and u_c = (u₀ + u₁)/2.
        """
        middles = 0.5 * (self.knots[:-1] + self.knots[1:])
        middles[:, :-1] -= 0.125 * self.times[1] * np.diff(self.slopes, axis=0)
        return middles

    @functools.cached_property
    def mean_slopes(self) -> np.ndarray:
        """(N - 1, n) mean slopes of the segments: (f₀ + 4 f_c + f₁)/6."""
        first, last = self.slopes[:-1], self.slopes[1:]
        return (first + 4.0 * self._rates(self.middles) + last) / 6.0

    @property
    def defects(self) -> np.ndarray:
        """(N - 1, n) x₁ - x₀ - h (f₀ + 4 f_c + f₁)/6, in the units of the states.

        They are those of Drake's DirectCollocationConstraint times 2 h/3.
        """
        return np.diff(self.states, axis=0) - self.times[1] * self.mean_slopes

    def defect_slopes(self) -> np.ndarray:
        """Returns the slopes of the defects, (N - 1, n, 2 (n + 1) + 1).

        The columns are those of the knots at both ends of a segment, and h.

        Raises:
            UncompilableError: a formula is not of what numba compiles.
        """
        step = self.times[1]
        at_knots, at_middles = (
            np.array([self._differentiate(point) for point in points])
            for points in (self.knots, self.middles)
        )
        count, n, width = at_middles.shape
        half = 0.5 * np.eye(width)
        turned = np.zeros((count + 1, width, width))
        turned[:, :n] = 0.125 * step * at_knots
        first = at_knots[:-1] + 4.0 * at_middles @ (half + turned[:-1])
        last = at_knots[1:] + 4.0 * at_middles @ (half - turned[1:])
        states = np.eye(n, width)
        longer = -0.125 * np.diff(self.slopes, axis=0)[:, :, None]
        by_step = -self.mean_slopes[:, :, None]
        by_step -= step / 1.5 * at_middles[:, :, :n] @ longer
        return np.concatenate(
            [-states - step / 6.0 * first, states - step / 6.0 * last, by_step], axis=2
        )

    def _differentiate(self, point: np.ndarray) -> np.ndarray:
        """Returns ∂f/∂(x, u) (n, n + 1) at a point (n + 1,)."""
        z = stacked(self.model)
        z[: len(point)] = point
        directions = np.eye(len(point), order="F")
        return differentiate(self.model, 0.0, z, directions)[1]

    def _rates(self, points: np.ndarray) -> np.ndarray:
        """Returns f (P, n) at points (P, n + 1) of states and command."""
        derivatives = self.model.chain.derivatives
        theta = self.model.numbers
        return np.array(
            [
                derivatives(0.0, point[:-1], point[-1], 0.0, 0.0, theta)
                for point in points
            ]
        )
