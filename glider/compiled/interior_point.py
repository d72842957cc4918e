"""A primal-dual interior-point method for collocated flights.

After Wächter and Biegler: On the implementation of an interior-point filter
line-search algorithm for large-scale nonlinear programming, 2006. Newton's step is that
of `glider.compiled.stages`, whose time grows with the number of knots alone.
"""

from typing import NamedTuple

import numpy as np

from glider.compiled import collocation, stages
from glider.compiled.collocation import collocate, curvature_along, slopes_along
from glider.compiled.jacobian import stacked
from glider.compiled.kernel import Family, UncompilableError, compile_errors
from glider.compiled.stages import newton_step, weigh
from glider.physics.model import GliderModel

STATUSES = ("solved", "stuck", "out of steps")
"""What `interior_point` returns the place in."""


class Program(NamedTuple):
    """A flight to optimize: N knots of states and command, segments of one length h.

    minimize   r ∫ u² dt + (x_N - goal)ᵀ diag(w) (x_N - goal), by the trapezoid rule.
    """

    low: np.ndarray
    """(N (n + 1) + 1,) bounds from below of the knots, one after the other, and of h;
    -inf where there is none, as where a value is fixed."""

    high: np.ndarray
    """The same from above."""

    rate_cost: float
    """r."""

    goal: np.ndarray
    """(n,)."""

    goal_weights: np.ndarray
    """(n,) w."""

    place: np.ndarray
    """(2,) where the flight ends, (x, z) [m]."""


class Limits(NamedTuple):
    """When to stop, and steps of differences."""

    tolerance: float = 1e-6
    """Largest slope of the Lagrangian, defect and complementarity, where the
    multipliers are of size 100 or less."""

    iterations: int = 150
    """At most so many."""

    slope_step: float = 1e-5
    """Step of first differences [m, rad, m/s, rad/s], before the last iterations."""

    curvature_step: float = 3e-4
    """Step of second differences. Newton's method needs no exact curvature: its root
    is where the exact slopes say."""

    penalty: float = 1e6
    """Penalty on the place at the end, see `newton_step`."""


DEFAULTS = Limits()


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


def lean_on(program, w, misses, cost_slope, cross, diagonal):
    """Writes the slopes and the curvature of the cost, and what the end misses."""
    n = program.goal.shape[0]
    width, last = n + 1, w.shape[0] - 1
    cost_slope[:] = 0.0
    diagonal[:] = 0.0
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
    for i in range(2):
        misses[i] = w[last - width + i] - program.place[i]


def longest(value, change, keep, longest_yet):
    """Returns the share of a change that leaves of a positive value a share keep."""
    return min(longest_yet, -keep * value / change) if change < 0.0 else longest_yet


def interior_point(
    program, limits, barrier, exact, w, multipliers, pull, forces, theta, z, progress
):
    """Finds a flight of least cost near a guess.

    Args:
        program: what to solve.
        limits: when to stop.
        barrier: weight of the barrier function at first.
        exact: whether slopes are exact from the start.
        w: (N (n + 1) + 1,) guess, overwritten by what was found last.
        multipliers: (N - 1, n) of the defects of `collocate`, as w.
        pull: (2,) multipliers of the place at the end, as w.
        forces: (2, N (n + 1) + 1) multipliers of the bounds; where not positive, at
            first those of the barrier function.
        theta: the glider's numbers.
        z: of `stacked`.
        progress: (4,), written: iterations, sum of what the constraints are missed by,
            the largest error of optimality, cost.

    Returns:
        a place in STATUSES.
    """
    size, n = w.shape[0], program.goal.shape[0]
    width, last = n + 1, size - 1
    count = last // width
    segments = count - 1
    knots = w[:last].reshape((count, width))
    tried = np.empty(size)
    tried_knots = tried[:last].reshape((count, width))
    rates, middles = np.empty((2 * count - 1, n)), np.empty((segments, width))
    defects = np.empty((segments, n))
    slopes = np.empty((2 * count - 1, n, width))
    curvature = np.empty((2 * count - 1, width, width))
    weights, back = np.empty((2 * count - 1, n)), np.empty((segments, width))
    slope, lagrangian = np.empty(size), np.empty(size)
    diagonal, stiff = np.empty(size), np.empty(size)
    cross, misses = np.empty(count), np.empty(2)
    change, ahead, drawn = np.empty(size), np.empty((segments, n)), np.empty(2)
    moves = np.empty((2, size))
    bounded = np.empty((2, size), np.bool_)
    slack = np.ones((2, size))
    filter_misses, filter_costs = np.empty(500), np.empty(500)
    filtered = 0

    for i in range(size):
        low, high = program.low[i], program.high[i]
        bounded[0, i], bounded[1, i] = not np.isinf(low), not np.isinf(high)
        inside = 1e-2 * (high - low)  # Infinite where one side is free.
        if bounded[0, i]:
            w[i] = max(w[i], low + min(inside, 1e-2 * max(1.0, abs(low))))
        if bounded[1, i]:
            w[i] = min(w[i], high - min(inside, 1e-2 * max(1.0, abs(high))))
        for side in range(2):
            if bounded[side, i]:
                gap = w[i] - low if side == 0 else high - w[i]
                if not forces[side, i] > 0.0:
                    forces[side, i] = barrier / gap
            else:
                forces[side, i] = 0.0
    missed = collocate(knots, w[last], theta, rates, middles, defects)
    missed += abs(w[last - width] - program.place[0])
    missed += abs(w[last - width + 1] - program.place[1])
    least, most = 1e-4 * max(1.0, missed), 1e4 * max(1.0, missed)
    damping = 0.0
    slopes_along(knots, middles, exact, limits.slope_step, z, theta, slopes)
    for iteration in range(limits.iterations + 1):
        lean_on(program, w, misses, slope, cross, diagonal)
        while True:
            lagrangian[:] = slope
            weigh(knots, w[last], rates, slopes, multipliers, weights, back, lagrangian)
            lagrangian[last - width] += pull[0]
            lagrangian[last - width + 1] += pull[1]
            dual, size_of = 0.0, 0.0
            for i in range(size):
                push = lagrangian[i] - forces[0, i] + forces[1, i]
                size_of += forces[0, i] + forces[1, i]
                if i >= n:  # The launch is fixed.
                    dual = max(dual, abs(push))
            for k in range(segments):
                for i in range(n):
                    size_of += abs(multipliers[k, i])
            scale = max(1.0, 0.01 * size_of / size)
            touch = 0.0
            for i in range(size):
                slack[0, i] = w[i] - program.low[i] if bounded[0, i] else 1.0
                slack[1, i] = program.high[i] - w[i] if bounded[1, i] else 1.0
                for side in range(2):
                    touch = max(touch, forces[side, i] * slack[side, i])
            error = max(dual / scale, missed, touch / scale)
            if exact or error > 1e3 * limits.tolerance:
                break
            exact = True
            slopes_along(knots, middles, exact, limits.slope_step, z, theta, slopes)
        progress[0], progress[1], progress[2] = iteration, missed, error
        progress[3] = weigh_path(program, w, 0.0)
        if error <= limits.tolerance:
            return 0
        if iteration == limits.iterations:
            return 2
        while barrier > 0.1 * limits.tolerance:
            off = max(dual / scale, missed)
            for i in range(size):
                for side in range(2):
                    if bounded[side, i]:
                        product = forces[side, i] * slack[side, i]
                        off = max(off, abs(product - barrier) / scale)
            if off >= 10.0 * barrier:
                break
            barrier = max(0.1 * limits.tolerance, min(0.2 * barrier, barrier**1.5))
            filtered = 0

        curvature_along(
            knots, middles, weights, slopes, limits.curvature_step, theta, curvature
        )
        for i in range(size):
            for side in range(2):
                if bounded[side, i]:
                    diagonal[i] += forces[side, i] / slack[side, i]
                    sign = 1.0 - 2.0 * side
                    slope[i] -= sign * barrier / slack[side, i]
        added = 0.0
        while True:
            for i in range(size):
                stiff[i] = diagonal[i] + added
            if newton_step(
                w[last],
                rates,
                slopes,
                curvature,
                defects,
                multipliers,
                back,
                cross,
                stiff,
                slope,
                misses,
                limits.penalty,
                change,
                ahead,
                drawn,
            ):
                break
            if added == 0.0:
                added = max(1e-4, damping / 3.0)
            else:
                added *= 100.0 if damping == 0.0 else 8.0
            if added > 1e10:
                return 1
        if added > 0.0:
            damping = added

        keep = max(0.99, 1.0 - barrier)
        share = share_of_forces = 1.0
        expected = 0.0
        for i in range(size):
            expected += slope[i] * change[i]
            for side in range(2):
                if bounded[side, i]:
                    gap, force = slack[side, i], forces[side, i]
                    step = change[i] * (1.0 - 2.0 * side)
                    move = (barrier - force * step) / gap - force
                    moves[side, i] = move
                    share = longest(gap, step, keep, share)
                    share_of_forces = longest(force, move, keep, share_of_forces)
        merit = weigh_path(program, w, barrier)
        rounding = 1e-11 * abs(merit)
        accepted = False
        for _ in range(25):
            for i in range(size):
                tried[i] = w[i] + share * change[i]
            now = collocate(tried_knots, tried[last], theta, rates, middles, defects)
            now += abs(tried[last - width] - program.place[0])
            now += abs(tried[last - width + 1] - program.place[1])
            after = weigh_path(program, tried, barrier)
            if now < most and after < np.inf:  # And no NaN.
                fine = True
                for k in range(filtered):
                    cheap = after < filter_costs[k] + rounding
                    if now >= filter_misses[k] and not cheap:
                        fine = False
                falls = expected < 0.0 and share * (-expected) ** 2.3 > missed**1.1
                if fine and missed <= least and falls:
                    promised = 1e-4 * share * expected + rounding
                    accepted = after <= merit + promised
                elif fine:
                    less = (1.0 - 1e-5) * missed
                    cheaper = merit - 1e-5 * missed
                    accepted = now <= less or after <= cheaper + rounding
                    if accepted and filtered < filter_misses.shape[0]:
                        filter_misses[filtered] = less
                        filter_costs[filtered] = cheaper
                        filtered += 1
            if accepted:
                break
            share *= 0.5
        if not accepted:
            return 1
        missed = now
        w[:] = tried
        for k in range(segments):
            for i in range(n):
                multipliers[k, i] += share * (ahead[k, i] - multipliers[k, i])
        for i in range(2):
            pull[i] += share * (drawn[i] - pull[i])
        for i in range(size):
            for side in range(2):
                if bounded[side, i]:
                    gap = w[i] - program.low[i]
                    if side == 1:
                        gap = program.high[i] - w[i]
                    force = forces[side, i] + share_of_forces * moves[side, i]
                    least_force = barrier / (1e10 * gap)
                    forces[side, i] = min(max(force, least_force), 1e10 * barrier / gap)
        slopes_along(knots, middles, exact, limits.slope_step, z, theta, slopes)
    return 2


LOOPS = Family(
    (weigh_path, lean_on, longest, interior_point),
    (interior_point,),
    uses=(collocation.LOOPS, stages.LOOPS),
)


class Optimum(NamedTuple):
    """A flight and its multipliers, as `interior_point` leaves them."""

    w: np.ndarray
    """(N (n + 1) + 1,) states and command at each knot, then the segments' length."""

    multipliers: np.ndarray
    """(N - 1, n) of the defects of `collocate`."""

    pull: np.ndarray
    """(2,) of the place at the end."""

    forces: np.ndarray
    """(2, N (n + 1) + 1) of the bounds from below and from above."""


def optimize(
    model: GliderModel,
    program: Program,
    guess: Optimum,
    barrier: float,
    limits: Limits = DEFAULTS,
    exact: bool = False,
) -> tuple[Optimum, str, np.ndarray]:
    """Finds a flight of least cost near a guess, see `interior_point`.

    Args:
        model: the glider, in still air and at time 0.
        program: what to solve.
        guess: to start from.
        barrier: weight of the barrier function at first.
        limits: when to stop.
        exact: whether slopes are exact from the start, not at the end alone.

    Returns:
        what was found, one of STATUSES, and progress (4,).

    Raises:
        UncompilableError: a formula is not of what numba compiles.
    """
    found = Optimum(*(part.copy() for part in guess))
    progress, theta = np.empty(4), model.numbers
    loop = LOOPS.over(model.kinds, model.has_field).interior_point
    z = stacked(model.num_states, theta)
    try:
        status = loop(program, limits, barrier, exact, *found, theta, z, progress)
    except compile_errors() as error:
        raise UncompilableError(str(error)) from None
    return found, STATUSES[status], progress
