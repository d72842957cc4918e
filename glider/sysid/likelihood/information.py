"""The information that flights hold on coefficients, as one small matrix a flight.

A flight's errors are linear in its launch state and in the coefficients. With the
launch state eliminated, their squares are a quadratic form [δθ; -1]' R [δθ; -1];
R is the flight's information. Sums, steps, cross-validation and standard errors
over flights need no more than these matrices.
"""

import numpy as np


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

    The larger of the classical one, scaled by the dispersion, and the sandwich
    estimate whose meat is the flights' scores: that one stays honest when errors
    within a flight are correlated.

    Args:
        information: (flights, m + 1, m + 1) at the coefficients.
        dispersion: mean squared error over noise variance.
        ridge: as in `solve`.
    """
    m = information.shape[1] - 1
    total = information.sum(axis=0)[:m, :m] + np.diag(np.broadcast_to(ridge, m))
    scale = 1.0 / np.sqrt(np.maximum(np.diag(total), 1e-300))
    inverse = np.linalg.inv(total * scale[:, None] * scale + 1e-12 * np.eye(m))
    inverse = inverse * scale[:, None] * scale
    scores = information[:, :m, m]
    flights = len(scores)
    meat = scores.T @ scores * (flights / max(flights - 1.0, 1.0))
    sandwich = inverse @ meat @ inverse
    classical = inverse * max(1.0, dispersion)
    larger = np.diag(sandwich) > np.diag(classical)
    grow = np.sqrt(np.where(larger, np.diag(sandwich) / np.diag(classical), 1.0))
    return classical * grow[:, None] * grow
