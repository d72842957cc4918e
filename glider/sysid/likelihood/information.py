"""The information that flights hold on coefficients, as one small matrix a flight.

A flight's errors are linear in its launch state and in the coefficients. With the
launch state eliminated, their squares are a quadratic form [δθ; -1]' R [δθ; -1];
R is the flight's information. Sums, steps, cross-validation and standard errors
over flights need no more than these matrices.
"""

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from glider.sysid.replay.sensitivity import (
    DIVERGED,
    Linearized,
)


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


def moved(information: np.ndarray, step: np.ndarray) -> np.ndarray:
    """Returns the information at coefficients that are a step away."""
    m = len(step)
    change = np.eye(m + 1)
    change[:m, m] = -step
    return change.T @ information @ change


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


def held_out_costs(
    information: np.ndarray, ridge: np.ndarray | float = 0.0
) -> np.ndarray:
    """Returns each flight's cost at the coefficients that the others give.

    Leave one flight out: δθ is refitted without flight i, then flight i, with
    its own launch state, is scored. Shape (flights,).
    """
    total = information.sum(axis=0)
    return np.array([cost(own, solve(total - own, ridge)) for own in information])
