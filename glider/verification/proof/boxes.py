"""Polynomials on boxes of a ball: their Taylor models there, and how large they are.

A box is w = center + half v with |v_i| <= 1, the ball is |w| <= 1. A coordinate that
the ball leaves free, as time, has center and half-width zero in it.
"""

import functools
import math

import numpy as np

from glider.compiled.kernel import machine_code
from glider.verification.dynamics.jets import Monomials
from glider.verification.dynamics.taylor_code import ROUNDING, WIDER

SLOPE_BLAME = 0.2
"""Blame of a box's linear terms, which the ball bounds too, beside 1 for those
of higher degree."""


def shifted(table, polynomials, center, half):
    """Returns polynomials (I, M) in w = center + half v, as models on boxes (m, B).

    These are coefficients (I, M, B) and remainders (I, B).
    """
    centers, halves, both = (
        table.values(of.T).T for of in (center, half, np.abs(center) + half)
    )
    found = _shift(polynomials, centers, table.left, table.right, _binomials(table))
    found *= halves
    return found, ROUNDING * WIDER * (np.abs(polynomials) @ both)


def shifted_from(table, polynomials):
    """Returns which coefficients (I, M) there are where polynomials are shifted."""
    present = np.zeros(polynomials.shape, dtype=bool)
    rows, products = np.nonzero(polynomials[:, _binomials(table)[0]])
    present[rows, table.left[products]] = True
    return present


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
def _shift(polynomials, centers, left, right, binomials):
    """Returns coefficients (I, M, B) in half v."""
    where, times = binomials
    shifted = np.zeros((len(polynomials), *centers.shape))
    for i in range(len(polynomials)):
        for p in range(len(left)):
            factor = polynomials[i, where[p]] * times[p]
            if factor != 0.0:
                total, part = shifted[i, left[p]], centers[right[p]]
                for box in range(centers.shape[1]):
                    total[box] += factor * part[box]
    return shifted


def top_in_balls(coefficients, remainder, center, half, exponents, balls):
    """Returns bounds (B,) of p(v) + remainder on the parts of boxes in unit balls.

    For any λ >= 0 the maximum of p in one ball is at most that of
        p(v) + λ (1 - |center + half v|²)
    over the box; there, what is mixed in v or cubic counts by its size, and the others
    are a sum of quadratic functions of one v_i each. So each ball has its own λ, the
    best of a few, and coordinates in none need none.

    Args:
        coefficients: (M, B) of polynomials in v with exponents (M, m).
        balls: which coordinates are those of a unit ball, for each ball.
    """
    which = np.full(len(center), -1)
    for k, ball in enumerate(balls):
        which[ball] = k
    # Numba keeps compiled code when a constant of another module changes: arguments.
    return _top_in_balls(
        coefficients, remainder, center, half, exponents, which, (ROUNDING, WIDER)
    )


@machine_code
def _top_in_balls(coefficients, remainder, center, half, exponents, which, constants):
    rounding, wider = constants
    count, boxes = coefficients.shape
    m = len(center)
    square = np.zeros(count, dtype=np.int64)
    for k in range(1 + m, count):
        for i in range(m):
            if exponents[k, i] == 2 and exponents[k].sum() == 2:
                square[k] = 1 + i
    bounds = np.empty(boxes)
    linear, quadratic = np.empty(m), np.zeros(m)
    tries = np.empty(m + 3)
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
        total = coefficients[0, box] + rounding * abs(coefficients[0, box])
        for i in range(m):
            linear[i] = coefficients[1 + i, box]
            if which[i] < 0:
                first, second = abs(linear[i]), quadratic[i]
                total += first + second
                if second < 0.0 and first < -2.0 * second:
                    total += first * first / (-4.0 * second) - first - second
                total += rounding * (first + abs(second))
        for ball in range(which.max() + 1):
            room, across, along, flat = 1.0, 0.0, 1e-300, 0.0
            for i in range(m):
                tries[i] = 0.0
                if which[i] != ball:
                    continue
                room -= center[i, box] ** 2
                pull = 2.0 * center[i, box] * half[i, box]
                if pull != 0.0:
                    tries[i] = linear[i] / pull
                across += linear[i] * pull
                along += pull * pull
                if half[i, box] > 0.0:
                    flat += (linear[i] / half[i, box]) ** 2
            # The last is the best of all where p is linear.
            tries[m], tries[m + 1] = 0.0, across / along
            tries[m + 2] = 0.5 * np.sqrt(flat)
            least = np.inf
            for weight in tries:
                if not (weight >= 0.0 and np.isfinite(weight)):
                    continue
                value = weight * room
                size = weight * (abs(room) + 1.0)
                for i in range(m):
                    if which[i] != ball:
                        continue
                    pull = 2.0 * center[i, box] * half[i, box]
                    first = linear[i] - weight * pull
                    second = quadratic[i] - weight * half[i, box] ** 2
                    if second < 0.0 and abs(first) < -2.0 * second:
                        value += first * first / (-4.0 * second)
                    else:
                        value += second + abs(first)
                    size += abs(linear[i]) + abs(quadratic[i]) + 4.0 * weight
                value += rounding * size
                least = min(least, value)
            total += least
        top = total + mixed
        bounds[box] = top + (wider - 1.0) * (abs(total) + mixed)
    return bounds


def blame_of(table, difference, remainder, rate):
    """Returns how much each v_i makes a bound large, (m, B): a guide for splitting.

    The highest degree of the rate (M, B) in it indicates what is beyond.
    """
    exponents, degrees = table.exponents, table.degrees
    sizes = np.abs(difference)
    m = exponents.shape[1]
    own = exponents[degrees >= 2].T @ sizes[degrees >= 2]
    # What is beyond the degree varies as the highest degree does.
    top = degrees == table.degree
    highest = exponents[top].T @ np.abs(rate[top])
    total = np.maximum(highest.sum(axis=0), 1e-300)
    return own + SLOPE_BLAME * sizes[1 : m + 1] + highest / total * remainder
