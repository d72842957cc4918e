"""A collocated path, and what it lacks of a flight."""

import functools

import numpy as np

from glider.compiled.jacobian import differentiate, stacked
from glider.compiled.kernel import UncompilableError
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
        self._is_fast = True  #: Until a formula does not compile.
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
        at_knots = self._slopes(self.knots)
        at_middles = self._slopes(self.middles)
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

    def _slopes(self, points: np.ndarray) -> np.ndarray:
        """Returns ∂f/∂(x, u) (P, n, n + 1) at points (P, n + 1)."""
        directions = np.eye(points.shape[1], order="F")
        return np.array([self._differentiate(at, directions)[1] for at in points])

    def _rates(self, points: np.ndarray) -> np.ndarray:
        """Returns f (P, n) at points (P, n + 1) of states and command."""
        if self._is_fast:
            try:
                none = np.zeros((0, 0), order="F")
                return np.array([self._differentiate(at, none)[0] for at in points])
            except UncompilableError:
                self._is_fast = False
        derivatives = self.model.chain.derivatives
        theta = self.model.numbers
        return np.array(
            [derivatives(0.0, at[:-1], at[-1], 0.0, 0.0, theta) for at in points]
        )

    def _differentiate(self, point, directions):
        z = stacked(self.model)
        z[: len(point)] = point
        return differentiate(self.model, 0.0, z, directions)
