"""The Kalman filter of a flight that is linear in all its unknowns.

A flight's deviation d from the states about which it was linearised moves by
    d⁺ = F d + u δ + noise,    y = H d + w δ + noise,
with the coefficients' changes δ. One recursion of covariances serves all columns: the
measurement's and each coefficient's. What comes out are whitened innovations, linear in
δ, whose squares are the flight's likelihood (the filter-error method; Maine and Iliff,
NASA RP-1168, 1986; Jategaonkar, Flight Vehicle System Identification).

Here the deviations are the motion's n states, and after them two velocities of the
moving air, a pitch acceleration, the elevator's departure from its replayed path
(first-order processes), and four constants of the flight: wind (x, z), elevator trim,
pitch zero.
"""

from typing import NamedTuple

import numpy as np

from glider.compiled.kernel import inlined_code, machine_code

MOTION = 7
"""States of a glider's motion, without those of effects."""

OWN_STATES = 8
"""Deviations after the motion's: gusts x, z, pitch acceleration, elevator, wind x, z,
trim, pitch zero."""

PROCESSES = 4
"""The first of them move; the others are constants of the flight."""

ELEVATOR = 3
PITCH = 2
PITCH_RATE = 6


class FilterArrays(NamedTuple):
    """A flight of K intervals, C channels and m columns, with n states, to filter.

    `mean` and the last four are written.
    """

    times: np.ndarray  #: (K + 1,) of the nodes [s].
    moves: np.ndarray  #: (K, n, n + 8) how each interval's end moves with deviations.
    inputs: np.ndarray  #: (K, n, m) how each column moves it.
    #: (K + 1, C, n + 8) how deviations show in what is measured; (1, C, n + 8) if that
    #: is the same at all nodes.
    shows: np.ndarray
    outputs: (
        np.ndarray
    )  #: (K + 1, C, m) how each column moves pose and elevator: C = 4.
    seen: np.ndarray  #: (K + 1, C) whether they were measured.
    variance: np.ndarray  #: (C,) of the measurements.
    start: np.ndarray  #: (n + 8,) variances of the deviations at the first node.
    mean: np.ndarray  #: (n + 8, m) what each column moves them by there; written.
    rates: np.ndarray  #: (4,) of the processes [1/s].
    powers: np.ndarray  #: (4,) their steady variances.
    innovations: np.ndarray  #: (K + 1, C, m) over their standard deviations.
    variances: np.ndarray  #: (K + 1, C) of the innovations; 1 where nothing was seen.
    #: (K + 1, C, n + 8) covariances of deviations and measurements; of length zero
    #: where nothing is to be smoothed.
    gains: np.ndarray
    #: (K + 1, 2, n + 9), written with them: covariances of the gusts and the deviations
    #: after a row, and the gusts of the last column.
    airs: np.ndarray


@inlined_code
def _filter_columns(
    n,
    m,
    times,
    moves,
    inputs,
    shows,
    outputs,
    seen,
    variance,
    start,
    mean,
    rates,
    powers,
    innovations,
    variances,
    gains,
    airs,
):
    """Whitens a flight's errors; every column of them is filtered at once.

    Args:
        n, m: numbers of states and columns.
        others: those of FilterArrays.
    """
    total = n + OWN_STATES
    keep = np.ones(OWN_STATES)
    # Rows of whole vectors of the processor, the rest zero, and no branches in loops
    # over them: what the compiler does at once.
    width = total + -total % 4
    narrow = n + -n % 4
    covariance = np.zeros((total, width))
    for i in range(total):
        covariance[i, i] = start[i]
    before = np.empty((total, m))
    half = np.empty((n, width))
    moved_by = np.zeros((total, narrow))
    own_half = np.empty(narrow)
    row = np.empty(total)
    gain = np.empty(width)
    innovations[:] = 0.0
    variances[:] = 1.0
    for k in range(times.shape[0]):
        for c in range(seen.shape[1]):
            if not seen[k, c]:
                continue
            row[:] = shows[k % shows.shape[0], c]
            own = variance[c]
            gain[:] = 0.0
            for j in range(m):
                innovations[k, c, j] = outputs[k, c, j]
            for i in range(total):
                part = row[i]
                if part != 0.0:
                    for j in range(width):
                        gain[j] += part * covariance[i, j]
                    for j in range(m):
                        innovations[k, c, j] -= part * mean[i, j]
            if gains.shape[0] > 0:
                gains[k, c] = gain[:total]
            for i in range(total):
                own += row[i] * gain[i]
            if own < variance[c]:  # By rounding: a covariance adds nothing negative.
                own = variance[c]
            inverse = 1.0 / own
            scale = np.sqrt(inverse)
            variances[k, c] = own
            for i in range(total):
                part = gain[i] * inverse
                for j in range(m):
                    mean[i, j] += part * innovations[k, c, j]
                for j in range(width):
                    covariance[i, j] -= part * gain[j]
            for j in range(m):
                innovations[k, c, j] *= scale
        if airs.shape[0] > 0:
            for p in range(2):
                airs[k, p, :total] = covariance[n + p, :total]
                airs[k, p, total] = mean[n + p, m - 1]
        if k == times.shape[0] - 1:
            break

        step = times[k + 1] - times[k]
        for p in range(PROCESSES):
            keep[p] = np.exp(-rates[p] * step)
        before[:] = mean
        for i in range(n):
            for j in range(m):
                mean[i, j] = inputs[k, i, j]
            for r in range(total):
                part = moves[k, i, r]
                moved_by[r, i] = part
                if part != 0.0:
                    for j in range(m):
                        mean[i, j] += part * before[r, j]
        for p in range(PROCESSES):
            for j in range(m):
                mean[n + p, j] *= keep[p]

        for i in range(n):
            half[i] = 0.0
            for r in range(total):
                part = moves[k, i, r]
                for j in range(width):
                    half[i, j] += part * covariance[r, j]
        for i in range(n):
            own_half[:] = 0.0
            for r in range(total):
                part = half[i, r]
                for j in range(narrow):
                    own_half[j] += part * moved_by[r, j]
            for j in range(n):
                covariance[i, j] = own_half[j]
            for j in range(n, total):
                value = half[i, j] * keep[j - n]
                covariance[i, j] = value
                covariance[j, i] = value
        for i in range(n, total):
            for j in range(n, total):
                covariance[i, j] *= keep[i - n] * keep[j - n]
        for p in range(PROCESSES):
            covariance[n + p, n + p] += powers[p] * (1.0 - keep[p] * keep[p])


@machine_code
def filter_flight(*flight):
    """Whitens a flight's errors, see `_filter_columns`.

    Loops whose length the compiler knows take two thirds of the time: there are copies
    for a glider without states of effects, and for one column of it, which fits of
    scales filter.
    """
    n = flight[1].shape[1]
    m = flight[2].shape[2]
    if n == MOTION and m == 1:
        _filter_columns(MOTION, 1, *flight)
    elif n == MOTION:
        _filter_columns(MOTION, m, *flight)
    else:
        _filter_columns(n, m, *flight)


@inlined_code
def _move_back(n, m, moves, keep, later, earlier):
    """Writes F' A for the matrix F of an interval and A (n + 8, m), `later`."""
    for r in range(n + OWN_STATES):
        kept = keep[r - n] if r >= n else 0.0
        for j in range(m):
            earlier[r, j] = kept * later[r, j]
        for i in range(n):
            part = moves[i, r]
            if part != 0.0:
                for j in range(m):
                    earlier[r, j] += part * later[i, j]


@inlined_code
def _trace_back(
    n,
    by_sensor,
    by_start,
    by_power,
    by_time,
    adjoint,
    times,
    moves,
    inputs,
    shows,
    outputs,
    seen,
    variance,
    start,
    mean,
    rates,
    powers,
    innovations,
    variances,
    gains,
    airs,
):
    """Writes what `smooth_flight` does."""
    total = n + OWN_STATES
    size = total + 1  # The last column is λ.
    row = np.empty(total)
    keep = np.ones(OWN_STATES)
    now = np.zeros((total, size))
    later = np.empty((total, size))
    half = np.empty(size)
    by_sensor[:] = 0.0
    by_power[:] = 0.0
    by_time[:] = 0.0
    for k in range(times.shape[0] - 1, -1, -1):
        if k < times.shape[0] - 1:
            step = times[k + 1] - times[k]
            later[:] = now
            for p in range(PROCESSES):
                keep[p] = np.exp(-rates[p] * step)
                own = 0.5 * (later[n + p, n + p] - later[n + p, total] ** 2)
                by_power[p] += own * (1.0 - keep[p] * keep[p])
            for p in range(2):
                mean = 0.0  # Of the adjoint and the gust's filtered covariances.
                for i in range(total):
                    moved = keep[i - n] * airs[k, p, i] if i >= n else 0.0
                    if i < n:
                        for r in range(total):
                            moved += moves[k, i, r] * airs[k, p, r]
                    side = later[n + p, i] - later[n + p, total] * later[i, total]
                    mean += side * moved
                mean -= later[n + p, total] * airs[k, p, total]
                own = later[n + p, n + p] - later[n + p, total] ** 2
                mean -= own * powers[p] * keep[p]
                by_time[p] += mean * keep[p] * step * rates[p]
            _move_back(n, size, moves[k], keep, later, now)
            for i in range(total):
                for j in range(total):
                    later[i, j] = now[j, i]
            _move_back(n, total, moves[k], keep, later, now)
        for p in range(2):
            for j in range(total):
                airs[k, p, total] += airs[k, p, j] * now[j, total]
        for c in range(seen.shape[1] - 1, -1, -1):
            if not seen[k, c]:
                continue
            row[:] = shows[k % shows.shape[0], c]
            inverse = 1.0 / variances[k, c]
            change = innovations[k, c, 0] * np.sqrt(variances[k, c])
            spread = inverse
            half[:] = 0.0
            for i in range(total):  # Λ is symmetric.
                part = gains[k, c, i] * inverse
                for j in range(size):  # Whole vectors; the last is not used.
                    half[j] += part * now[i, j]
                change -= gains[k, c, i] * now[i, total]
            for i in range(total):
                spread += gains[k, c, i] * half[i] * inverse
            change *= inverse
            by_sensor[c] += 0.5 * (spread - change * change)
            for i in range(total):
                part = row[i]
                if part != 0.0:
                    for j in range(total):
                        now[i, j] += part * (row[j] * spread - half[j])
                        now[j, i] -= part * half[j]
                    now[i, total] += part * change
    for i in range(by_start.shape[0]):
        by_start[i] = 0.5 * (now[i, i] - now[i, total] ** 2)
        adjoint[i] = now[i, total]


@machine_code
def smooth_flight(by_sensor, by_start, by_power, by_time, adjoint, *flight):
    """Smooths a flight of one column that was filtered; writes its cost's slopes.

    The adjoint recursion of Bryson and Frazier: with λ, what later rows say of a node's
    deviations, they are filtered + covariance · λ. It leaves the gusts in
    airs[:, :, -1]. The cost is ½ Σ (e² + log s) of innovations e over their standard
    deviations and of their variances s. With Λ, the covariance of λ,
        dcost = ½ tr((Λ - λ λ') dP) - λ' dm
    for changes of a covariance P and a mean m (Segal and Weinstein, IEEE Trans. Inf.
    Theory 35, 1989).

    Args:
        by_sensor: (C,) by the variances of the measurements.
        by_start: (n + 8,) by those of the deviations at the first node.
        by_power: (4,) by the steady ones of the processes, but for their start.
        by_time: (2,) by the logarithms of the gusts' correlation times.
        adjoint: (n + 8,) λ of the first node.
        flight: those of FilterArrays, with gains and airs.
    """
    n = flight[1].shape[1]
    if n == MOTION:
        _trace_back(MOTION, by_sensor, by_start, by_power, by_time, adjoint, *flight)
    else:
        _trace_back(n, by_sensor, by_start, by_power, by_time, adjoint, *flight)


def no_flight() -> FilterArrays:
    """Returns arrays of the types that `filter_flight` is compiled for."""
    a, b, c = (np.zeros((0,) * count) for count in (1, 2, 3))
    return FilterArrays(
        times=a,
        moves=c,
        inputs=c,
        shows=c,
        outputs=c,
        seen=np.zeros((0, 0), dtype=bool),
        variance=a,
        start=np.zeros(OWN_STATES),  # It has no other states.
        mean=b,
        rates=a,
        powers=a,
        innovations=c,
        variances=b,
        gains=c,
        airs=c,
    )
