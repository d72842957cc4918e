"""What the Taylor polynomial leaves out, as a bounded disturbance.

Only the accelerations are not linear in the state. Where |R_k| <= β_k on the set,
    2 zᵀ Lᵀ R <= zᵀ D z,  D = Σ_k λ_k (Lᵀ e_k)(Lᵀ e_k)ᵀ + β_k² / λ_k I,  any λ_k > 0,
on its boundary. Here the largest |R_k| is looked for; `remainder_proof` proves a bound.
"""

from collections.abc import Callable

import numpy as np

from glider.verification.dynamics.error_dynamics import (
    closed_loop_rates,
    curved_parts,
    table_of,
)
from glider.verification.dynamics.nominal import Nominal
from glider.verification.sos.forms import to_ball

SAMPLES = 500
"""Directions in which the remainder is sampled; the same at all times."""

STARTS = 4
"""Climbs for each rate and sign, each from the best of its share of the directions: R
has several hills."""

ROUNDS = 8
"""Of the climb."""

STRIDE = 0.3
"""Of its first step, on the unit sphere."""

DIFFERENCE = 1e-4
"""For the slopes that it follows."""


def sample_remainder(
    nominal: Nominal,
    coefficients: np.ndarray,
    S: np.ndarray,
    directions: np.ndarray,
    at: np.ndarray,
) -> np.ndarray:
    """Returns the largest |R_k| found on the boundary of the set, (len(at), n).

    It is the largest that climbing reaches from the best of the given directions: no
    bound, but seldom less than nine tenths of one.

    Args:
        nominal: the flight.
        coefficients: (T, n, M) of `expand`.
        S: (len(at), n, n) the sets.
        directions: (B, n) points of the unit sphere; their negatives are used too.
        at: indices of the times.
    """
    n = S.shape[-1]
    _, rows = curved_parts(nominal.model, n)
    count = len(rows)
    forth = np.swapaxes(to_ball(S)[1], 1, 2)

    def rest(z, here):
        """Returns R (K, B, r) at points (K, B, n) of the spheres at some times."""
        errors = z @ forth[here]
        return remainder_of(nominal, coefficients, at[here], errors)[..., rows]

    shares = np.array_split(np.concatenate([directions, -directions]), STARTS)
    starts = np.empty((len(at), 2 * count, STARTS, n))
    for k in range(len(at)):  # One by one: many points at once do not fit the cache.
        for i, points in enumerate(shares):
            seen = rest(points[None], slice(k, k + 1))[0]
            best = np.concatenate([seen.argmax(axis=0), seen.argmin(axis=0)])
            starts[k, :, i] = points[best]

    def climbed(z):
        """Returns R or -R (K, B), whichever each point climbs."""
        values = rest(z, slice(None))
        which = np.arange(z.shape[1]) // (z.shape[1] // (2 * count))
        picked = np.take_along_axis(values, (which % count)[None, :, None], axis=2)
        return np.where(which < count, 1.0, -1.0) * picked[..., 0]

    highest = climb_sphere(climbed, starts.reshape(len(at), -1, n))
    found = np.zeros((len(at), n))
    found[:, rows] = highest.reshape(len(at), 2, count, STARTS).max(axis=(1, 3))
    return found


def climb_sphere(function: Callable, z: np.ndarray) -> np.ndarray:
    """Returns the values (K, B) that climbing on unit spheres from points reaches.

    Args:
        function: of points (K, B N, n), N in a row for each of B, to values (K, B N).
        z: (K, B, n) where to start.
    """
    n = z.shape[-1]
    value = function(z)
    stride = np.full((*value.shape, 1), STRIDE)
    steps = DIFFERENCE * np.eye(n)
    for _ in range(ROUNDS):
        around = function((z[:, :, None] + steps).reshape(len(z), -1, n))
        slope = around.reshape(*value.shape, n) - value[..., None]
        slope -= np.sum(slope * z, axis=2, keepdims=True) * z
        slope /= np.maximum(np.linalg.norm(slope, axis=2, keepdims=True), 1e-300)
        moved = z + stride * slope
        moved /= np.linalg.norm(moved, axis=2, keepdims=True)
        reached = function(moved)
        up = (reached > value)[..., None]
        z = np.where(up, moved, z)
        value = np.maximum(value, reached)
        stride *= np.where(up, 1.2, 0.4)
    return value


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
    n = errors.shape[-1]
    monomials = table_of(n).values(errors.reshape(-1, n))
    monomials = monomials.reshape(*errors.shape[:2], -1)
    rates = rates_of(nominal, at, errors)
    return rates - monomials @ np.swapaxes(coefficients[at], 1, 2)


def rates_of(nominal: Nominal, at: np.ndarray, errors: np.ndarray) -> np.ndarray:
    """Returns the true ė (K, B, n) of deviations (K, B, n), without limits."""
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
