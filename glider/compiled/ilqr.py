"""Iterative LQR over explicit steps."""

import numpy as np

from glider.compiled.jacobian import directional
from glider.physics.chain import derivatives


def rate_bounds(elevator, step, limits):
    """Least and largest rate that keep the servo's limits over a step [rad/s].

    Its rate limit, or what takes the elevator to its stop.
    """
    top = max(min((limits[1] - elevator) / step, limits[2]), -limits[2])
    return min(max((limits[0] - elevator) / step, -limits[2]), top), top


def ilqr_step(t, x, u, step, order, p, c, field, work, end):
    """Writes into end (n,) where a state is after one step; work is (2, n)."""
    n = x.shape[0]
    for i in range(n):
        work[0, i] = x[i]
        end[i] = x[i]
    for stage in range(order):
        weight = 1.0 if order == 1 else (1.0 / 6.0 if stage in (0, 3) else 1.0 / 3.0)
        d = derivatives(
            t + 0.5 * step * ((stage + 1) // 2), work[0], u, 0.0, 0.0, p, c, field
        )
        ahead = 0.5 * step if stage < 2 else step
        for i in range(n):
            work[1, i] = d[i]
        for i in range(n):
            end[i] += step * weight * work[1, i]
            work[0, i] = x[i] + ahead * work[1, i]


def ilqr_roll(
    share,
    step,
    order,
    states,
    inputs,
    feed,
    gains,
    costs,
    goal,
    limits,
    p,
    c,
    field,
    new_states,
    new_inputs,
):
    """Flies the policy u = ū + share k + K (x - x̄) from the launch new_states[0].

    Args:
        share: of the feed-forward.
        step: [s].
        order: 1 for explicit Euler, 4 for classical Runge-Kutta.
        states: (N + 1, n) x̄.
        inputs: (N,) ū [rad/s].
        feed: (N,) k.
        gains: (N, n) K.
        costs: (3, n + 1): q for each state and r; Q and R; F and no more.
        goal: (n,).
        limits: elevator's lower and upper stop [rad], rate limit [rad/s].
        p, c, field: as in `derivatives`.
        new_states: (N + 1, n), written but for the launch.
        new_inputs: (N,), written.

    Returns:
        the flight's cost and what it pays for leaving x̄, ū:
        ½ Σ_k ((x_k - goal)ᵀ Q (x_k - goal) + R u_k²) + ½ (x_N - goal)ᵀ F (x_N - goal)
        and ½ Σ_k ((x_k - x̄_k)ᵀ q (x_k - x̄_k) + r (u_k - ū_k)²).
    """
    n = states.shape[1]
    work = np.empty((2, n))
    steps = inputs.shape[0]
    cost = hold = 0.0
    for k in range(steps):
        x = new_states[k]
        u = inputs[k] + share * feed[k]
        for i in range(n):
            change, error = x[i] - states[k, i], x[i] - goal[i]
            u += gains[k, i] * change
            hold += 0.5 * costs[0, i] * change * change
            cost += 0.5 * costs[1, i] * error * error
        low, high = rate_bounds(x[3], step, limits)
        u = min(max(u, low), high)
        change = u - inputs[k]
        hold += 0.5 * costs[0, n] * change * change
        cost += 0.5 * costs[1, n] * u * u
        new_inputs[k] = u
        ilqr_step(k * step, x, u, step, order, p, c, field, work, new_states[k + 1])
    for i in range(n):
        error = new_states[steps, i] - goal[i]
        cost += 0.5 * costs[2, i] * error * error
    return cost, hold


def ilqr_linearize(step, order, states, inputs, p, c, field, jacobian):
    """Writes ∂x_k+1/∂x_k and, as the last column, ∂x_k+1/∂u_k: (N, n, n + 1).

    Each stage's slopes are taken along what the stages before make of a unit
    vector, which is the chain rule of the step.
    """
    n = states.shape[1]
    along = np.zeros((n + 1, n + 1)).T  # As the plant asks: compiled only once.
    slopes = np.empty((n, n + 1))
    z = np.zeros(n + 12 + c.shape[0])
    value = np.empty(n)
    z[n + 3 : n + 12] = p
    z[n + 12 :] = c
    for k in range(inputs.shape[0]):
        z[:n] = states[k]
        z[n] = inputs[k]
        for i in range(n + 1):
            for j in range(n + 1):
                along[i, j] = 1.0 if i == j else 0.0
                if i < n:
                    jacobian[k, i, j] = along[i, j]
        for stage in range(order):
            weight = 1.0 / 6.0 if stage in (0, 3) else 1.0 / 3.0
            if order == 1:
                weight = 1.0
            ahead = 0.5 * step if stage < 2 else step
            t = step * (k + 0.5 * ((stage + 1) // 2))
            directional(t, z, along, n, field, value, slopes)
            for i in range(n):
                z[i] = states[k, i] + ahead * value[i]
                for j in range(n + 1):
                    jacobian[k, i, j] += step * weight * slopes[i, j]
                    along[i, j] = (1.0 if i == j else 0.0) + ahead * slopes[i, j]


def ilqr_backward(
    damping, step, states, inputs, jacobian, costs, goal, limits, feed, gains
):
    """Writes the policy k, K that improves most on a nominal flight x̄, ū.

    By dynamic programming over the linear steps; the curvature of the dynamics is
    left out, so that the cost-to-go ½ x̃ᵀ V x̃ + sᵀ x̃ stays convex. A command at a
    bound stays there, and follows it where that is a stop.

    Args:
        damping: weight of leaving the nominal's next state, beyond the costs.
        step: [s].
        states: (N + 1, n) x̄.
        inputs: (N,) ū [rad/s].
        jacobian: (N, n, n + 1) of `ilqr_linearize`.
        costs, goal, limits: as in `ilqr_roll`.
        feed: (N,), written: k.
        gains: (N, n), written: K.

    Returns:
        what it promises: the cost changes by share * first + share² * second.

    Source: Tassa, Mansard, Todorov: Control-limited differential dynamic
    programming, 2014; with one input its box problem is a clamp.
    """
    steps, n = inputs.shape[0], states.shape[1]
    v, s = np.zeros((n, n)), np.empty(n)
    va, total = np.empty((n, n + 1)), np.empty((n + 1, n + 1))
    slope, gain, cross = np.empty(n + 1), np.empty(n), np.empty(n)
    first = second = 0.0
    for i in range(n):
        v[i, i] = costs[2, i]
        s[i] = costs[2, i] * (states[steps, i] - goal[i])
    for k in range(steps - 1, -1, -1):
        a = jacobian[k]
        for i in range(n):
            for j in range(n + 1):
                product = 0.0
                for m in range(n):
                    product += v[i, m] * a[m, j]
                va[i, j] = product
        for i in range(n + 1):
            product = 0.0
            for m in range(n):
                product += a[m, i] * s[m]
            slope[i] = product
            for j in range(i, n + 1):
                product = 0.0
                for m in range(n):
                    product += a[m, i] * va[m, j]
                total[i, j] = product
                total[j, i] = product
            total[i, i] += costs[0, i] + costs[1, i]
        for i in range(n):
            slope[i] += costs[1, i] * (states[k, i] - goal[i])
        slope[n] += costs[1, n] * inputs[k]

        stiff = total[n, n]
        for j in range(n):
            cross[j] = total[n, j]
        for m in range(n):
            stiff += damping * a[m, n] * a[m, n]
            for j in range(n):
                cross[j] += damping * a[m, n] * a[m, j]
        push = -slope[n] / stiff
        for j in range(n):
            gain[j] = -cross[j] / stiff
        low, high = rate_bounds(states[k, 3], step, limits)
        if push <= low - inputs[k] or push >= high - inputs[k]:
            push = min(max(push, low - inputs[k]), high - inputs[k])
            gain[:] = 0.0
            if abs(inputs[k] + push) < limits[2]:  # A stop moves with the elevator.
                gain[3] = -1.0 / step

        first += push * slope[n]
        second += 0.5 * push * push * total[n, n]
        feed[k] = push
        for i in range(n):
            gains[k, i] = gain[i]
            s[i] = slope[i] + total[n, i] * push
            s[i] += gain[i] * (total[n, n] * push + slope[n])
            for j in range(n):
                v[i, j] = total[i, j] + gain[i] * total[n, n] * gain[j]
                v[i, j] += gain[i] * total[n, j] + total[n, i] * gain[j]
    return first, second


LOOPS = (rate_bounds, ilqr_step, ilqr_roll, ilqr_linearize, ilqr_backward)
ENTRIES = (ilqr_roll, ilqr_linearize, ilqr_backward)
USES = ("directional",)
