"""Loops over boxes in a ball: polynomials moved to them, and how large they are there.

A box is w = center + half v with |v_i| <= 1 (`glider.verification.proof.boxes`). What
bounds a polynomial counts the rounding of its own sums, a share of their terms' sizes.
"""

import numpy as np

from glider.compiled.kernel import called_code, machine_code


@machine_code
def shift(polynomials, centers, halves, left, right, where, times):
    """Returns coefficients (I, M, B) in v, given monomials (M, B)."""
    shifted = np.zeros((len(polynomials), *centers.shape))
    for i in range(len(polynomials)):
        for p in range(len(left)):
            factor = polynomials[i, where[p]] * times[p]
            if factor == 0.0:
                continue  # A loop under an if would not be vectorised.
            total = shifted[i, left[p]]
            part = centers[right[p]]
            width = halves[left[p]]
            for box in range(len(total)):
                total[box] += factor * part[box] * width[box]
    return shifted


@called_code
def _top(first, second):
    """Returns the maximum of first v + second v² over |v| <= 1, first >= 0."""
    if second < 0.0 and first < -2.0 * second:
        return first * first / (-4.0 * second)
    return first + second


@machine_code
def top_in_balls(linear, quadratic, sizes, remainder, center, half, which, rounding):
    """Returns bounds (B,) of p(v) + remainder on the parts of boxes in unit balls.

    For any λ >= 0 the maximum of p in one ball is at most that of
        p(v) + λ (1 - |center + half v|²)
    over the box, where p is at most a sum of quadratic functions of one v_i each. So
    each ball has its own λ, the best of a few, and coordinates in none need none.

    Args:
        linear: (1 + m, B) of p, its constant first.
        quadratic: (m, B) of v_i² in a bound of the rest of p.
        sizes: (B,) sums of the sizes of all coefficients of p.
        remainder: (B,) of each.
        center, half: (m, B) of the boxes.
        which: (m,) number of the unit ball that each coordinate is of; -1 for none.
        rounding: relative bound of an operation's.
    """
    m, boxes = center.shape
    bounds = np.empty(boxes)
    tries = np.empty(2 * m + 3)
    for box in range(boxes):
        known = sizes[box] + remainder[box]
        if not np.isfinite(known):  # min and max would drop a NaN.
            bounds[box] = np.inf
            continue
        total = linear[0, box]
        for i in range(m):
            if which[i] < 0:
                total += _top(abs(linear[1 + i, box]), quadratic[i, box])
        for ball in range(which.max() + 1):
            room = 1.0
            across = 0.0
            along = 1e-300
            flat = 0.0
            tries[:] = 0.0
            for i in range(m):
                if which[i] != ball or half[i, box] <= 0.0:
                    continue
                slope = linear[1 + i, box]
                width = half[i, box]
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
                    value += _top(first, second)
                least = min(least, value)
            total += least
        bounds[box] = total + remainder[box] + rounding * (known + abs(total))
    return bounds
