"""A primal-dual interior-point method for collocated flights.

After Wächter and Biegler: On the implementation of an interior-point filter
line-search algorithm for large-scale nonlinear programming, 2006. Newton's step is that
of `glider.compiled.stages`, whose time grows with the number of knots alone. Here is
the order of the steps alone, so that of a glider with other effects only its dynamics
have to be compiled (`glider.compiled.collocation`).
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from glider.compiled import barrier as steps
from glider.compiled.barrier import Optimum, Program, Scratch
from glider.compiled.collocation import Path, PathDynamics
from glider.compiled.inequalities import Formula, Inequalities
from glider.compiled.stages import newton_step, weigh
from glider.physics.model import GliderModel

_PENALTY = 1e6
"""Penalty on the place at the end, see `newton_step`."""

_NEAR = 1e3
"""Errors of optimality, in tolerances, below which slopes have to be fine."""

_COARSE = 1e-4
"""Tolerance above which coarse slopes are enough."""

_STIFFEST = 1e10
"""Most that is added to the curvature."""

_HALVINGS = 25
"""A step is halved at most so often."""


class Outcome(NamedTuple):
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


class Filter:
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
    iterations: int = 150,
    formulas: Sequence[Formula] = (),
    margins: np.ndarray | None = None,
) -> Outcome:
    """Finds a flight of least cost near a guess.

    Args:
        model: the glider, in still air and at time 0.
        program: what to solve.
        guess: to start from; its forces, where not positive, are the barrier's.
        barrier: weight of the barrier function at first.
        tolerance: largest slope of the Lagrangian, defect and complementarity, where
            the multipliers are of size 100 or less.
        iterations: at most so many.
        formulas: J inequalities g(x) >= margin that hold at the P points of the path.
        margins: (J, P) of them, None for zeros.

    Raises:
        UncompilableError: a formula of the glider is not of what numba compiles.
    """
    at = Optimum(*(part.copy() for part in guess))
    knots = len(guess.multipliers) + 1
    dynamics = PathDynamics(model, knots)
    scratch = steps.make_scratch(program, knots)
    path = dynamics.path
    penalty = _PENALTY if program.is_held else 0.0
    steps.enter(program, barrier, scratch, at.w, at.forces)
    missed = _missed(program, dynamics, at.w)
    if margins is None:
        margins = np.zeros((len(formulas), len(path.points)))
    limits = Inequalities(formulas, margins, path, barrier)
    missed += limits.missed
    known = Filter(missed)
    damping = 0.0
    least = 0.1 * tolerance
    near = -np.inf if tolerance >= _COARSE else _NEAR * tolerance
    fine = False
    dynamics.linearize(fine)
    status = "out of steps"
    for iteration in range(iterations + 1):
        limits.linearize()
        while True:
            steps.lean_on(program, at, scratch)
            limits.push(scratch)
            weigh(at.w[-1], path, at.multipliers, scratch)
            dual, touch, total = steps.assess(program, at, scratch)
            total += limits.sum_of_forces
            scale = max(1.0, 0.01 * total / (at.w.size + limits.count))
            off = max(dual / scale, missed)
            error = max(off, touch / scale, limits.touch / scale)
            if fine or error > near:
                break
            fine = True
            dynamics.linearize(fine)
        if error <= tolerance:
            status = "solved"
        if status == "solved" or iteration == iterations:
            break
        while barrier > least:
            apart = steps.miss_barrier(barrier, at.forces, scratch)
            apart = max(apart, limits.miss_barrier(barrier))
            if max(off, apart / scale) >= 10.0 * barrier:
                break
            barrier = max(least, min(0.2 * barrier, barrier**1.5))
            known.forget()
        dynamics.curve()
        steps.add_barrier(barrier, at.forces, scratch)
        limits.curve(barrier, scratch)
        added = _step_down(penalty, damping, path, at, scratch)
        if added is None:
            status = "stuck"
            break
        damping = added or damping
        keep = max(0.99, 1.0 - barrier)
        shares = steps.keep_clear(barrier, keep, at.forces, scratch)
        more = limits.keep_clear(barrier, keep, scratch)
        share = min(shares[0], more[0])
        share_of_forces = min(shares[1], more[1])
        expected = shares[2] + more[2]
        weight = limits.weigh_barrier(barrier)
        before = missed, steps.weigh_path(program, at.w, barrier) + weight
        for _ in range(_HALVINGS):
            tried = at.w + share * scratch.change
            missed = _missed(program, dynamics, tried)
            lacking, weight = limits.try_step(share, barrier)
            missed += lacking
            after = missed, steps.weigh_path(program, tried, barrier) + weight
            if known.accepts(before, after, share, expected):
                break
            share *= 0.5
        else:
            status = "stuck"
            break
        at.w[:] = tried
        steps.change_multipliers(program, barrier, share, share_of_forces, at, scratch)
        limits.take_step(share, share_of_forces, barrier)
        dynamics.linearize(fine)
    return Outcome(
        optimum=at,
        status=status,
        iterations=iteration,
        error=error,
        cost=steps.weigh_path(program, at.w, 0.0),
    )


def _missed(program: Program, dynamics: PathDynamics, w: np.ndarray) -> float:
    """Returns the sum of the defects, and of what the end misses its place by."""
    missed = dynamics.collocate(w)
    if program.is_held:
        end = slice(-program.goal.size - 2, -program.goal.size)
        missed += float(np.abs(w[end] - program.place).sum())
    return missed


def _step_down(
    penalty: float, damping: float, path: Path, at: Optimum, scratch: Scratch
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
