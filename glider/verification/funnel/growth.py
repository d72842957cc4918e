"""V̇/V on the boundary of a funnel, at its times and between them: its largest value.

The largest value on the unit sphere is found by ascent from many points: a lower bound,
in all cases seen of the truth itself, or nearly. It only guides the choice of a funnel,
which sums of squares then certify.
"""

from collections.abc import Callable

import numpy as np

from glider.verification.dynamics.nominal import Nominal
from glider.verification.funnel.boundary import (
    BOUNDS,
    BoundaryForms,
    BoundarySets,
    boundary_forms,
)
from glider.verification.sos.forms import spread_form
from glider.verification.sos.sphere import normalized

SHARES = (0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9)
"""Points of each interval where V̇ is examined. With five, a funnel was made whose V
rises between two of them, where a servo limit cuts it down; it could not be proven."""

_NEIGHBORS = 2
"""Rounds of ascent from where the neighbors in time reached their largest value."""


def largest_growth(forms: BoundaryForms, starts: np.ndarray) -> np.ndarray:
    """Returns the largest V̇/V (T,) found by ascent, at times in order [1/s].

    One ascent misses the truth at some times, by up to 0.08 1/s with 12 starts; what a
    neighbor in time found leads there. The quadratic part's axes are starts too.
    """
    axes = np.swapaxes(np.linalg.eigh(forms.quadratic)[1], 1, 2)
    seeds = np.broadcast_to(starts, (len(axes), *starts.shape))
    points = np.concatenate([seeds, axes], axis=1)
    value, worst = _largest_values(*forms, points)
    for _ in range(_NEIGHBORS):
        around = np.concatenate([worst[:1], worst, worst[-1:]])
        points = np.stack([around[:-2], worst, around[2:]], axis=1)
        value, worst = _largest_values(*forms, points)
    return value


def growth_between(
    sets: BoundarySets, share: float, starts: np.ndarray, here: Nominal
) -> np.ndarray:
    """Returns the largest V̇/V found by ascent at one point of each flow [1/s].

    Args:
        share: of an interval, where the point is; from 0 to 1.
        starts: of the ascent.
        here: the nominal flight there.
    """

    def mixed(values):
        return sets.nominal.mixed(values, share)

    own = {name: mixed(getattr(sets, name)) for name in BOUNDS}
    own |= {"S": sets.curve(here.times), "slopes": sets.curve(here.times, 1)}
    between = BoundarySets(nominal=here, settings=sets.settings, **own)
    forms = boundary_forms(between, mixed(sets.nominal.push_slopes))
    return largest_growth(forms, starts)


_ROUNDS, _CLIMB_ROUNDS = 40, 8
"""Steps of the power iteration on a polynomial, and of a climb on any function."""

_STRIDE = 0.3
"""First step of a climb on the unit sphere."""

DIFFERENCE = 1e-4
"""Step of difference quotients in the coordinates of the ball."""


def _largest_values(
    quadratic: np.ndarray, cubic: np.ndarray, quartic: np.ndarray, starts: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Returns max over |z| = 1 of zᵀ N z + c₃(z) + c₄(z) for T polynomials, and where.

    Shifted power iteration (Kolda and Mayo 2011): z ← (∇p + α z) / |∇p + α z|, from
    starts (T, B, n) and their negatives.
    """
    n = quadratic.shape[-1]
    z = np.concatenate([starts, -starts], axis=1)
    third = spread_form(cubic, n, 3)
    fourth = spread_form(quartic, n, 4)
    norms = [np.linalg.norm(a.reshape(len(a), -1), axis=1) for a in (third, fourth)]
    bound = np.linalg.norm(quadratic, axis=(1, 2)) + 2.0 * norms[0] + 3.0 * norms[1]
    shift = np.broadcast_to(0.2 * bound[:, None, None], (*z.shape[:2], 1)).copy()
    value, slope = _value_and_half_slope(quadratic, third, fourth, z)
    for _ in range(_ROUNDS):
        moved = normalized(slope + shift * z)
        new_value, new_slope = _value_and_half_slope(quadratic, third, fourth, moved)
        up = (new_value >= value)[..., None]
        z = np.where(up, moved, z)
        slope = np.where(up, new_slope, slope)
        value = np.maximum(value, new_value)
        shift *= np.where(up, 0.7, 3.0)
    best = np.arange(len(value)), np.argmax(value, axis=1)
    return value[best], z[best]


def climb_sphere(function: Callable, z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Returns what climbing on unit spheres reaches: values (K, B), points (K, B, n).

    The function is of points (K, B N, n), N in a row for each of B, to values (K, B N);
    z (K, B, n) is where to start.
    """
    n = z.shape[-1]
    value = function(z)
    stride = np.full((*value.shape, 1), _STRIDE)
    steps = DIFFERENCE * np.eye(n)
    for _ in range(_CLIMB_ROUNDS):
        around = function((z[:, :, None] + steps).reshape(len(z), -1, n))
        slope = around.reshape(*value.shape, n) - value[..., None]
        slope -= np.sum(slope * z, axis=2, keepdims=True) * z
        slope /= np.maximum(np.linalg.norm(slope, axis=2, keepdims=True), 1e-300)
        moved = normalized(z + stride * slope)
        reached = function(moved)
        up = (reached > value)[..., None]
        z = np.where(up, moved, z)
        value = np.maximum(value, reached)
        stride *= np.where(up, 1.2, 0.4)
    return value, z


def _value_and_half_slope(quadratic, third, fourth, z):
    """Returns p (T, B) and ∇p / 2 (T, B, n) at points, given symmetric tensors."""
    count, batch, n = z.shape
    flat = (z[..., :, None] * z[..., None, :]).reshape(count, batch, n * n)
    linear = z @ quadratic
    square = flat @ third.reshape(count, n * n, n)
    matrix = (flat @ fourth.reshape(count, n * n, n * n)).reshape(count, batch, n, n)
    cube = (matrix @ z[..., None])[..., 0]
    value = np.sum(z * (linear + square + cube), axis=2)
    return value, linear + 1.5 * square + 2.0 * cube
