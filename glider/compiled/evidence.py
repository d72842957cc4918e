"""Marginal likelihoods of sets of columns, of which a search compares 100,000."""

import numpy as np

from glider.compiled.kernel import called_code, machine_code


@called_code
def _factorize(a):
    """Writes the Cholesky factor of a (n, n) into its lower half; False: there is none.

    By rows, each of which is along the memory.
    """
    for i in range(a.shape[0]):
        for j in range(i + 1):
            total = a[i, j]
            for k in range(j):
                total -= a[i, k] * a[j, k]
            if i > j:
                a[i, j] = total / a[j, j]
            elif total > 0.0:
                a[i, i] = np.sqrt(total)
            else:  # NaN too.
                return False
    return True


@called_code
def _solve_lower(factor, b):
    """Overwrites b (n,) by L⁻¹ b."""
    for i in range(b.shape[0]):
        for k in range(i):
            b[i] -= factor[i, k] * b[k]
        b[i] /= factor[i, i]


@called_code
def _solve_upper(factor, b):
    """Overwrites b (n,) by L⁻ᵀ b."""
    for i in range(b.shape[0] - 1, -1, -1):
        b[i] /= factor[i, i]
        for k in range(i):
            b[k] -= factor[i, k] * b[i]


@called_code
def _calc_volume(factor, precision, columns):
    """Logarithm of the posterior's volume over the prior's, twice."""
    total = 0.0
    for i, column in enumerate(columns):
        total += np.log(precision[column]) - 2.0 * np.log(factor[i, i])
    return total


@called_code
def _allows(low, high, columns, steps):
    """Whether coefficients are physical."""
    for i, column in enumerate(columns):
        if steps[i] < low[column] or steps[i] > high[column]:
            return False
    return True


@machine_code
def extended(gram, at, precision, low, high, own, more, ends, gains):
    """Writes the log marginal likelihood that columns gain, with others, over none.

    ½ b' A⁻¹ b - ½ log |A| + ½ log |Λ|, A = G + Λ [nats]; minus infinity where a
    coefficient would not be physical. What the columns explain of the others is
    eliminated once for all.

    Args:
        gram: (M + 1, M + 1) of all columns and, last, the error.
        at: (m,) the candidates' columns of them; several may share one.
        precision: (m,) of the prior, Λ.
        low: (m,) least coefficients that are physical.
        high: (m,) largest.
        own: (n,) candidates that are in all sets.
        more: (q,) columns of the sets' others, one set behind the other.
        ends: (s,) where each set ends in `more`.
        gains: (s,), written.
    """
    n = own.shape[0]
    last = gram.shape[0] - 1
    gains[:] = -np.inf
    factor = np.empty((n, n))
    for i in range(n):
        for j in range(i + 1):
            factor[i, j] = gram[at[own[i]], at[own[j]]]
        factor[i, i] += precision[own[i]]
    if not _factorize(factor):
        return
    error = np.empty(n)  # L⁻¹ b, of the columns that are in all sets.
    for i in range(n):
        error[i] = gram[at[own[i]], last]
    _solve_lower(factor, error)
    alone = error.copy()  # Their coefficients without any other.
    _solve_upper(factor, alone)
    gain = error @ error + _calc_volume(factor, precision, own)
    begin = 0
    steps = np.empty(n)
    for s in range(ends.shape[0]):
        index = more[begin : ends[s]]
        begin = ends[s]
        count = index.shape[0]
        side = np.empty((count, n))
        a = np.empty((count, count))
        step = np.empty(count)
        for p in range(count):
            for i in range(n):
                side[p, i] = gram[at[index[p]], at[own[i]]]
            _solve_lower(factor, side[p])
            for r in range(p + 1):
                a[p, r] = gram[at[index[p]], at[index[r]]] - side[p] @ side[r]
            a[p, p] += precision[index[p]]
            step[p] = gram[at[index[p]], last] - side[p] @ error
        if not _factorize(a):
            continue
        _solve_lower(a, step)
        value = gain + step @ step + _calc_volume(a, precision, index)
        _solve_upper(a, step)
        steps[:] = 0.0
        for p in range(count):
            steps += side[p] * step[p]
        _solve_upper(factor, steps)
        if _allows(low, high, own, alone - steps) and _allows(low, high, index, step):
            gains[s] = 0.5 * value
