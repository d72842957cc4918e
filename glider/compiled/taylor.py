"""Taylor series, and operations on Taylor models on many boxes at once.

A Taylor model (`glider.verification.dynamics.taylor_models`) on B boxes is coefficients
(M, B) of polynomials in v, |v_i| <= 1, and bounds (B,) of what these leave out. NumPy's
and LLVM's functions are assumed accurate to 100 units in the last place.
"""

import numpy as np

from glider.compiled.kernel import called_code, machine_code

ROUNDING, TERMS = 1e-13, 300
"""Relative bound of an operation's rounding, and terms of a sum that it is enough for:
a sum of 300 products has 7e-14."""

WIDER = 1.0 + 1e-12
"""Factor that covers the rounding of the bounds themselves: they are sums of a
few hundred terms that are not negative, with an error below 1e-13."""

_SQRT, _SIN, _COS, _EXP, _TANH, _ARCTAN, _RECIPROCAL = range(7)

FUNCTIONS: dict[np.ufunc, int] = {
    **{np.sqrt: _SQRT, np.sin: _SIN, np.cos: _COS, np.exp: _EXP},
    **{np.tanh: _TANH, np.arctan: _ARCTAN, np.reciprocal: _RECIPROCAL},
}
"""Functions that the physics may use and their codes; np.reciprocal is division."""

INPUT, SUM, PRODUCT, CHANGE, WITHIN = range(7, 12)
"""Codes of the other operations: f a + g b + h, a b, a less its center, and a where
a² <= b² + c² is known."""

WIDTH = 64
"""Boxes that are handled at once, few enough for the processor's cache."""


@called_code
def _write_series(which, a, terms):
    """Writes the Taylor coefficients of a function at a, as many as there is room."""
    count = len(terms)
    if which == _SQRT:
        terms[0] = np.sqrt(a)
        for k in range(1, count):
            terms[k] = terms[k - 1] * (1.5 - k) / (k * a)
    elif which == _RECIPROCAL:
        terms[0] = 1.0 / a
        for k in range(1, count):
            terms[k] = -terms[k - 1] / a
    elif which == _EXP:
        terms[0] = np.exp(a)
        for k in range(1, count):
            terms[k] = terms[k - 1] / k
    elif which == _TANH:  # y' = 1 - y².
        terms[0] = np.tanh(a)
        for k in range(count - 1):
            square = 0.0
            for i in range(k + 1):
                square += terms[i] * terms[k - i]
            terms[k + 1] = ((1.0 if k == 0 else 0.0) - square) / (k + 1)
    elif which == _ARCTAN:  # (1 + a² + 2 a h + h²) y' = 1.
        terms[0] = np.arctan(a)
        for k in range(1, count):
            slope = 1.0 if k == 1 else -2.0 * a * (k - 1) * terms[k - 1]
            slope -= (k - 2) * terms[k - 2] if k > 2 else 0.0
            terms[k] = slope / (k * (1.0 + a * a))
    else:
        value = np.sin(a)
        slope = np.cos(a)
        if which == _COS:
            value, slope = slope, -value
        factorial = 1.0
        for k in range(count):
            factorial *= max(k, 1)
            terms[k] = value / factorial
            value, slope = slope, -value


@called_code
def _tail(which, center, below, spread, terms):
    """Bounds what a function has beyond its series' terms, within spread of center.

    By the derivative that follows, |g⁽ᵏ⁾ / k!|, but for a reciprocal and a root, whose
    argument is not farther below its center than that.
    """
    count = len(terms)
    if which == _SQRT:  # It grows with the distance, upward and downward.
        tail = 0.0
        high = np.sqrt(center + spread)
        for step in (-below, spread):
            polynomial = 0.0
            power = 1.0
            for k in range(count):
                polynomial += terms[k] * power
                power *= step
            gap = abs(polynomial - np.sqrt(center + step))
            tail = max(tail, gap * WIDER + ROUNDING * high)
        return tail if below <= center else np.inf
    if which == _RECIPROCAL:  # 1 / (a + h) = Σ (-h)ᵏ / aᵏ⁺¹, a geometric series.
        size = abs(center)
        share = spread / size
        tail = share**count / (size * (1.0 - share * WIDER)) * WIDER
        return tail if share * WIDER < 1.0 else np.inf
    bound = 1.0
    for k in range(1, count + 1):
        bound /= k
    if which == _EXP:
        bound *= np.exp(center + spread)
    elif which == _TANH:  # Cauchy's estimate: |tanh| <= tan 1 within 1 of the line.
        bound = np.tan(1.0)
    elif which == _ARCTAN:
        bound = 1.0 / count
    return bound * spread**count * WIDER


# A model here is a tuple: coefficients (M + 1, WIDTH) with a last row of zeros, sums
# (D + 1, WIDTH) of their sizes by degree, bounds (WIDTH,), and which rows (M,) there
# are. Other rows but the first stand for zeros, whatever they hold.


@called_code
def _measure(into, degrees):
    """Writes the sums of the coefficients' sizes."""
    into[1][:] = 0.0
    for k in range(len(degrees)):
        if into[3][k]:
            into[1][degrees[k]] += np.abs(into[0][k])


@called_code
def _round(bounds, a, factor):
    """Adds a factor times a model's bound and the rounding of its coefficients."""
    bounds += factor * (a[2] + ROUNDING * a[1].sum(axis=0))


@called_code
def _add(into, a, b, numbers, degrees):
    """Writes f a + g b + h."""
    (f, g, h), sizes = numbers, into[1]
    sizes[:] = 0.0
    for k in range(len(degrees)):
        if not into[3][k]:
            continue  # A loop under an if would not be vectorised.
        row = into[0][k]
        size = sizes[degrees[k]]
        x = a[0][k if a[3][k] else -1]
        y = b[0][k if b[3][k] else -1]
        for box in range(WIDTH):
            row[box] = f * x[box] + g * y[box]
            size[box] += abs(row[box])
    if h != 0.0:
        into[0][0] += h
        sizes[0] = np.abs(into[0][0])
    into[2][:] = ROUNDING * abs(h)
    _round(into[2], a, abs(f))
    _round(into[2], b, abs(g))
    into[2][:] *= WIDER


@called_code
def _multiply(into, a, b, starts, table):
    """Writes the product of two models; starts (M + 1,) are those of its products."""
    left, right, degrees = table
    values_a = a[0]
    values_b = b[0]
    sizes = into[1]
    order = degrees[-1]
    sizes[:] = 0.0
    for k in range(len(degrees)):
        if starts[k] == starts[k + 1]:
            continue
        total = into[0][k]
        size = sizes[degrees[k]]
        total[:] = 0.0
        for p in range(starts[k], starts[k + 1]):
            x = values_a[left[p]]
            y = values_b[right[p]]
            for box in range(WIDTH):
                total[box] += x[box] * y[box]
        for box in range(WIDTH):
            size[box] += abs(total[box])
    bounds = into[2]
    sum_a = np.zeros(WIDTH)
    sum_b = np.zeros(WIDTH)
    bounds[:] = 0.0
    for i in range(order + 1):
        bounds += a[1][i] * sum_b  # So far of the degrees beyond order - i.
        sum_a += a[1][i]
        sum_b += b[1][order - i]
    known = (sum_a + a[2]) * b[2] + a[2] * sum_b
    rounded = ROUNDING * sum_a * sum_b
    bounds[:] = (bounds + known + rounded) * WIDER


@called_code
def _limit(into, a, b, c):
    """Writes a model, or zero with its limit as the bound where that is smaller."""
    first = b[2] + b[1].sum(axis=0)
    second = c[2] + c[1].sum(axis=0)
    limit = np.sqrt(first * first + second * second) * WIDER
    keeps = a[2] <= limit
    for k in range(len(into[3])):
        into[0][k] = np.where(keeps, a[0][k], 0.0)
    for i in range(len(a[1])):
        into[1][i] = np.where(keeps, a[1][i], 0.0)
    into[2][:] = np.where(keeps, a[2], limit)


@called_code
def _reach(model, degrees):
    """Returns how far below and above its center a model's values are, (WIDTH,) each.

    Squares v_i² are not negative; that of v₁ follows the m linear terms.
    """
    above = model[2].copy()
    m = np.count_nonzero(degrees == 1)
    for i in range(1, len(model[1])):
        above += model[1][i]
    below = above * WIDER
    k = 1 + m
    for i in range(m if degrees[-1] > 1 else 0):
        if model[3][k]:
            below -= np.maximum(model[0][k], 0.0)
        k += m - i
    return below * WIDER, above * WIDER


@called_code
def _apply(which, into, model, powers, every, degrees):
    """Writes a function of a model: its series in powers of the change from the center.

    The powers are slots of every model, as many as the degree, from the first on.
    """
    terms = np.empty((WIDTH, len(powers) + 1))
    tails = np.empty(WIDTH)
    below, above = _reach(model, degrees)
    for box in range(WIDTH):
        center = model[0][0, box]
        term = terms[box]
        _write_series(which, center, term)
        tails[box] = _tail(which, center, below[box], above[box], term)
        if which == _SQRT and len(powers) % 2 == 1 and np.isfinite(tails[box]):
            # Up to an odd degree its polynomial is never below it.
            tails[box] = 0.5 * tails[box] + ROUNDING * term[0]
            term[0] -= tails[box]
    bounds = into[2]
    for k in range(len(degrees)):
        if into[3][k]:
            into[0][k] = 0.0
    into[0][0] = terms[:, 0]
    bounds[:] = tails + ROUNDING * (1.0 + np.abs(terms[:, 0]))
    for j in range(len(powers)):
        n = powers[j]
        term = terms[:, j + 1].copy()
        shares = every[2][n] + every[1][n].sum(axis=0)
        for k in range(len(degrees)):
            if not every[3][n, k]:
                continue
            row = into[0][k]
            x = every[0][n, k]
            for box in range(WIDTH):
                row[box] += term[box] * x[box]
        size = np.abs(term)
        bounds += size * every[2][n]
        # The term itself is known up to rounding.
        bounds += 3.0 * ROUNDING * (1.0 + size) * shares
    bounds *= WIDER
    _measure(into, degrees)
    if which == _SQRT:
        _straighten(into, model, below, above)


@called_code
def _straighten(root, square, below, above):
    """Replaces roots by straight lines where these leave out less, as near zero.

    Their arguments are nowhere negative, whatever their polynomials are. Over [a, b]
    the root lies above its chord, of slope 1 / (√a + √b), by at most
    (√b - √a)² / (4 (√a + √b)).
    """
    center = square[0][0]
    change = square[1][1:].sum(axis=0)
    low = np.maximum(center - below * WIDER, 0.0)
    first = np.sqrt(low)
    last = np.sqrt(center + above * WIDER)
    slope = 1.0 / (first + last)
    gap = 0.125 * (last - first) ** 2 * slope
    middle = (center - low) * slope + (first + gap)
    sizes = slope * (np.abs(center) + low + change) + np.abs(middle) + last
    left = (square[2] * slope + gap + 3.0 * ROUNDING * sizes) * WIDER
    for box in range(WIDTH):
        # Also where the root is unknown, but not where nothing is asked to be known.
        if left[box] >= root[2][box] or np.isnan(left[box]):
            continue
        root[2][box] = left[box]
        for k in range(1, len(root[3])):
            if square[3][k]:
                root[0][k, box] = square[0][k, box] * slope[box]
            elif root[3][k]:
                root[0][k, box] = 0.0
        root[0][0, box] = middle[box]
        root[1][0, box] = abs(middle[box])
        for i in range(1, len(root[1])):
            root[1][i, box] = square[1][i, box] * slope[box]


@machine_code
def run(code, of, numbers, present, results, slots, table, inputs, remainders):
    """Carries out operations on models, WIDTH boxes at a time.

    Args:
        code: (N, 3) of each operation: what, into which slot, and which starts are
            those of its products.
        of: (N, D + 1) slots of its operands, or the number of its input.
        numbers: (N, 3) plain numbers f, g and h.
        present: (N, M) which coefficients of its result may not be zero.
        results: (R,) slots where the results are.
        slots: number of slots.
        table: left and right of products, degrees (M,), and starts (., M + 1).
        inputs, remainders: (I, M, B) and (I, B) of models.

    Returns:
        Coefficients (R, M, B) and remainders (R, B) of the results.
    """
    left, right, degrees, starts = table
    boxes = inputs.shape[2]
    count = len(degrees)
    table = (left, right, degrees)
    values = np.zeros((slots, count + 1, WIDTH))
    sizes = np.zeros((slots, degrees[-1] + 1, WIDTH))
    bounds = np.zeros((slots, WIDTH))
    there = np.zeros((slots, count), np.bool_)
    every = values, sizes, bounds, there
    found = np.zeros((len(results), count, boxes))
    lost = np.empty((len(results), boxes))
    for first in range(0, boxes, WIDTH):
        some = min(WIDTH, boxes - first)  # In the other columns is what was there.
        here = slice(first, first + some)
        for k in range(len(code)):
            what, into, pattern = code[k]
            there[into] = present[k]
            if not present[k, 0]:
                values[into, 0] = 0.0  # Functions read their centers there.
            model = values[into], sizes[into], bounds[into], there[into]
            i = of[k, 0]
            j = of[k, 1]
            if what == INPUT:
                for row in range(count):
                    if model[3][row]:
                        model[0][row, :some] = inputs[i, row, here]
                model[2][:some] = remainders[i, here]
                _measure(model, degrees)
                continue
            a = values[i], sizes[i], bounds[i], there[i]
            b = values[j], sizes[j], bounds[j], there[j]
            if what == SUM:
                _add(model, a, b, numbers[k], degrees)
            elif what == PRODUCT:
                _multiply(model, a, b, starts[pattern], table)
            elif what == CHANGE:
                model[0][:], model[1][:], model[2][:] = a[0], a[1], a[2]
                model[0][0], model[1][0] = 0.0, 0.0
            elif what == WITHIN:
                c = of[k, 2]
                _limit(model, a, b, (values[c], sizes[c], bounds[c], there[c]))
            else:
                _apply(what, model, a, of[k, 1:], every, degrees)
        for k in range(len(results)):
            for row in range(count):
                if there[results[k], row]:
                    found[k, row, here] = values[results[k], row, :some]
            lost[k, here] = bounds[results[k], :some]
    return found, lost
