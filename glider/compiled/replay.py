"""Flights along a log: its times, its elevator, its nodes."""

import numpy as np

from glider.compiled.constants import DIFFERENCE
from glider.physics.chain import (
    accelerations,
    derivatives,
    measure,
    meet_air,
)


def log_step(t, x, step, elevator, rate, p, c, field, work):
    """Advances x by one Runge-Kutta step with the elevator's path prescribed.

    Here x[3] is the elevator's constant offset from that path.

    Args:
        elevator: (3,) its path at the start, the middle and the end [rad].
        rate: its mean rate over the step [rad/s].
    """
    total, y = work[0], work[1]
    total[:] = 0.0
    y[:] = x
    for stage in range(4):
        weight = 1.0 / 6.0 if stage in (0, 3) else 1.0 / 3.0
        offset = 0.0 if stage == 0 else (step if stage == 3 else 0.5 * step)
        y[3] = x[3] + elevator[(stage + 1) // 2]
        d = derivatives(t + offset, y, rate + 0.0 * x[0], 0.0, 0.0, p, c, field)
        ahead = 0.5 * step if stage < 2 else step
        for i in range(x.shape[0]):
            total[i] += weight * d[i]
            y[i] = x[i] + ahead * d[i]
    total[3] = 0.0
    for i in range(x.shape[0]):
        x[i] += step * total[i]


def log_rollout(times, start, elevator, rate, theta, field, states):
    """Flies from one start along a log's times, elevator prescribed.

    Args:
        times: (K + 1,).
        start: (n,).
        elevator: (K, 3) as in `log_step`.
        rate: (K,).
        theta: parameters (9,) and coefficients, one after the other.
        states: (K + 1, n), written.
    """
    p, c = theta[:9], theta[9:]
    x = start.copy()
    work = np.empty((2, x.shape[0]), x.dtype)
    states[0] = x
    for k in range(times.shape[0] - 1):
        step = times[k + 1] - times[k]
        log_step(times[k], x, step, elevator[k], rate[k], p, c, field, work)
        states[k + 1] = x


def log_translation(times, start, pitch, elevator, rate, theta, field, states):
    """As `log_rollout`, with the pitch and its rate prescribed as well.

    Args:
        pitch: (K, 3, 2) pitch and pitch rate at the start, middle and end of
            each step.
    """
    p, c = theta[:9], theta[9:]
    n = start.shape[0]
    x = start.copy()
    work = np.empty((2, n), x.dtype)
    total, y = work[0], work[1]
    states[0] = x
    for k in range(times.shape[0] - 1):
        step = times[k + 1] - times[k]
        total[:] = 0.0
        y[:] = x
        for stage in range(4):
            weight = 1.0 / 6.0 if stage in (0, 3) else 1.0 / 3.0
            point = (stage + 1) // 2
            y[2] = pitch[k, point, 0]
            y[3] = x[3] + elevator[k, point]
            y[6] = pitch[k, point, 1]
            t = times[k] + 0.5 * step * point
            d = derivatives(t, y, rate[k] + 0.0 * x[0], 0.0, 0.0, p, c, field)
            ahead = 0.5 * step if stage < 2 else step
            for i in range(n):
                total[i] += weight * d[i]
                y[i] = x[i] + ahead * d[i]
        total[3] = 0.0
        for i in range(n):
            x[i] += step * total[i]
        x[2] = pitch[k, 2, 0]
        x[6] = pitch[k, 2, 1]
        states[k + 1] = x


def log_advance(times, nodes, elevator, rate, theta, field, ends):
    """Flies each interval of a log from its own node; ends (K, n) is written."""
    p, c = theta[:9], theta[9:]
    work = np.empty((2, nodes.shape[1]), nodes.dtype)
    for k in range(times.shape[0] - 1):
        step = times[k + 1] - times[k]
        ends[k] = nodes[k]
        log_step(times[k], ends[k], step, elevator[k], rate[k], p, c, field, work)


def log_extras(times, nodes, elevator, rate, theta, field):
    """Flies the effects' own states along given nodes; nodes[1:, 7:] is written."""
    p, c = theta[:9], theta[9:]
    n = nodes.shape[1]
    x = np.empty_like(nodes[0])
    work = np.empty((2, n), nodes.dtype)
    for k in range(times.shape[0] - 1):
        step = times[k + 1] - times[k]
        x[:] = nodes[k]
        log_step(times[k], x, step, elevator[k], rate[k], p, c, field, work)
        for i in range(7, n):
            nodes[k + 1, i] = x[i]


def log_shoot(
    times, nodes, elevator, rate, theta, free, scale, field, ends, by_x, by_theta
):
    """Flies each interval of a log from its own node, with derivatives.

    Forward differences in floats: at these steps they are good to 1e-6, half the
    price of a complex step, and spare the user its compilation.

    Args:
        times: (K + 1,).
        nodes: (K + 1, n) states at the times.
        elevator: (K, 3).
        rate: (K,).
        theta: parameters and coefficients.
        free: (m,) indices into theta.
        scale: typical sizes of theta.
        ends: (K, n), written: the state that each interval ends in.
        by_x: (K, n, n), written: ∂end/∂node.
        by_theta: (K, n, m), written: ∂end/∂theta[free].
    """
    n = nodes.shape[1]
    p, c = theta[:9], theta[9:]
    x = np.empty_like(nodes[0])
    work = np.empty((2, n), x.dtype)
    log_advance(times, nodes, elevator, rate, theta, field, ends)
    for k in range(times.shape[0] - 1):
        step = times[k + 1] - times[k]
        for j in range(n):
            x[:] = nodes[k]
            x[j] += DIFFERENCE
            log_step(times[k], x, step, elevator[k], rate[k], p, c, field, work)
            for i in range(n):
                by_x[k, i, j] = (x[i] - ends[k, i]) / DIFFERENCE
        for j in range(free.shape[0]):
            x[:] = nodes[k]
            size = DIFFERENCE * scale[free[j]]
            kept = theta[free[j]]
            theta[free[j]] += size
            log_step(times[k], x, step, elevator[k], rate[k], p, c, field, work)
            theta[free[j]] = kept
            for i in range(n):
                by_theta[k, i, j] = (x[i] - ends[k, i]) / size


def log_propagate(by_x, inputs, states):
    """Chains the intervals' derivatives into those of the whole flight.

    Args:
        by_x: (K, n, n) how each interval's end moves with its node.
        inputs: (K, n, m) how it moves with m further columns.
        states: (K + 1, n, n + m), written: how each state moves with the first
            node, then with the columns.
    """
    intervals, n, _ = by_x.shape
    m = inputs.shape[2]
    states[0] = 0.0
    for i in range(n):
        states[0, i, i] = 1.0
    for k in range(intervals):
        for i in range(n):
            for j in range(n + m):
                total = 0.0
                for r in range(n):
                    total += by_x[k, i, r] * states[k, r, j]
                if j >= n:
                    total += inputs[k, i, j - n]
                states[k + 1, i, j] = total


def log_measure(nodes, theta, free, scale, pose, by_x, by_theta):
    """What the sensors show of each node, with derivatives.

    Args:
        nodes: (K, n) states.
        theta: parameters and coefficients.
        free: (m,) indices into theta.
        scale: typical sizes of theta.
        pose: (K, 3), written.
        by_x: (K, 3, n), written.
        by_theta: (K, 3, m), written.
    """
    n = nodes.shape[1]
    p, c = theta[:9], theta[9:]
    x = np.empty_like(nodes[0])
    for k in range(nodes.shape[0]):
        x[:] = nodes[k]
        y = measure(x, p, c)
        for i in range(3):
            pose[k, i] = y[i]
        for j in range(n):
            x[j] += DIFFERENCE
            y = measure(x, p, c)
            x[j] = nodes[k, j]
            for i in range(3):
                by_x[k, i, j] = (y[i] - pose[k, i]) / DIFFERENCE
        for j in range(free.shape[0]):
            size = DIFFERENCE * scale[free[j]]
            kept = theta[free[j]]
            theta[free[j]] += size
            y = measure(x, p, c)
            theta[free[j]] = kept
            for i in range(3):
                by_theta[k, i, j] = (y[i] - pose[k, i]) / size


def log_flow(times, nodes, elevator, rate, theta, field, values):
    """Flow and acceleration at each node of a log.

    Args:
        elevator: (K,) at the nodes.
        rate: (K,) at the nodes.
        values: (K, 9), written: V, sin α, cos α, velocity through the air (x, z),
            accelerations (ẍ, z̈, θ̈), elevator.
    """
    p, c = theta[:9], theta[9:]
    x = np.empty_like(nodes[0])
    for k in range(nodes.shape[0]):
        x[:] = nodes[k]
        x[3] += elevator[k]
        u = rate[k] + 0.0 * x[0]
        flow, terms = meet_air(times[k], x, u, 0.0, 0.0, p, c, field)
        a = accelerations(flow, terms, x, c)
        values[k, 0] = flow.speed
        values[k, 1] = flow.sin_alpha
        values[k, 2] = flow.cos_alpha
        values[k, 3] = flow.air_x
        values[k, 4] = flow.air_z
        values[k, 5] = a[0]
        values[k, 6] = a[1]
        values[k, 7] = a[2]
        values[k, 8] = x[3]


LOOPS = (
    log_step,
    log_rollout,
    log_translation,
    log_advance,
    log_extras,
    log_shoot,
    log_propagate,
    log_measure,
    log_flow,
)
ENTRIES = LOOPS
USES = ()
