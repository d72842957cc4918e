"""Iterative LQR over explicit steps."""

from typing import NamedTuple

import numpy as np

from glider.compiled.collocation import add_difference, spread
from glider.compiled.kernel import Family
from glider.compiled.runge_kutta import BLOCK, advance, advance_block, put
from glider.physics.chain import derivatives
from glider.physics.model import GliderModel
from glider.physics.servo import STOPPING_TIME, Servo, rate_bounds


def slope_held(t, node, x, data, rate):
    """Writes the derivatives under a command that is held."""
    u, theta = data
    d = derivatives(t, x, u, 0.0, 0.0, theta)
    for i in range(x.shape[0]):
        rate[i] = d[i]


def ilqr_roll(
    share,
    step,
    order,
    laps,
    states,
    inputs,
    feed,
    gains,
    costs,
    servo,
    theta,
    new_states,
    new_inputs,
):
    """Flies the policy u = ū + share k + K (x - x̄) from the launch new_states[0].

    Args:
        share: of the feed-forward.
        step: [s].
        order: 1 for explicit Euler, 4 for classical Runge-Kutta.
        laps: equal steps of the integrator to one of them.
        states: (N + 1, n) x̄.
        inputs: (N,) ū [rad/s].
        feed: (N,) k.
        gains: (N, n) K.
        costs: q and r, Q and R, F and the goal, see `GoalCosts`.
        servo: its limits.
        theta: the glider's numbers.
        new_states: (N + 1, n), written but for the launch.
        new_inputs: (N,), written.

    Returns:
        the flight's cost and what it pays for leaving x̄, ū:
        ½ Σ_k ((x_k - goal)ᵀ Q (x_k - goal) + R u_k²) + ½ (x_N - goal)ᵀ F (x_N - goal)
        and ½ Σ_k ((x_k - x̄_k)ᵀ q (x_k - x̄_k) + r (u_k - ū_k)²).
    """
    n = states.shape[1]
    work = np.empty((3, n))
    steps = inputs.shape[0]
    cost = hold = 0.0
    for k in range(steps):
        x = new_states[k]
        u = inputs[k] + share * feed[k]
        for i in range(n):
            change, error = x[i] - states[k, i], x[i] - costs.goal[i]
            u += gains[k, i] * change
            hold += 0.5 * costs.hold[i] * change * change
            cost += 0.5 * costs.stage[i] * error * error
        low, high = rate_bounds(x[3], servo, step)
        u = min(max(u, low), high)
        change = u - inputs[k]
        hold += 0.5 * costs.hold[n] * change * change
        cost += 0.5 * costs.stage[n] * u * u
        new_inputs[k] = u
        after = new_states[k + 1]
        put(x, after)
        for lap in range(laps):
            t = (k + lap / laps) * step
            advance(slope_held, t, after, step / laps, order, (u, theta), work)
    for i in range(n):
        error = new_states[steps, i] - costs.goal[i]
        cost += 0.5 * costs.final[i] * error * error
    return cost, hold


def slopes_aside(t, node, work, data):
    """Writes into work[:n, 1] the derivatives of the states work[:n, 0].

    work[n, 0] holds the commands, and the steps of a block begin at times of their own.
    """
    theta, begins = data
    n = work.shape[0] - 1
    for j in range(BLOCK):
        d = derivatives(begins[j] + t, work[:, 0, j], work[n, 0, j], 0.0, 0.0, theta)
        for i in range(len(d)):
            work[i, 1, j] = d[i]


def ilqr_ends(points, steps, step, order, laps, theta, ends):
    """Writes where points of states and command are a step later.

    Args:
        points: (M, n + 1); point m is one of step m modulo N, as `spread` has them.
        steps: N.
        step, order, laps: as in `ilqr_roll`.
        theta: the glider's numbers.
        ends: (M, n), written.
    """
    count, width = points.shape
    work, begins = np.empty((width, 4, BLOCK)), np.empty(BLOCK)
    for first in range(0, count, BLOCK):
        here = min(BLOCK, count - first)
        for j in range(BLOCK):
            k = first + min(j, here - 1)
            begins[j] = step * (k % steps)
            for i in range(width):
                work[i, 0, j] = points[k, i]
        for lap in range(laps):
            t = lap / laps * step
            advance_block(slopes_aside, t, work, step / laps, order, (theta, begins))
        for j in range(here):
            for i in range(width - 1):
                ends[first + j, i] = work[i, 0, j]


def ilqr_backward(damping, step, states, inputs, jacobian, costs, servo, feed, gains):
    """Writes the policy k, K that improves most on a nominal flight x̄, ū.

    By dynamic programming over the linear steps; the curvature of the dynamics is
    left out, so that the cost-to-go ½ x̃ᵀ V x̃ + sᵀ x̃ stays convex. A command at a
    bound stays there, and follows it where that is a stop.

    Args:
        damping: weight of leaving the nominal's next state, beyond the costs.
        step: [s].
        states: (N + 1, n) x̄.
        inputs: (N,) ū [rad/s].
        jacobian: (N, n, n + 1) of `linearize_steps`.
        costs, servo: as in `ilqr_roll`.
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
        v[i, i] = costs.final[i]
        s[i] = costs.final[i] * (states[steps, i] - costs.goal[i])
    for k in range(steps - 1, -1, -1):
        a = jacobian[k]
        for i in range(n):
            for j in range(n + 1):
                va[i, j] = 0.0
            for m in range(n):
                for j in range(n + 1):  # Innermost along rows: side by side.
                    va[i, j] += v[i, m] * a[m, j]
        for i in range(n + 1):
            slope[i] = 0.0
            for j in range(n + 1):
                total[i, j] = 0.0
            total[i, i] = costs.hold[i] + costs.stage[i]
        for m in range(n):
            for i in range(n + 1):
                slope[i] += a[m, i] * s[m]
                for j in range(n + 1):
                    total[i, j] += a[m, i] * va[m, j]
        for i in range(n):
            slope[i] += costs.stage[i] * (states[k, i] - costs.goal[i])
        slope[n] += costs.stage[n] * inputs[k]

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
        low, high = rate_bounds(states[k, 3], servo, step)
        if push <= low - inputs[k] or push >= high - inputs[k]:
            push = min(max(push, low - inputs[k]), high - inputs[k])
            gain[:] = 0.0
            if abs(inputs[k] + push) < servo.rate:  # A stop moves with the elevator.
                gain[3] = -1.0 / (step + STOPPING_TIME)

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


LOOPS = Family((slope_held, ilqr_roll, slopes_aside, ilqr_ends), (ilqr_roll, ilqr_ends))

DIFFERENCE = 1e-5
"""Step of the differences [m, rad, m/s, rad/s]."""

BACKWARD = Family((ilqr_backward,), (ilqr_backward,))
"""Family of the backward pass: no physics in it, so that one serves all gliders."""


class GoalCosts(NamedTuple):
    """Weights of states and, where one more, of the command behind them."""

    hold: np.ndarray
    """(n + 1,) q, r of leaving the flight of the iteration before."""

    stage: np.ndarray
    """(n + 1,) Q, R of the distance from the goal on the way."""

    final: np.ndarray
    """(n,) F of the distance at the end."""

    goal: np.ndarray
    """(n,) state that the costs count from."""


def roll(
    model: GliderModel,
    share: float,
    step: float,
    order: int,
    nominal: tuple[np.ndarray, np.ndarray],
    policy: tuple[np.ndarray, np.ndarray],
    costs: GoalCosts,
    servo: Servo,
) -> tuple[np.ndarray, np.ndarray, float, float]:
    """Flies a policy about a nominal flight from its launch, see `ilqr_roll`.

    Args:
        model: the glider.
        share: of the feed-forward.
        step: [s].
        order: 1 or 4.
        nominal: states (N + 1, n) and inputs (N,) [rad/s].
        policy: feed-forward (N,) and gains (N, n).
        costs: of a flight.
        servo: its limits.

    Returns:
        states, inputs, the flight's cost and what it pays for leaving the nominal.
    """
    states, inputs = np.empty_like(nominal[0]), np.empty_like(nominal[1])
    states[0] = nominal[0][0]
    cost, hold = LOOPS.over(model.kinds).ilqr_roll(
        share,
        step,
        order,
        model.count_laps(step, order),
        *nominal,
        *policy,
        costs,
        servo,
        model.numbers,
        states,
        inputs,
    )
    return states, inputs, cost, hold


def linearize_steps(
    model: GliderModel, step: float, order: int, states: np.ndarray, inputs: np.ndarray
) -> np.ndarray:
    """Returns ∂x_k+1/∂x_k and, as the last column, ∂x_k+1/∂u_k: (N, n, n + 1).

    By central differences side by side, which take half of the time of exact slopes one
    after the other and err by 1e-9 of them.
    """
    steps, n = len(inputs), states.shape[1]
    points = np.column_stack([states[:steps], inputs])
    moved = np.empty((2 * points.size, n + 1))
    ends, jacobian = np.empty((len(moved), n)), np.zeros((steps, n, n + 1))
    spread(points, DIFFERENCE, moved)
    LOOPS.over(model.kinds).ilqr_ends(
        moved, steps, step, order, model.count_laps(step, order), model.numbers, ends
    )
    add_difference(ends, 0.5 / DIFFERENCE, jacobian)
    return jacobian


def improve_policy(
    damping: float,
    step: float,
    nominal: tuple[np.ndarray, np.ndarray],
    jacobian: np.ndarray,
    costs: GoalCosts,
    servo: Servo,
) -> tuple[tuple[np.ndarray, np.ndarray], tuple[float, float]]:
    """Returns the policy that improves most on a nominal flight; see `ilqr_backward`.

    Args:
        damping: weight of leaving the nominal's next state.
        step: [s].
        nominal: states (N + 1, n) and inputs (N,) [rad/s].
        jacobian: of `linearize_steps`.
        costs: of a flight.
        servo: its limits.

    Returns:
        feed-forward (N,) and gains (N, n), and what they promise: the cost changes by
        share * first + share² * second.
    """
    states, inputs = nominal
    policy = np.zeros(len(inputs)), np.zeros((len(inputs), states.shape[1]))
    promise = BACKWARD.over().ilqr_backward(
        damping, step, states, inputs, jacobian, costs, servo, *policy
    )
    return policy, promise
