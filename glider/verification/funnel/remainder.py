"""The Taylor remainder R, as a bounded disturbance.

Only the accelerations are not linear in the state. Where |R_k| <= β_k on the set,
    2 zᵀ Lᵀ R <= zᵀ D z,  D = Σ_k λ_k (Lᵀ e_k)(Lᵀ e_k)ᵀ + β_k² / λ_k I,  any λ_k > 0,
on its boundary. Here the largest |R_k| is looked for;
`glider.verification.proof` proves a bound.
"""

import numpy as np

from glider.verification.dynamics.error_dynamics import (
    closed_loop_rates,
    evaluate,
    nonlinear_parts,
)
from glider.verification.dynamics.nominal import Nominal
from glider.verification.funnel.ascent import climb_sphere
from glider.verification.sos.forms import to_ball

SAMPLES = 500
"""Directions in which the remainder is sampled; the same at all times."""

CLIMBS = 4
"""Climbs for each rate and sign, each from the best of its share of the directions: R
has several hills."""

LEAST_REMAINDER = 1e-9
"""Sampled remainder that counts [m/s², rad/s²]. A smaller one may be rounding, of which
6e-14 was seen; in the shipped funnels those that count are 0.02 or more."""


def sample_remainder(
    nominal: Nominal,
    coefficients: np.ndarray,
    S: np.ndarray,
    directions: np.ndarray,
    at: np.ndarray,
) -> np.ndarray:
    """Returns the largest |R_k| found on the boundaries of sets, (K, n).

    It is the largest that climbing reaches from the best of the given directions: no
    bound, but seldom less than nine tenths of one.

    Args:
        nominal: the flight.
        coefficients: (T, n, M) of `expand`.
        S: (K, n, n) the sets.
        directions: (B, n) points of the unit sphere; their negatives are used too.
        at: (K,) indices of the times.
    """
    n = S.shape[-1]
    _, rows = nonlinear_parts(nominal.model, n)
    count = len(rows)
    L_inv = np.swapaxes(to_ball(S)[1], 1, 2)

    def remainders(z, here):
        """Returns R (K, B, r) at points (K, B, n) of the spheres at some times."""
        errors = z @ L_inv[here]
        return remainder_of(nominal, coefficients, at[here], errors)[..., rows]

    shares = np.array_split(np.concatenate([directions, -directions]), CLIMBS)
    starts = np.empty((len(at), 2 * count, CLIMBS, n))
    for k in range(len(at)):  # One by one: many points at once do not fit the cache.
        for i, points in enumerate(shares):
            seen = remainders(points[None], slice(k, k + 1))[0]
            best = np.concatenate([seen.argmax(axis=0), seen.argmin(axis=0)])
            starts[k, :, i] = points[best]

    def climbed(z):
        """Returns R or -R (K, B), whichever each point climbs."""
        values = remainders(z, slice(None))
        which = np.arange(z.shape[1]) // (z.shape[1] // (2 * count))
        picked = np.take_along_axis(values, (which % count)[None, :, None], axis=2)
        return np.where(which < count, 1.0, -1.0) * picked[..., 0]

    highest, _ = climb_sphere(climbed, starts.reshape(len(at), -1, n))
    found = np.zeros((len(at), n))
    found[:, rows] = highest.reshape(len(at), 2, count, CLIMBS).max(axis=(1, 3))
    return found


def remainder_of(
    nominal: Nominal, coefficients: np.ndarray, at: np.ndarray, errors: np.ndarray
) -> np.ndarray:
    """Returns R (K, B, n) = ė - p(e), the servo's limits apart.

    Args:
        nominal: the flight.
        coefficients: (T, n, M) of p, as `expand` gives them.
        at: (K,) indices of the times.
        errors: (K, B, n) deviations e.
    """
    return true_rates(nominal, at, errors) - evaluate(coefficients[at], errors)


def true_rates(nominal: Nominal, at: np.ndarray, errors: np.ndarray) -> np.ndarray:
    """Returns ė (K, B, n) of deviations (K, B, n) by the physics, without limits."""
    x0 = nominal.states[at][:, None]
    states = np.concatenate([x0, x0 + errors], axis=1)
    rates = closed_loop_rates(
        nominal.model,
        list(np.moveaxis(states, 2, 0)),
        nominal.gains[at].T[..., None],
        nominal.states[at].T[..., None],
        nominal.inputs[at][:, None],
    )
    full = np.stack([np.broadcast_to(rate, states.shape[:2]) for rate in rates], axis=2)
    return full[:, 1:] - full[:, :1]


def inflate(sampled: np.ndarray, inflation: float) -> np.ndarray:
    """Returns β, sampled remainders times an inflation; what may be rounding is 0."""
    return inflation * np.where(sampled > LEAST_REMAINDER, sampled, 0.0)


def remainder_weights(S: np.ndarray, beta: np.ndarray, sizes: np.ndarray) -> np.ndarray:
    """Returns λ (T, n) that add little growth where states have these sizes.

    With W = Lᵀ Σ L, these minimize tr(W D).

    Args:
        S: (T, n, n).
        beta: (T, n) bounds of the remainder.
        sizes: (n,) typical deviations, Σ = diag(sizes²).
    """
    L_T, _ = to_ball(S)
    weight = L_T @ np.diag(sizes**2) @ np.swapaxes(L_T, 1, 2)
    pull = np.einsum("tik,tij,tjk->tk", L_T, weight, L_T)
    return beta * np.sqrt(np.einsum("tii->t", weight)[:, None] / pull)


def remainder_form(S: np.ndarray, beta: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Returns D (T, n, n) in the coordinates of the ball.

    Args:
        S: (T, n, n).
        beta: (T, n) bounds of the remainder.
        weights: (T, n) λ, zero where beta is zero.
    """
    L_T, _ = to_ball(S)
    n = S.shape[-1]
    ball = np.divide(beta**2, weights, out=np.zeros_like(beta), where=weights > 0.0)
    along = np.einsum("tik,tk,tjk->tij", L_T, weights, L_T)
    return along + ball.sum(axis=1)[:, None, None] * np.eye(n)
