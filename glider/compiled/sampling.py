"""Costs of command sequences, sampled by the dozen or by the thousand."""

import numpy as np

from glider.compiled.constants import BLOCK
from glider.compiled.rollouts import rollouts


def cost_to_go(
    states, command, nominal, price, step, goal, weights, rate_cost, free_end, to_go
):
    """Writes what a flight costs from each of its steps on; see `sampled_costs`."""
    steps = command.shape[0]
    for k in range(steps, -1, -1):
        final = 0.0
        if k == steps or (free_end and k > 0):
            for i in range(goal.shape[0]):
                final += weights[i] * (states[k, i] - goal[i]) ** 2
        if k == steps:
            least = final
        else:
            v = command[k]
            pull = nominal[k] * (v - 0.5 * nominal[k])
            least += rate_cost * step * v * v + price * pull
            # A flight that has left the numbers (NaN) ends before.
            if free_end and k > 0 and not least < final:
                least = final
        to_go[k] = least


def sampled_costs(
    start,
    command,
    nominal,
    price,
    step,
    order,
    limits,
    goal,
    weights,
    rate_cost,
    free_end,
    p,
    c,
    field,
    to_go,
    states,
):
    """Flies one launch under many command sequences and says what each costs.

    With the stage cost
        l_k = rate_cost step v_k² + price (ν_k v_k - ν_k² / 2)
    of commands v about a nominal sequence ν and the final cost
        f(x) = (x - goal)ᵀ diag(weights) (x - goal)
    the cost-to-go is S_N = f(x_N), S_k = l_k + S_{k+1}; with a free end it is
    S_k = min(f(x_k), l_k + S_{k+1}) for k > 0: the flight ends where that is
    cheapest. Still air.

    Args:
        start: (n,) state at launch.
        command: (B, N) elevator-rate commands, each held for one step [rad/s].
        nominal: (N,) [rad/s].
        price: of the likelihood ratio; 0 for none.
        step: [s].
        order: 1 for explicit Euler, 4 for classical Runge-Kutta.
        limits: elevator's lower and upper stop [rad], rate limit [rad/s]; the
            glider gets commands that keep them, as far as no effect delays them.
        goal, weights: (7,).
        rate_cost: [1/(rad²/s)].
        free_end: whether the flight may end before its last step.
        p, c, field: as in `derivatives`.
        to_go: (B, N + 1), written.
        states: (B, N + 1, n), written; or (0, N + 1, n) to keep none.
    """
    batch, steps = command.shape
    n = start.shape[0]
    given = np.empty((BLOCK, steps))
    starts = np.empty((BLOCK, n))
    path = np.empty((BLOCK, steps + 1, n))
    for j in range(BLOCK):
        starts[j] = start
    for first in range(0, batch, BLOCK):
        count = min(BLOCK, batch - first)
        for j in range(BLOCK):  # What is left of the last block repeats a glider.
            elevator = start[3]
            for k in range(steps):
                rate = command[first + min(j, count - 1), k]
                rate = min(max(rate, -limits[2]), limits[2])
                rate = max(rate, (limits[0] - elevator) / step)
                rate = min(rate, (limits[1] - elevator) / step)
                elevator += rate * step
                given[j, k] = rate
        rollouts(starts, given, step, p, c, field, order, path)
        for j in range(count):
            cost_to_go(
                path[j],
                command[first + j],
                nominal,
                price,
                step,
                goal,
                weights,
                rate_cost,
                free_end,
                to_go[first + j],
            )
            if states.shape[0] > 0:
                states[first + j] = path[j]


LOOPS = (cost_to_go, sampled_costs)
ENTRIES = (sampled_costs,)
USES = ("rollouts",)
