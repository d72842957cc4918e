"""Extended Kalman filters along flights.

All numbers that a glider's motion depends on stand in one vector z, as in
`derivatives_of`. Behind the state each of them is a constant, an input that is known
at every step, or a slow state that is estimated. x̄ is the state with the slow states
behind it, N = n + m numbers.
"""

from typing import NamedTuple

import numpy as np

from glider.compiled.kernel import Family
from glider.compiled.runge_kutta import TINY, put
from glider.physics.chain import NUM_INPUTS, derivatives_of, measure, theta_of


def ekf_advance(t, z, estimated, step, count, gaussians, value, slopes):
    """Advances x̄ by Runge-Kutta steps, with the exact derivative of the result.

    By complex steps through all of the Runge-Kutta steps. A slow state decays as
    ṡ = -decay s, solved exactly.

    Args:
        t: [s].
        z: as in `derivatives_of`.
        estimated: what is, see `EstimatedFlight`.
        step: [s].
        count: number of steps.
        gaussians: of the free functions.
        value: (N,), written.
        slopes: (N, N), written; or (0, 0).
    """
    n = estimated.n
    places = estimated.places
    acting = estimated.acting
    decay = estimated.decay
    exact = slopes.shape[0] > 0
    y = np.empty(z.shape[0], np.complex128)
    start = np.empty(n, np.complex128)
    total = np.empty(n, np.complex128)
    half = np.exp(-0.5 * step * decay)
    if exact:
        slopes[:] = 0.0
        for i in range(value.shape[0]):
            slopes[i, i] = np.exp(-step * count * decay[i - n]) if i >= n else 1.0
    for k in acting if exact else acting[:1]:
        put(z, y)
        if exact:
            y[places[k]] = z[places[k]] + 1j * TINY
        for lap in range(count):
            # The step of `runge_kutta.advance`, which costs an eighth more here: its
            # data are counted as references in each of the many short calls.
            put(y, start)
            put(y, total)
            for stage in range(4):
                weight = step / 6.0 if stage in (0, 3) else step / 3.0
                ahead = 0.5 * step if stage < 2 else step
                now = t + step * (lap + 0.5 * ((stage + 1) // 2))
                d = derivatives_of(now, y, n, gaussians)
                for i in range(n):
                    total[i] += weight * d[i]
                    y[i] = start[i] + ahead * d[i]
                if stage in (0, 2):
                    for i in range(decay.shape[0]):
                        y[places[n + i]] *= half[i]
            put(total, y[:n])
        for j in range(n if exact else 0):
            slopes[j, k] = y[j].imag / TINY
        for j in range(value.shape[0]):
            value[j] = y[places[j]].real


def _ekf_measure(z, estimated, gaussians, value, slopes):
    """Writes what is measured of x̄, with derivatives: the pose, then x[3:].

    Args:
        z, estimated, gaussians: as in `ekf_advance`.
        value: (M,), written; M from 3 to n.
        slopes: (M, N), written.
    """
    n = estimated.n
    y = z.astype(np.complex128)
    slopes[:] = 0.0
    for k in estimated.seen:
        i = estimated.places[k]
        y[i] = z[i] + 1j * TINY
        pose = measure(y, theta_of(y[n + NUM_INPUTS :], gaussians))
        y[i] = z[i]
        for j in range(3):
            value[j] = pose[j].real
            slopes[j, k] = pose[j].imag / TINY
    for j in range(3, value.shape[0]):
        value[j] = z[j]
        slopes[j, j] = 1.0


def _add_product(a, b, sign, total):
    """Adds a b, or subtracts it."""
    for i in range(a.shape[0]):
        for k in range(b.shape[0]):
            factor = sign * a[i, k]
            for j in range(b.shape[1]):
                total[i, j] += factor * b[k, j]


def _factorize(matrix):
    """Overwrites a matrix's lower half by its Cholesky factor; NaN if it has none."""
    for i in range(matrix.shape[0]):
        for j in range(i + 1):
            total = matrix[i, j]
            for k in range(j):
                total -= matrix[i, k] * matrix[j, k]
            matrix[i, j] = np.sqrt(total) if i == j else total / matrix[j, j]


def _solve_factorized(factor, b):
    """Overwrites b by L⁻ᵀ L⁻¹ b."""
    size = factor.shape[0]
    for i in range(size):
        for k in range(i):
            b[i] -= factor[i, k] * b[k]
        b[i] /= factor[i, i]
    for i in range(size - 1, -1, -1):
        for k in range(i + 1, size):
            b[i] -= factor[k, i] * b[k]
        b[i] /= factor[i, i]


def _ekf_predict(n, covariance, slopes, process, half):
    """P ← F P Fᵀ + Q, in place; `half` is (N, N) scratch.

    The slow states' rows of F hold nothing but their own decay.
    """
    half[:] = 0.0
    _add_product(slopes[:n], covariance, 1.0, half)
    for i in range(n, covariance.shape[0]):
        for j in range(covariance.shape[1]):
            half[i, j] = slopes[i, i] * covariance[i, j]
    covariance[:] = 0.0
    _add_product(half, slopes.T, 1.0, covariance)
    for i in range(covariance.shape[0]):
        covariance[i, i] += process[i]


def _ekf_correct(mean, covariance, slopes, noise, innovation, spread, work):
    """Corrects a belief by an innovation; mean and covariance are overwritten.

    S = H P Hᵀ + R, K = P Hᵀ S⁻¹ and, in Joseph's form, in which an error of K
    counts only by its square,
        A = P - K (H P),  P ← A - (A Hᵀ) Kᵀ + (K R) Kᵀ.

    Args:
        slopes: (M, N) H.
        noise: (M, M) R.
        innovation: (M,).
        spread: (M, M), written: S.
        work: (4, N, N) scratch; N is at least M.

    Returns:
        the innovation's square νᵀ S⁻¹ ν.
    """
    rows = innovation.shape[0]
    cross = work[0, :, :rows]
    gain = work[1, :, :rows]
    factor = work[2, :rows, :rows]
    weighted = work[3, 0, :rows]
    cross[:] = 0.0
    spread[:] = noise
    _add_product(covariance, slopes.T, 1.0, cross)
    _add_product(slopes, cross, 1.0, spread)
    factor[:] = spread
    gain[:] = cross
    weighted[:] = innovation
    _factorize(factor)
    _solve_factorized(factor, weighted)
    square = 0.0
    for j in range(rows):
        square += innovation[j] * weighted[j]
    for i in range(mean.shape[0]):
        _solve_factorized(factor, gain[i])
        for j in range(rows):
            mean[i] += gain[i, j] * innovation[j]
    _add_product(gain, cross.T, -1.0, covariance)
    cross[:] = 0.0
    _add_product(covariance, slopes.T, 1.0, cross)
    _add_product(gain, noise, -1.0, cross)
    _add_product(cross, gain.T, -1.0, covariance)
    for i in range(mean.shape[0]):  # Rounding would lose symmetry slowly.
        for j in range(i):
            mean_of_both = 0.5 * (covariance[i, j] + covariance[j, i])
            covariance[i, j] = mean_of_both
            covariance[j, i] = mean_of_both
    return square


def ekf_run(
    t, z, estimated, clock, gaussians, process, noise, inputs, measured, belief, seen
):
    """Runs an extended Kalman filter along a batch of flights.

    Each sample is a prediction of `count` Runge-Kutta steps, then a correction. A
    measurement with a NaN in it is none: then there is no correction, and its
    innovation is NaN.

    Args:
        t: at the start [s].
        z: the constants in their places; the rest is overwritten.
        estimated, gaussians: as in `ekf_advance`.
        clock: Runge-Kutta step [s] and their count to a sample.
        process: (N,) variances that a prediction adds.
        noise: (M, M) covariance of a measurement.
        inputs: (B, K, r), each held for a sample.
        measured: (B, K, M) at the samples' ends.
        belief: means (B, K + 1, N) and covariances (B, K + 1, N, N); the first are
            given, the others are written.
        seen: innovations (B, K, M), their covariances (B, K, M, M), and their squares
            νᵀ S⁻¹ ν (B, K), written.
    """
    step, count = clock
    means, covariances = belief
    innovations, spreads, squares = seen
    places = estimated.places
    entry = estimated.entry
    size = means.shape[2]
    rows = measured.shape[2]
    mean = np.empty(size)
    covariance = np.empty((size, size))
    slopes = np.empty((size, size))
    shows = np.empty((rows, size))
    shown = np.empty(rows)
    work = np.empty((4, size, size))
    for b in range(means.shape[0]):
        put(means[b, 0], mean)
        for i in range(size):
            put(covariances[b, 0, i], covariance[i])
        for k in range(inputs.shape[1]):
            for i in range(entry.shape[0]):
                z[entry[i]] = inputs[b, k, i]
            for i in range(size):
                z[places[i]] = mean[i]
            now = t + k * count * step
            ekf_advance(now, z, estimated, step, count, gaussians, mean, slopes)
            _ekf_predict(estimated.n, covariance, slopes, process, work[0])
            for i in range(size):
                z[places[i]] = mean[i]
            _ekf_measure(z, estimated, gaussians, shown, shows)
            known = True
            for i in range(rows):
                shown[i] = measured[b, k, i] - shown[i]
                known = known and not np.isnan(shown[i])
            if known:
                squares[b, k] = _ekf_correct(
                    mean, covariance, shows, noise, shown, spreads[b, k], work
                )
                put(shown, innovations[b, k])
            else:
                squares[b, k] = np.nan
                innovations[b, k] = np.nan
                spreads[b, k] = np.nan
            put(mean, means[b, k + 1])
            for i in range(size):
                put(covariance[i], covariances[b, k + 1, i])


LOOPS = Family(
    (
        *(_add_product, _factorize, _solve_factorized, _ekf_predict, _ekf_correct),
        *(ekf_advance, _ekf_measure, ekf_run),
    ),
    (ekf_advance, ekf_run),
)


class EstimatedFlight(NamedTuple):
    """Numbers of a glider that a filter estimates, and their places in z.

    Attributes:
        n: number of states.
        places: (N,) indices into z of x̄.
        decay: (m,) decay rates of the slow states [1/s].
        acting: indices into x̄ of what the motion depends on, at least one; by the
            others the derivative is their own decay.
        seen: indices into x̄ of what the pose depends on, at least one.
        entry: (r,) indices into z of the known inputs.
    """

    n: int
    places: np.ndarray
    decay: np.ndarray
    acting: np.ndarray
    seen: np.ndarray
    entry: np.ndarray
