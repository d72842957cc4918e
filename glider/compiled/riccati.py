"""The Riccati equations back along a nominal path."""

import numpy as np

from glider.compiled import jacobian
from glider.compiled.jacobian import directional
from glider.compiled.kernel import Family
from glider.compiled.runge_kutta import advance, put


def slope_of_cost(t, node, flat, data, rate):
    """Writes -Ṡ and, as its last column, -ṡ; see `riccati`.

    `flat` holds S and s (n, n + 1). Of the data, `jacobian` is A and, as its last
    column, B at the times, `at` counts them and falls with the node; `back` is scratch.
    """
    at, jacobian, excess, q, r, back = data
    n = q.shape[0]
    s = flat.reshape((n, n + 1))
    slope = rate.reshape((n, n + 1))
    a = jacobian[at - node]
    e = excess[at - node]
    drive = 0.0
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


def riccati(times, states, slopes, inputs, q, r, s, z, gaussians, gain, offset, cost):
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
        z: of `stacked`; states and inputs are overwritten.
        gaussians: of the free functions.
        gain: (M + 1, n), written: K at every other time.
        offset: (M + 1,), written: k₀.
        cost: (M + 1, n, n + 1), written: S and, as its last column, s.
    """
    count, n = states.shape
    jacobian = np.empty((count, n, n + 1))
    excess = np.empty((count, n))
    each = np.zeros((n + 1, n + 1)).T  # As the plant asks: compiled only once.
    for i in range(n + 1):
        each[i, i] = 1.0
    for k in range(count):
        put(states[k], z[:n])
        z[n] = inputs[k]
        directional(times[k], z, each, n, gaussians, excess[k], jacobian[k])
        for i in range(n):
            excess[k, i] -= slopes[k, i]

    flat = np.empty(n * (n + 1))
    now = flat.reshape((n, n + 1))
    work = np.empty((3, n * (n + 1)))
    back = np.empty(n)
    for i in range(n):
        put(s[i], now[i, :n])
        now[i, n] = 0.0
    for k in range(count // 2, -1, -1):
        for i in range(n):
            put(now[i], cost[k, i])
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
        data = (2 * k, jacobian, excess, q, r, back)
        advance(slope_of_cost, times[2 * k], flat, step, 4, data, work)
        for i in range(n):  # Symmetry, which rounding would lose slowly.
            for j in range(i):
                now[i, j] = now[j, i] = 0.5 * (now[i, j] + now[j, i])


LOOPS = Family((slope_of_cost, riccati), (riccati,), uses=(jacobian.LOOPS,))
