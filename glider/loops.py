"""Loops over the dynamics, which `glider.kernel` compiles with the chain.

Each takes arrays and writes into arrays. Their text is compiled behind that of
`glider.chain`, so that `derivatives` means the glider with its effects.
"""

import numpy as np

from glider.chain import accelerations, derivatives, measure, meet_air
from glider.servo_limits import limited_rate

DIFFERENCE = 1e-6
"""Step of the finite differences, in a coefficient's own scale."""

TINY = 1e-30
"""Length of the complex steps."""

BLOCK = 32
"""Gliders that `rollouts` flies side by side."""


def rollouts(start, command, step, p, c, field, order, states):
    """Flies a batch of gliders under command tapes in still air.

    Gliders go in blocks, and of a block all take a step before any takes the
    next: so the compiler puts several gliders into one instruction. For that it
    must see that nothing overlaps, hence one work array of a fixed width and
    parameters as a tuple.

    Args:
        start: (B, n) states at launch.
        command: (B, N) elevator-rate commands, each held for one step [rad/s].
        step: [s].
        p, c, field: as in `derivatives`.
        order: 1 for explicit Euler, 4 for classical Runge-Kutta.
        states: (B, N + 1, n), written; or (B, 1, n) to keep only the last.
    """
    batch, n = start.shape
    steps = command.shape[1]
    keep = states.shape[1] > 1
    p = (p[0], p[1], p[2], p[3], p[4], p[5], p[6], p[7], p[8])
    work = np.empty((n + 1, 4, BLOCK), start.dtype)
    path = np.empty((steps if keep else 1, n, BLOCK), start.dtype)
    for first in range(0, batch, BLOCK):
        count = min(BLOCK, batch - first)
        for j in range(BLOCK):  # What is left of the last block repeats a glider.
            for i in range(n):
                work[i, 0, j] = start[first + min(j, count - 1), i]
        for k in range(steps):
            for j in range(BLOCK):
                work[n, 0, j] = command[first + min(j, count - 1), k]
            if order == 1:
                slopes(k * step, work, p, c, field)
                for i in range(n):
                    for j in range(BLOCK):
                        work[i, 0, j] += step * work[i, 1, j]
            else:
                runge_kutta_block(k * step, work, step, p, c, field)
            if keep:
                path[k] = work[:n, 0]
        if not keep:
            path[0] = work[:n, 0]
        for j in range(count):
            if keep:
                states[first + j, 0] = start[first + j]
            for k in range(path.shape[0]):
                for i in range(n):
                    states[first + j, k + keep, i] = path[k, i, j]


def slopes(t, work, p, c, field):
    """Writes into work[:n, 1] the derivatives of the states work[:n, 0].

    work[n, 0] holds the commands.
    """
    n = work.shape[0] - 1
    for j in range(BLOCK):
        d = derivatives(t, work[:, 0, j], work[n, 0, j], 0.0, 0.0, p, c, field)
        for i in range(len(d)):
            work[i, 1, j] = d[i]


def runge_kutta_block(t, work, step, p, c, field):
    """Advances the states work[:n, 0] by one step; work[:, 1:] is scratch."""
    n = work.shape[0] - 1
    for i in range(n):
        for j in range(BLOCK):
            work[i, 2, j] = work[i, 0, j]
            work[i, 3, j] = work[i, 0, j]
    for stage in range(4):
        weight = 1.0 / 6.0 if stage in (0, 3) else 1.0 / 3.0
        offset = 0.0 if stage == 0 else (step if stage == 3 else 0.5 * step)
        ahead = 0.5 * step if stage < 2 else step
        slopes(t + offset, work, p, c, field)
        for i in range(n):
            for j in range(BLOCK):
                work[i, 3, j] += step * weight * work[i, 1, j]
                work[i, 0, j] = work[i, 2, j] + ahead * work[i, 1, j]
    for i in range(n):
        for j in range(BLOCK):
            work[i, 0, j] = work[i, 3, j]


def directional(t, z, directions, n, field, value, slopes):
    """The derivatives of a glider and their exact slopes along given directions.

    By complex steps, f'(z) v = Im f(z + i h v) / h for a tiny h, without a
    difference in which digits could cancel. Unit vectors give the Jacobian.

    Args:
        t: [s].
        z: (n + 3 + 9 + len(c),) state, command [rad/s], wind (x, z) [m/s], p, c.
        directions: (r, m); row i belongs to z[i], missing rows are zero.
        n: number of states.
        field: as in `derivatives`.
        value: (n,), written.
        slopes: (n, m), written.
    """
    y = z.astype(np.complex128)
    for k in range(max(directions.shape[1], 1)):
        if directions.shape[1] > 0:
            for i in range(directions.shape[0]):
                y[i] = z[i] + 1j * TINY * directions[i, k]
        p, c = y[n + 3 : n + 12], y[n + 12 :]
        d = derivatives(t, y, y[n], y[n + 1], y[n + 2], p, c, field)
        for i in range(len(d)):
            value[i] = d[i].real
            if directions.shape[1] > 0:
                slopes[i, k] = d[i].imag / TINY


def riccati(times, states, slopes, inputs, q, r, s, p, c, field, gain, offset, cost):
    """Linearizes about a nominal path and integrates the Riccati equations back.

    With A, B along the path, e = f(x₀, u₀) - ẋ₀ and K = R⁻¹ Bᵀ S:
        -Ṡ  = Q + S A + Aᵀ S - S B R⁻¹ Bᵀ S
        -ṡ  = (A - B K)ᵀ s + S e
    the cost-to-go is x̃ᵀ S x̃ + 2 x̃ᵀ s + (a number), x̃ = x - x₀, and the policy is
    u = u₀ - K x̃ - k₀ with k₀ = R⁻¹ Bᵀ s. Derivatives are complex steps; each
    Runge-Kutta step spans two intervals of the times.

    Args:
        times: (2 M + 1,) uniform [s].
        states: (2 M + 1, n) x₀.
        slopes: (2 M + 1, n) ẋ₀.
        inputs: (2 M + 1,) u₀ [rad/s].
        q: (n, n) Q.
        r: R.
        s: (n, n) S at the end.
        p, c, field: as in `derivatives`.
        gain: (M + 1, n), written: K at every other time.
        offset: (M + 1,), written: k₀.
        cost: (M + 1, n, n + 1), written: S and, as its last column, s.
    """
    count, n = states.shape
    jacobian = np.empty((count, n, n + 1))
    excess = np.empty((count, n))
    each = np.zeros((n + 1, n + 1)).T  # As the plant asks: compiled only once.
    z = np.zeros(n + 12 + c.shape[0])
    z[n + 3 : n + 12] = p
    z[n + 12 :] = c
    for i in range(n + 1):
        each[i, i] = 1.0
    for k in range(count):
        z[:n] = states[k]
        z[n] = inputs[k]
        directional(times[k], z, each, n, field, excess[k], jacobian[k])
        excess[k] -= slopes[k]

    now = np.empty((n, n + 1))
    here = np.empty((n, n + 1))
    total = np.empty((n, n + 1))
    slope = np.empty((n, n + 1))
    back = np.empty(n)
    now[:, :n] = s
    now[:, n] = 0.0
    for k in range(count // 2, -1, -1):
        cost[k] = now
        for j in range(n + 1):
            push = 0.0
            for i in range(n):
                push += jacobian[2 * k, i, n] * now[i, j]
            if j < n:
                gain[k, j] = push / r
            else:
                offset[k] = push / r
        if k == 0:
            break
        step = times[2 * k] - times[2 * k - 2]
        here[:] = now
        total[:] = now
        for stage in range(4):
            at = 2 * k - (stage + 1) // 2
            riccati_slope(jacobian[at], excess[at], q, r, here, back, slope)
            weight = step / 6.0 if stage in (0, 3) else step / 3.0
            ahead = 0.5 * step if stage < 2 else step
            for i in range(n):
                for j in range(n + 1):
                    total[i, j] += weight * slope[i, j]
                    here[i, j] = now[i, j] + ahead * slope[i, j]
        for i in range(n):  # Symmetry, which rounding would lose slowly.
            now[i, n] = total[i, n]
            for j in range(n):
                now[i, j] = 0.5 * (total[i, j] + total[j, i])


def riccati_slope(a, e, q, r, s, back, slope):
    """Writes -Ṡ and, as its last column, -ṡ; see `riccati`.

    `a` is A and, as its last column, B; `back` is scratch.
    """
    n = q.shape[0]
    for j in range(n + 1):  # Bᵀ S, Bᵀ s.
        push = 0.0
        for i in range(n):
            push += a[i, n] * s[i, j]
        if j < n:
            back[j] = push
        else:
            drive = push
    for i in range(n):
        for j in range(n):
            total = q[i, j] - back[i] * back[j] / r
            for m in range(n):
                total += s[i, m] * a[m, j] + a[m, i] * s[m, j]
            slope[i, j] = total
        total = -back[i] * drive / r
        for m in range(n):
            total += a[m, i] * s[m, n] + s[i, m] * e[m]
        slope[i, n] = total


def guided(
    start,
    steps,
    step,
    offset,
    gain,
    hold,
    noise,
    limits,
    wire,
    p,
    c,
    field,
    miss,
    states,
):
    """Flies a batch of gliders under the feedback u = offset - gain x.

    Blocks as in `rollouts`. The servo's `limited_rate` lies between command and
    glider.

    Args:
        start: (B, n) states at launch.
        steps: their number, N.
        step: [s].
        offset: (2 N + 1,) at the steps and half steps, or with a hold (H,), one
            for each command [rad/s].
        gain: (2 N + 1, m) or (H, m); the first m states are fed back.
        hold: number of steps that a command is held; 0 for none.
        noise: (B, H, m) added to the states fed back; (B, 0, m) for none.
        limits: elevator's lower and upper stop [rad], rate limit [rad/s].
        wire: (x, z) [m].
        p, c, field: as in `derivatives`.
        miss: (B,), written: least distance of the path from the wire, by
            straight segments between the steps [m].
        states: (B, N + 1, n), written; or (B, 1, n) to keep only the last.
    """
    batch, n = start.shape
    keep = states.shape[1] > 1
    p = (p[0], p[1], p[2], p[3], p[4], p[5], p[6], p[7], p[8])
    work = np.empty((n + 1, 4, BLOCK))
    error = np.zeros((gain.shape[1], BLOCK))
    near = np.empty((3, BLOCK))
    path = np.empty((steps if keep else 1, n, BLOCK))
    for first in range(0, batch, BLOCK):
        count = min(BLOCK, batch - first)
        for j in range(BLOCK):  # What is left of the last block repeats a glider.
            for i in range(n):
                work[i, 0, j] = start[first + min(j, count - 1), i]
            near[2, j] = np.inf
        for k in range(steps):
            for i in range(2):
                near[i] = work[i, 0]
            if hold > 0 and k % hold == 0:
                if noise.shape[1] > 0:
                    for j in range(BLOCK):
                        for i in range(gain.shape[1]):
                            row = first + min(j, count - 1)
                            error[i, j] = noise[row, k // hold, i]
                feed_back(k // hold, offset, gain, error, work)
            guided_step(k, work, step, offset, gain, hold, error, limits, p, c, field)
            approach(wire, work, near)
            if keep:
                path[k] = work[:n, 0]
        if not keep:
            path[0] = work[:n, 0]
        for j in range(count):
            miss[first + j] = np.sqrt(near[2, j])
            if keep:
                states[first + j, 0] = start[first + j]
            for k in range(path.shape[0]):
                for i in range(n):
                    states[first + j, k + keep, i] = path[k, i, j]


def guided_step(k, work, step, offset, gain, hold, error, limits, p, c, field):
    """Advances the states work[:n, 0] by step k; work[n, 1] holds the commands."""
    n = work.shape[0] - 1
    for i in range(n):
        for j in range(BLOCK):
            work[i, 2, j] = work[i, 0, j]
            work[i, 3, j] = work[i, 0, j]
    for stage in range(4):
        weight = 1.0 / 6.0 if stage in (0, 3) else 1.0 / 3.0
        half = (stage + 1) // 2
        ahead = 0.5 * step if stage < 2 else step
        if hold == 0:
            feed_back(2 * k + half, offset, gain, error, work)
        for j in range(BLOCK):
            work[n, 0, j] = limited_rate(
                work[n, 1, j], work[3, 0, j], limits[0], limits[1], limits[2]
            )
        slopes(step * (k + 0.5 * half), work, p, c, field)
        for i in range(n):
            for j in range(BLOCK):
                work[i, 3, j] += step * weight * work[i, 1, j]
                work[i, 0, j] = work[i, 2, j] + ahead * work[i, 1, j]
    for i in range(n):
        for j in range(BLOCK):
            work[i, 0, j] = work[i, 3, j]


def feed_back(row, offset, gain, error, work):
    """Writes into work[n, 1] the commands for states that are seen with an error."""
    n = work.shape[0] - 1
    for j in range(BLOCK):
        work[n, 1, j] = offset[row]
    for i in range(gain.shape[1]):
        for j in range(BLOCK):
            work[n, 1, j] -= gain[row, i] * (work[i, 0, j] + error[i, j])


def approach(wire, work, near):
    """Lowers near[2], the least squared distances from the wire, by one segment.

    It leads from near[:2] to the positions in work.
    """
    for j in range(BLOCK):
        from_x, from_z = near[0, j] - wire[0], near[1, j] - wire[1]
        along_x, along_z = work[0, 0, j] - near[0, j], work[1, 0, j] - near[1, j]
        square = along_x * along_x + along_z * along_z + 1e-300
        share = -(from_x * along_x + from_z * along_z) / square
        share = min(max(share, 0.0), 1.0)
        x, z = from_x + share * along_x, from_z + share * along_z
        near[2, j] = min(near[2, j], x * x + z * z)


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
    slopes,
    runge_kutta_block,
    rollouts,
    directional,
    riccati_slope,
    riccati,
    feed_back,
    approach,
    guided_step,
    guided,
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
"""What the kernel compiles, callees first."""

ENTRIES = ("rollouts", "directional", "riccati", "guided")
"""Those that are called from Python, besides every log_*; the kernel keeps them on
disk and puts the others into them."""
