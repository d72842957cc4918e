"""Polynomials on boxes of a ball: their Taylor models there, and how large they are.

A box is w = center + half v with |v_i| <= 1, the ball is |w| <= 1. A coordinate that
the ball leaves free, as time, has center and half-width zero in it.
"""

import functools
import math

import numpy as np

from glider.compiled.kernel import machine_code
from glider.compiled.taylor import ROUNDING, WIDER
from glider.verification.dynamics.jets import Monomials

SLOPE_BLAME = 0.2
"""Blame of a box's linear terms, which the ball bounds too, beside 1 for those
of higher degree."""


def shifted(table, polynomials, center, half):
    """Returns polynomials (I, M) in w = center + half v, as models on boxes (m, B).

    These are coefficients (I, M, B) and remainders (I, B).
    """
    centers, halves, both = (
        table.values(of.T).T.copy() for of in (center, half, np.abs(center) + half)
    )
    found = _shift(
        polynomials, centers, halves, table.left, table.right, *_binomials(table)
    )
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
def _shift(polynomials, centers, halves, left, right, where, times):
    """Returns coefficients (I, M, B) in v, given monomials (M, B)."""
    shifted = np.zeros((len(polynomials), *centers.shape))
    for i in range(len(polynomials)):
        for p in range(len(left)):
            factor = polynomials[i, where[p]] * times[p]
            if factor == 0.0:
                continue  # A loop under an if would not be vectorised.
            total, part, width = shifted[i, left[p]], centers[right[p]], halves[left[p]]
            for box in range(len(total)):
                total[box] += factor * part[box] * width[box]
    return shifted


def top_in_balls(coefficients, remainder, center, half, exponents, balls):
    """Returns bounds (B,) of p(v) + remainder on the parts of boxes in unit balls.

    For any λ >= 0 the maximum of p in one ball is at most that of
        p(v) + λ (1 - |center + half v|²)
    over the box. There, what is mixed in v or cubic is at most its size times a mean of
    squares v_i², and the rest a sum of quadratic functions of one v_i each. So each
    ball has its own λ, the best of a few, and coordinates in none need none.

    Args:
        coefficients: (M, B) of polynomials in v with exponents (M, m).
        balls: which coordinates are those of a unit ball, for each ball.
    """
    which = np.full(len(center), -1)
    for k, ball in enumerate(balls):
        which[ball] = k
    linear, quadratic, sizes = _by_variable(coefficients, exponents)
    # Numba keeps compiled code when a constant of another module changes: arguments.
    return _top_in_balls(
        linear, quadratic, sizes, remainder, center, half, which, ROUNDING
    )


@machine_code
def _by_variable(coefficients, exponents):
    """Returns p up to degree 1, and Σ quadratic[i] v_i² (m, B) above its rest.

    Also the sums (B,) of the sizes of all coefficients.
    """
    count, m = exponents.shape
    quadratic = np.zeros((m, coefficients.shape[1]))
    sizes = np.zeros(coefficients.shape[1])
    for k in range(count):
        row, degree = coefficients[k], exponents[k].sum()
        for box in range(len(sizes)):
            sizes[box] += abs(row[box])
        is_square = degree == 2 and exponents[k].max() == 2
        for i in range(m):
            if degree < 2 or exponents[k, i] == 0:
                continue  # A loop under an if would not be vectorised.
            share, total = exponents[k, i] / degree, quadratic[i]
            if is_square:
                total += row
                continue
            for box in range(len(sizes)):
                total[box] += share * abs(row[box])
    return coefficients[: 1 + m], quadratic, sizes


@machine_code
def _top_in_balls(linear, quadratic, sizes, remainder, center, half, which, rounding):
    """Bounds linear[0] + Σ (linear[1 + i] v_i + quadratic[i] v_i²) + remainder."""
    m, boxes = center.shape
    bounds, tries = np.empty(boxes), np.empty(2 * m + 3)
    for box in range(boxes):
        known = sizes[box] + remainder[box]
        if not np.isfinite(known):  # min and max would drop a NaN.
            bounds[box] = np.inf
            continue
        total = linear[0, box]
        for i in range(m):
            if which[i] < 0:
                first, second = abs(linear[1 + i, box]), quadratic[i, box]
                if second < 0.0 and first < -2.0 * second:
                    total += first * first / (-4.0 * second)
                else:
                    total += first + second
        for ball in range(which.max() + 1):
            room, across, along, flat = 1.0, 0.0, 1e-300, 0.0
            tries[:] = 0.0
            for i in range(m):
                if which[i] != ball or half[i, box] <= 0.0:
                    continue
                slope, width = linear[1 + i, box], half[i, box]
                pull = 2.0 * center[i, box] * width
                if pull != 0.0:
                    tries[i] = slope / pull
                tries[m + i] = quadratic[i, box] / width**2
                across += slope * pull
                along += pull * pull
                flat += (slope / width) ** 2
            # The last is the best of all where p is linear.
            tries[2 * m + 1], tries[2 * m + 2] = across / along, 0.5 * np.sqrt(flat)
            for i in range(m):
                if which[i] == ball:
                    room -= center[i, box] ** 2
            least = np.inf
            for weight in tries:
                if not (weight >= 0.0 and np.isfinite(weight)):
                    continue
                value = weight * room + rounding * weight * (abs(room) + 4.0 * m)
                for i in range(m):
                    if which[i] != ball:
                        continue
                    pull = 2.0 * center[i, box] * half[i, box]
                    first = abs(linear[1 + i, box] - weight * pull)
                    second = quadratic[i, box] - weight * half[i, box] ** 2
                    if second < 0.0 and first < -2.0 * second:
                        value += first * first / (-4.0 * second)
                    else:
                        value += second + first
                least = min(least, value)
            total += least
        bounds[box] = total + remainder[box] + rounding * (known + abs(total))
    return bounds


def blame_of(table, difference, remainder, rate):
    """Returns how much each v_i makes a bound large, (m, B): a guide for splitting.

    The highest degree of the rate (M, B) in it indicates what is beyond.
    """
    exponents, sizes = table.exponents, np.abs(difference)
    m = exponents.shape[1]
    own = exponents[1 + m :].T @ sizes[1 + m :]
    # What is beyond the degree varies as the highest degree does.
    top = table.of_degree(table.degree)
    highest = exponents[top].T @ np.abs(rate[top])
    total = np.maximum(highest.sum(axis=0), 1e-300)
    return own + SLOPE_BLAME * sizes[1 : m + 1] + highest / total * remainder
