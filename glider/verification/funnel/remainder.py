"""The Taylor remainder R, as a bounded disturbance.

Only the accelerations are not linear in the state. Where |R_k| <= β_k (1 + eᵀ F e) on
the set,
    2 zᵀ Lᵀ R <= zᵀ D z (1 + eᵀ F e),
    D = Σ_k λ_k (Lᵀ e_k)(Lᵀ e_k)ᵀ + β_k² / λ_k I,  any λ_k > 0,
on its boundary. F is where R is large (docs/certificate.md has why). Here the largest
|R_k| is looked for; `glider.verification.proof` proves a bound. For a set of gliders R
is also the difference of their rates, about their own centers (`moving_center`).
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
from scipy.optimize import linprog

from glider.physics.confidence import physical, theta_at
from glider.verification.dynamics.moving_center import MovingCenter
from glider.verification.dynamics.nominal import (
    Nominal,
    evaluate,
    nonlinear_parts,
    open_loop_rates,
)
from glider.verification.funnel.boundary import PUSHES
from glider.verification.funnel.growth import climb_sphere
from glider.verification.funnel.settings import FunnelSettings
from glider.verification.sos.forms import to_ball
from glider.verification.sos.sphere import normalized

SAMPLES = 500
"""Directions in which the remainder is sampled; the same at all times."""

_CLIMBS = 4
"""Climbs for each rate and sign, each from the best of its share of the directions."""

_NEIGHBORS = 2
"""Rounds of climbing from where the neighbors in time reached their largest R. Without
any, a hill of R in pitch was missed at times, and a funnel was not proven there."""

LEAST_REMAINDER = 1e-9
"""Sampled remainder that counts [m/s², rad/s²]. Rounding makes 6e-14; in the shipped
funnels those that count are 0.02 or more."""


def sample_remainder(
    nominal: Nominal,
    S: np.ndarray,
    directions: np.ndarray,
    at: np.ndarray,
    center: MovingCenter,
    focus: np.ndarray | None = None,
    pushes: np.ndarray | None = None,
) -> np.ndarray:
    """Returns the largest |R_k| / (1 + eᵀ F e) on the boundaries of sets, (K, n).

    It is what climbing reaches: no bound, but seldom less than nine tenths of one.

    Args:
        S: (K, n, n) of the sets, at K times in order.
        directions: (B, n + r) to sample, and their negatives: of e, of δ, and where
            there are any, three of pushes.
        focus: (K, n, n) F; zero if None.
        pushes: (K, 2) bounds of the command's error and the wind; none if None.
    """
    remainders = _Remainders(nominal, S, at, center, focus, pushes)
    found = np.zeros(S.shape[:2])
    found[:, remainders.rows] = _of_both_signs(remainders.climb(directions)[0])
    return found


class _Remainders:
    """R / (1 + eᵀ F e) on the boundaries of K sets, of the rates that have one."""

    def __init__(self, nominal, S, at, center, focus, pushes):
        self._names = center.confidence.names
        self.which, self.rows = nonlinear_parts(nominal.model, self._names)
        self._nominal = nominal
        self._center = center
        self._at = at
        self._pushes = pushes
        self._L_inv = np.swapaxes(to_ball(S)[1], 1, 2)
        self.focus = np.zeros_like(S) if focus is None else focus

    def errors(self, y, here):
        """Returns e (K, B, n) on the sets' boundaries, towards points."""
        L_inv = self._L_inv[here]
        return normalized(y[..., : L_inv.shape[-1]]) @ L_inv

    def __call__(self, y, here=slice(None)):
        """Returns values (K, B, rows) at points (K, B, n + r + 3), at some times."""
        errors = self.errors(y, here)
        center = self._center
        push = None
        n = errors.shape[-1]
        last = n + center.confidence.dimension
        on_boundary = center.confidence.on_boundary(y[..., n:last])
        deviations = physical(self._nominal.model, self._names, on_boundary)
        if self._pushes is not None:
            error = np.sign(y[..., -3:-2])
            wind = normalized(y[..., -2:])
            push = np.concatenate([error, wind], axis=-1)
            push *= self._pushes[here][:, None, PUSHES]
        given = errors, center, deviations, push
        found = _remainder_of(self._nominal, self._at[here], *given)
        bent = np.einsum("kbi,kij,kbj->kb", errors, self.focus[here], errors)
        # Where 1 + eᵀ F e is not positive, nothing is a bound.
        return found[..., self.rows] / np.maximum(1.0 + bent, 1e-12)[..., None]

    def climb(self, directions):
        """Returns the highest of each rate and sign, (K, 2 rows), and where."""
        count = len(self.rows)
        total = directions.shape[-1]
        shares = np.array_split(np.concatenate([directions, -directions]), _CLIMBS)
        starts = np.empty((len(self._at), 2 * count, _CLIMBS, total))
        for k in range(len(self._at)):  # One by one: all do not fit the cache.
            for i, points in enumerate(shares):
                seen = self(points[None], slice(k, k + 1))[0]
                best = np.concatenate([seen.argmax(axis=0), seen.argmin(axis=0)])
                starts[k, :, i] = points[best]

        def climbed(y):
            """Returns R or -R (K, B), whichever each point climbs."""
            values = self(y)
            which = np.arange(y.shape[1]) // (y.shape[1] // (2 * count))
            picked = np.take_along_axis(values, (which % count)[None, :, None], axis=2)
            return np.where(which < count, 1.0, -1.0) * picked[..., 0]

        for turn in range(1 + (_NEIGHBORS if len(starts) > 1 else 0)):
            if turn:
                around = np.concatenate([points[:1], points, points[-1:]])
                starts = np.stack([around[:-2], points, around[2:]], axis=2)
            starts = starts.reshape(len(starts), -1, total)
            values, points = climb_sphere(climbed, starts)
            values = values.reshape(len(values), 2 * count, -1)
            best = values.argmax(axis=2)[..., None, None]
            points = points.reshape(*values.shape, total)
            points = np.take_along_axis(points, best, axis=2)[:, :, 0]
        return values.max(axis=2), points


def _of_both_signs(highest):
    """Returns the largest sizes (K, rows), given those of each rate and sign."""
    return highest.reshape(len(highest), 2, -1).max(axis=1)


_ROUNDS = 2
"""Times that F is made, the second with the points where the first was exceeded."""


def find_focus(
    nominal: Nominal,
    S: np.ndarray,
    directions: np.ndarray,
    at: np.ndarray,
    center: MovingCenter,
    sizes: np.ndarray,
    pushes: np.ndarray | None = None,
    floor: float = FunnelSettings.floor,
) -> np.ndarray:
    """Returns F (K, n, n), positive semidefinite, of where R is large.

    At points that were seen, whose second moment's axes it has, 1 + eᵀ F e is at least
    R over a floor of its largest value, and tr(Σ F) is small; Σ is `sizes`.
    """
    bare, bent = (_Remainders(nominal, S, at, center, None, pushes) for _ in range(2))
    states = [i for i in bare.which if i < S.shape[-1]]
    scales = np.sqrt(np.diagonal(np.linalg.inv(S), axis1=1, axis2=2))[:, states]
    square = scales[:, :, None] * scales[:, None]
    block = np.ix_(states, states)
    seen: list[list[tuple[np.ndarray, np.ndarray]]] = [[] for _ in at]
    for turn in range(_ROUNDS):
        highest, tops = bent.climb(directions)
        if turn == 0:
            top = _of_both_signs(highest)
            largest = np.where(top > LEAST_REMAINDER, top, np.inf)
        for k in range(len(at)):
            more = [] if turn else [directions, -directions]
            points = np.concatenate([tops[k], *more])[None]
            here = slice(k, k + 1)
            values = np.abs(bare(points, here)[0]) / largest[k]
            own = bare.errors(points, here)[0][:, states] / scales[k]
            seen[k].append((values.max(axis=1), own))
            shares, own = map(np.concatenate, zip(*seen[k], strict=True))
            F = _least_focus(shares / floor, own, sizes[k][block] / square[k])
            bent.focus[k][block] = F / square[k]
    return bent.focus


def _least_focus(shares, own, sizes):
    """Returns F (m, m) so that 1 + eᵀ F e is at least shares (B,)."""
    moment = np.einsum("b,bi,bj->ij", shares**2, own, own)
    axes = np.linalg.eigh(moment)[1]
    cost = np.einsum("ij,ik,jk->k", sizes / np.trace(sizes), axes, axes) + 1e-3
    needs = shares > 1.0
    if not np.any(needs):
        return np.zeros_like(moment)
    found = linprog(cost, A_ub=-((own[needs] @ axes) ** 2), b_ub=1.0 - shares[needs])
    F = (axes * (found.x if found.success else 0.0 * cost)) @ axes.T
    return 0.5 * (F + F.T)


def _remainder_of(
    nominal: Nominal,
    at: np.ndarray,
    errors: np.ndarray,
    center: MovingCenter,
    deviations: np.ndarray,
    push: np.ndarray | None = None,
) -> np.ndarray:
    """Returns R (K, B, n) = ė - p(e), without the servo's limits, at K times.

    Errors e are from x₀ + X δ, with deviations δ (K, B, m). A push (K, B, 3) is d_u
    and w, which act in R but for G (d_u, w).
    """
    known = evaluate(nominal.closed_loop[at], errors)
    pushed_command = 0.0
    wind: Sequence[Any] = (0.0, 0.0)
    if push is not None:
        pushed_command, *wind = np.moveaxis(push, 2, 0)
        G = nominal.push_slopes[at]
        slopes = G[:, None, ..., 0] + np.einsum("kijl,kbl->kbij", G[..., 1:], errors)
        known = known + (slopes @ push[..., None])[..., 0]
    moved = deviations @ np.swapaxes(center.shifts[at], 1, 2)
    commanded = np.einsum("kbm,km->kb", deviations, center.commands[at])
    drift = deviations @ np.swapaxes(center.slopes[at], 1, 2)
    names = center.confidence.names
    each = np.moveaxis(deviations, 2, 0)
    theta = theta_at(nominal.model, names, each)
    center_states = nominal.states[at][:, None] + moved
    states = center_states + errors
    commands = nominal.inputs[at][:, None] + commanded + pushed_command
    commands = commands - np.einsum("ki,kbi->kb", nominal.gains[at], errors)
    x = list(np.moveaxis(states, 2, 0))
    rates = open_loop_rates(nominal.model, x, commands, theta, wind)
    of_each = [np.broadcast_to(rate, commands.shape) for rate in rates]
    flown = np.stack(of_each, axis=2)
    return flown - nominal.slopes[at][:, None] - drift - known


def remainder_weights(S: np.ndarray, beta: np.ndarray, sizes: np.ndarray) -> np.ndarray:
    """Returns λ (T, n) that minimize tr(W D), W = Lᵀ Σ L, Σ `sizes`."""
    weight, pulls = _pulls(S, np.eye(S.shape[-1]), sizes)
    return beta * np.sqrt(weight[:, None] / pulls)


def push_weights(
    S: np.ndarray, pushes: np.ndarray, slopes: np.ndarray, sizes: np.ndarray
) -> np.ndarray:
    """Returns the same λ (T, 2) of pushes (T, 2) along G (T, n, 3, 1 + n)."""
    weight, pulls = _pulls(S, slopes[..., 0], sizes)
    pulls = np.stack([pulls[:, 0], pulls[:, 1] + pulls[:, 2]], axis=1)
    return pushes * np.sqrt(weight[:, None] / pulls)


def _pulls(S, directions, sizes):
    """Returns tr W (T,) and gᵀ L W Lᵀ g (T, m) for directions g (..., n, m)."""
    L_T, _ = to_ball(S)
    weight = L_T @ sizes @ np.swapaxes(L_T, 1, 2)
    pulls = L_T @ directions
    along = np.einsum("tik,tij,tjk->tk", pulls, weight, pulls)
    return np.einsum("tii->t", weight), along
