"""Polynomials on boxes of a ball: their Taylor models there, and how large they are.

A box is w = center + half v with |v_i| <= 1, the ball is |w| <= 1. A coordinate that
the ball leaves free, as time, has center and half-width zero in it.
"""

import functools
import math

import numpy as np

from glider.compiled.kernel import machine_code
from glider.verification.dynamics.jets import Monomials
from glider.verification.dynamics.taylor_models import (
    ROUNDING,
    WIDER,
    TaylorModel,
)

SLOPE_BLAME = 0.2
"""Blame of a box's linear terms, which the ball bounds too, beside 1 for those
of higher degree."""


def shifted(table, polynomial, center, half):
    """Returns the Taylor model of a polynomial in w = center + half v.

    Args:
        table: the Monomials, in w and in v.
        polynomial: (M,) coefficients.
        center: (m, B) of the boxes.
        half: (m, B) their half-widths.
    """
    coefficients, sizes = _shift(
        polynomial,
        table.values(center.T).T,
        table.values(half.T).T,
        table.left,
        table.right,
        _binomials(table),
    )
    return TaylorModel(table, coefficients, ROUNDING * sizes * WIDER)


@functools.lru_cache(maxsize=16)
def _binomials(table: Monomials) -> tuple[np.ndarray, np.ndarray]:
    """Returns for each product in the table where it goes and how often it occurs.

    w^(i+j) has Π_k binomial(i_k + j_k, i_k) terms v^i (center)^j.
    """
    counts = np.diff(table.starts, append=len(table.left))
    where = np.repeat(np.arange(len(table.starts)), counts)
    pairs = zip(table.exponents[where], table.exponents[table.left], strict=True)
    times = [math.prod(map(math.comb, whole, part)) for whole, part in pairs]
    return where, np.array(times, dtype=float)


@machine_code
def _shift(polynomial, centers, halves, left, right, binomials):
    """Returns coefficients (M, B) in v, and the sum of the sizes of all terms (B,)."""
    where, times = binomials
    shifted, sizes = np.zeros_like(centers), np.zeros(centers.shape[1])
    for p in range(len(left)):
        factor = polynomial[where[p]] * times[p]
        if factor == 0.0:
            continue
        for box in range(centers.shape[1]):
            part = factor * centers[right[p], box] * halves[left[p], box]
            shifted[left[p], box] += part
            sizes[box] += abs(part)
    return shifted, sizes


def bound_in_ball(coefficients, remainder, center, half, exponents):
    """Returns bounds (B,) of |p(v)| + remainder on the parts of boxes in the ball.

    For any λ >= 0 the maximum of p in the ball is at most that of
        p(v) + λ (1 - |center + half v|²)
    over the box; there, what is mixed in v or cubic counts by its size, and the others
    are a sum of quadratic functions of one v_i each. λ is the best of a few.

    Args:
        coefficients: (M, B) of polynomials in v.
        remainder: (B,).
        center: (m, B) of the boxes.
        half: (m, B) their half-widths.
        exponents: (M, m) of the monomials.
    """
    # Numba keeps compiled code when a constant of another module changes: arguments.
    constants = ROUNDING, WIDER
    return _bound_in_ball(coefficients, remainder, center, half, exponents, constants)


@machine_code
def _bound_in_ball(coefficients, remainder, center, half, exponents, constants):
    rounding, wider = constants
    count, boxes = coefficients.shape
    m = len(center)
    square = np.zeros(count, dtype=np.int64)
    for k in range(1 + m, count):
        for i in range(m):
            if exponents[k, i] == 2 and exponents[k].sum() == 2:
                square[k] = 1 + i
    bounds = np.empty(boxes)
    linear, quadratic = np.empty(m), np.empty(m)
    tries = np.empty(m + 2)
    for box in range(boxes):
        mixed = remainder[box]
        for k in range(1 + m, count):
            if square[k]:
                quadratic[square[k] - 1] = coefficients[k, box]
            else:
                mixed += abs(coefficients[k, box])
        known = mixed
        for k in range(1 + m):
            known += abs(coefficients[k, box])
        if not np.isfinite(known):  # min and max would drop a NaN.
            bounds[box] = np.inf
            continue
        room = 1.0
        for i in range(m):
            room -= center[i, box] ** 2
        worst = 0.0
        for sign in (1.0, -1.0):
            across, along = 0.0, 1e-300
            for i in range(m):
                linear[i] = sign * coefficients[1 + i, box]
                pull = 2.0 * center[i, box] * half[i, box]
                tries[i] = linear[i] / pull if pull != 0.0 else 0.0
                across += linear[i] * pull
                along += pull * pull
            tries[m], tries[m + 1] = 0.0, across / along
            least = np.inf
            for weight in tries:
                if not weight >= 0.0:
                    continue
                value = weight * room
                size = weight * (abs(room) + 1.0)
                for i in range(m):
                    first = linear[i] - 2.0 * weight * center[i, box] * half[i, box]
                    second = sign * quadratic[i] - weight * half[i, box] ** 2
                    if second < 0.0 and abs(first) < -2.0 * second:
                        value += first * first / (-4.0 * second)
                    else:
                        value += second + abs(first)
                    size += abs(linear[i]) + abs(quadratic[i]) + 4.0 * weight
                value += rounding * size
                least = min(least, value)
            worst = max(worst, sign * coefficients[0, box] + least)
        bounds[box] = (worst + mixed) * wider
    return bounds


def blame_of(difference, rate):
    """Returns how much each v_i makes a bound large, (m, B): a guide for splitting.

    Args:
        difference: the TaylorModel that is bounded.
        rate: that of the rate in it, whose highest degree tells of what is beyond.
    """
    exponents, degrees = difference.table.exponents, difference.table.degrees
    sizes = np.abs(difference.coefficients)
    m = exponents.shape[1]
    own = exponents[degrees >= 2].T @ sizes[degrees >= 2]
    # What is beyond the degree varies as the highest degree does.
    top = degrees == difference.table.degree
    highest = exponents[top].T @ np.abs(rate.coefficients[top])
    total = np.maximum(highest.sum(axis=0), 1e-300)
    return own + SLOPE_BLAME * sizes[1 : m + 1] + highest / total * difference.remainder
