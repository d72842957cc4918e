"""What the Taylor polynomial leaves out, as a bounded disturbance.

Only the accelerations are not linear in the state. Where |R_k| <= β_k on the set,
    2 zᵀ Lᵀ R <= zᵀ D z,  D = Σ_k λ_k (Lᵀ e_k)(Lᵀ e_k)ᵀ + β_k² / λ_k I,  any λ_k > 0,
on its boundary.
"""

import numpy as np

from glider.verification.error_dynamics import closed_loop_rates, evaluate
from glider.verification.forms import to_ball
from glider.verification.nominal import Nominal

SAMPLES = 1000
"""Directions in which the remainder is sampled; the same at all times."""


def sample_remainder(
    nominal: Nominal,
    coefficients: np.ndarray,
    S: np.ndarray,
    directions: np.ndarray,
    at: np.ndarray,
) -> np.ndarray:
    """Returns the largest |R_k| seen on the boundary of the set, (len(at), n).

    Args:
        nominal: the flight.
        coefficients: (T, n, M) of `expand`.
        S: (len(at), n, n) the sets.
        directions: (B, n) points of the unit sphere; their negatives are used too.
        at: indices of the times.
    """
    both = np.concatenate([directions, -directions])
    found = []
    for k, matrix in zip(at, S, strict=True):
        errors = both @ to_ball(matrix)[1].T
        true = rates_of(nominal, k, errors)
        found.append(np.abs(true - evaluate(coefficients[k], errors)).max(axis=0))
    return np.array(found)


def rates_of(nominal: Nominal, k: int, errors: np.ndarray) -> np.ndarray:
    """Returns the true ė (B, n) of deviations (B, n) at a time, without limits."""
    states = np.vstack([np.zeros((1, errors.shape[1])), errors]) + nominal.states[k]
    rates = closed_loop_rates(
        nominal.model,
        list(states.T),
        nominal.gains[k],
        nominal.states[k],
        nominal.inputs[k],
    )
    full = np.array([np.broadcast_to(rate, len(states)) for rate in rates])
    return (full[:, 1:] - full[:, :1]).T


def remainder_weights(S: np.ndarray, beta: np.ndarray, sizes: np.ndarray) -> np.ndarray:
    """Returns λ (T, n) that add little growth where states have these sizes.

    Args:
        S: (T, n, n).
        beta: (T, n).
        sizes: (n,) typical deviations.
    """
    upper, _ = to_ball(S)
    weight = upper @ np.diag(sizes**2) @ np.swapaxes(upper, 1, 2)
    pull = np.einsum("tik,tij,tjk->tk", upper, weight, upper)
    return beta * np.sqrt(np.einsum("tii->t", weight)[:, None] / pull)


def remainder_form(S: np.ndarray, beta: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Returns D (T, n, n) in the coordinates of the ball; λ_k = 0 with β_k = 0."""
    upper, _ = to_ball(S)
    n = S.shape[-1]
    ball = np.divide(beta**2, weights, out=np.zeros_like(beta), where=weights > 0.0)
    along = np.einsum("tik,tk,tjk->tij", upper, weights, upper)
    return along + ball.sum(axis=1)[:, None, None] * np.eye(n)
