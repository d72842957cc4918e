"""The Riccati equations back along a nominal path."""

import numpy as np

from glider.compiled.jacobian import directional


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


LOOPS = (riccati_slope, riccati)
ENTRIES = (riccati,)
USES = ("directional",)
