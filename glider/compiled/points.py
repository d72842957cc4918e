"""Derivatives of a glider at many points at once, and what a path needs of them."""

import numpy as np

from glider.compiled import collocation
from glider.compiled.collocation import Path, empty_path
from glider.compiled.constants import BLOCK
from glider.compiled.kernel import Family, UncompilableError, compile_errors
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


ROUGH = ((1e-5, 1.0),)
"""Steps of first differences [m, rad, m/s, rad/s], and how much each counts."""

FINE = ((1e-4, 4.0 / 3.0), (2e-4, -1.0 / 3.0))
"""The same of fourth order (Richardson). Of what changes within 0.01 rad, as the
sharpest stall of the library, they leave 1e-8 of the slope; of all else 1e-11."""

CURVATURE_STEP = 3e-4
"""Step of second differences. Newton's method needs no exact curvature: its root
is where the slopes say."""


class PathDynamics:
    """A glider's dynamics along collocated paths on so many knots.

    Of the glider's own code there is only `rates_at`; the rest is compiled once for
    all gliders. So a glider with other effects compiles in a second, not ten.
    """

    def __init__(self, model: GliderModel, knots: int) -> None:
        """Allocates the arrays that each step overwrites."""
        n = model.num_states
        self.path: Path = empty_path(knots, n)
        self._loops = LOOPS.over(model.kinds, model.has_field)
        self._theta = model.numbers
        most = (2 * knots - 1) * ((n + 1) * (n + 4) // 2 + 1)
        self._moved, self._rates = np.empty((most, n + 1)), np.empty((most, n))
        self._axes = np.empty(n + 1, dtype=np.int64)

    def collocate(self, w: np.ndarray) -> float:
        """Writes points, rates and defects of knots and h; returns Σ |defect|.

        Args:
            w: (N (n + 1) + 1,) the knots, one after the other, and h.

        Raises:
            UncompilableError: a formula is not of what numba compiles.
        """
        points, rates = self.path.points, self.path.rates
        knots, step = len(self.path.defects) + 1, w[-1]
        points[:knots] = w[:-1].reshape(knots, -1)
        try:
            self._loops.rates_at(points[:knots], self._theta, rates[:knots])
        except compile_errors() as error:
            raise UncompilableError(str(error)) from None
        collocation.place_middles(step, rates, points)
        self._loops.rates_at(points[knots:], self._theta, rates[knots:])
        return collocation.find_defects(step, rates, points, self.path.defects)

    def linearize(self, fine: bool) -> None:
        """Writes the slopes at the points of `collocate`.

        Args:
            fine: whether by FINE differences; else by ROUGH ones, in half of the time.
        """
        points, slopes = self.path.points, self.path.slopes
        count = 2 * points.size
        moved, rates = self._moved[:count], self._rates[:count]
        slopes[:] = 0.0
        for step, share in FINE if fine else ROUGH:
            collocation.spread(points, step, moved)
            self._loops.rates_at(moved, self._theta, rates)
            collocation.add_difference(rates, 0.5 * share / step, slopes)

    def curve(self) -> None:
        """Writes the curvature at the points of `linearize`, by the path's weights."""
        path, step = self.path, CURVATURE_STEP
        number, count = collocation.spread_pairs(
            path.points, path.slopes, step, self._axes, self._moved
        )
        rates = self._rates[:count]
        self._loops.rates_at(self._moved[:count], self._theta, rates)
        collocation.difference_twice(
            rates, path.weights, step, self._axes, number, path.curvature
        )
