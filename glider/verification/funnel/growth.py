"""V̇/V on the boundary of a funnel, at its times and between them: its largest value.

The largest value on the unit sphere is found by ascent from many points: a lower bound,
in all cases seen of the truth itself, or nearly. It only guides the choice of a funnel,
which sums of squares then certify.
"""

import dataclasses
import functools
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from scipy.interpolate import PPoly

from glider.verification.dynamics.nominal import Nominal, hermite_path
from glider.verification.funnel.settings import FunnelSettings
from glider.verification.sos.forms import (
    higher_forms,
    product_form,
    quadratic_form,
    spread_form,
    to_ball,
)
from glider.verification.sos.sphere import normalized

SHARES = (0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9)
"""Points of each interval where V̇ is examined. With five, a funnel was made whose V
rises between two of them, where a servo limit cuts it down; it could not be proven."""

_NEIGHBORS = 2
"""Rounds of ascent from where the neighbors in time reached their largest value."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class BoundarySets:
    """The sets {x₀ + e: eᵀ S e <= 1} along a flight, and what acts on them.

    The names of the arrays are keys in a funnel's file.
    """

    nominal: Nominal  #: Flight x₀, and the feedback that keeps the glider inside.
    settings: FunnelSettings  #: Settings that it was made with.
    S: np.ndarray  #: Matrices S (T, n, n), between the times cubic Hermite polynomials.
    slopes: np.ndarray  #: Slopes Ṡ (T, n, n) [1/s].
    beta: np.ndarray  #: Bounds β (T, n) of the Taylor remainder [m/s², rad/s²].
    weights: np.ndarray  #: Weights λ (T, n) of `glider.verification.funnel.remainder`.
    focus: np.ndarray  #: F (T, n, n) of |R_k| <= β_k (1 + eᵀ F e), where R is large.
    push_weights: np.ndarray  #: λ (T, 2) of the command's error and of the wind.
    errors: np.ndarray  #: Largest error of the command u₀ - K e (T,) [rad/s].
    rests: np.ndarray  #: Of it, what is not eᵀ M e (T,) [rad/s].

    @functools.cached_property
    def curve(self) -> PPoly:
        """S as a function of time."""
        return hermite_path(self.nominal.times, self.S, self.slopes)

    @property
    def pushes(self) -> np.ndarray:
        """Bounds (T, 2) of the command's error [rad/s] and of the wind [m/s]."""
        return pushes_of(self.errors, self.settings)

    @property
    def unknown_pushes(self) -> np.ndarray:
        """The same without the command's error that is known, eᵀ M e."""
        return pushes_of(self.rests, self.settings)


BOUNDS = ("beta", "weights", "focus", "push_weights", "errors", "rests")
"""Names of the arrays that are straight lines between the times."""


def pushes_of(errors: np.ndarray, settings: FunnelSettings) -> np.ndarray:
    """Returns bounds (K, 2) of the command's error, (K,), and of the wind."""
    return np.stack([errors, settings.wind + 0.0 * errors], axis=1)


class BoundaryForms(NamedTuple):
    """V̇/V = zᵀ N z + c₃(z) + c₄(z) on the boundary |z| = 1, at each of T times."""

    quadratic: np.ndarray  #: Matrices N (T, n, n) [1/s].
    cubic: np.ndarray  #: Coefficients of c₃ (T, C₃) [1/s].
    quartic: np.ndarray  #: Coefficients of c₄ (T, C₄) [1/s].


PUSHES = [0, 1, 1]
"""Which bound each push has: the command's error, and the wind along x and z."""


def boundary_forms(sets: BoundarySets, G: np.ndarray) -> BoundaryForms:
    """Returns V̇/V on the boundaries, with (zᵀ D z)(1 + eᵀ F e) of R and pushes."""
    S = sets.S
    nominal = sets.nominal
    cubic, quartic = higher_forms(S, nominal.closed_loop)
    _, L_inv_T = to_ball(S)
    L_inv = np.swapaxes(L_inv_T, 1, 2)
    disturbance = _remainder_form(S, sets.beta, sets.weights)
    quadratic = quadratic_form(S, sets.slopes, nominal.closed_loop)
    quadratic = L_inv @ quadratic @ L_inv_T + disturbance
    quartic = quartic + product_form(disturbance, L_inv @ sets.focus @ L_inv_T)
    push = _push_form(S, G, sets.unknown_pushes, sets.push_weights, nominal.bends)
    return BoundaryForms(*map(np.add, (quadratic, cubic, quartic), push))


def _push_form(
    S: np.ndarray,
    slopes: np.ndarray,
    pushes: np.ndarray,
    weights: np.ndarray,
    bends: np.ndarray,
) -> BoundaryForms:
    """Returns what pushes (T, 2) along G add to V̇/V, G (T, n, 3, 1 + n) in (1, e).

    The command is off by eᵀ M e too, of either sign, M the bends (T, n, n).
    2 eᵀ S G w <= λ |Gᵀ S e|² + w² / λ of both axes of the wind: half of w² each.
    Gᵀ S e = pᵀ z + zᵀ M z, so that its square is a quartic.
    """
    L_T, L_inv_T = to_ball(S)
    sizes = pushes[:, PUSHES] * [1.0, np.sqrt(0.5), np.sqrt(0.5)]
    weights = weights[:, PUSHES]
    quadratic = _remainder_form(S, sizes, weights, slopes[..., 0])
    p = np.moveaxis(L_T @ slopes[..., 0], 2, 0)
    M = L_inv_T.swapaxes(1, 2) @ np.moveaxis(slopes[..., 1:], 2, 0).swapaxes(2, 3)
    M = M @ L_T.swapaxes(1, 2)
    cubic, quartic = (
        np.einsum("tk,ktc->tc", weights, product_form(factor, M)) for factor in (p, M)
    )
    known = 2.0 * L_inv_T.swapaxes(1, 2) @ bends @ L_inv_T
    return BoundaryForms(
        quadratic,
        2.0 * cubic + product_form(p[0], known),
        quartic + product_form(M[0], known),
    )


def _remainder_form(
    S: np.ndarray,
    beta: np.ndarray,
    weights: np.ndarray,
    directions: np.ndarray | None = None,
) -> np.ndarray:
    """Returns D (T, n, n) in the coordinates of the ball; λ is zero where β is.

    The directions (T, n, m) are those of m disturbances; of R they are the axes.
    """
    L_T, _ = to_ball(S)
    n = S.shape[-1]
    ball = np.divide(beta**2, weights, out=np.zeros_like(beta), where=weights > 0.0)
    pulls = L_T if directions is None else L_T @ directions
    along = np.einsum("tik,tk,tjk->tij", pulls, weights, pulls)
    return along + ball.sum(axis=1)[:, None, None] * np.eye(n)


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
