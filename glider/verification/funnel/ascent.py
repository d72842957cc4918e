"""The largest value of a function on the unit sphere, by ascent from many points.

A lower bound of the truth and in all cases seen the truth itself, or nearly; it only
guides the choice of a funnel, which sums of squares then certify.
"""

from collections.abc import Callable

import numpy as np

from glider.verification.sos.forms import spread_form

ROUNDS = 40
"""Steps of the power iteration on a polynomial."""

CLIMB_ROUNDS = 8
"""Steps of a climb on any function."""

STRIDE = 0.3
"""First step of a climb on the unit sphere."""

DIFFERENCE = 1e-4
"""Step of difference quotients in the coordinates of the ball."""


def largest_values(
    quadratic: np.ndarray, cubic: np.ndarray, quartic: np.ndarray, starts: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Returns max over |z| = 1 of zᵀ N z + c₃(z) + c₄(z) for several polynomials.

    Shifted power iteration, z ← (∇p + α z) / |∇p + α z| with α large enough for p
    never to fall (Kolda and Mayo 2011).

    Args:
        quadratic: (T, n, n) N.
        cubic: (T, C₃) coefficients of c₃.
        quartic: (T, C₄) coefficients of c₄.
        starts: (T, B, n) points to start from; their negatives are tried too.

    Returns:
        values (T,) and where they are taken, (T, n).
    """
    n = quadratic.shape[-1]
    third, fourth = spread_form(cubic, n, 3), spread_form(quartic, n, 4)
    z = np.concatenate([starts, -starts], axis=1)
    norms = [np.linalg.norm(a.reshape(len(a), -1), axis=1) for a in (third, fourth)]
    bound = np.linalg.norm(quadratic, axis=(1, 2)) + 2.0 * norms[0] + 3.0 * norms[1]
    shift = np.broadcast_to(0.2 * bound[:, None, None], (*z.shape[:2], 1)).copy()
    value, slope = _value_and_half_slope(quadratic, third, fourth, z)
    for _ in range(ROUNDS):
        moved = slope + shift * z
        moved /= np.linalg.norm(moved, axis=2, keepdims=True)
        new_value, new_slope = _value_and_half_slope(quadratic, third, fourth, moved)
        up = (new_value >= value)[..., None]
        z = np.where(up, moved, z)
        slope = np.where(up, new_slope, slope)
        value = np.maximum(value, new_value)
        shift *= np.where(up, 0.7, 3.0)
    best = np.argmax(value, axis=1)
    rows = np.arange(len(value))
    return value[rows, best], z[rows, best]


def climb_sphere(function: Callable, z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Returns what climbing on unit spheres reaches: values (K, B), points (K, B, n).

    Args:
        function: of points (K, B N, n), N in a row for each of B, to values (K, B N).
        z: (K, B, n) where to start.
    """
    n = z.shape[-1]
    value = function(z)
    stride = np.full((*value.shape, 1), STRIDE)
    steps = DIFFERENCE * np.eye(n)
    for _ in range(CLIMB_ROUNDS):
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
    return value, z


def _value_and_half_slope(quadratic, third, fourth, z):
    """Returns p (T, B) and ∇p / 2 (T, B, n) at points, given symmetric tensors."""
    count, batch, n = z.shape
    twice = z[..., :, None] * z[..., None, :]
    flat = twice.reshape(count, batch, n * n)
    linear = z @ quadratic
    square = flat @ third.reshape(count, n * n, n)
    matrix = (flat @ fourth.reshape(count, n * n, n * n)).reshape(count, batch, n, n)
    cube = (matrix @ z[..., None])[..., 0]
    value = np.sum(z * (linear + square + cube), axis=2)
    return value, linear + 1.5 * square + 2.0 * cube
