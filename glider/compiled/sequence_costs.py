"""Costs of many command sequences from one launch."""

from typing import NamedTuple

import numpy as np

from glider.compiled import flight
from glider.compiled.flight import flights
from glider.compiled.kernel import Family
from glider.compiled.runge_kutta import BLOCK, put
from glider.physics.chain import demanded_angle
from glider.physics.servo import rate_bounds


def cost_to_go(states, command, nominal, penalty, step, cost, to_go):
    """Writes the cost-to-go of a flight at each of its steps; see `sampled_costs`."""
    steps = command.shape[0]
    for k in range(steps, -1, -1):
        final = 0.0
        may_end = cost.free_end and k > 0
        if k == steps or may_end:
            for i in range(cost.goal.shape[0]):
                final += cost.weights[i] * (states[k, i] - cost.goal[i]) ** 2
        if k == steps:
            least = final
        else:
            v = command[k]
            pull = nominal[k] * (v - 0.5 * nominal[k])
            least += cost.rate * step * v * v + penalty * pull
            # A flight that has diverged (NaN) ends before.
            if may_end and not least < final:
                least = final
        to_go[k] = least


def sampled_costs(
    start, command, nominal, penalty, steps, block, servos, cost, theta, to_go, states
):
    """Flies one launch under many command sequences and computes their costs.

    With the stage cost
        l_k = rate step v_k² + penalty (ν_k v_k - ν_k² / 2)
    of commands v about a nominal sequence ν and the final cost
        f(x) = (x - goal)ᵀ diag(weights) (x - goal)
    the cost-to-go is S_N = f(x_N), S_k = l_k + S_{k+1}; with a free end it is
    S_k = min(f(x_k), l_k + S_{k+1}) for k > 0: the flight ends where that is
    cheapest. Still air.

    Args:
        start: (1, n) state at launch.
        command: (B, N) elevator-rate commands, each held for a time [rad/s].
        nominal: (N,) [rad/s].
        penalty: of the likelihood ratio; 0 for none.
        steps: of the flights, `steps.every` to a command.
        block: tape and states of BLOCK flights, written.
        servos: the glider's, and one without limits: the glider gets commands that
            its servo follows.
        cost: of a flight, see `FlightCost`.
        theta: the glider's numbers.
        to_go: (B, N + 1), written.
        states: (B, N + 1, n), written; or (0, N + 1, n) to keep none.
    """
    tape, flown = block
    servo, free = servos
    batch, count = command.shape
    hold = steps.length * steps.every
    for first in range(0, batch, BLOCK):
        for j in range(BLOCK):  # What is left of the last block repeats a sequence.
            row = min(first + j, batch - 1)
            angle = demanded_angle(start[0], theta.c)
            for k in range(count):
                low, high = rate_bounds(angle, servo, hold)
                rate = min(max(command[row, k], low), high)
                angle += rate * hold
                tape.offset[j, k] = rate
        flights(start, steps, tape, free, (0.0, 0.0), theta, None, flown)
        for row in range(first, min(first + BLOCK, batch)):
            path = flown.states[row - first]
            cost_to_go(path, command[row], nominal, penalty, hold, cost, to_go[row])
            if states.shape[0] > 0:
                for k in range(count + 1):
                    put(path[k], states[row, k])


LOOPS = Family((cost_to_go, sampled_costs), (sampled_costs,), uses=(flight.LOOPS,))


class FlightCost(NamedTuple):
    """Cost of a flight under a sequence of commands, see `sampled_costs`.

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
