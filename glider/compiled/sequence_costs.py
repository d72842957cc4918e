"""Costs of flights under command sequences."""

from typing import NamedTuple

import numpy as np

from glider.compiled.kernel import machine_code


class FlightCost(NamedTuple):
    """Cost of a flight under a sequence of commands, see `costs_to_go`.

    Attributes:
        goal: (7,) state to end in.
        weights: (7,) of the squared distance from it.
        rate: weight of the squared elevator rate [1/(rad²/s)].
        free_end: whether the flight may end before its last step.
    """

    goal: np.ndarray
    weights: np.ndarray
    rate: float
    free_end: bool


@machine_code
def costs_to_go(states, command, nominal, penalty, step, cost):
    """Returns the costs-to-go S (B, N + 1) of flights at each of their steps.

    With the stage cost
        l_k = rate step v_k² + penalty (ν_k v_k - ν_k² / 2)
    of commands v about a nominal sequence ν and the final cost
        f(x) = (x - goal)ᵀ diag(weights) (x - goal)
    it is S_N = f(x_N), S_k = l_k + S_{k+1}; with a free end
    S_k = min(f(x_k), l_k + S_{k+1}) for k > 0: the flight ends where that is cheapest.

    Args:
        states: (B, N + 1, n).
        command: (B, N) elevator-rate commands [rad/s].
        nominal: (N,) [rad/s].
        penalty: of the likelihood ratio; 0 for none.
        step: time that a command is held [s].
        cost: of a flight, see `FlightCost`.
    """
    batch, steps = command.shape
    to_go = np.empty((batch, steps + 1))
    for b in range(batch):
        least = 0.0
        for k in range(steps, -1, -1):
            may_end = cost.free_end and k > 0
            final = 0.0
            if k == steps or may_end:
                for i in range(cost.goal.shape[0]):
                    apart = states[b, k, i] - cost.goal[i]
                    final += cost.weights[i] * apart * apart
            if k == steps:
                least = final
            else:
                v = command[b, k]
                pull = nominal[k] * (v - 0.5 * nominal[k])
                least += cost.rate * step * v * v + penalty * pull
                # A flight that has diverged (NaN) ends before.
                if may_end and not least < final:
                    least = final
            to_go[b, k] = least
    return to_go
