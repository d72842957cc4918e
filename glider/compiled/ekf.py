"""Extended Kalman filters, and flights for them to watch.

All numbers that a glider's motion depends on stand in one vector z, as in
`directional`: state, command, wind, parameters, coefficients. Behind the state each
of them is a constant, an input that is known at every step, or a slow state that
is estimated. x̄ is the state with the slow states behind it, N = n + m numbers.
"""

import numpy as np

from glider.compiled.constants import TINY
from glider.physics.chain import (
    derivatives,
    measure,
)
from glider.physics.servo import limited_rate


def ekf_advance(t, z, n, slow, decay, acting, step, count, field, value, slopes):
    """Advances x̄ by Runge-Kutta steps, with the exact derivative of the result.

    By complex steps through all of the Runge-Kutta steps. A slow state decays as
    ṡ = -decay s, solved exactly.

    Args:
        t: [s].
        z: as in `directional`.
        n: number of states.
        slow: (m,) indices into z.
        decay: (m,) [1/s].
        acting: indices into x̄ of what the motion depends on, at least one; by
            the others the derivative is their own decay.
        step: [s].
        count: number of steps.
        field: as in `derivatives`.
        value: (N,), written.
        slopes: (N, N), written; or (0, 0).
    """
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
        y[:] = z
        if exact:
            i = k if k < n else slow[k - n]
            y[i] = z[i] + 1j * TINY
        p, c = y[n + 3 : n + 12], y[n + 12 :]
        for lap in range(count):
            start[:] = y[:n]
            total[:] = y[:n]
            for stage in range(4):
                weight = step / 6.0 if stage in (0, 3) else step / 3.0
                ahead = 0.5 * step if stage < 2 else step
                now = t + step * (lap + 0.5 * ((stage + 1) // 2))
                d = derivatives(now, y, y[n], y[n + 1], y[n + 2], p, c, field)
                for i in range(n):
                    total[i] += weight * d[i]
                    y[i] = start[i] + ahead * d[i]
                if stage in (0, 2):
                    for i in range(slow.shape[0]):
                        y[slow[i]] *= half[i]
            y[:n] = total
        for j in range(n if exact else 0):
            slopes[j, k] = y[j].imag / TINY
        for j in range(value.shape[0]):
            value[j] = y[j if j < n else slow[j - n]].real


def ekf_measure(z, n, slow, seen, value, slopes):
    """What is measured of x̄, with derivatives: the pose, then x[3:].

    Args:
        z, n, slow: as in `ekf_advance`.
        seen: indices into x̄ of what the pose depends on, at least one.
        value: (M,), written; M from 3 to n.
        slopes: (M, N), written; or (0, 0).
    """
    y = z.astype(np.complex128)
    p, c = y[n + 3 : n + 12], y[n + 12 :]
    exact = slopes.shape[0] > 0
    slopes[:] = 0.0
    for k in seen if exact else seen[:1]:
        i = k if k < n else slow[k - n]
        if exact:
            y[i] = z[i] + 1j * TINY
        pose = measure(y, p, c)
        y[i] = z[i]
        for j in range(3):
            value[j] = pose[j].real
            if exact:
                slopes[j, k] = pose[j].imag / TINY
    for j in range(3, value.shape[0]):
        value[j] = z[j]
        if exact:
            slopes[j, j] = 1.0


def ekf_predict(n, covariance, slopes, process, scratch):
    """P ← F P Fᵀ + Q, in place; `scratch` is (N, N).

    The slow states' rows of F hold nothing but their own decay.
    """
    size = covariance.shape[0]
    for i in range(size):
        for j in range(size):
            scratch[i, j] = slopes[i, i] * covariance[i, j] if i >= n else 0.0
    for i in range(n):
        for k in range(size):
            for j in range(size):
                scratch[i, j] += slopes[i, k] * covariance[k, j]
    for i in range(size):
        for j in range(i, size):
            if j < n:
                total = 0.0
                for k in range(size):
                    total += scratch[i, k] * slopes[j, k]
            else:
                total = scratch[i, j] * slopes[j, j]
            if i == j:
                total += process[i]
            covariance[i, j] = total
            covariance[j, i] = total


def ekf_correct(mean, covariance, slopes, noise, innovation, spread, work):
    """Corrects a belief by an innovation; mean and covariance are overwritten.

    S = H P Hᵀ + R, K = P Hᵀ S⁻¹ and, in Joseph's form, in which an error of K
    counts only by its square,
        A = P - K (H P),  P ← A - (A Hᵀ) Kᵀ + (K R) Kᵀ.

    Args:
        slopes: (M, N) H.
        noise: (M, M) R.
        innovation: (M,).
        spread: (M, M), written: S.
        work: (3, N, N) scratch; N is at least M.

    Returns:
        the innovation's square νᵀ S⁻¹ ν.
    """
    size, rows = mean.shape[0], innovation.shape[0]
    cross, gain, root = work[0], work[1], work[2]
    for i in range(size):  # P Hᵀ
        for j in range(rows):
            total = 0.0
            for k in range(size):
                total += covariance[i, k] * slopes[j, k]
            cross[i, j] = total
    for i in range(rows):
        for j in range(i, rows):
            total = noise[i, j]
            for k in range(size):
                total += slopes[i, k] * cross[k, j]
            spread[i, j] = total
            spread[j, i] = total
    for i in range(rows):  # S = L Lᵀ, with the diagonal's inverse in its place.
        for j in range(i + 1):
            total = spread[i, j]
            for k in range(j):
                total -= root[i, k] * root[j, k]
            root[i, j] = 1.0 / np.sqrt(total) if i == j else total * root[j, j]
    square = 0.0
    for j in range(rows):  # L⁻¹ ν, into a row that the gain has not filled yet.
        total = innovation[j]
        for k in range(j):
            total -= root[j, k] * gain[0, k]
        gain[0, j] = total * root[j, j]
        square += gain[0, j] * gain[0, j]
    for i in range(size):  # K = P Hᵀ L⁻ᵀ L⁻¹
        for j in range(rows):
            total = cross[i, j]
            for k in range(j):
                total -= gain[i, k] * root[j, k]
            gain[i, j] = total * root[j, j]
        for j in range(rows - 1, -1, -1):
            total = gain[i, j]
            for k in range(j + 1, rows):
                total -= gain[i, k] * root[k, j]
            gain[i, j] = total * root[j, j]
        for j in range(rows):
            mean[i] += gain[i, j] * innovation[j]

    for i in range(size):  # A
        for k in range(rows):
            for j in range(size):
                covariance[i, j] -= gain[i, k] * cross[j, k]
    for i in range(size):  # A Hᵀ - K R, into the place of P Hᵀ.
        for j in range(rows):
            total = 0.0
            for k in range(size):
                total += covariance[i, k] * slopes[j, k]
            for k in range(rows):
                total -= gain[i, k] * noise[k, j]
            cross[i, j] = total
    for i in range(size):
        for j in range(i, size):
            total = covariance[i, j]
            for k in range(rows):
                total -= cross[i, k] * gain[j, k]
            covariance[i, j] = total
            covariance[j, i] = total
    return square


def ekf_run(
    t,
    z,
    n,
    slow,
    decay,
    acting,
    seen,
    entry,
    step,
    count,
    field,
    process,
    noise,
    inputs,
    measured,
    means,
    covariances,
    innovations,
    spreads,
    squares,
):
    """Runs an extended Kalman filter along a batch of flights.

    Each sample is a prediction of `count` Runge-Kutta steps, then a correction. A
    measurement with a NaN in it is none: then there is no correction, and its
    innovation is NaN.

    Args:
        t: at the start [s].
        z: the constants in their places; the rest is overwritten.
        n, slow, decay, acting, step, count, field: as in `ekf_advance`.
        seen: as in `ekf_measure`.
        entry: (r,) indices into z of the known inputs.
        process: (N,) variances that a prediction adds.
        noise: (M, M) covariance of a measurement.
        inputs: (B, K, r), each held for a sample.
        measured: (B, K, M) at the samples' ends.
        means: (B, K + 1, N); the first is given, the others are written.
        covariances: (B, K + 1, N, N), likewise.
        innovations: (B, K, M), written.
        spreads: (B, K, M, M), written: covariances of the innovations.
        squares: (B, K), written: the innovations' νᵀ S⁻¹ ν.
    """
    size, rows = means.shape[2], measured.shape[2]
    mean = np.empty(size)
    covariance = np.empty((size, size))
    slopes = np.empty((size, size))
    shows = np.empty((rows, size))
    shown = np.empty(rows)
    work = np.empty((3, size, size))
    for b in range(means.shape[0]):
        mean[:] = means[b, 0]
        covariance[:] = covariances[b, 0]
        for k in range(inputs.shape[1]):
            for i in range(entry.shape[0]):
                z[entry[i]] = inputs[b, k, i]
            for i in range(size):
                z[i if i < n else slow[i - n]] = mean[i]
            now = t + k * count * step
            ekf_advance(
                now, z, n, slow, decay, acting, step, count, field, mean, slopes
            )
            ekf_predict(n, covariance, slopes, process, work[0])
            for i in range(size):
                z[i if i < n else slow[i - n]] = mean[i]
            ekf_measure(z, n, slow, seen, shown, shows)
            known = True
            for i in range(rows):
                shown[i] = measured[b, k, i] - shown[i]
                known = known and not np.isnan(shown[i])
            if known:
                squares[b, k] = ekf_correct(
                    mean, covariance, shows, noise, shown, spreads[b, k], work
                )
                innovations[b, k] = shown
            else:
                squares[b, k] = np.nan
                innovations[b, k] = np.nan
                spreads[b, k] = np.nan
            means[b, k + 1] = mean
            covariances[b, k + 1] = covariance


def ekf_fly(
    t,
    z,
    n,
    slow,
    decay,
    acting,
    seen,
    entry,
    step,
    count,
    field,
    gain,
    limits,
    shocks,
    errors,
    inputs,
    states,
    measured,
):
    """Flies a batch of gliders under feedback and noise, for a filter to watch.

    The motion is exactly what `ekf_run` takes it for.

    Args:
        t, z, n, slow, decay, acting, seen, entry, step, count, field: as in `ekf_run`.
        gain: (K, f, n) of the feedback of the true state to the first f inputs.
        limits: elevator's lower and upper stop [rad], rate limit [rad/s]; the
            first input is the elevator's rate.
        shocks: (B, K, N) added to x̄ at the end of each sample.
        errors: (B, K, M) of the measurements.
        inputs: (B, K, r); the feedback is subtracted and the limits kept, in place.
        states: (B, K + 1, N); the first is given, the others are written.
        measured: (B, K, M), written.
    """
    size = states.shape[2]
    now = np.empty(size)
    none = np.empty((0, 0))
    for b in range(states.shape[0]):
        now[:] = states[b, 0]
        for k in range(inputs.shape[1]):
            for i in range(gain.shape[1]):
                for j in range(n):
                    inputs[b, k, i] -= gain[k, i, j] * now[j]
            inputs[b, k, 0] = limited_rate(
                inputs[b, k, 0], now[3], limits[0], limits[1], limits[2]
            )
            for i in range(entry.shape[0]):
                z[entry[i]] = inputs[b, k, i]
            for i in range(size):
                z[i if i < n else slow[i - n]] = now[i]
            start = t + k * count * step
            ekf_advance(start, z, n, slow, decay, acting, step, count, field, now, none)
            for i in range(size):
                now[i] += shocks[b, k, i]
                z[i if i < n else slow[i - n]] = now[i]
            ekf_measure(z, n, slow, seen, measured[b, k], none)
            for i in range(measured.shape[2]):
                measured[b, k, i] += errors[b, k, i]
            states[b, k + 1] = now


LOOPS = (ekf_advance, ekf_measure, ekf_predict, ekf_correct, ekf_run, ekf_fly)
ENTRIES = (ekf_advance, ekf_run, ekf_fly)
USES = ()
