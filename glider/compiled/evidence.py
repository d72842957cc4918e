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
    begin = 0
    for s in range(ends.shape[0]):
        index = np.concatenate((own, more[begin : ends[s]]))
        begin = ends[s]
        count = index.shape[0]
        factor = np.empty((count, count))
        step = np.empty(count)
        for i in range(count):
            row = gram[at[index[i]]]
            for j in range(i + 1):
                factor[i, j] = row[at[index[j]]]
            factor[i, i] += precision[index[i]]
            step[i] = row[-1]
        if not _factorize(factor):
            continue
        _solve_lower(factor, step)
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
