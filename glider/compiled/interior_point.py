"""A primal-dual interior-point method for collocated flights.

After Wächter and Biegler: On the implementation of an interior-point filter
line-search algorithm for large-scale nonlinear programming, 2006. Newton's step is that
of `glider.compiled.stages`, whose time grows with the number of knots alone.
"""

from typing import NamedTuple

import numpy as np

from glider.compiled.collocation import Path, PathDynamics
from glider.compiled.kernel import machine_code
from glider.compiled.stages import newton_step, weigh
from glider.physics.model import GliderModel

_PENALTY = 1e6
"""Penalty on the place at the end, see `newton_step`."""

_NEAR = 1e3
"""Errors of optimality, in tolerances, below which slopes have to be fine."""

_COARSE = 1e-4
"""Tolerance above which coarse slopes are enough."""

_STIFFEST = 1e10
"""Most that is added to the curvature, and the factor within which the force of a limit
stays of the barrier's."""

_HALVINGS = 25
"""A step is halved at most so often."""

_INSIDE = 1e-2
"""Share of a bound, or of the width between two, that a guess keeps from it."""


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
    """

    w: np.ndarray
    multipliers: np.ndarray
    pull: np.ndarray


class _Scratch(NamedTuple):
    """Arrays that one step passes to the next.

    Attributes:
        slope: (N (n + 1) + 1,) of the cost, then with the barrier function's.
        lagrangian: (N (n + 1) + 1,) slope of the Lagrangian.
        diagonal: (N (n + 1) + 1,) curvature of the cost, then with the barrier
            function's.
        cross: (N,) curvature of the cost by a command and h.
        misses: (2,) by which the end leaves its place.
        by_middle: (N - 1, n + 1) slope of the Lagrangian by the middles of `weigh`.
        by_middle_and_step: (N - 1, n + 1) its slope by h.
        change: (N (n + 1) + 1,) Newton's step.
        ahead: (N - 1, n) multipliers after it.
        drawn: (2,) multipliers of the place after it.
    """

    slope: np.ndarray
    lagrangian: np.ndarray
    diagonal: np.ndarray
    cross: np.ndarray
    misses: np.ndarray
    by_middle: np.ndarray
    by_middle_and_step: np.ndarray
    change: np.ndarray
    ahead: np.ndarray
    drawn: np.ndarray


def _make_scratch(num_states: int, knots: int) -> _Scratch:
    """Allocates the arrays that the steps write."""
    width = num_states + 1
    size = knots * width + 1
    segments = (knots - 1, width)
    return _Scratch(
        slope=np.empty(size),
        lagrangian=np.empty(size),
        diagonal=np.empty(size),
        cross=np.empty(knots),
        misses=np.empty(2),
        by_middle=np.empty(segments),
        by_middle_and_step=np.empty(segments),
        change=np.empty(size),
        ahead=np.empty((knots - 1, num_states)),
        drawn=np.empty(2),
    )


class _Outcome(NamedTuple):
    """What the method ended with.

    Attributes:
        optimum: the path that was reached last.
        status: one of solved, stuck, out of steps.
        iterations: how many were made.
        error: largest error of optimality.
        cost: cost of the path.
    """

    optimum: Optimum
    status: str
    iterations: int
    error: float
    cost: float


class _Limits:
    """Slacks s > 0 of the bounds, and their forces λ.

    Each bound is w_i - low - s = 0 or high - w_i - s = 0. At the barrier's minimum
    λ s = μ. Slacks and forces are eliminated from Newton's step: what is left adds to
    its slopes and curvature.
    """

    def __init__(self, bounds: np.ndarray, w: np.ndarray, barrier: float) -> None:
        """Starts from a path inside the bounds, with the barrier's forces.

        Args:
            bounds: (2, N (n + 1) + 1) of a `Program`.
            w: of an `Optimum`.
            barrier: weight μ of the barrier function.
        """
        low, high = bounds
        below = np.flatnonzero(np.isfinite(low))
        above = np.flatnonzero(np.isfinite(high))
        self._which = np.concatenate([below, above])
        self._signs = np.repeat([1.0, -1.0], [len(below), len(above)])
        limits = np.concatenate([low[below], high[above]])
        apart = w[self._which] - limits
        self._slacks = self._signs * apart
        self._forces = barrier / self._slacks
        self._products = self._forces * self._slacks
        self._logarithms = float(np.log(self._slacks).sum())

    @property
    def touch(self) -> float:
        """Largest product of force and slack."""
        return float(self._products.max())

    @property
    def sum_of_forces(self) -> float:
        """Sum of all forces."""
        return float(self._forces.sum())

    def push(self, scratch: _Scratch) -> None:
        """Adds the forces to the Lagrangian's slope by knots and h."""
        _push_bounds(self._which, self._signs, self._forces, scratch.lagrangian)

    def miss_barrier(self, barrier: float) -> float:
        """Returns the largest difference of force times slack from the weight."""
        missed = self._products - barrier
        return float(np.abs(missed).max())

    def curve(self, barrier: float, scratch: _Scratch) -> None:
        """Adds what the barrier does to slopes and curvature of the program."""
        of_bounds = self._which, self._signs, self._slacks, self._forces
        _curve_bounds(*of_bounds, barrier, scratch.slope, scratch.diagonal)

    def keep_clear(
        self, barrier: float, keep: float, scratch: _Scratch
    ) -> tuple[float, float, float]:
        """Finds the step of slacks and forces beside Newton's.

        Args:
            barrier: its weight.
            keep: share of a slack or a force that a step may take.
            scratch: with Newton's step.

        Returns:
            the shares of the step and of the forces' that keep both positive, and by
            how much the whole step changes the barrier problem's cost, to first order.
        """
        expected = float(scratch.slope @ scratch.change)
        self._rise = self._signs * scratch.change[self._which]
        given = self._slacks, self._forces, self._rise
        self._moves, share, share_of_forces = _find_moves(barrier, keep, *given)
        return share, share_of_forces, expected

    def weigh_barrier(self, barrier: float) -> float:
        """Returns the barrier function, after `try_step` that of the tried slacks."""
        return -barrier * self._logarithms

    def try_step(self, share: float) -> None:
        """Moves the slacks that `weigh_barrier` is of by a share of their step."""
        self._tried = self._slacks + share * self._rise
        self._logarithms = float(np.log(self._tried).sum())

    def take_step(self, share_of_forces: float, barrier: float) -> None:
        """Takes the step that was tried, and keeps the forces near the barrier's."""
        self._slacks = self._tried
        given = self._slacks, self._moves, self._forces, self._products
        _move_forces(barrier, share_of_forces, *given)


@machine_code
def _push_bounds(which, signs, forces, slope):
    """Adds the forces of B bounds, the first of all, to a slope at their places."""
    for k in range(len(which)):
        place = which[k]
        slope[place] -= signs[k] * forces[k]


@machine_code
def _curve_bounds(which, signs, slacks, forces, barrier, slope, diagonal):
    """Adds the barrier function of B bounds to slope and curvature at their places."""
    for k in range(len(which)):
        place = which[k]
        own = barrier / slacks[k]
        slope[place] -= signs[k] * own
        diagonal[place] += forces[k] / slacks[k]


@machine_code
def _move_forces(barrier, share, slacks, moves, forces, products):
    """Moves forces, within a factor of the barrier's; writes their products."""
    own = barrier / slacks
    moved = np.maximum(forces + share * moves, own / _STIFFEST)
    forces[:] = np.minimum(moved, own * _STIFFEST)
    products[:] = forces * slacks


@machine_code
def _find_moves(barrier, keep, slacks, forces, rise):
    """Finds the forces' step beside that of the slacks, their rise.

    Returns:
        the step, and the shares of both that take at most a share keep of all slacks
        and forces.
    """
    moves = (barrier - forces * rise) / slacks - forces
    share = 1.0 / max(1.0, np.max(-rise / slacks) / keep)
    share_of_forces = 1.0 / max(1.0, np.max(-moves / forces) / keep)
    return moves, share, share_of_forces


class _Filter:
    """Pairs of (missed, cost) that no later path may be worse than in both."""

    def __init__(self, missed: float) -> None:
        """Scales the filter by the first path's constraint violation."""
        self._least = 1e-4 * max(1.0, missed)
        self._most = 1e4 * max(1.0, missed)
        self._pairs: list[tuple[float, float]] = []

    def forget(self) -> None:
        """Forgets the costs, which another weight of the barrier has changed."""
        self._pairs.clear()

    def accepts(
        self,
        before: tuple[float, float],
        after: tuple[float, float],
        share: float,
        expected: float,
    ) -> bool:
        """Checks whether a step makes progress, and remembers it.

        Args:
            before: (missed, cost) of the path that the step leaves.
            after: of the path that it reaches.
            share: of Newton's step.
            expected: change of the cost by Newton's step, to first order.
        """
        (missed, cost), (now, then) = before, after
        rounding = 1e-11 * abs(cost)
        if not (now < self._most and then < np.inf):  # So no NaN either.
            return False
        if any(now >= m and then >= c + rounding for m, c in self._pairs):
            return False
        falls = expected < 0.0 and share * (-expected) ** 2.3 > missed**1.1
        if missed <= self._least and falls:
            return then <= cost + 1e-4 * share * expected + rounding
        fewer = (1.0 - 1e-5) * missed
        cheaper = cost - 1e-5 * missed
        if now <= fewer or then <= cheaper + rounding:
            self._pairs.append((fewer, cheaper))
            return True
        return False


def optimize(
    model: GliderModel,
    program: Program,
    guess: Optimum,
    barrier: float,
    tolerance: float,
    iterations: int,
) -> _Outcome:
    """Finds a flight of least cost near a guess.

    Args:
        model: the glider, in still air and at time 0.
        program: what to solve.
        guess: to start from; the limits' forces are the barrier's at first.
        barrier: weight of the barrier function at first.
        tolerance: largest slope of the Lagrangian, defect and complementarity, where
            the multipliers are of size 100 or less.
        iterations: at most so many.

    Raises:
        UncompilableError: a formula of the glider is not of what numba compiles.
    """
    at = Optimum(*(part.copy() for part in guess))
    knots = len(guess.multipliers) + 1
    dynamics = PathDynamics(model, knots)
    scratch = _make_scratch(program.goal.size, knots)
    path = dynamics.path
    penalty = _PENALTY if program.is_held else 0.0
    _enter(program.bounds, at.w)
    missed = _missed(program, dynamics, at.w)
    limits = _Limits(program.bounds, at.w, barrier)
    weights = _command_weights(program, knots)
    cost = _cost_of(program, weights, at.w)
    known = _Filter(missed)
    damping = 0.0
    least = 0.1 * tolerance
    near = -np.inf if tolerance >= _COARSE else _NEAR * tolerance
    fine = False
    dynamics.linearize(fine)
    status = "out of steps"
    for iteration in range(iterations + 1):
        while True:
            _lean_on(program, weights, at, scratch)
            limits.push(scratch)
            weigh(at.w[-1], path, at.multipliers, scratch)
            free = scratch.lagrangian[program.goal.size :]  # The launch is fixed.
            total = limits.sum_of_forces + np.abs(at.multipliers).sum()
            scale = max(1.0, 0.01 * total / at.w.size)
            dual = np.abs(free).max()
            off = max(dual / scale, missed)
            error = max(off, limits.touch / scale)
            if fine or error > near:
                break
            fine = True
            dynamics.linearize(fine)
        if error <= tolerance:
            status = "solved"
        if status == "solved" or iteration == iterations:
            break
        while barrier > least:
            apart = limits.miss_barrier(barrier)
            if max(off, apart / scale) >= 10.0 * barrier:
                break
            barrier = max(least, min(0.2 * barrier, barrier**1.5))
            known.forget()
        dynamics.curve()
        limits.curve(barrier, scratch)
        added = _step_down(penalty, damping, path, at, scratch)
        if added is None:
            status = "stuck"
            break
        damping = added or damping
        keep = max(0.99, 1.0 - barrier)
        share, share_of_forces, expected = limits.keep_clear(barrier, keep, scratch)
        before = missed, cost + limits.weigh_barrier(barrier)
        for _ in range(_HALVINGS):
            tried = at.w + share * scratch.change
            missed = _missed(program, dynamics, tried)
            limits.try_step(share)
            cost = _cost_of(program, weights, tried)
            after = missed, cost + limits.weigh_barrier(barrier)
            if known.accepts(before, after, share, expected):
                break
            share *= 0.5
        else:
            status = "stuck"
            break
        at.w[:] = tried
        turn = scratch.ahead - at.multipliers
        at.multipliers[:] += share * turn
        pulled = scratch.drawn - at.pull
        at.pull[:] += share * pulled
        limits.take_step(share_of_forces, barrier)
        dynamics.linearize(fine)
    return _Outcome(
        optimum=at,
        status=status,
        iterations=iteration,
        error=float(error),
        cost=_cost_of(program, weights, at.w),
    )


def _enter(bounds: np.ndarray, w: np.ndarray) -> None:
    """Moves a guess inside its bounds."""
    low, high = bounds
    width = high - low  # Infinite where one side is free.
    below = np.isfinite(low)
    above = np.isfinite(high)
    size = np.maximum(1.0, np.abs(low))
    room = _INSIDE * np.minimum(width, size)
    np.maximum(w, low + room, out=w, where=below)
    size = np.maximum(1.0, np.abs(high))
    room = _INSIDE * np.minimum(width, size)
    np.minimum(w, high - room, out=w, where=above)


def _cost_of(program: Program, weights: np.ndarray, w: np.ndarray) -> float:
    """Returns the cost of knots and h, with `_command_weights`."""
    n = program.goal.size
    commands = w[n : -1 : n + 1]
    of_commands = weights * commands @ commands
    error = w[-n - 2 : -2] - program.goal
    at_end = program.goal_weights @ (error * error)
    return float(0.5 * w[-1] * of_commands + at_end)


def _command_weights(program: Program, knots: int) -> np.ndarray:
    """Returns weights (N,) of squared commands, by the trapezoid rule, times 2 / h."""
    weights = np.full(knots, 2.0 * program.rate_cost)
    weights[[0, -1]] *= 0.5
    return weights


def _lean_on(
    program: Program, weights: np.ndarray, at: Optimum, scratch: _Scratch
) -> None:
    """Writes slopes and curvature of the cost, and what the end misses.

    The Lagrangian's slope lacks the part of defects and limits then.
    """
    n = program.goal.size
    of_commands = slice(n, -1, n + 1)
    end = slice(-n - 2, -2)
    place = slice(-n - 2, -n)
    step = at.w[-1]
    commands = at.w[of_commands]
    slope = scratch.slope
    diagonal = scratch.diagonal
    np.multiply(weights, commands, out=scratch.cross)
    slope[:] = 0.0
    slope[of_commands] = scratch.cross * step
    slope[-1] = 0.5 * (scratch.cross @ commands)
    error = at.w[end] - program.goal
    stiffness = 2.0 * program.goal_weights
    slope[end] = stiffness * error
    diagonal[:] = 0.0
    diagonal[of_commands] = weights * step
    diagonal[end] = stiffness
    scratch.lagrangian[:] = slope
    scratch.lagrangian[place] += at.pull
    scratch.misses[:] = 0.0
    if program.is_held:
        scratch.misses[:] = at.w[place] - program.place


def _missed(program: Program, dynamics: PathDynamics, w: np.ndarray) -> float:
    """Returns the sum of the defects, and of what the end misses its place by."""
    missed = dynamics.collocate(w)
    if program.is_held:
        end = slice(-program.goal.size - 2, -program.goal.size)
        missed += float(np.abs(w[end] - program.place).sum())
    return missed


def _step_down(
    penalty: float, damping: float, path: Path, at: Optimum, scratch: _Scratch
) -> float | None:
    """Writes Newton's step, of a curvature that is made positive where it is not.

    Returns:
        what was added to its diagonal, None where nothing helps.
    """
    added = 0.0
    step = at.w[-1]
    while added <= _STIFFEST:
        if newton_step(step, path, at.multipliers, scratch, added, penalty):
            return added
        if added == 0.0:
            added = max(1e-4, damping / 3.0)
        else:
            added *= 8.0 if damping else 100.0
    return None
