"""Standard errors of a model's coefficients.

`uncertainty_of` computes them by the likelihood, whose inverse information is a
covariance where the model is right, and by the jackknife over flights, which holds
where it is not. `larger_of` joins the two. `averaged` adds what the choice between
rival models leaves open.
"""

import dataclasses
import functools
from collections.abc import Sequence

import numpy as np

from glider.sysid.constants import Z
from glider.sysid.likelihood.information import solve_scaled
from glider.sysid.likelihood.model_fit import grams_of, linear_flights, prior_of
from glider.sysid.likelihood.task import FitResult, Task

_LEAST_SHARE = 1e-3  # Of a covariance that flights show: less is as good as none.


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class Uncertainty:
    """Errors of a model's free parameters and functions, by its flights.

    Their covariance is the larger of the likelihood's and that of the jackknife over
    flights, which holds where errors within a flight are correlated or coefficients
    vary from flight to flight (MacKinnon and White, Journal of Econometrics 29, 1985).

    Attributes:
        free: m slots of theta, the first columns; q coordinates of functions follow.
        named: the slots of effects and of unknown parameters among them.
        likelihood: (m + q, m + q) inverse of the information.
        places: name of a function to its columns.
        changes: (flights, m + q); their squares sum to the jackknife's covariance.
        average: covariance of the named slots over rival models, if there are any.
    """

    free: tuple[int, ...]
    named: tuple[int, ...]
    likelihood: np.ndarray
    places: dict[str, range]
    changes: np.ndarray
    average: np.ndarray | None = None

    def of(self, places: Sequence[int]) -> tuple[np.ndarray, float]:
        """Returns the covariance of some columns and its degrees of freedom."""
        likelihood = self.likelihood[np.ix_(places, places)]
        return larger_of(likelihood, self.changes[:, places])

    @functools.cached_property
    def covariance(self) -> tuple[np.ndarray, float]:
        """Covariance of the named slots and its degrees of freedom.

        It is that of `of`, or of `averaged` where there are rivals.
        """
        matrix, freedom = self.of([self.free.index(slot) for slot in self.named])
        return matrix if self.average is None else self.average, freedom

    def std(self, slot: int) -> float:
        """Returns the standard error of a free slot of theta; NaN of another."""
        if slot not in self.free:
            return float("nan")
        if slot in self.named:
            matrix, _ = self.covariance
            k = self.named.index(slot)
        else:
            matrix, _ = self.of([self.free.index(slot)])
            k = 0
        return float(np.sqrt(matrix[k, k]))


def uncertainty_of(task: Task, model: FitResult) -> Uncertainty:
    """Returns the errors of a model's parameters and functions.

    The flights are linearized about the model once more.
    """
    flights = linear_flights(task, model)
    grams = grams_of(flights, model.scales)
    likelihood, changes = jackknife(grams, prior_of(task, model).precision)

    named = set(task.vehicle.unknown)
    for kind in model.kinds:
        named.update(task.space.slots_of(kind))

    return Uncertainty(
        free=model.free,
        named=tuple(slot for slot in model.free if slot in named),
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

    With probabilities p, covariances C and differences d from the first model's theta,
    the covariance is Σ p (C + d d'): an effect that a model lacks differs by all of its
    size. C holds if that model is right.

    Args:
        probabilities: of each model.
        models: the one first that is reported.
        known: errors of each model.
    """
    first = models[0].theta
    total = np.zeros(2 * first.shape)
    for probability, model, own in zip(probabilities, models, known, strict=True):
        change = model.theta - first
        spread = np.outer(change, change)
        spread[np.ix_(own.named, own.named)] += own.covariance[0]
        total += probability * spread

    slots = known[0].named
    return dataclasses.replace(known[0], average=total[np.ix_(slots, slots)])


def jackknife(
    grams: np.ndarray, precision: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Returns two estimates of the errors of coefficients that flights determine.

    Where a flight alone shows a coefficient, the change without it is one of the
    linearization: it is cut at `Z` standard deviations of the prior.

    Args:
        grams: the flights' information, (flights, m + 1, m + 1).
        precision: (m,) of the prior.

    Returns:
        the inverse of all flights' information and the prior's, (m, m); and the changes
        of the coefficients without each flight, (flights, m), scaled so that their
        squares sum to the jackknife's covariance.
    """
    flights = len(grams)
    m = len(precision)
    hessians = grams[:, :m, :m]
    total = hessians.sum(axis=0) + np.diag(precision)
    covariance = solve_scaled(total, np.eye(m), 1e-12)
    symmetric = 0.5 * (covariance + covariance.T)

    # About the fit to all flights, that without a flight is one Newton step away.
    changes = solve_scaled(total - hessians, grams[:, :m, m], 1e-12)
    beyond = np.sqrt(changes**2 @ precision) / Z
    changes /= np.maximum(beyond, 1.0)[:, None]
    return symmetric, changes * np.sqrt((flights - 1.0) / flights)


def larger_of(likelihood: np.ndarray, changes: np.ndarray) -> tuple[np.ndarray, float]:
    """Returns the larger of two covariances, as matrices, and its degrees of freedom.

    In axes where the likelihood's is one, eigenvalues of the jackknife's are at least
    one. Only the share that it adds is estimated from flights, of which those that
    change most count for fewer: with squares s of a flight's changes in units of the
    covariance, (1 + 2/r) (Σ s)² / Σ s² flights of normal changes do as well.

    Args:
        likelihood: the likelihood's covariance, (r, r).
        changes: those of `jackknife`, (flights, r).
    """
    flights, r = changes.shape
    if not np.isfinite(np.sum(likelihood) + np.sum(changes)):  # The model diverges.
        return np.full((r, r), np.nan), np.inf

    # A root of the likelihood's covariance: in its axes that is the unit matrix.
    size = np.sqrt(np.diag(likelihood))
    values, axes = np.linalg.eigh(likelihood / size[:, None] / size)
    root = axes * np.sqrt(np.maximum(values, 1e-12))

    # The jackknife's covariance in these axes, none of it less than one.
    in_axes = np.linalg.solve(root, (changes / size).T)
    values, axes = np.linalg.eigh(in_axes @ in_axes.T)
    larger = np.maximum(values, 1.0)
    root = size[:, None] * (root @ axes) * np.sqrt(larger)

    # How many flights of normal changes would determine it as well.
    squares = np.sum((axes.T @ in_axes) ** 2 / larger[:, None], axis=0)
    sum_of_squares = max(float(np.sum(squares**2)), 1e-300)
    effective = (1.0 + 2.0 / max(r, 1)) * float(np.sum(squares)) ** 2 / sum_of_squares

    # Only the jackknife's share of the larger covariance is uncertain by them.
    share = float(np.sum(larger - 1.0) / max(np.sum(larger), 1e-300))
    freedom = max(min(effective, flights) - 1.0, r) / max(share, _LEAST_SHARE)
    return root @ root.T, freedom
