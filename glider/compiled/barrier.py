"""Steps of a primal-dual interior-point method for collocated flights.

Loops over the numbers of a path: none knows the dynamics, so one compiled code serves
all gliders. `glider.compiled.interior_point` puts them in order.
"""

from typing import NamedTuple

import numpy as np

from glider.compiled.kernel import called_code, machine_code


class Program(NamedTuple):
    """A flight to optimize: N knots of states and command, segments of one length h.

    minimize   r ∫ u² dt + (x_N - goal)ᵀ diag(w) (x_N - goal), by the trapezoid rule.

    Attributes:
        low: (N (n + 1) + 1,) bounds from below of the knots, one after the other, and
            of h; -inf where there is none, as where a value is fixed.
        high: the same from above.
        rate_cost: r.
        goal: (n,).
        goal_weights: (n,) w.
        place: (2,) where the flight ends, (x, z) [m].
        is_held: whether it has to end there; else the cost alone draws it to its goal.
    """

    low: np.ndarray
    high: np.ndarray
    rate_cost: float
    goal: np.ndarray
    goal_weights: np.ndarray
    place: np.ndarray
    is_held: bool


class Optimum(NamedTuple):
    """A flight and its multipliers.

    Attributes:
        w: (N (n + 1) + 1,) states and command at each knot, then the segments' length.
        multipliers: (N - 1, n) of the defects.
        pull: (2,) of the place at the end.
        forces: (2, N (n + 1) + 1) of the bounds from below and from above.
    """

    w: np.ndarray
    multipliers: np.ndarray
    pull: np.ndarray
    forces: np.ndarray


class Scratch(NamedTuple):
    """Arrays that one step passes to the next.

    Attributes:
        bounded: (2, N (n + 1) + 1) whether there is a bound from below, from above.
        slack: the distance from it.
        slope: (N (n + 1) + 1,) of the cost, then with the barrier function's.
        lagrangian: (N (n + 1) + 1,) slope without the bounds' forces.
        diagonal: (N (n + 1) + 1,) curvature of the cost, then with the barrier
            function's.
        cross: (N,) curvature of the cost by a command and h.
        misses: (2,) by which the end leaves its place.
        back: (N - 1, n + 1) g of `weigh`.
        change: (N (n + 1) + 1,) Newton's step.
        ahead: (N - 1, n) multipliers after it.
        drawn: (2,) multipliers of the place after it.
        moves: (2, N (n + 1) + 1) change of the forces.
    """

    bounded: np.ndarray
    slack: np.ndarray
    slope: np.ndarray
    lagrangian: np.ndarray
    diagonal: np.ndarray
    cross: np.ndarray
    misses: np.ndarray
    back: np.ndarray
    change: np.ndarray
    ahead: np.ndarray
    drawn: np.ndarray
    moves: np.ndarray


def make_scratch(program: Program, knots: int) -> Scratch:
    """Allocates the arrays that the steps write."""
    size, n = program.low.size, program.goal.size
    return Scratch(
        bounded=np.isfinite(np.array([program.low, program.high])),
        slack=np.ones((2, size)),
        slope=np.empty(size),
        lagrangian=np.empty(size),
        diagonal=np.empty(size),
        cross=np.empty(knots),
        misses=np.empty(2),
        back=np.empty((knots - 1, n + 1)),
        change=np.empty(size),
        ahead=np.empty((knots - 1, n)),
        drawn=np.empty(2),
        moves=np.empty((2, size)),
    )


@machine_code
def enter(program, barrier, scratch, w, forces):
    """Moves a guess inside its bounds, and gives the bounds the barrier's forces."""
    bounded = scratch.bounded
    for i in range(len(w)):
        low, high = program.low[i], program.high[i]
        inside = 1e-2 * (high - low)  # Infinite where one side is free.
        if bounded[0, i]:
            w[i] = max(w[i], low + min(inside, 1e-2 * max(1.0, abs(low))))
        if bounded[1, i]:
            w[i] = min(w[i], high - min(inside, 1e-2 * max(1.0, abs(high))))
        for side in range(2):
            if not bounded[side, i]:
                forces[side, i] = 0.0
            elif not forces[side, i] > 0.0:
                gap = w[i] - low if side == 0 else high - w[i]
                forces[side, i] = barrier / gap


@machine_code
def weigh_path(program, w, barrier):
    """Returns cost and barrier function of a path; infinite where out of bounds."""
    n = program.goal.shape[0]
    width, last = n + 1, w.shape[0] - 1
    total = 0.0
    for k in range(n, last, width):
        share = 0.5 if k == n or k == last - 1 else 1.0
        total += share * w[k] * w[k]
    cost = program.rate_cost * w[last] * total
    for i in range(n):
        error = w[last - width + i] - program.goal[i]
        cost += program.goal_weights[i] * error * error
    product, logs = 1.0, 0.0
    for i in range(last + 1):
        for side in range(2):
            bound = program.low[i] if side == 0 else program.high[i]
            if np.isinf(bound):
                continue
            slack = w[i] - bound if side == 0 else bound - w[i]
            if not slack > 0.0:
                return np.inf
            product *= slack
            if product < 1e-200 or product > 1e200:  # One logarithm for many.
                logs += np.log(product)
                product = 1.0
    return cost - barrier * (logs + np.log(product))


@machine_code
def lean_on(program, optimum, scratch):
    """Writes slopes and curvature of the cost, and what the end misses.

    The Lagrangian's slope lacks the defects' part then, which `weigh` adds.
    """
    w, n = optimum.w, program.goal.shape[0]
    cost_slope, diagonal, cross = scratch.slope, scratch.diagonal, scratch.cross
    width, last = n + 1, w.shape[0] - 1
    for i in range(last + 1):
        cost_slope[i] = 0.0
        diagonal[i] = 0.0
    rate, total = program.rate_cost, 0.0
    for k in range(cross.shape[0]):
        share = 0.5 if k == 0 or k == cross.shape[0] - 1 else 1.0
        u = w[k * width + n]
        cross[k] = 2.0 * rate * share * u
        cost_slope[k * width + n] = cross[k] * w[last]
        diagonal[k * width + n] = 2.0 * rate * share * w[last]
        total += share * u * u
    cost_slope[last] = rate * total
    for i in range(n):
        at = last - width + i
        cost_slope[at] = 2.0 * program.goal_weights[i] * (w[at] - program.goal[i])
        diagonal[at] = 2.0 * program.goal_weights[i]
    for i in range(last + 1):
        scratch.lagrangian[i] = cost_slope[i]
    for i in range(2):
        miss = w[last - width + i] - program.place[i]
        scratch.misses[i] = miss if program.is_held else 0.0
        scratch.lagrangian[last - width + i] += optimum.pull[i]


@machine_code
def assess(program, optimum, scratch):
    """Measures the distance of a path from optimality, and writes the slack.

    Args:
        program: to solve.
        optimum: the path.
        scratch: with the slope of the Lagrangian.

    Returns:
        the largest slope of the Lagrangian, the largest product of a bound's force and
        slack, and the scale of both.
    """
    w, multipliers, _, forces = optimum
    size, n = w.shape[0], program.goal.shape[0]
    lagrangian, slack = scratch.lagrangian, scratch.slack
    dual, touch, size_of = 0.0, 0.0, 0.0
    for i in range(size):
        if scratch.bounded[0, i]:
            slack[0, i] = w[i] - program.low[i]
        if scratch.bounded[1, i]:
            slack[1, i] = program.high[i] - w[i]
        for side in range(2):
            size_of += forces[side, i]
            touch = max(touch, forces[side, i] * slack[side, i])
        if i >= n:  # The launch is fixed.
            dual = max(dual, abs(lagrangian[i] - forces[0, i] + forces[1, i]))
    for k in range(multipliers.shape[0]):
        for i in range(n):
            size_of += abs(multipliers[k, i])
    return dual, touch, max(1.0, 0.01 * size_of / size)


@machine_code
def lower_barrier(barrier, least, error, scale, scratch, forces):
    """Returns the barrier's weight, less where its problem is solved well enough.

    Args:
        barrier: before.
        least: below which it does not go.
        error: the larger of the scaled slope and of what the constraints are missed by.
        scale: of `assess`.
        scratch: with the slack.
        forces: of the bounds.
    """
    while barrier > least:
        off = error
        for i in range(forces.shape[1]):
            for side in range(2):
                if scratch.bounded[side, i]:
                    product = forces[side, i] * scratch.slack[side, i]
                    off = max(off, abs(product - barrier) / scale)
        if off >= 10.0 * barrier:
            break
        barrier = max(least, min(0.2 * barrier, barrier**1.5))
    return barrier


@called_code
def longest(value, change, keep, longest_yet):
    """Returns the share of a change that leaves of a positive value a share keep."""
    return min(longest_yet, -keep * value / change) if change < 0.0 else longest_yet


@machine_code
def add_barrier(barrier, forces, scratch):
    """Adds the barrier function's slope and curvature to the cost's."""
    for i in range(forces.shape[1]):
        for side in range(2):
            if scratch.bounded[side, i]:
                gap = scratch.slack[side, i]
                scratch.diagonal[i] += forces[side, i] / gap
                scratch.slope[i] -= (1.0 - 2.0 * side) * barrier / gap


@machine_code
def keep_clear(barrier, forces, scratch):
    """Writes the forces' step beside Newton's.

    Returns:
        the shares of the step and of the forces' that keep clear of the bounds, and by
        how much the whole step changes the barrier problem's cost, to first order.
    """
    keep = max(0.99, 1.0 - barrier)
    share = share_of_forces = 1.0
    expected = 0.0
    for i in range(forces.shape[1]):
        change = scratch.change[i]
        expected += scratch.slope[i] * change
        for side in range(2):
            if scratch.bounded[side, i]:
                gap, force = scratch.slack[side, i], forces[side, i]
                step = change * (1.0 - 2.0 * side)
                move = (barrier - force * step) / gap - force
                scratch.moves[side, i] = move
                share = longest(gap, step, keep, share)
                share_of_forces = longest(force, move, keep, share_of_forces)
    return share, share_of_forces, expected


@machine_code
def change_multipliers(program, barrier, share, share_of_forces, optimum, scratch):
    """Takes the multipliers' step, and keeps the forces near the barrier's own."""
    w, multipliers, pull, forces = optimum
    for k in range(multipliers.shape[0]):
        for i in range(multipliers.shape[1]):
            multipliers[k, i] += share * (scratch.ahead[k, i] - multipliers[k, i])
    for i in range(2):
        pull[i] += share * (scratch.drawn[i] - pull[i])
    for i in range(w.shape[0]):
        for side in range(2):
            if scratch.bounded[side, i]:
                gap = w[i] - program.low[i] if side == 0 else program.high[i] - w[i]
                force = forces[side, i] + share_of_forces * scratch.moves[side, i]
                least = barrier / (1e10 * gap)
                forces[side, i] = min(max(force, least), 1e10 * barrier / gap)
