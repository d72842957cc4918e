"""Standard errors of a model."""

import dataclasses
import functools
from collections.abc import Sequence

import numpy as np

from glider.sysid.constants import Z
from glider.sysid.likelihood import model_fit
from glider.sysid.likelihood.information import solve_scaled
from glider.sysid.likelihood.task import FitResult, Task

_LEAST_SHARE = 1e-3  # Of a covariance that flights show: less is as good as none.


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class Uncertainty:
    """Errors of a model's free parameters and functions, by its flights.

    Their covariance is the larger of the likelihood's and that of the jackknife over
    flights, which holds where errors within a flight are correlated or coefficients
    vary from flight to flight (MacKinnon and White, Journal of Econometrics 29, 1985).
    """

    free: tuple[int, ...]  #: Slots of theta, then the functions' coordinates follow.
    named: tuple[int, ...]  #: Those of effects and of unknown parameters.
    likelihood: np.ndarray  #: (m + q, m + q) inverse of the information.
    places: dict[str, range]  #: Name of a function to its columns.
    changes: np.ndarray  #: (flights, m + q) their squares sum to the jackknife's.
    average: np.ndarray | None = None  #: Covariance of the named slots over rivals.

    def of(self, places: Sequence[int]) -> tuple[np.ndarray, float]:
        """Returns the covariance of some columns and its degrees of freedom."""
        likelihood = self.likelihood[np.ix_(places, places)]
        return larger_of(likelihood, self.changes[:, places])

    @functools.cached_property
    def covariance(self) -> tuple[np.ndarray, float]:
        """Of the named slots, see `of`; with rivals where these are averaged."""
        matrix, freedom = self.of([self.free.index(slot) for slot in self.named])
        return matrix if self.average is None else self.average, freedom

    def std(self, slot: int) -> float:
        """Returns the standard error of a free slot of theta; NaN of another."""
        if slot in self.named:
            k = self.named.index(slot)
            return float(np.sqrt(self.covariance[0][k, k]))

        if slot not in self.free:
            return float("nan")
        return float(np.sqrt(self.of([self.free.index(slot)])[0][0, 0]))


def uncertainty_of(task: Task, model: FitResult) -> Uncertainty:
    """Returns the errors of a model's parameters."""
    grams = model_fit.grams_of(model_fit.linear_flights(task, model), model.scales)
    mine = {i for kind in model.kinds for i in task.space.slots_of(kind)}
    mine |= set(task.vehicle.unknown)
    likelihood, changes = jackknife(grams, model_fit.prior_of(task, model).precision)
    return Uncertainty(
        free=model.free,
        named=tuple(slot for slot in model.free if slot in mine),
        places=model.places(),
        likelihood=likelihood,
        changes=changes,
    )


def averaged(
    probabilities: Sequence[float],
    models: Sequence[FitResult],
    known: Sequence[Uncertainty],
) -> Uncertainty:
    """Returns the errors of the first of models that may be right, averaged over all.

    The mean of their covariances and of the squares of what they differ by: where an
    effect is absent, by all of its size. Errors of each hold if it is right.
    """
    first = models[0].theta
    total = np.zeros(2 * models[0].theta.shape)
    for probability, model, own in zip(probabilities, models, known, strict=True):
        change = model.theta - first
        named = list(own.named)
        spread = np.outer(change, change)
        spread[np.ix_(named, named)] += own.covariance[0]
        total += probability * spread

    slots = list(known[0].named)
    return dataclasses.replace(known[0], average=total[np.ix_(slots, slots)])


def jackknife(
    grams: np.ndarray, precision: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Returns the inverse of flights' information and a prior's, and scaled changes.

    Their squares sum to the jackknife's covariance. Where a flight alone shows a
    coefficient, the change without it is one of the linearization: it is cut at `Z`
    standard deviations of the prior.
    """
    flights = len(grams)
    m = grams.shape[1] - 1
    hessians = grams[:, :m, :m]
    total = hessians.sum(axis=0) + np.diag(precision)
    covariance = solve_scaled(total, np.eye(m), 1e-12)
    changes = solve_scaled(total - hessians, grams[:, :m, m], 1e-12)
    beyond = np.sqrt(changes**2 @ precision) / Z
    changes /= np.maximum(beyond, 1.0)[:, None]
    symmetric = 0.5 * (covariance + covariance.T)
    return symmetric, changes * np.sqrt((flights - 1.0) / flights)


def larger_of(likelihood: np.ndarray, changes: np.ndarray) -> tuple[np.ndarray, float]:
    """Returns the larger of two covariances (r, r), as matrices, and its freedom.

    In axes where the likelihood's is one, eigenvalues of the jackknife's are at least
    one. Only the share that it adds is estimated from flights, of which those that
    change most count for fewer: with squares s of a flight's changes in units of the
    covariance, (1 + 2/r) (Σ s)² / Σ s² flights of normal changes do as well.
    """
    flights, r = changes.shape
    if not np.isfinite(np.sum(likelihood) + np.sum(changes)):  # The model diverges.
        return np.full((r, r), np.nan), np.inf
    # The jackknife's covariance in the axes where the likelihood's is one.
    size = np.sqrt(np.diag(likelihood))
    values, axes = np.linalg.eigh(likelihood / size[:, None] / size)
    root = axes * np.sqrt(np.maximum(values, 1e-12))
    in_axes = np.linalg.solve(root, (changes / size).T)
    values, axes = np.linalg.eigh(in_axes @ in_axes.T)
    larger = np.maximum(values, 1.0)
    # The larger one's root, and how many flights its own share is estimated from.
    root = size[:, None] * (root @ axes) * np.sqrt(larger)
    squares = np.sum((axes.T @ in_axes) ** 2 / larger[:, None], axis=0)
    total = max(float(np.sum(squares**2)), 1e-300)
    effective = (1.0 + 2.0 / max(r, 1)) * float(np.sum(squares)) ** 2 / total
    share = float(np.sum(larger - 1.0) / max(np.sum(larger), 1e-300))
    freedom = max(min(effective, flights) - 1.0, r) / max(share, _LEAST_SHARE)
    return root @ root.T, freedom
