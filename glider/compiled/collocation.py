"""Hermite-Simpson collocation of a path: defects, slopes and curvature.

Of a glider's own code there is only `rates_at`, its derivatives at many points; the
rest, which places the points and evaluates the path, is compiled once for all gliders.
So a glider with other effects compiles in a second, not ten.
The P = 2 N - 1 points of a path are its N knots, then the middles of its segments.
"""

from typing import NamedTuple

import numpy as np

from glider.compiled.kernel import CompileError, Family, UncompilableError
from glider.compiled.runge_kutta import BLOCK
from glider.physics.chain import derivatives
from glider.physics.model import GliderModel


def rates_at(points, theta, rates):
    """Writes ẋ (P, n) at points (P, n + 1) of states and command.

    In blocks of points that lie side by side, so that one instruction serves several.
    """
    count, width = points.shape
    work = np.empty((width, 2, BLOCK))
    for first in range(0, count, BLOCK):
        here = min(BLOCK, count - first)
        for j in range(BLOCK):
            k = first + min(j, here - 1)
            for i in range(width):
                work[i, 0, j] = points[k, i]
        for j in range(BLOCK):
            d = derivatives(0.0, work[:, 0, j], work[-1, 0, j], 0.0, 0.0, theta)
            for i in range(len(d)):
                work[i, 1, j] = d[i]
        for j in range(here):
            for i in range(width - 1):
                rates[first + j, i] = work[i, 1, j]


LOOPS = Family((rates_at,), (rates_at,))


def rates_along(model: GliderModel, points: np.ndarray) -> np.ndarray:
    """Returns ẋ (P, n) of a glider at points (P, n + 1) of states and command.

    Raises:
        UncompilableError: a formula is not of what numba compiles.
    """
    rates = np.empty((len(points), model.num_states))
    loops = LOOPS.over(model.kinds)
    try:
        loops.rates_at(np.ascontiguousarray(points), model.numbers, rates)
    except CompileError as error:
        raise UncompilableError(str(error)) from None
    return rates


_ROUGH = ((1e-5, 1.0),)
"""Steps of first differences [m, rad, m/s, rad/s], and how much each counts."""

_FINE = ((1e-4, 4.0 / 3.0), (2e-4, -1.0 / 3.0))
"""The same of fourth order (Richardson). Of what changes within 0.01 rad, as the
sharpest stall of the library, they leave 1e-8 of the slope; of all else 1e-11."""

_CURVATURE_STEP = 3e-4
"""Step of second differences. Newton's method needs no exact curvature: its root
is where the slopes say."""


class Path(NamedTuple):
    """The P points of a path on N knots, and what the dynamics make of them.

    Attributes:
        points: (P, n + 1) states and commands, at the knots and then in the middles.
        rates: (P, n) f.
        slopes: (P, n, n + 1) ∂f/∂(x, u).
        curvature: (P, n + 1, n + 1) ∂²(wᵀf)/∂(x, u)².
        weights: (P, n) w.
        defects: (N - 1, n).
    """

    points: np.ndarray
    rates: np.ndarray
    slopes: np.ndarray
    curvature: np.ndarray
    weights: np.ndarray
    defects: np.ndarray


class PathDynamics:
    """A glider's dynamics along collocated paths on so many knots."""

    def __init__(self, model: GliderModel, knots: int) -> None:
        """Allocates the arrays that each step overwrites."""
        n = model.num_states
        count = 2 * knots - 1
        self.path = Path(
            points=np.empty((count, n + 1)),
            rates=np.empty((count, n)),
            slopes=np.empty((count, n, n + 1)),
            curvature=np.empty((count, n + 1, n + 1)),
            weights=np.empty((count, n)),
            defects=np.empty((knots - 1, n)),
        )
        self._loops = LOOPS.over(model.kinds)
        self._theta = model.numbers
        most = count * ((n + 1) * (n + 4) // 2 + 1)
        self._moved = np.empty((most, n + 1))
        self._rates = np.empty((most, n))

    def collocate(self, w: np.ndarray) -> float:
        """Writes points, rates and defects of knots and h; returns Σ |defect|.

        A middle is (x₀ + x₁)/2 + h (f₀ - f₁)/8, (u₀ + u₁)/2, and a defect
        x₁ - x₀ - h/6 (f₀ + 4 f_c + f₁): that of Drake's DirectCollocationConstraint
        times 2 h/3.

        Args:
            w: (N (n + 1) + 1,) the knots, one after the other, and h.

        Raises:
            UncompilableError: a formula is not of what numba compiles.
        """
        points = self.path.points
        rates = self.path.rates
        knots = len(self.path.defects) + 1
        step = w[-1]
        points[:knots] = w[:-1].reshape(knots, -1)
        first = points[: knots - 1]
        last = points[1:knots]
        try:
            self._loops.rates_at(points[:knots], self._theta, rates[:knots])
        except CompileError as error:
            raise UncompilableError(str(error)) from None
        start = rates[: knots - 1]
        end = rates[1:knots]
        points[knots:] = 0.5 * (first + last)
        points[knots:, :-1] += 0.125 * step * (start - end)
        self._loops.rates_at(points[knots:], self._theta, rates[knots:])
        slope = start + 4.0 * rates[knots:] + end
        self.path.defects[:] = (last - first)[:, :-1] - step / 6.0 * slope
        return float(np.abs(self.path.defects).sum())

    def linearize(self, fine: bool) -> None:
        """Writes the slopes at the points of `collocate`.

        Args:
            fine: whether by _FINE differences; else by _ROUGH ones, in half the time.
        """
        points = self.path.points
        slopes = self.path.slopes
        count, n, width = slopes.shape
        moved = self._moved[: 2 * points.size]
        rates = self._rates[: 2 * points.size]
        aside = np.array([np.eye(width), -np.eye(width)])[:, :, None]
        slopes[:] = 0.0
        for step, share in _FINE if fine else _ROUGH:
            moved[:] = (points + step * aside).reshape(moved.shape)
            self._loops.rates_at(moved, self._theta, rates)
            forth, back = rates.reshape(2, width, count, n)
            rise = (forth - back) * (0.5 * share / step)
            slopes += rise.transpose(1, 2, 0)

    def curve(self) -> None:
        """Writes the curvature at the points of `linearize`, by the path's weights."""
        path = self.path
        points = path.points
        count, width = points.shape
        step = _CURVATURE_STEP
        # What no slope depends on has no curvature either.
        axes = np.flatnonzero(path.slopes.any(axis=(0, 1)))
        unit = step * np.eye(width)[axes]
        a, b = np.tril_indices(len(axes), -1)
        aside = np.concatenate([unit, -unit, unit[a] + unit[b], np.zeros((1, width))])
        moved = self._moved[: len(aside) * count]
        rates = self._rates[: len(aside) * count]
        moved[:] = (points + aside[:, None]).reshape(moved.shape)
        self._loops.rates_at(moved, self._theta, rates)
        weighed = rates.reshape(len(aside), count, -1) * path.weights
        values = weighed.sum(axis=2)
        rises = (values[:-1] - values[-1]) / step**2
        forth, back, both = np.split(rises, [len(axes), 2 * len(axes)])
        mixed = both - forth[a] - forth[b]
        path.curvature[:] = 0.0
        path.curvature[:, axes, axes] = (forth + back).T
        path.curvature[:, axes[a], axes[b]] = mixed.T
        path.curvature[:, axes[b], axes[a]] = mixed.T
