"""Standard errors of a model, with allowance for errors of its formulas."""

import dataclasses

import numpy as np

from glider.sysid.likelihood import model_fit
from glider.sysid.likelihood.candidates import Candidates, saturated_scales
from glider.sysid.likelihood.information import counted_from, covariance, eliminate
from glider.sysid.likelihood.linear_flight import slopes
from glider.sysid.likelihood.task import Task

ALLOWED = 4.5  # Evidence that the curves' strength may cost [nats]: three deviations.
STRENGTHS_ASKED = np.geomspace(0.003, model_fit.STRENGTH_RANGE[1], 60)  # None to most.


@dataclasses.dataclass(frozen=True, kw_only=True)
class Uncertainty:
    """Covariance of a model's free parameters and blocks over flights."""

    free: tuple[int, ...]  #: Slots of theta, then the blocks' coordinates follow.
    covariance: np.ndarray  #: (m + q, m + q).
    places: dict[str, range]  #: Name of a block to its rows of the covariance.

    def std(self, slot: int) -> float:
        """Returns the standard error of a slot of theta; NaN where it is not free."""
        if slot not in self.free:
            return float("nan")
        k = self.free.index(slot)
        return float(np.sqrt(self.covariance[k, k]))


def uncertainty_of(task: Task, model: model_fit.FitResult) -> Uncertainty:
    """Returns the covariance of a model's parameters, see `information.covariance`."""
    grams = model_fit.grams_of(model_fit.linear_flights(task, model), model.scales)
    precision = model_fit.prior_of(task, model).precision
    known = covariance(grams, precision)
    return Uncertainty(free=model.free, covariance=known, places=model.places())


def with_allowed_curves(task: Task, model: model_fit.FitResult) -> model_fit.FitResult:
    """Returns a model with the strongest prior of curves that its flights allow.

    Curves over the angle of attack that the flights cannot show may have biased the
    coefficients: standard errors are computed with such curves beside the formulas.

    The strength s is the largest whose evidence, the coefficients integrated out, is
    at most ALLOWED below the best, where curves are not mistaken for moving air: with
    eigenvalues λ of the curves' information, and g of the error along them,

        log p(s) = ½ Σ g² / (λ + s⁻²) - ½ Σ log(1 + s² λ).
    """
    if model.has_force_errors:  # They allow for any shape already.
        return model
    bent = model.with_curves(task.curves, 1.0)
    columns = Candidates(
        task=task,
        model=bent,
        directions=tuple(slopes(task.layout, model.theta, model.free)),
        variants={},
        flights=model_fit.linear_flights(task, bent),
        columns=(),
    )
    scales = saturated_scales(columns, model.scales, 2)
    prior, first = model_fit.prior_of(task, bent), len(model.free)
    own = np.zeros(len(prior.mean))
    curves = range(first, first + task.curves.count)
    own[curves] = bent.coordinates[: task.curves.count]
    known = [j for j in range(len(own)) if j not in curves]
    reduced = eliminate(
        counted_from(columns.grams(scales).sum(axis=0), own),
        known,
        prior.precision[known],
        prior.mean[known],
    )
    values, axes = np.linalg.eigh(reduced[:-1, :-1])
    values, error = np.maximum(values, 0.0), axes.T @ reduced[:-1, -1]
    squares = np.square(STRENGTHS_ASKED)[:, None]
    evidence = 0.5 * np.sum(
        error**2 / (values + 1.0 / squares) - np.log1p(squares * values), axis=1
    )
    allowed = STRENGTHS_ASKED[evidence >= evidence.max() - ALLOWED]
    return bent.with_curves(task.curves, float(allowed.max()))
