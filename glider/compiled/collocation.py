"""Hermite-Simpson collocation of a path: defects, slopes and curvature.

Of a glider's own code there is only `rates_at`, its derivatives at many points; the
rest, which places the points and evaluates the path, is compiled once for all gliders.
So a glider with other effects compiles in a second, not ten.
The P = 2 N - 1 points of a path are its N knots, then the middles of its segments.
"""

from typing import NamedTuple

import numpy as np

from glider.compiled.kernel import CompileError, Family, UncompilableError, machine_code
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


@machine_code
def _place_middles(step, rates, points):
    """Writes the middles (x_c, u_c) of the cubics between knots.

    x_c = (x₀ + x₁)/2 + h (f₀ - f₁)/8 and u_c = (u₀ + u₁)/2.

    Args:
        step: h [s].
        rates: (P, n) f, of which those at the knots are read.
        points: (P, n + 1) states and commands; the middles are written.
    """
    n = rates.shape[1]
    count = (len(points) + 1) // 2
    for k in range(count - 1):
        for i in range(n + 1):
            points[count + k, i] = 0.5 * (points[k, i] + points[k + 1, i])
        for i in range(n):
            points[count + k, i] += 0.125 * step * (rates[k, i] - rates[k + 1, i])


@machine_code
def _find_defects(step, rates, points, defects):
    """Writes the defects (N - 1, n): x₁ - x₀ - h/6 (f₀ + 4 f_c + f₁).

    They are those of Drake's DirectCollocationConstraint times 2 h/3.

    Returns:
        the sum of all |defect|.
    """
    count = len(defects) + 1
    total = 0.0
    for k in range(count - 1):
        for i in range(rates.shape[1]):
            slope = rates[k, i] + 4.0 * rates[count + k, i] + rates[k + 1, i]
            defect = points[k + 1, i] - points[k, i] - step / 6.0 * slope
            defects[k, i] = defect
            total += abs(defect)
    return total


@machine_code
def spread(points, step, moved):
    """Writes points moved along each axis, forth and back: (2 (n + 1) P, n + 1)."""
    count, width = points.shape
    at = 0
    for axis in range(width):
        for side in (step, -step):
            for k in range(count):
                for i in range(width):
                    moved[at, i] = points[k, i]
                moved[at, axis] += side
                at += 1


@machine_code
def add_difference(rates, factor, slopes):
    """Adds differences of the rates at points of `spread` to slopes (P, n, n + 1)."""
    count, n, width = slopes.shape
    for axis in range(width):
        forth = 2 * axis * count
        back = (2 * axis + 1) * count
        for k in range(count):
            for i in range(n):
                rise = rates[forth + k, i] - rates[back + k, i]
                slopes[k, i, axis] += factor * rise


@machine_code
def _spread_pairs(points, slopes, step, axes, moved):
    """Writes points moved along each axis, forth and back, and along each two.

    What no slope depends on at any point has no curvature either and is not moved.

    Args:
        points: (P, n + 1).
        slopes: (P, n, n + 1) there.
        step: of the differences.
        axes: (n + 1,), written: those that are moved, first.
        moved: (((n + 1)² + 3 (n + 1)) / 2 + 1) P points, written as far as used.

    Returns:
        how many axes are moved, and how many points are written.
    """
    count, width = points.shape
    number = 0
    for axis in range(width):
        matters = False
        for k in range(count):
            for i in range(width - 1):
                if slopes[k, i, axis] != 0.0:
                    matters = True
        if matters:
            axes[number] = axis
            number += 1
    at = 0
    for a in range(-1, number):
        for b in range(-2, a):
            # The points themselves, then back and forth, then with each axis before.
            for k in range(count):
                for i in range(width):
                    moved[at, i] = points[k, i]
                if a >= 0:
                    moved[at, axes[a]] += -step if b == -2 else step
                if b >= 0:
                    moved[at, axes[b]] += step
                at += 1
    return number, at


@machine_code
def _difference_twice(rates, weights, step, axes, number, curvature):
    """Writes ∂²(wᵀẋ)/∂(x, u)² (P, n + 1, n + 1) from rates at `_spread_pairs`.

    Args:
        rates: at the moved points.
        weights: (P, n) w.
        step: of the differences.
        axes, number: of `_spread_pairs`.
        curvature: written.
    """
    count, n = weights.shape
    forth = np.empty(n + 1)
    for k in range(count):
        for i in range(n + 1):
            for j in range(n + 1):
                curvature[k, i, j] = 0.0
        at = count + k
        middle = 0.0
        for i in range(n):
            middle += weights[k, i] * rates[k, i]
        for a in range(number):
            for b in range(-2, a):
                value = -middle
                for i in range(n):
                    value += weights[k, i] * rates[at, i]
                at += count
                if b == -2:
                    back = value
                elif b == -1:
                    forth[a] = value
                    own = axes[a]
                    curvature[k, own, own] = (forth[a] + back) / (step * step)
                else:
                    both = (value - forth[a] - forth[b]) / (step * step)
                    curvature[k, axes[a], axes[b]] = both
                    curvature[k, axes[b], axes[a]] = both


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
        self._axes = np.empty(n + 1, dtype=np.int64)

    def collocate(self, w: np.ndarray) -> float:
        """Writes points, rates and defects of knots and h; returns Σ |defect|.

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
        try:
            self._loops.rates_at(points[:knots], self._theta, rates[:knots])
        except CompileError as error:
            raise UncompilableError(str(error)) from None
        _place_middles(step, rates, points)
        self._loops.rates_at(points[knots:], self._theta, rates[knots:])
        return _find_defects(step, rates, points, self.path.defects)

    def linearize(self, fine: bool) -> None:
        """Writes the slopes at the points of `collocate`.

        Args:
            fine: whether by _FINE differences; else by _ROUGH ones, in half the time.
        """
        points = self.path.points
        slopes = self.path.slopes
        count = 2 * points.size
        moved = self._moved[:count]
        rates = self._rates[:count]
        slopes[:] = 0.0
        for step, share in _FINE if fine else _ROUGH:
            spread(points, step, moved)
            self._loops.rates_at(moved, self._theta, rates)
            add_difference(rates, 0.5 * share / step, slopes)

    def curve(self) -> None:
        """Writes the curvature at the points of `linearize`, by the path's weights."""
        path = self.path
        step = _CURVATURE_STEP
        number, count = _spread_pairs(
            path.points, path.slopes, step, self._axes, self._moved
        )
        rates = self._rates[:count]
        self._loops.rates_at(self._moved[:count], self._theta, rates)
        _difference_twice(rates, path.weights, step, self._axes, number, path.curvature)
