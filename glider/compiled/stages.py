"""Newton's step of a collocated path, stage by stage.

A stage's state is s = (x, u, h), with the command at its knot and the length of the
segments, which all stages share; what is chosen there is the command at the next knot.
What depends on both has the columns (u₁, x₀, u₀, h, 1); where the multipliers p of the
place at the end matter, (p₀, p₁) follow.
"""

import numpy as np

from glider.compiled.kernel import called_code, inlined_code, machine_code


@called_code
def _invert(matrix, inverse):
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
            _swap_rows(matrix, k, best)
            _swap_rows(inverse, k, best)
        scale = 1.0 / matrix[k, k]
        for j in range(n):
            matrix[k, j] *= scale
            inverse[k, j] *= scale
        for i in range(n):
            factor = matrix[i, k]
            if i == k or factor == 0.0:
                continue
            for j in range(n):
                matrix[i, j] -= factor * matrix[k, j]
                inverse[i, j] -= factor * inverse[k, j]


@called_code
def _swap_rows(matrix, a, b):
    """Swaps two rows of a matrix."""
    for j in range(matrix.shape[1]):
        kept = matrix[a, j]
        matrix[a, j] = matrix[b, j]
        matrix[b, j] = kept


@inlined_code
def _multiply(a, b, product):
    """Writes a b, with as many columns of a as b has rows; in memory of its own."""
    for i in range(a.shape[0]):
        for j in range(b.shape[1]):
            product[i, j] = 0.0
        for m in range(b.shape[0]):
            factor = a[i, m]
            for j in range(b.shape[1]):
                product[i, j] += factor * b[m, j]


@inlined_code
def _add_transposed(a, b, total):
    """Adds aᵀ b to the first columns of the total, of whose rows a may have more."""
    for m in range(a.shape[0]):
        for i in range(total.shape[0]):
            factor = a[m, i]
            for j in range(b.shape[1]):
                total[i, j] += factor * b[m, j]


@inlined_code
def _dot(row, vector):
    """Returns the product of two vectors of one length."""
    total = 0.0
    for j in range(row.shape[0]):
        total += row[j] * vector[j]
    return total


@machine_code
def weigh(step, path, multipliers, scratch):
    """Adds what the defects weigh to the Lagrangian's slope.

    They weigh Σ μᵀ (x₁ - x₀ - h/6 (f₀ + 4 f_c + f₁)). Let b be the slope of the
    Lagrangian by a middle's (x_c, u_c): -2/3 h (∂f_c)ᵀ μ. The curvature by all points
    is Σ ∂²(wᵀ f), besides what h brings in; w is -h/6 μ ± h/8 b at the ends of a
    segment and -2/3 h μ within.

    Args:
        step: h [s].
        path: with slopes; its weights w are written.
        multipliers: (N - 1, n) μ.
        scratch: b and its slope by h are written, the Lagrangian's slope is added to.
    """
    segments, n = multipliers.shape
    count = segments + 1
    width = n + 1
    rates = path.rates
    slopes = path.slopes
    weights = path.weights
    gradient = scratch.lagrangian
    for k in range(count):
        for i in range(n):
            weights[k, i] = 0.0
    by_step = 0.0
    for k in range(segments):
        mu = multipliers[k]
        within = count + k
        here = k * width
        ahead = here + width
        for j in range(width):
            total = 0.0
            for i in range(n):
                total += slopes[within, i, j] * mu[i]
            by_middle_and_step = -2.0 / 3.0 * total
            by_middle = step * by_middle_and_step
            scratch.by_middle_and_step[k, j] = by_middle_and_step
            scratch.by_middle[k, j] = by_middle
            gradient[here + j] += 0.5 * by_middle
            gradient[ahead + j] += 0.5 * by_middle
        for i in range(n):
            gradient[here + i] -= mu[i]
            gradient[ahead + i] += mu[i]
            outer = step / 6.0 * mu[i]
            inner = step / 8.0 * scratch.by_middle[k, i]
            weights[k, i] += inner - outer
            weights[k + 1, i] -= inner + outer
            weights[within, i] = -4.0 * outer
            slope = rates[k, i] + 4.0 * rates[within, i] + rates[k + 1, i]
            turn = rates[k, i] - rates[k + 1, i]
            by_step += scratch.by_middle[k, i] * turn / 8.0 - mu[i] * slope / 6.0
    gradient[count * width] += by_step
    for k in range(count):
        for j in range(width):
            total = 0.0
            for i in range(n):
                total += slopes[k, i, j] * weights[k, i]
            gradient[k * width + j] += total


@inlined_code
def _apply(matrix, vector, product):
    """Writes the product of a matrix and a vector."""
    for i in range(matrix.shape[0]):
        total = 0.0
        for j in range(matrix.shape[1]):
            total += matrix[i, j] * vector[j]
        product[i] = total


@called_code
def _link(step, path, k, matrix, asked, by_end, inverse, to_end, to_middle):
    """Writes how a segment's end and its middle follow from its stage.

    Args:
        step: h [s].
        path: with its slopes.
        k: counts the segments.
        matrix, asked: (n, n) and (n, n + 4) scratch.
        by_end: (n, n), written: the middle's states by the end's.
        inverse: (n, n), written: of the defect's slopes by the end's states.
        to_end: (n, n + 4), written: the end's states.
        to_middle: (n + 1, n + 4), written: the middle's states and command.
    """
    n = matrix.shape[0]
    within = path.defects.shape[0] + 1 + k
    width = n + 1
    at_step = n + 2
    at_one = n + 3
    rates = path.rates
    first = path.slopes[k]
    end = path.slopes[k + 1]
    middle = path.slopes[within]
    eighth = 0.125 * step
    sixth = step / 6.0
    to_middle[:] = 0.0
    for i in range(n):
        for j in range(width):
            to_middle[i, 1 + j] = eighth * first[i, j]
        for j in range(n):
            by_end[i, j] = -eighth * end[i, j]
        to_middle[i, 1 + i] += 0.5
        by_end[i, i] += 0.5
        to_middle[i, 0] = -eighth * end[i, n]
        to_middle[i, at_step] = 0.125 * (rates[k, i] - rates[k + 1, i])
    to_middle[n, 0] = 0.5
    to_middle[n, width] = 0.5
    # By the defect, x₁ - h/6 (4 f_c + f₁) is x₀ + h/6 f₀ and what is missed.
    _multiply(middle, to_middle, asked)
    _multiply(middle, by_end, matrix)
    for i in range(n):
        for j in range(asked.shape[1]):
            asked[i, j] *= 4.0 * sixth
        for j in range(width):
            asked[i, 1 + j] += sixth * first[i, j]
        for j in range(n):
            matrix[i, j] = -sixth * (4.0 * matrix[i, j] + end[i, j])
        asked[i, 1 + i] += 1.0
        matrix[i, i] += 1.0
        slope = rates[k, i] + 4.0 * rates[within, i] + rates[k + 1, i]
        asked[i, 0] += sixth * end[i, n]
        asked[i, at_step] += slope / 6.0
        asked[i, at_one] = -path.defects[k, i]
    _invert(matrix, inverse)
    _multiply(inverse, asked, to_end)
    _multiply(by_end, to_end, asked)
    to_middle[:n] += asked


@called_code
def _add_knot(k, step, path, multipliers, scratch, added, value):
    """Adds what a knot itself contributes to the value of its stage."""
    segments, n = multipliers.shape
    width = n + 1
    slopes = path.slopes[k]
    first = k * width
    value[n, width] += scratch.cross[k]
    value[width, n] += scratch.cross[k]
    for j in range(width):
        for i in range(width):
            value[j, i] += path.curvature[k, j, i]
        value[j, j] += scratch.diagonal[first + j] + added
        value[j, n + 2] += scratch.slope[first + j]
    for side in range(2):
        m = k - side  # The segment that begins here, then the one that ends here.
        if m < 0 or m >= segments:
            continue
        sign = 1.0 - 2.0 * side
        by_step = scratch.by_middle_and_step[m]
        for j in range(width):
            crossed = 0.5 * by_step[j]
            for i in range(n):
                inner = scratch.by_middle[m, i] + step * by_step[i]
                weight = sign * inner / 8.0 - multipliers[m, i] / 6.0
                crossed += slopes[i, j] * weight
            value[width, j] += crossed
            value[j, width] += crossed
        if side == 0:
            for i in range(n):
                turn = path.rates[k, i] - path.rates[k + 1, i]
                value[width, width] += 0.25 * by_step[i] * turn


@machine_code
def newton_step(step, path, multipliers, scratch, added, penalty):
    """Solves for Newton's step of the barrier problem by a Riccati recursion.

    minimize   ½ dᵀ (H + D) d + qᵀ d   subject to the linear defects, x̃₀ = 0 and
    the place at the end.

    H is the curvature of the Lagrangian. The place at the end enters as a penalty,
    which changes no solution, and by two multipliers p, found last.

    Args:
        step, path, multipliers: as in `weigh`, with the path's curvature.
        scratch: with the diagonal D, the slope q and what the place is missed by; its
            change d and the multipliers `ahead` and `drawn` are written.
        added: to each of D.
        penalty: on the place; 0 where the end is free.

    Returns:
        whether the step is a minimum: the curvature is positive wherever the
        constraints leave freedom.
    """
    segments, n = multipliers.shape
    count = segments + 1
    width = n + 1  # Also the place of h in a stage's state.
    m = n + 2  # Size of that state; (1, p₀, p₁) come after it.
    last = count * width
    to_end = np.empty((segments, n, m + 2))
    to_middle = np.empty((segments, width, m + 2))
    by_end = np.empty((segments, n, n))
    inverse = np.empty((segments, n, n))
    gains = np.empty((segments, m + 3))
    values = np.empty((count, n, m + 3))
    matrix = np.empty((n, n))
    asked = np.empty((n, m + 2))
    bent = np.empty((width, m + 2))
    carried = np.empty((m, m + 4))
    total = np.empty((m + 1, m + 4))

    value = np.zeros((m, m + 3))
    _add_knot(segments, step, path, multipliers, scratch, added, value)
    for i in range(2):
        value[i, i] += penalty
        value[i, m] += penalty * scratch.misses[i]
        value[i, m + 1 + i] = 1.0
    for k in range(segments - 1, -1, -1):
        end = to_end[k]
        middle = to_middle[k]
        _link(step, path, k, matrix, asked, by_end[k], inverse[k], end, middle)
        values[k + 1] = value[:n]
        _multiply(value, end, carried)
        for i in range(m):  # The next command and h go on as they are.
            carried[i, 0] += value[i, n]
            carried[i, m] += value[i, width]
            carried[i, m + 1] += value[i, m]
            carried[i, m + 2] = value[i, m + 1]
            carried[i, m + 3] = value[i, m + 2]
        _multiply(path.curvature[count + k], middle, bent)
        total[:] = 0.0
        _add_transposed(end, carried, total)
        for j in range(m + 4):
            total[0, j] += carried[n, j]
            total[m, j] += carried[width, j]
        _add_transposed(middle, bent, total)
        own = total[1:, 1:]
        _add_knot(k, step, path, multipliers, scratch, added, own)
        if k == 0:
            own[width, width] += scratch.diagonal[last] + added
            own[width, m] += scratch.slope[last]
        stiff = total[0, 0]
        if not stiff > 0.0:
            return False
        for j in range(m + 3):
            gains[k, j] = -total[0, 1 + j] / stiff
            for i in range(m):
                value[i, j] = own[i, j] + total[1 + i, 0] * gains[k, j]

    # The first command and h are free, the launch is not.
    a = value[n, n]
    b = value[n, width]
    d = value[width, width]
    determinant = a * d - b * b
    if not (a > 0.0 and determinant > 0.0):
        return False
    states = np.zeros((3, count, m + 3))  # For each of (1, p₀, p₁) alone.
    stage = np.empty(m + 2)
    for r in range(3):
        by_command = value[n, m + r]
        by_step = value[width, m + r]
        states[r, :, m + r] = 1.0
        states[r, 0, n] = (b * by_step - d * by_command) / determinant
        states[r, 0, width] = (b * by_command - a * by_step) / determinant
        for k in range(segments):
            here = states[r, k]
            ahead = states[r, k + 1]
            stage[0] = _dot(gains[k], here)
            stage[1:] = here[: m + 1]
            _apply(to_end[k], stage, ahead)
            ahead[n] = stage[0]
            ahead[width] = here[width]
    pull = scratch.drawn
    pull[:] = 0.0
    if penalty > 0.0:
        ends = states[:, segments]
        left = -scratch.misses[0] - ends[0, 0]
        below = -scratch.misses[1] - ends[0, 1]
        determinant = ends[1, 0] * ends[2, 1] - ends[2, 0] * ends[1, 1]
        if not determinant > 0.0:
            return False
        pull[0] = (ends[2, 1] * left - ends[2, 0] * below) / determinant
        pull[1] = (ends[1, 0] * below - ends[1, 1] * left) / determinant
    found = states[0] + pull[0] * states[1] + pull[1] * states[2]
    for k in range(count):
        scratch.change[k * width : (k + 1) * width] = found[k, :width]
    scratch.change[last] = found[0, width]

    # Each segment's multipliers balance what its end's states weigh.
    shift = np.empty(width)  # Of the segment's middle.
    weights = np.empty(width)
    forces = np.empty(n)
    for k in range(segments):
        stage[0] = found[k + 1, n]
        stage[1:] = found[k, : m + 1]
        _apply(to_middle[k], stage, shift)
        _apply(path.curvature[count + k], shift, weights)
        _apply(values[k + 1], found[k + 1], forces)
        for i in range(n):
            forces[i] += _dot(by_end[k, :, i], weights)
        for i in range(n):
            scratch.ahead[k, i] = -_dot(inverse[k, :, i], forces)
    return True
