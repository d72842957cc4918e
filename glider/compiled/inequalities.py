"""Smooth inequalities g(x) >= 0 at the points of a collocated path after its launch.

In the interior-point method each is g(x) - margin - s = 0 with a slack s > 0, whose
force λ is that of the barrier, λ s = μ. Slack and force are eliminated from Newton's
step: what is left adds to slopes and curvature of the points.
"""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from glider.compiled.barrier import STIFFEST, Scratch, longest_step
from glider.compiled.collocation import Path
from glider.compiled.runge_kutta import TINY

Formula = Callable[[Any], Any]
"""g of states (n, ...), real or complex."""

_CURVATURE_STEP = 1e-4
"""Step of the differences of exact slopes."""

_LEAST_SLACK = 5e-2
"""Slack at first, at least."""


class Inequalities:
    """Slacks (J, P - 1) and forces (J, P - 1) of J inequalities at points of a path.

    The first of the path's P points, the launch, is fixed and left out. Where there
    are no inequalities, all methods return at once.
    """

    def __init__(
        self,
        formulas: Sequence[Formula],
        margins: np.ndarray,
        path: Path,
        barrier: float,
    ) -> None:
        """Starts from the points of a path.

        Args:
            formulas: J of them.
            margins: (J, P) that each g is to be at least; the launch's is not read.
            path: whose points, slopes and curvature are read and written.
            barrier: weight of the barrier function.
        """
        self._formulas = formulas
        self._margins = margins[:, 1:]
        self._path = path
        self.count = 0
        if formulas:
            self.evaluate()
            self._slacks = np.maximum(self._values, _LEAST_SLACK)
            self._forces = barrier / self._slacks
            self.count = self._slacks.size

    def evaluate(self) -> None:
        """Evaluates g at the points."""
        states = self._path.points[1:, :-1].T
        values = [formula(states) for formula in self._formulas]
        self._values = np.array(values) - self._margins

    def linearize(self) -> None:
        """Differentiates g at the points."""
        if self.count:
            found = [_differentiate(g, self._path.points[1:]) for g in self._formulas]
            self._slopes = np.array([slopes for slopes, _ in found])
            self._curvature = np.array([curvature for _, curvature in found])

    def push(self, scratch: Scratch) -> None:
        """Writes the slope of the Lagrangian by the points, -Σ λ ∂g."""
        if self.count:
            pushes = scratch.pushes[1:, :-1]
            np.einsum("jp,jpi->pi", -self._forces, self._slopes, out=pushes)

    @property
    def missed(self) -> float:
        """Sum of the differences of g and slacks."""
        return float(np.abs(self._values - self._slacks).sum()) if self.count else 0.0

    @property
    def touch(self) -> float:
        """Largest product of force and slack."""
        return float((self._forces * self._slacks).max()) if self.count else 0.0

    @property
    def sum_of_forces(self) -> float:
        """Sum of all forces."""
        return float(self._forces.sum()) if self.count else 0.0

    def miss_barrier(self, barrier: float) -> float:
        """Returns the largest difference of force times slack from the weight."""
        if not self.count:
            return 0.0
        return float(np.abs(self._forces * self._slacks - barrier).max())

    def curve(self, barrier: float, scratch: Scratch) -> None:
        """Adds to the path's curvature, and writes what the barrier pushes."""
        if not self.count:
            return
        stiffness = self._forces / self._slacks
        slopes = self._slopes
        curvature = self._path.curvature[1:, :-1, :-1]
        curvature += np.einsum("jp,jpa,jpb->pab", stiffness, slopes, slopes)
        curvature -= np.einsum("jp,jpab->pab", self._forces, self._curvature)
        missed = self._values - self._slacks
        after = barrier / self._slacks - stiffness * missed
        pushes = scratch.barrier_pushes[1:, :-1]
        np.einsum("jp,jpi->pi", -after, slopes, out=pushes)

    def keep_clear(
        self, barrier: float, keep: float, scratch: Scratch
    ) -> tuple[float, float, float]:
        """Finds the step of slacks and forces beside Newton's, as `barrier.keep_clear`.

        Returns:
            the shares of the step and of the forces' that keep both positive, and by
            how much the whole step changes the barrier function, to first order.
        """
        if not self.count:
            return 1.0, 1.0, 0.0
        shifts = scratch.shifts[1:, :-1]
        missed = self._values - self._slacks
        self._rise = np.einsum("jpi,pi->jp", self._slopes, shifts) + missed
        own = barrier / self._slacks
        self._moves = own - self._forces - self._forces / self._slacks * self._rise
        expected = -float((own * self._rise).sum())
        share = longest_step(self._slacks.ravel(), self._rise.ravel(), keep)
        share_of_forces = longest_step(self._forces.ravel(), self._moves.ravel(), keep)
        return share, share_of_forces, expected

    def weigh_barrier(self, barrier: float) -> float:
        """Returns the barrier function of the slacks."""
        return -barrier * float(np.log(self._slacks).sum()) if self.count else 0.0

    def try_step(self, share: float, barrier: float) -> tuple[float, float]:
        """Evaluates a share of the step at points that have moved.

        Returns:
            by how much g and slacks differ in sum, and the barrier function.
        """
        if not self.count:
            return 0.0, 0.0
        self.evaluate()
        slacks = self._slacks + share * self._rise
        missed = float(np.abs(self._values - slacks).sum())
        return missed, -barrier * float(np.log(slacks).sum())

    def take_step(self, share: float, share_of_forces: float, barrier: float) -> None:
        """Takes the step, and keeps the forces near the barrier's own."""
        if not self.count:
            return
        self._slacks = self._slacks + share * self._rise
        forces = self._forces + share_of_forces * self._moves
        own = barrier / self._slacks
        self._forces = np.clip(forces, own / STIFFEST, own * STIFFEST)


def _differentiate(
    formula: Formula, points: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Returns slopes (P, n) and curvature (P, n, n) of g at points (P, n + 1).

    Slopes are exact, by complex steps, and their differences are the curvature.
    """
    states = points[:, :-1].T
    n, count = states.shape
    slopes = np.zeros((n, count))
    curvature = np.zeros((n, n, count))
    axes = np.eye(n)[:, :, None]
    slopes[:] = formula(states[:, None] + 1j * TINY * axes).imag / TINY
    matters = np.flatnonzero(np.any(slopes != 0.0, axis=1))
    steps = 1j * TINY * axes[:, matters, None]
    for i in matters:
        moved = np.repeat(states[:, None, None] + steps, 2, axis=2)
        moved[i, :, 0] += _CURVATURE_STEP
        moved[i, :, 1] -= _CURVATURE_STEP
        forth, back = np.moveaxis(formula(moved).imag / TINY, 1, 0)
        curvature[i, matters] = (forth - back) / (2.0 * _CURVATURE_STEP)
    return slopes.T, np.moveaxis(curvature, 2, 0)
