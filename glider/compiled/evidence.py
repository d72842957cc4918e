"""Marginal likelihoods of sets of columns, of which a search compares 100,000."""

import numpy as np

from glider.compiled.kernel import called_code, machine_code


@called_code
def _factorize(a, first):
    """Writes the Cholesky factor of a (n, n) into its lower half; False: there is none.

    By rows, each of which is along the memory; those before the first have it already.
    """
    for i in range(first, a.shape[0]):
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
def _solve_lower(factor, b, first):
    """Overwrites b (n,) by L⁻¹ b, from the first row on."""
    for i in range(first, b.shape[0]):
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
def _fill(a, b, first, gram, at, precision, index):
    """Writes the rows of A, from the first on, into a lower half, and those of b."""
    for i in range(first, index.shape[0]):
        row = gram[at[index[i]]]
        for j in range(i + 1):
            a[i, j] = row[at[index[j]]]
        a[i, i] += precision[index[i]]
        b[i] = row[-1]


@machine_code
def extended(gram, at, precision, low, high, own, more, ends, gains):
    """Writes the log marginal likelihood that columns gain, with others, over none.

    ½ b' A⁻¹ b - ½ log |A| + ½ log |Λ|, A = G + Λ [nats]; minus infinity where a
    coefficient would not be physical.

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
    gains[:] = -np.inf
    common = own.shape[0]
    most = common
    begin = 0
    for s in range(ends.shape[0]):
        most = max(most, common + ends[s] - begin)
        begin = ends[s]
    index = np.empty(most, own.dtype)
    index[:common] = own
    factors = np.empty((most, most))
    solved = np.empty(most)
    _fill(factors, solved, 0, gram, at, precision, own)
    if not _factorize(factors[:common, :common], 0):
        return
    _solve_lower(factors, solved[:common], 0)
    begin = 0
    for s in range(ends.shape[0]):
        count = common + ends[s] - begin
        index[common:count] = more[begin : ends[s]]
        begin = ends[s]
        factor = factors[:count, :count]
        _fill(factor, solved, common, gram, at, precision, index[:count])
        if not _factorize(factor, common):
            continue
        step = solved[:count].copy()
        _solve_lower(factor, step, common)
        value = step @ step
        for i in range(count):
            value += np.log(precision[index[i]]) - 2.0 * np.log(factor[i, i])
        _solve_upper(factor, step)
        is_physical = True
        for i in range(count):
            if step[i] < low[index[i]] or step[i] > high[index[i]]:
                is_physical = False
        if is_physical:
            gains[s] = 0.5 * value
