"""The joint output-error fit of coefficients and launch states over whole flights.

This is the article's simulation-error refinement (its BPTT/RTRL step), as a
Gauss-Newton method in the lifted (multiple-shooting) form of
`glider.sysid.replay`. Launch states are eliminated flight by flight, so a fit
deals with one small matrix a flight: the information that the flight holds on
the coefficients. Sums, cross-validation and standard errors over flights are
then sums over these matrices.
"""

import dataclasses
import os
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from glider.effects import NO_FIELD, Field
from glider.sysid.replay import (
    DIVERGED,
    Linearized,
    Noise,
    Record,
    kernel,
    linearize,
    theta_lower,
    theta_scale,
    theta_upper,
)
from glider.sysid.shooting import fit_start, fly

_POOL = ThreadPoolExecutor(max_workers=os.cpu_count())


def in_parallel(function: Callable[[Any], Any], items: Iterable) -> list:
    """Returns function(item) for each; the compiled loops release Python's lock."""
    kernel()  # Compiled once, before the threads meet in it.
    return list(_POOL.map(function, items))


def eliminate_start(errors: Linearized) -> np.ndarray:
    """Returns a flight's information on theta, launch state eliminated.

    With errors e = r - X δs - T δθ, min over δs of |e|² is the quadratic form
    [δθ; -1]' R [δθ; -1]; R has shape (m + 1, m + 1). A model that blows up has
    an infinite cost.
    """
    table = np.column_stack([errors.by_start, errors.by_theta, errors.residual])
    k = errors.by_start.shape[1]
    if not np.abs(table).max() < DIVERGED:
        lost = np.zeros((table.shape[1] - k,) * 2)
        lost[-1, -1] = np.inf
        return lost
    gram = table.T @ table
    scale = 1.0 / np.sqrt(np.maximum(np.diag(gram)[:k], 1e-300))
    corner = gram[:k, :k] * scale[:, None] * scale + 1e-13 * np.eye(k)
    side = gram[:k, k:] * scale[:, None]
    return gram[k:, k:] - side.T @ cho_solve(cho_factor(corner), side)


def solve(information: np.ndarray, ridge: np.ndarray | float = 0.0) -> np.ndarray:
    """Returns the minimiser δθ of [δθ; -1]' R [δθ; -1] + Σ ridge δθ²."""
    m = information.shape[0] - 1
    if m == 0:
        return np.zeros(0)
    hessian = information[:m, :m] + np.diag(np.broadcast_to(ridge, m))
    scale = 1.0 / np.sqrt(np.maximum(np.diag(hessian), 1e-300))
    scaled = hessian * scale[:, None] * scale + 1e-10 * np.eye(m)
    return scale * np.linalg.solve(scaled, scale * information[:m, m])


def bounded_step(
    information: np.ndarray,
    ridge: np.ndarray,
    damping: float,
    lower: np.ndarray,
    upper: np.ndarray,
) -> np.ndarray:
    """Returns a Levenberg-Marquardt step that keeps between bounds.

    A coefficient that would leave them stays on its bound, and the others are
    solved for anew.
    """
    m = len(ridge)
    hessian = np.diag(information)[:m]
    fixed = np.zeros(m, dtype=bool)
    step = np.zeros(m)
    for _ in range(m + 1):
        loose = np.flatnonzero(~fixed)
        keep = np.append(loose, m)
        reduced = information[np.ix_(keep, keep)].copy()
        reduced[:-1, -1] -= (
            information[np.ix_(loose, np.flatnonzero(fixed))] @ step[fixed]
        )
        step[loose] = solve(reduced, ridge[loose] + damping * hessian[loose])
        outside = ~fixed & ((step < lower) | (step > upper))
        if not outside.any():
            break
        step[outside] = np.clip(step, lower, upper)[outside]
        fixed |= outside
    return step


def cost(information: np.ndarray, step: np.ndarray) -> float:
    """Returns [δθ; -1]' R [δθ; -1]: the sum of squared errors at a step."""
    v = np.append(step, -1.0)
    return float(v @ information @ v)


@dataclasses.dataclass(frozen=True, kw_only=True)
class Fit:
    """Coefficients found by rollout.

    Attributes:
        theta: the model found, in the order of SLOTS.
        free: indices into theta that were fitted.
        information: (flights, m + 1, m + 1) at theta, see `eliminate_start`.
        degrees: number of measurements less launch states, of each flight.
    """

    theta: np.ndarray
    free: tuple[int, ...]
    information: np.ndarray
    degrees: np.ndarray

    @property
    def cost(self) -> float:
        """Sum of squared errors over the noise variance."""
        return float(self.information[:, -1, -1].sum())

    @property
    def dispersion(self) -> float:
        """Mean squared error over noise variance; one under the true model."""
        return self.cost / float(self.degrees.sum() - len(self.free))


@dataclasses.dataclass(frozen=True, kw_only=True)
class Problem:
    """What a fit is about: the flights, their noise and the residual field.

    Attributes:
        records: the flights.
        noise: of the campaign.
        field: a residual field in the model.
        trim_is_known: as in `linearize`.
        is_exact: whether errors are taken along rollouts from fitted starts, not
            linearised about the smoothed measurement.
        prior: mean and standard deviation of theta (each in the order of SLOTS,
            infinite where nothing is known beforehand), or None.
    """

    records: Sequence[Record]
    noise: Noise
    field: Field = NO_FIELD
    trim_is_known: bool = True
    is_exact: bool = False
    prior: tuple[np.ndarray, np.ndarray] | None = None

    def thinned(self, count: int) -> "Problem":
        """Returns the problem with at most `count` of its flights, evenly picked."""
        last = len(self.records) - 1
        keep = np.linspace(0, last, min(count, last + 1)).round().astype(int)
        return dataclasses.replace(self, records=[self.records[i] for i in keep])


def gather(
    problem: Problem,
    theta: np.ndarray,
    free: tuple[int, ...],
    forcing: Callable[[Record], np.ndarray] | None = None,
) -> np.ndarray:
    """Returns every flight's information at theta, (flights, m + 1, m + 1).

    A prior counts as one flight more.
    """

    def one(i: int) -> np.ndarray:
        record = problem.records[i]
        errors = linearize(
            record,
            theta,
            free,
            problem.noise,
            field=problem.field,
            nodes=_rollout(problem, record, theta) if problem.is_exact else None,
            forcing=None if forcing is None else forcing(record),
            trim_is_known=problem.trim_is_known,
        )
        return eliminate_start(errors)

    information = in_parallel(one, range(len(problem.records)))
    if problem.prior is not None:
        information.append(_prior_information(problem.prior, theta, free, information))
    return np.stack(information)


def _rollout(problem: Problem, record: Record, theta: np.ndarray) -> np.ndarray:
    start = fit_start(
        record, theta, problem.noise, problem.field, problem.trim_is_known
    )
    return fly(record, theta, start, problem.field)


def _prior_information(
    prior: tuple[np.ndarray, np.ndarray],
    theta: np.ndarray,
    free: tuple[int, ...],
    information: list[np.ndarray],
) -> np.ndarray:
    mean, spread = (values[list(free)] for values in prior)
    columns = np.zeros((len(free), information[0].shape[0]))
    columns[:, : len(free)] = np.diag(1.0 / spread)
    columns[:, -1] = (mean - theta[list(free)]) / spread
    return columns.T @ columns


def degrees_of_freedom(problem: Problem) -> np.ndarray:
    """Returns measurements less launch states, of each flight."""
    channels = np.array([3 + r.has_servo for r in problem.records])
    rows = np.array([len(r.time) for r in problem.records])
    per_flight = np.array(
        [6 + (r.has_servo or not problem.trim_is_known) for r in problem.records]
    )
    return channels * rows - per_flight


def fit(
    problem: Problem,
    theta: np.ndarray,
    free: tuple[int, ...],
    *,
    iterations: int = 12,
    tolerance: float = 0.02,
) -> Fit:
    """Fits theta[free] by Gauss-Newton, damped where a step fails.

    Args:
        problem: the flights.
        theta: where to start.
        free: indices into theta, signals last.
        iterations: at most.
        tolerance: stop when the cost would fall by less than this.
    """
    free = tuple(sorted(free))
    index = list(free)
    lower, upper = theta_lower()[index], theta_upper()[index]
    ridge = 1e-6 / theta_scale()[index] ** 2
    theta = theta.copy()
    information = gather(problem, theta, free)
    damping = 0.0
    for _ in range(iterations if free else 0):
        total = information.sum(axis=0)
        step = bounded_step(
            total, ridge, damping, lower - theta[index], upper - theta[index]
        )
        if total[-1, -1] - cost(total, step) < tolerance:
            break
        trial = theta.copy()
        trial[index] = np.clip(theta[index] + step, lower, upper)
        moved = gather(problem, trial, free)
        gained = total[-1, -1] - moved[:, -1, -1].sum()
        if not gained > 0.0:
            if damping > 1e3:
                break
            damping = max(10.0 * damping, 1e-2)
            continue
        theta, information = trial, moved
        damping = 0.0 if damping < 1e-3 else 0.1 * damping
        if gained < tolerance:
            break
    return Fit(
        theta=theta,
        free=free,
        information=information,
        degrees=degrees_of_freedom(problem),
    )


def covariance(result: Fit) -> np.ndarray:
    """Returns the covariance of the fitted coefficients, (m, m).

    The larger of the classical one, scaled by the dispersion, and the sandwich
    estimate whose meat is the flights' scores: that one stays honest when errors
    within a flight are correlated.
    """
    m = len(result.free)
    total = result.information.sum(axis=0)[:m, :m]
    scale = 1.0 / np.sqrt(np.maximum(np.diag(total), 1e-300))
    inverse = np.linalg.inv(total * scale[:, None] * scale + 1e-12 * np.eye(m))
    inverse = inverse * scale[:, None] * scale
    scores = result.information[:, :m, m]
    flights = len(scores)
    meat = scores.T @ scores * (flights / max(flights - 1.0, 1.0))
    sandwich = inverse @ meat @ inverse
    classical = inverse * max(1.0, result.dispersion)
    larger = np.diag(sandwich) > np.diag(classical)
    grow = np.sqrt(np.where(larger, np.diag(sandwich) / np.diag(classical), 1.0))
    return classical * grow[:, None] * grow


def held_out_costs(
    information: np.ndarray, ridge: np.ndarray | float = 0.0
) -> np.ndarray:
    """Returns each flight's cost at the coefficients that the others give.

    Leave one flight out: δθ is refitted without flight i, then flight i, with
    its own launch state, is scored. Shape (flights,).
    """
    total = information.sum(axis=0)
    return np.array([cost(own, solve(total - own, ridge)) for own in information])
