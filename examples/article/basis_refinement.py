"""Refinement of a model from the least equation error to the least simulation error.

The article's BPTT/RTRL step for the basis model. The sensitivities of the flights'
states to the coefficients are carried forward with the states (real-time recurrent
learning), here as the imaginary parts of complex steps, which are exact to rounding.
"""

import dataclasses
from collections.abc import Sequence

import numpy as np
from scipy.optimize import least_squares as minimize_squares
from threadpoolctl import threadpool_limits

from basis_dynamics import BasisDynamics, SampledFlights, basis_rollouts
from glider.compiled.runge_kutta import TINY
from glider.errors import InputError

SCALES = (0.1, 0.1, 0.1, np.inf, 0.5, 0.5, 1.0)
"""Scales of the states' errors of equal weight [m, rad, m/s, rad/s]. The elevator's
angle is no model's merit: it is the sum of its rates."""

LARGEST_ERROR = 100.0
"""Error that no flight reaches [m, rad, m/s, rad/s]: a model that does has diverged."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class RolloutError:
    """Errors of a model's rollouts against flights, launch states given.

    Attributes:
        weighted: RMS of the states' errors over SCALES [-].
        position_m: RMS distance of x and z.
        pitch_rad: RMS.
    """

    weighted: float
    position_m: float
    pitch_rad: float


def rollout_error(
    model: BasisDynamics, flights: SampledFlights, scales: Sequence[float] = SCALES
) -> RolloutError:
    """Flies a model from the flights' launches under their rates.

    Infinite where the model diverges, beyond LARGEST_ERROR.
    """
    with np.errstate(all="ignore"):
        error = _errors(model, flights, model.coefficients)
        squares = np.where(np.abs(error) < LARGEST_ERROR, error, np.inf) ** 2
        weighted = np.sum(squares / np.square(scales), axis=-1, where=_counts(scales))
        return RolloutError(
            weighted=float(np.sqrt(np.mean(weighted))),
            position_m=float(np.sqrt(np.mean(squares[..., 0] + squares[..., 1]))),
            pitch_rad=float(np.sqrt(np.mean(squares[..., 2]))),
        )


def refine(
    model: BasisDynamics,
    flights: SampledFlights,
    scales: Sequence[float] = SCALES,
    evaluations: int = 50,
) -> BasisDynamics:
    """Returns the model with the coefficients that fly closest to flights.

    Minimizes Σ ((x_sim - x_data) / scale)² over all steps of all flights, from the
    model's own coefficients, by Gauss-Newton steps in a trust region.

    Args:
        model: where to start, as `fit_basis` leaves it.
        flights: to fit.
        scales: (7,) of the states' errors; infinite for no weight.
        evaluations: of all flights, at most.

    Raises:
        InputError: the model to start from diverges.
    """
    counts, weights = _counts(scales), 1.0 / np.asarray(scales)
    size = np.where(model.coefficients == 0.0, 1.0, np.abs(model.coefficients))

    def errors(share: np.ndarray) -> np.ndarray:
        with np.errstate(all="ignore"):
            error = _errors(model, flights, size * share) * weights
            return error[..., counts].ravel()

    def slopes(share: np.ndarray) -> np.ndarray:
        steps = np.diag(1j * TINY * size)
        flown = _errors(model, flights, size * share + steps).imag / TINY
        return (flown * weights)[..., counts].reshape(len(share), -1).T

    start = model.coefficients / size
    if not np.all(np.isfinite(errors(start))):
        raise InputError(
            "refine: the model diverges along the flights; expected one that flies to "
            "their end."
        )
    with threadpool_limits(limits=1, user_api="blas"):  # Small matrices.
        found = minimize_squares(
            errors, start, jac=slopes, x_scale="jac", max_nfev=evaluations
        )
    return dataclasses.replace(model, coefficients=size * found.x)


def _counts(scales: Sequence[float]) -> np.ndarray:
    return np.isfinite(scales)


def _errors(
    model: BasisDynamics, flights: SampledFlights, coefficients: np.ndarray
) -> np.ndarray:
    start = flights.states[:, 0]
    flown = basis_rollouts(model, start, flights.rates, flights.step, coefficients)
    return flown - flights.states
