"""Steps of a primal-dual interior-point method for collocated flights.

Loops over the numbers of a path: none knows the dynamics, so one compiled code serves
all gliders. `glider.compiled.interior_point` puts them in order.
"""

from typing import NamedTuple

import numpy as np

from glider.compiled.kernel import called_code, machine_code

STIFFEST = 1e10
"""Factor within which the force of a bound or an inequality stays of the barrier's."""


class Program(NamedTuple):
    """A flight to optimize: N knots of states and command, segments of one length h.

    minimize   r ∫ u² dt + (x_N - goal)ᵀ diag(w) (x_N - goal), by the trapezoid rule.

    Attributes:
        bounds: (2, N (n + 1) + 1) of the knots, one after the other, and of h, from
            below and from above; infinite where there is none, as where a value is
            fixed.
        rate_cost: r.
        goal: (n,).
        goal_weights: (n,) w.
        place: (2,) where the flight ends, (x, z) [m].
        is_held: whether it has to end there; else the cost alone draws it to its goal.
    """

    bounds: np.ndarray
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
        pushes: (P, n + 1) slope of the Lagrangian by the points of the path that the
            inequalities bring in.
        barrier_pushes: the same with the forces of the barrier after Newton's step.
        by_middle: (N - 1, n + 1) slope of the Lagrangian by the middles of `weigh`.
        by_middle_and_step: (N - 1, n + 1) its slope by h.
        change: (N (n + 1) + 1,) Newton's step.
        shifts: (P, n + 1) that of the points.
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
    pushes: np.ndarray
    barrier_pushes: np.ndarray
    by_middle: np.ndarray
    by_middle_and_step: np.ndarray
    change: np.ndarray
    shifts: np.ndarray
    ahead: np.ndarray
    drawn: np.ndarray
    moves: np.ndarray


def make_scratch(program: Program, knots: int) -> Scratch:
    """Allocates the arrays that the steps write."""
    size = program.bounds.shape[1]
    n = program.goal.size
    points = (2 * knots - 1, n + 1)
    segments = (knots - 1, n + 1)
    return Scratch(
        bounded=np.isfinite(program.bounds),
        slack=np.ones((2, size)),
        slope=np.empty(size),
        lagrangian=np.empty(size),
        diagonal=np.empty(size),
        cross=np.empty(knots),
        misses=np.empty(2),
        pushes=np.zeros(points),
        barrier_pushes=np.zeros(points),
        by_middle=np.empty(segments),
        by_middle_and_step=np.empty(segments),
        change=np.empty(size),
        shifts=np.empty(points),
        ahead=np.empty((knots - 1, n)),
        drawn=np.empty(2),
        moves=np.empty((2, size)),
    )


@called_code
def _inwards(side):
    """Returns the sign of the way from a bound, from below or from above, to inside."""
    return 1.0 - 2.0 * side


@machine_code
def enter(program, barrier, scratch, w, forces):
    """Moves a guess inside its bounds, and gives the bounds the barrier's forces."""
    for i in range(w.shape[0]):
        low = program.bounds[0, i]
        high = program.bounds[1, i]
        width = high - low  # Infinite where one side is free.
        if scratch.bounded[0, i]:
            w[i] = max(w[i], low + 1e-2 * min(width, max(1.0, abs(low))))
        if scratch.bounded[1, i]:
            w[i] = min(w[i], high - 1e-2 * min(width, max(1.0, abs(high))))
        for side in range(2):
            gap = _inwards(side) * (w[i] - program.bounds[side, i])
            if not scratch.bounded[side, i]:
                forces[side, i] = 0.0
            elif not forces[side, i] > 0.0:
                forces[side, i] = barrier / gap


@machine_code
def weigh_path(program, w, barrier):
    """Returns cost and barrier function of a path; infinite where out of bounds."""
    n = program.goal.shape[0]
    width = n + 1
    last = w.shape[0] - 1
    end = last - width
    total = 0.0
    for k in range(n, last, width):
        share = 0.5 if k == n or k == last - 1 else 1.0
        total += share * w[k] * w[k]
    cost = program.rate_cost * w[last] * total
    for i in range(n):
        error = w[end + i] - program.goal[i]
        cost += program.goal_weights[i] * error * error
    product = 1.0
    logs = 0.0
    for i in range(last + 1):
        for side in range(2):
            bound = program.bounds[side, i]
            if np.isinf(bound):
                continue
            slack = _inwards(side) * (w[i] - bound)
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

    The Lagrangian's slope lacks the part of defects and inequalities then, which
    `weigh` adds.
    """
    w = optimum.w
    n = program.goal.shape[0]
    width = n + 1
    last = w.shape[0] - 1
    end = last - width
    slope = scratch.slope
    diagonal = scratch.diagonal
    cross = scratch.cross
    slope[:] = 0.0
    diagonal[:] = 0.0
    total = 0.0
    for k in range(cross.shape[0]):
        at = k * width + n
        share = 0.5 if k == 0 or at == last - 1 else 1.0
        weight = 2.0 * program.rate_cost * share
        cross[k] = weight * w[at]
        slope[at] = cross[k] * w[last]
        diagonal[at] = weight * w[last]
        total += share * w[at] * w[at]
    slope[last] = program.rate_cost * total
    for i in range(n):
        weight = 2.0 * program.goal_weights[i]
        slope[end + i] = weight * (w[end + i] - program.goal[i])
        diagonal[end + i] = weight
    scratch.lagrangian[:] = slope
    for i in range(2):
        miss = w[end + i] - program.place[i]
        scratch.misses[i] = miss if program.is_held else 0.0
        scratch.lagrangian[end + i] += optimum.pull[i]


@machine_code
def assess(program, optimum, scratch):
    """Measures the distance of a path from optimality, and writes the slack.

    Args:
        program: to solve.
        optimum: the path.
        scratch: with the slope of the Lagrangian.

    Returns:
        the largest slope of the Lagrangian, the largest product of a bound's force and
        slack, and the sum of all forces and multipliers.
    """
    w = optimum.w
    forces = optimum.forces
    n = program.goal.shape[0]
    dual = 0.0
    touch = 0.0
    sum_of_all = 0.0
    for i in range(w.shape[0]):
        left = scratch.lagrangian[i]
        for side in range(2):
            force = forces[side, i]
            left -= _inwards(side) * force
            sum_of_all += force
            if scratch.bounded[side, i]:
                gap = _inwards(side) * (w[i] - program.bounds[side, i])
                scratch.slack[side, i] = gap
                touch = max(touch, force * gap)
        if i >= n:  # The launch is fixed.
            dual = max(dual, abs(left))
    for row in optimum.multipliers:
        for multiplier in row:
            sum_of_all += abs(multiplier)
    return dual, touch, sum_of_all


@machine_code
def miss_barrier(barrier, forces, scratch):
    """Returns the largest difference of a bound's force times slack from the weight."""
    worst = 0.0
    for i in range(forces.shape[1]):
        for side in range(2):
            if scratch.bounded[side, i]:
                product = forces[side, i] * scratch.slack[side, i]
                worst = max(worst, abs(product - barrier))
    return worst


@called_code
def _longest(value, change, keep, longest_yet):
    """Returns the share of a change that leaves of a positive value a share keep."""
    return min(longest_yet, -keep * value / change) if change < 0.0 else longest_yet


@machine_code
def longest_step(values, changes, keep):
    """Returns the share of changes that leaves of all positive values a share keep."""
    share = 1.0
    for i in range(len(values)):
        share = _longest(values[i], changes[i], keep, share)
    return share


@machine_code
def add_barrier(barrier, forces, scratch):
    """Adds the barrier function's slope and curvature to the cost's."""
    for i in range(forces.shape[1]):
        for side in range(2):
            if scratch.bounded[side, i]:
                gap = scratch.slack[side, i]
                scratch.diagonal[i] += forces[side, i] / gap
                scratch.slope[i] -= _inwards(side) * barrier / gap


@machine_code
def keep_clear(barrier, keep, forces, scratch):
    """Writes the forces' step beside Newton's.

    Args:
        barrier: its weight.
        keep: share of a slack or a force that a step may take.
        forces: of the bounds.
        scratch: with the step; the forces' is written.

    Returns:
        the shares of the step and of the forces' that keep clear of the bounds, and by
        how much the whole step changes the barrier problem's cost, to first order.
    """
    share = 1.0
    share_of_forces = 1.0
    expected = 0.0
    for i in range(forces.shape[1]):
        change = scratch.change[i]
        expected += scratch.slope[i] * change
        for side in range(2):
            if scratch.bounded[side, i]:
                gap = scratch.slack[side, i]
                force = forces[side, i]
                step = _inwards(side) * change
                move = (barrier - force * step) / gap - force
                scratch.moves[side, i] = move
                share = _longest(gap, step, keep, share)
                share_of_forces = _longest(force, move, keep, share_of_forces)
    return share, share_of_forces, expected


@machine_code
def change_multipliers(program, barrier, share, share_of_forces, optimum, scratch):
    """Takes the multipliers' step, and keeps the forces near the barrier's own."""
    forces = optimum.forces
    multipliers = optimum.multipliers
    for k in range(multipliers.shape[0]):
        for i in range(multipliers.shape[1]):
            multipliers[k, i] += share * (scratch.ahead[k, i] - multipliers[k, i])
    for i in range(2):
        optimum.pull[i] += share * (scratch.drawn[i] - optimum.pull[i])
    for i in range(forces.shape[1]):
        for side in range(2):
            if scratch.bounded[side, i]:
                gap = _inwards(side) * (optimum.w[i] - program.bounds[side, i])
                own = barrier / gap
                force = forces[side, i] + share_of_forces * scratch.moves[side, i]
                forces[side, i] = min(max(force, own / STIFFEST), STIFFEST * own)
