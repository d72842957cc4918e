"""The information that flights hold on coefficients, as one small matrix a flight.

A flight's errors are linear in its launch state and in the coefficients. With the
launch state eliminated, their squares are a quadratic form [δθ; -1]' R [δθ; -1];
R is the flight's information. Sums, steps, cross-validation and standard errors
over flights need no more than these matrices.
"""

import numpy as np
from scipy.special import ndtri, stdtrit  # scipy.stats takes 0.4 s to import.


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


def covariance(
    information: np.ndarray, dispersion: float, ridge: np.ndarray | float = 0.0
) -> np.ndarray:
    """Returns the covariance of coefficients fitted to flights, (m, m).

    The larger of the classical one, scaled by the dispersion, and the jackknife over
    flights: that one stays honest when errors within a flight are correlated, and
    where flights are few for the coefficients (MacKinnon and White, Journal of
    Econometrics 29, 1985), widened as Student's t of so few asks: 1.96 standard errors
    are to hold 95 %. Everything being linear, each flight is left out exactly.

    Args:
        information: (flights, m + 1, m + 1) at the coefficients.
        dispersion: mean squared error over noise variance.
        ridge: as in `solve`.
    """
    m = information.shape[1] - 1
    hessians = information[:, :m, :m]
    total = hessians.sum(axis=0) + np.diag(np.broadcast_to(ridge, m))
    scale = 1.0 / np.sqrt(np.maximum(np.diag(total), 1e-300))
    square = scale[:, None] * scale
    least = 1e-12 * np.eye(m)
    classical = np.linalg.inv(total * square + least) * square * max(1.0, dispersion)
    flights = len(information)
    scores = scale * information[:, :m, m]
    others = (total - hessians) * square + least
    changes = scale * np.linalg.solve(others, scores[:, :, None])[:, :, 0]
    jackknife = np.square(changes).sum(axis=0) * (flights - 1.0) / max(flights, 1.0)
    if flights > 1:
        jackknife *= (stdtrit(flights - 1, 0.975) / ndtri(0.975)) ** 2
    grow = np.sqrt(np.maximum(jackknife / np.diag(classical), 1.0))
    return classical * grow[:, None] * grow
