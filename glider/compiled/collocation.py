"""Hermite-Simpson collocation of a path: defects, slopes and curvature."""

import numpy as np

from glider.compiled import jacobian
from glider.compiled.constants import BLOCK
from glider.compiled.jacobian import directional
from glider.compiled.kernel import Family
from glider.physics.chain import derivatives


def block_rates(work, theta):
    """Writes into work[:n, 1] the derivatives of the points work[:n + 1, 0]."""
    n = work.shape[0] - 1
    for j in range(BLOCK):
        d = derivatives(0.0, work[:, 0, j], work[n, 0, j], 0.0, 0.0, theta)
        for i in range(len(d)):
            work[i, 1, j] = d[i]


def block_weighed(work, theta):
    """Writes into work[0, 1] the sum of weights work[:n, 2] times the derivatives."""
    n = work.shape[0] - 1
    for j in range(BLOCK):
        d = derivatives(0.0, work[:, 0, j], work[n, 0, j], 0.0, 0.0, theta)
        total = 0.0
        for i in range(len(d)):
            total += work[i, 2, j] * d[i]
        work[0, 1, j] = total


def rates_at(points, theta, rates):
    """Writes ẋ (P, n) at points (P, n + 1) of states and command."""
    count, width = points.shape
    work = np.empty((width, 3, BLOCK))
    for first in range(0, count, BLOCK):
        for j in range(BLOCK):
            k = min(first + j, count - 1)
            for i in range(width):
                work[i, 0, j] = points[k, i]
        block_rates(work, theta)
        for j in range(min(BLOCK, count - first)):
            for i in range(width - 1):
                rates[first + j, i] = work[i, 1, j]


def collocate(knots, step, theta, rates, middles, defects):
    """Writes what the cubic of each segment makes of its ends.

    With f at the knots and y_c = (x_c, u_c), x_c = (x₀ + x₁)/2 + h (f₀ - f₁)/8,
    u_c = (u₀ + u₁)/2, the defect is x₁ - x₀ - h/6 (f₀ + 4 f(y_c) + f₁): that of
    `glider.planning.transcription.hermite_simpson` times 2 h/3.

    Args:
        knots: (N, n + 1) states and commands.
        step: h [s].
        theta: the glider's numbers.
        rates: (2 N - 1, n), written: f at the knots, then in the middles.
        middles: (N - 1, n + 1), written: y_c.
        defects: (N - 1, n), written.

    Returns:
        the sum of all |defect|.
    """
    count, width = knots.shape
    n = width - 1
    rates_at(knots, theta, rates)
    for k in range(count - 1):
        for i in range(n):
            middles[k, i] = 0.5 * (knots[k, i] + knots[k + 1, i])
            middles[k, i] += 0.125 * step * (rates[k, i] - rates[k + 1, i])
        middles[k, n] = 0.5 * (knots[k, n] + knots[k + 1, n])
    rates_at(middles, theta, rates[count:])
    total = 0.0
    for k in range(count - 1):
        for i in range(n):
            slope = rates[k, i] + 4.0 * rates[count + k, i] + rates[k + 1, i]
            defect = knots[k + 1, i] - knots[k, i] - step / 6.0 * slope
            defects[k, i] = defect
            total += abs(defect)
    return total


def slopes_along(knots, middles, exact, step, z, theta, slopes):
    """Writes ∂ẋ/∂(x, u) at the knots, then in the middles: (2 N - 1, n, n + 1).

    Args:
        knots, middles: as in `collocate`.
        exact: whether by complex steps; else by central differences, side by side
            for a block of points, in a tenth of the time.
        step: of the differences.
        z: of `stacked`; states and commands are overwritten.
        theta: the glider's numbers.
        slopes: written.
    """
    count, width = knots.shape
    n, points = width - 1, 2 * count - 1
    if exact:
        value = np.empty(n)
        each = np.zeros((width, width)).T  # As the plant asks: compiled only once.
        for i in range(width):
            each[i, i] = 1.0
        for k in range(points):
            for i in range(width):
                z[i] = knots[k, i] if k < count else middles[k - count, i]
            directional(0.0, z, each, n, theta.field, value, slopes[k])
        return
    work = np.empty((width, 3, BLOCK))
    for first in range(0, points, BLOCK):
        for j in range(BLOCK):
            k = min(first + j, points - 1)
            for i in range(width):
                work[i, 0, j] = knots[k, i] if k < count else middles[k - count, i]
        for m in range(width):
            work[m, 0] += step
            block_rates(work, theta)
            work[:, 2] = work[:, 1]
            work[m, 0] -= 2.0 * step
            block_rates(work, theta)
            work[m, 0] += step
            for i in range(n):
                for j in range(min(BLOCK, points - first)):
                    rise = work[i, 2, j] - work[i, 1, j]
                    slopes[first + j, i, m] = 0.5 / step * rise


def curvature_along(knots, middles, weights, slopes, step, theta, curvature):
    """Writes ∂²(wᵀẋ)/∂(x, u)² at the knots, then in the middles.

    By second differences, side by side for a block of points. What no slope
    depends on at any point has no curvature either and is not moved.

    Args:
        knots, middles: as in `collocate`.
        weights: (2 N - 1, n) w.
        slopes: of `slopes_along`.
        step: of the differences.
        theta: the glider's numbers.
        curvature: (2 N - 1, n + 1, n + 1), written.
    """
    count, width = knots.shape
    n, points = width - 1, 2 * count - 1
    moved = np.zeros(width, np.bool_)
    for k in range(points):
        for i in range(n):
            for j in range(width):
                if slopes[k, i, j] != 0.0:
                    moved[j] = True
    work = np.zeros((width, 3, BLOCK))
    middle = np.empty(BLOCK)
    pair = np.empty((width, BLOCK))
    curvature[:] = 0.0
    for first in range(0, points, BLOCK):
        here = min(BLOCK, points - first)
        for j in range(BLOCK):
            k = min(first + j, points - 1)
            for i in range(width):
                work[i, 0, j] = knots[k, i] if k < count else middles[k - count, i]
            for i in range(n):
                work[i, 2, j] = weights[k, i]
        block_weighed(work, theta)
        middle[:] = work[0, 1]
        for i in range(width):
            if not moved[i]:
                continue
            work[i, 0] += step
            block_weighed(work, theta)
            pair[i] = work[0, 1] - middle
            work[i, 0] -= 2.0 * step
            block_weighed(work, theta)
            work[i, 0] += step
            for j in range(here):
                twice = pair[i, j] + work[0, 1, j] - middle[j]
                curvature[first + j, i, i] = twice / (step * step)
        for i in range(width):
            for m in range(i):
                if not (moved[i] and moved[m]):
                    continue
                work[i, 0] += step
                work[m, 0] += step
                block_weighed(work, theta)
                work[i, 0] -= step
                work[m, 0] -= step
                for j in range(here):
                    both = work[0, 1, j] - middle[j] - pair[i, j] - pair[m, j]
                    curvature[first + j, i, m] = both / (step * step)
                    curvature[first + j, m, i] = curvature[first + j, i, m]


LOOPS = Family(
    (
        block_rates,
        block_weighed,
        rates_at,
        collocate,
        slopes_along,
        curvature_along,
    ),
    (rates_at, collocate, slopes_along, curvature_along),
    uses=(jacobian.LOOPS,),
)
