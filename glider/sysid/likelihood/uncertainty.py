"""Standard errors of a model, with allowance for errors of its formulas."""

import dataclasses

import numpy as np

from glider.sysid.likelihood import model_fit
from glider.sysid.likelihood.candidates import Candidates, saturated_scales
from glider.sysid.likelihood.directions import slopes
from glider.sysid.likelihood.information import covariance, eliminate
from glider.sysid.likelihood.task import Task


@dataclasses.dataclass(frozen=True, kw_only=True)
class Uncertainty:
    """Covariance of a model's free parameters and curves over flights."""

    free: tuple[int, ...]  # Slots of theta, then the curves' coordinates follow.
    covariance: np.ndarray  # (m + q, m + q).
    flights: np.ndarray  # (flights, m + q + 1, m + q + 1) information of each.

    def std(self, slot: int) -> float:
        """Returns the standard error of a slot of theta; NaN where it is not free."""
        if slot not in self.free:
            return float("nan")
        k = self.free.index(slot)
        return float(np.sqrt(self.covariance[k, k]))


def uncertainty_of(task: Task, model: model_fit.FitResult) -> Uncertainty:
    """Returns the covariance of a model's parameters.

    The larger of that of the likelihood and that of the jackknife over flights, see
    `glider.sysid.likelihood.information.covariance`.
    """
    directions = slopes(task.layout, model.theta, model.free)
    flights = model_fit.linear_flights(task, model, directions)
    grams = np.stack(model_fit.grams_of(flights, model.scales))
    _, _, precision = model_fit.prior_of(task, model, model.free)
    return Uncertainty(
        free=model.free, covariance=covariance(grams, precision), flights=grams
    )


def with_allowed_curves(task: Task, model: model_fit.FitResult) -> model_fit.FitResult:
    """Returns a model with the strongest prior of curves that its flights allow.

    No glider follows formulas exactly. Curves over the angle of attack that the flights
    cannot show may have biased the coefficients: standard errors are computed with such
    curves beside the formulas. The more the flights determine, the less they allow.

    The strength s is the largest whose evidence, the coefficients integrated out, is
    at most ALLOWED below the best, where curves are not mistaken for moving air: with
    eigenvalues λ of the curves' information, and g of the error along them,

        log p(s) = ½ Σ g² / (λ + s⁻²) - ½ Σ log(1 + s² λ).
    """
    if model.has_force_errors:  # They allow for any shape already.
        return model
    coordinates = model.coordinates if model.has_curves else np.zeros(task.curves.count)
    bent = dataclasses.replace(model, coordinates=coordinates, strength=1.0)
    index = list(model.free)
    directions = slopes(task.layout, model.theta, index)
    columns = Candidates(
        task=task,
        model=bent,
        directions=tuple(directions),
        variants={},
        flights=model_fit.linear_flights(task, bent, directions),
    )
    scales, _ = saturated_scales(columns, model.scales, 2)
    gram = columns.grams(scales).sum(axis=0)
    known = slice(0, len(index))
    own, mean, precision = model_fit.prior_of(task, bent, index)
    change = (mean - own)[known]
    reduced = eliminate(gram, range(len(index)), precision[known], change)
    information = reduced[:-1, :-1]
    error = reduced[:-1, -1] + information @ coordinates
    values, axes = np.linalg.eigh(information)
    values, error = np.maximum(values, 0.0), axes.T @ error
    squares = np.square(STRENGTHS_ASKED)[:, None]
    evidence = 0.5 * np.sum(
        error**2 / (values + 1.0 / squares) - np.log1p(squares * values), axis=1
    )
    allowed = STRENGTHS_ASKED[evidence >= evidence.max() - ALLOWED]
    return dataclasses.replace(bent, strength=float(allowed.max()))


ALLOWED = 4.5
"""Evidence that the curves' strength may cost [nats]: three standard deviations."""

STRENGTHS_ASKED = np.geomspace(0.003, model_fit.STRENGTH_RANGE[1], 60)
"""Strengths of curves that are tried; no sensor detects the least."""
