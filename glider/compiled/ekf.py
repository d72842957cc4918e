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
        for i in range(n):
            slopes[i, i] = 1.0
        for i in range(n, value.shape[0]):
            exponent = -step * count * decay[i - n]
            slopes[i, i] = np.exp(exponent)
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
                is_end = stage in (0, 3)
                weight = step / 6.0 if is_end else step / 3.0
                ahead = 0.5 * step if stage < 2 else step
                share = 0.5 * ((stage + 1) // 2)
                now = t + step * (lap + share)
                d = derivatives_of(now, y, n, gaussians)
                for i in range(n):
                    total[i] += weight * d[i]
                    y[i] = start[i] + ahead * d[i]
                if stage in (0, 2):
                    for i in range(decay.shape[0]):
                        place = places[n + i]
                        y[place] *= half[i]
            put(total, y[:n])
        for j in range(n if exact else 0):
            slopes[j, k] = y[j].imag / TINY
        for j in range(value.shape[0]):
            value[j] = y[places[j]].real


def ekf_measure(z, estimated, gaussians, value, slopes):
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
        numbers = y[n + NUM_INPUTS :]
        theta = theta_of(numbers, gaussians)
        pose = measure(y, theta)
        y[i] = z[i]
        for j in range(3):
            value[j] = pose[j].real
            slopes[j, k] = pose[j].imag / TINY
    for j in range(3, value.shape[0]):
        value[j] = z[j]
        slopes[j, j] = 1.0


def ekf_correct(mean, covariance, slopes, noise, innovation, spread):
    """Corrects a belief by an innovation; mean and covariance are overwritten.

    S = H P Hᵀ + R, K = P Hᵀ S⁻¹ and, in Joseph's form, in which an error of K
    counts only by its square,
        A = P - K (H P),  P ← A - (A Hᵀ) Kᵀ + (K R) Kᵀ.

    Args:
        slopes: (M, N) H.
        noise: (M, M) R.
        innovation: (M,).
        spread: (M, M), written: S.

    Returns:
        the innovation's square νᵀ S⁻¹ ν; NaN for a belief that is not finite.
    """
    cross = covariance @ slopes.T
    spread[:] = slopes @ cross + noise
    if not np.isfinite(spread).all():
        mean[:] = np.nan
        covariance[:] = np.nan
        return np.nan
    inverse = np.linalg.inv(spread)
    gain = cross @ inverse
    mean += gain @ innovation
    covariance -= gain @ cross.T
    rest = covariance @ slopes.T - gain @ noise
    covariance -= rest @ gain.T
    covariance[:] = 0.5 * (covariance + covariance.T)
    return innovation @ inverse @ innovation


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
    slopes = np.empty((size, size))
    shows = np.empty((rows, size))
    shown = np.empty(rows)
    noises = np.diag(process)
    for b in range(means.shape[0]):
        for k in range(inputs.shape[1]):
            mean = means[b, k + 1]
            covariance = covariances[b, k + 1]
            for i in range(entry.shape[0]):
                z[entry[i]] = inputs[b, k, i]
            for i in range(size):
                z[places[i]] = means[b, k, i]
            now = t + k * count * step
            ekf_advance(now, z, estimated, step, count, gaussians, mean, slopes)
            moved = slopes @ covariances[b, k] @ slopes.T + noises
            covariance[:] = 0.5 * (moved + moved.T)
            for i in range(size):
                z[places[i]] = mean[i]
            ekf_measure(z, estimated, gaussians, shown, shows)
            seen_now = measured[b, k] - shown
            if np.isnan(seen_now).any():
                squares[b, k] = np.nan
                innovations[b, k] = np.nan
                spreads[b, k] = np.nan
            else:
                innovations[b, k] = seen_now
                squares[b, k] = ekf_correct(
                    mean, covariance, shows, noise, seen_now, spreads[b, k]
                )


LOOPS = Family((ekf_advance, ekf_measure, ekf_correct, ekf_run), (ekf_advance, ekf_run))


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
