"""The joint output-error fit of coefficients and launch states over whole flights.

This is the article's simulation-error refinement (its BPTT/RTRL step), as a
Gauss-Newton method in the lifted (multiple-shooting) form of
`sysid.replay.sensitivity`. Launch states are eliminated flight by flight, so a fit
deals with one small matrix a flight: the information that the flight holds on
the coefficients. Sums, cross-validation and standard errors over flights are
then sums over these matrices.
"""

import dataclasses
import os
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np

from glider.sysid.likelihood.information import (
    bounded_step,
    cost,
    covariance,
    eliminate_start,
)
from glider.sysid.replay.problem import Problem
from glider.sysid.replay.record import Record
from glider.sysid.replay.sensitivity import linearize
from glider.sysid.replay.shooting import (
    fit_start,
    fly_record,
)

_POOL = ThreadPoolExecutor(max_workers=os.cpu_count())


def in_parallel(function: Callable[[Any], Any], items: Iterable) -> list:
    """Returns function(item) for each; the compiled loops release Python's lock."""
    return list(_POOL.map(function, items))


@dataclasses.dataclass(frozen=True, kw_only=True)
class Fit:
    """Coefficients found by rollout.

    Attributes:
        theta: the model found, as the layout has it.
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
            problem,
            record,
            theta,
            free,
            nodes=_rollout(problem, record, theta) if problem.is_exact else None,
            forcing=None if forcing is None else forcing(record),
        )
        return eliminate_start(errors)

    information = in_parallel(one, range(len(problem.records)))
    if problem.prior is not None:
        information.append(_prior_information(problem.prior, theta, free, information))
    return np.stack(information)


def _rollout(problem: Problem, record: Record, theta: np.ndarray) -> np.ndarray:
    return fly_record(problem, record, theta, fit_start(problem, record, theta))


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
    layout = problem.layout
    lower, upper = layout.lower[index], layout.upper[index]
    ridge = 1e-6 / layout.scale[index] ** 2
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


def fit_covariance(result: Fit) -> np.ndarray:
    """Returns the covariance of the fitted coefficients, (m, m)."""
    return covariance(result.information, result.dispersion)
