"""Newton's step of a collocated path, stage by stage.

A stage's state is s = (x, u, h), with the command at its knot and the length of the
segments, which all stages share; what is chosen there is the command at the next knot.
"""

import numpy as np

from glider.compiled.kernel import called_code, machine_code


@called_code
def invert(matrix, inverse):
    """Writes the inverse of a matrix (n, n), which is destroyed; pivots by rows."""
    n = matrix.shape[0]
    for i in range(n):
        for j in range(n):
            inverse[i, j] = 1.0 if i == j else 0.0
    for k in range(n):
        best = k
        for i in range(k + 1, n):
            if abs(matrix[i, k]) > abs(matrix[best, k]):
                best = i
        if best != k:
            for j in range(n):
                matrix[k, j], matrix[best, j] = matrix[best, j], matrix[k, j]
                inverse[k, j], inverse[best, j] = inverse[best, j], inverse[k, j]
        scale = 1.0 / matrix[k, k]
        for j in range(n):
            matrix[k, j] *= scale
            inverse[k, j] *= scale
        for i in range(n):
            factor = matrix[i, k]
            if i != k and factor != 0.0:
                for j in range(n):
                    matrix[i, j] -= factor * matrix[k, j]
                    inverse[i, j] -= factor * inverse[k, j]


@called_code
def multiply(a, b, product):
    """Writes a b, with as many columns of a as b has rows; in memory of its own."""
    for i in range(a.shape[0]):
        for j in range(b.shape[1]):
            product[i, j] = 0.0
        for m in range(b.shape[0]):
            factor = a[i, m]
            for j in range(b.shape[1]):
                product[i, j] += factor * b[m, j]


@called_code
def add_transposed(a, b, total):
    """Adds aᵀ b to the total, in its shape; a may have more columns."""
    for m in range(a.shape[0]):
        for i in range(total.shape[0]):
            factor = a[m, i]
            for j in range(total.shape[1]):
                total[i, j] += factor * b[m, j]


@machine_code
def weigh(step, path, multipliers, back, gradient):
    """Adds the multipliers' part to the gradient of the Lagrangian.

    Σ μᵀ (x₁ - x₀ - h/6 (f₀ + 4 f_c + f₁)) by all knots and by h. With
    g = (∂f_c)ᵀ μ, its curvature is Σ ∂²(wᵀ f) over knots and middles, beside what h
    brings in; w is -h/6 μ ∓ h²/12 g at the ends of a segment and -2/3 h μ within.

    Args:
        step: h [s].
        path: whose weights w are written.
        multipliers: (N - 1, n) μ.
        back: (N - 1, n + 1), written: g.
        gradient: (N (n + 1) + 1,), added to.
    """
    segments, n = multipliers.shape
    count, width = segments + 1, n + 1
    last = count * width
    rates, slopes, weights = path.rates, path.slopes, path.weights
    for k in range(count):
        for i in range(n):
            weights[k, i] = 0.0
    for k in range(count - 1):
        mu, middle = multipliers[k], slopes[count + k]
        by_step = 0.0
        for j in range(width):
            total = 0.0
            for i in range(n):
                total += middle[i, j] * mu[i]
            back[k, j] = total
            gradient[k * width + j] -= step / 3.0 * total
            gradient[(k + 1) * width + j] -= step / 3.0 * total
        for i in range(n):
            gradient[k * width + i] -= mu[i]
            gradient[(k + 1) * width + i] += mu[i]
            inner = step * step / 12.0 * back[k, i]
            weights[k, i] -= step / 6.0 * mu[i] + inner
            weights[k + 1, i] += inner - step / 6.0 * mu[i]
            weights[count + k, i] = -2.0 / 3.0 * step * mu[i]
            slope = rates[k, i] + 4.0 * rates[count + k, i] + rates[k + 1, i]
            by_step -= mu[i] * slope / 6.0
            by_step -= step / 12.0 * back[k, i] * (rates[k, i] - rates[k + 1, i])
        gradient[last] += by_step
    for k in range(count):
        for j in range(width):
            total = 0.0
            for i in range(n):
                total += slopes[k, i, j] * weights[k, i]
            gradient[k * width + j] += total


@called_code
def link(step, path, k, matrix, asked, by_end, inverse, to_end, to_middle):
    """Writes how a segment's end and its middle follow from its stage.

    Args:
        step: h [s].
        path: with its slopes.
        k: counts the segments.
        matrix, asked: (n, n) and (n, n + 4) scratch.
        by_end: (n, n), written: the middle's states by the end's.
        inverse: (n, n), written: of the defect's slopes by the end's states.
        to_end: (n, n + 4), written: the end's states by x₀, u₀, h, u₁, and what
            the defect asks.
        to_middle: (n + 1, n + 4), written: the middle's states and command.
    """
    n = matrix.shape[0]
    width, count = n + 1, path.defects.shape[0] + 1
    rates, slopes, defects = path.rates, path.slopes, path.defects
    first, end, middle = slopes[k], slopes[k + 1], slopes[count + k]
    for i in range(n):
        for j in range(width):
            own = 0.5 if i == j else 0.0
            to_middle[i, j] = own + 0.125 * step * first[i, j]
        to_middle[i, n + 1] = 0.125 * (rates[k, i] - rates[k + 1, i])
        to_middle[i, n + 2] = -0.125 * step * end[i, n]
        to_middle[i, n + 3] = 0.0
    for j in range(n + 4):
        to_middle[n, j] = 0.0
    to_middle[n, n] = 0.5
    to_middle[n, n + 2] = 0.5
    # The defect by the same, with the other sign.
    share = step / 6.0
    multiply(middle, to_middle, asked)
    for i in range(n):
        for j in range(n + 4):
            asked[i, j] *= 4.0 * share
        for j in range(width):
            asked[i, j] += share * first[i, j]
        asked[i, i] += 1.0
        slope = rates[k, i] + 4.0 * rates[count + k, i] + rates[k + 1, i]
        asked[i, n + 1] += slope / 6.0
        asked[i, n + 2] += share * end[i, n]
        asked[i, n + 3] = -defects[k, i]
    for i in range(n):
        for j in range(n):
            by_end[i, j] = -0.125 * step * end[i, j]
        by_end[i, i] += 0.5
    for i in range(n):
        for j in range(n):
            total = 0.25 * end[i, j]
            for m in range(n):
                total += middle[i, m] * by_end[m, j]
            matrix[i, j] = -4.0 * share * total
        matrix[i, i] += 1.0
    invert(matrix, inverse)
    multiply(inverse, asked, to_end)
    multiply(by_end, to_end, asked)
    for i in range(n):
        for j in range(n + 4):
            to_middle[i, j] += asked[i, j]


@called_code
def own_curvature(k, step, slopes, curvature, multipliers, back, own):
    """Writes the curvature (n + 2, n + 2) of the defects at a knot, by x, u and h."""
    n = own.shape[0] - 2
    width, count = n + 1, multipliers.shape[0] + 1
    for j in range(width):
        for i in range(width):
            own[i, j] = curvature[k, i, j]
        own[width, j] = 0.0
    own[width, width] = 0.0
    for side in range(2):
        m = k - side  # The segment that begins here, then the one that ends here.
        if m < 0 or m > count - 2:
            continue
        sign = 1.0 - 2.0 * side
        for j in range(width):
            total = -back[m, j] / 3.0
            for i in range(n):
                weight = multipliers[m, i] / 6.0 + sign * step / 6.0 * back[m, i]
                total -= slopes[k, i, j] * weight
            own[width, j] += total
    for j in range(width):
        own[j, width] = own[width, j]


@machine_code
def newton_step(
    step,
    path,
    multipliers,
    back,
    cross,
    diagonal,
    added,
    gradient,
    misses,
    penalty,
    change,
    ahead,
    pull,
):
    """Solves for Newton's step of the barrier problem by a Riccati recursion.

    minimize   ½ dᵀ (H + D) d + qᵀ d   subject to the linear defects, x̃₀ = 0 and
    the place at the end.

    H is the curvature of the Lagrangian. The place at the end enters as a penalty,
    which changes no solution, and by two multipliers found last.

    Args:
        step, multipliers, back: as in `weigh`.
        path: with its slopes and its curvature.
        cross: (N,) curvature of the cost by a command and h.
        diagonal: (N (n + 1) + 1,) D, with what the cost has on the diagonal.
        added: to each of D.
        gradient: (N (n + 1) + 1,) q of cost and barrier alone.
        misses: (2,) by which the end leaves its place.
        penalty: on them; 0 where the end is free.
        change: (N (n + 1) + 1,), written: d.
        ahead: (N - 1, n), written: new multipliers.
        pull: (2,), written: multipliers of the place at the end.

    Returns:
        whether the step is a minimum: the curvature is positive wherever the
        constraints leave freedom.
    """
    rates, slopes, curvature = path.rates, path.slopes, path.curvature
    segments, n = multipliers.shape
    count, width, m = segments + 1, n + 1, n + 2
    to_end = np.empty((segments, n, m + 2))
    to_middle = np.empty((segments, width, m + 2))
    inverse, matrix = np.empty((segments, n, n)), np.empty((n, n))
    by_end, asked = np.empty((segments, n, n)), np.empty((n, m + 2))
    gains, feeds = np.empty((segments, m)), np.empty((segments, 3))
    value, cost = np.zeros((m, m)), np.zeros((m, 3))
    values, costs = np.empty((count, n, m)), np.empty((count, n, 3))
    total, own = np.empty((m + 1, m + 2)), np.empty((m, m))
    slope, bent = np.empty((m + 1, 3)), np.empty((width, m + 2))
    carried = np.empty((m, m + 2))
    last = count * width

    own_curvature(segments, step, slopes, curvature, multipliers, back, value)
    for i in range(width):
        value[i, i] += diagonal[segments * width + i] + added
        cost[i, 0] = gradient[segments * width + i]
    value[n, width] += cross[segments]
    value[width, n] += cross[segments]
    for i in range(2):
        value[i, i] += penalty
        cost[i, 0] += penalty * misses[i]
        cost[i, 1 + i] = 1.0
    for k in range(segments - 1, -1, -1):
        end, middle = to_end[k], to_middle[k]
        link(step, path, k, matrix, asked, by_end[k], inverse[k], end, middle)
        for i in range(n):
            for j in range(m):
                values[k + 1, i, j] = value[i, j]
            for r in range(3):
                costs[k + 1, i, r] = cost[i, r]
        # What the next stage's value and the middle's curvature make of this stage.
        multiply(value, end, carried)
        for i in range(m):
            carried[i, n + 1] += value[i, width]
            carried[i, n + 2] += value[i, n]
        multiply(curvature[count + k], middle, bent)
        for i in range(m + 1):
            for j in range(m + 2):
                total[i, j] = 0.0
            for r in range(3):
                slope[i, r] = 0.0
        add_transposed(end, carried, total)
        add_transposed(middle, bent, total)
        add_transposed(end, cost, slope)
        for i in range(m + 1):
            slope[i, 0] += total[i, m + 1]
        for i in range(2):  # The next command and h go on as they are.
            row, at = (n, n + 2) if i == 0 else (n + 1, n + 1)
            for c in range(m + 1):
                total[at, c] += carried[row, c]
            slope[at, 0] += carried[row, m + 1]
            for r in range(3):
                slope[at, r] += cost[row, r]
        own_curvature(k, step, slopes, curvature, multipliers, back, own)
        for i in range(width):
            own[i, i] += diagonal[k * width + i] + added
            slope[i, 0] += gradient[k * width + i]
        by_step = 0.0
        for i in range(n):
            by_step += back[k, i] * (rates[k, i] - rates[k + 1, i])
        own[width, width] = -by_step / 6.0
        own[n, width] += cross[k]
        own[width, n] += cross[k]
        for i in range(m):
            for j in range(m):
                total[i, j] += own[i, j]
        if k == 0:
            total[width, width] += diagonal[last] + added
            slope[width, 0] += gradient[last]
        stiff = total[m, m]
        if not stiff > 0.0:
            return False
        for i in range(m):
            gains[k, i] = -total[m, i] / stiff
        for r in range(3):
            feeds[k, r] = -slope[m, r] / stiff
        for i in range(m):
            for j in range(m):
                value[i, j] = total[i, j] + total[i, m] * gains[k, j]
            for r in range(3):
                cost[i, r] = slope[i, r] + total[i, m] * feeds[k, r]

    # The first command and h are free, the launch is not.
    a, b, d = value[n, n], value[n, width], value[width, width]
    determinant = a * d - b * b
    if not (a > 0.0 and determinant > 0.0):
        return False
    paths = np.empty((3, count, m))
    for r in range(3):
        path = paths[r]
        for i in range(m):
            path[0, i] = 0.0
        path[0, n] = (b * cost[width, r] - d * cost[n, r]) / determinant
        path[0, width] = (b * cost[n, r] - a * cost[width, r]) / determinant
        for k in range(segments):
            push = feeds[k, r]
            for i in range(m):
                push += gains[k, i] * path[k, i]
            for i in range(n):
                ends = to_end[k, i, n + 2] * push
                if r == 0:
                    ends += to_end[k, i, m + 1]
                for j in range(m):
                    ends += to_end[k, i, j] * path[k, j]
                path[k + 1, i] = ends
            path[k + 1, n] = push
            path[k + 1, width] = path[k, width]
    a, b = paths[1, segments, 0], paths[2, segments, 0]
    c, d = paths[1, segments, 1], paths[2, segments, 1]
    left = -misses[0] - paths[0, segments, 0]
    below = -misses[1] - paths[0, segments, 1]
    determinant = a * d - b * c
    if penalty == 0.0:
        pull[0], pull[1] = 0.0, 0.0
    elif determinant > 0.0:
        pull[0] = (d * left - b * below) / determinant
        pull[1] = (a * below - c * left) / determinant
    else:
        return False
    path = paths[0]
    for k in range(count):
        for i in range(m):
            path[k, i] += pull[0] * paths[1, k, i] + pull[1] * paths[2, k, i]
        for i in range(width):
            change[k * width + i] = path[k, i]
    change[last] = path[0, width]

    # Each segment's multipliers balance what its end's states weigh.
    state = np.empty(m + 2)
    for k in range(segments):
        for i in range(m):
            state[i] = path[k, i]
        state[n + 2] = path[k + 1, n]
        state[n + 3] = 1.0
        for i in range(width):
            moved = 0.0
            for j in range(m + 2):
                moved += to_middle[k, i, j] * state[j]
            bent[i, 0] = moved
        for i in range(width):
            weight = 0.0
            for j in range(width):
                weight += curvature[count + k, i, j] * bent[j, 0]
            bent[i, 1] = weight
        for i in range(n):
            force = costs[k + 1, i, 0]
            force += pull[0] * costs[k + 1, i, 1] + pull[1] * costs[k + 1, i, 2]
            for j in range(m):
                force += values[k + 1, i, j] * path[k + 1, j]
            for j in range(n):
                force += by_end[k, j, i] * bent[j, 1]
            bent[i, 2] = force
        for i in range(n):
            weight = 0.0
            for j in range(n):
                weight -= inverse[k, j, i] * bent[j, 2]
            ahead[k, i] = weight
    return True
