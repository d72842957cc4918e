"""Commands from a clock, as a continuous feedback: its gains, and what it leaves out.

A command that is held is u₀ - K(t) e + eᵀ M(t) e + q: docs/certificate.md has K̇, Ṁ and
q̇. eᵀ M e is known. Of q̇, without what vanishes,
    q̇ = K F₃ - 2 eᵀ M (F₂ + B eᵀ M e) + ... + (K - 2 eᵀ M)(R + G (q, w)),
so that q is of third order in e: it starts again at each sample, from what the command
is off by there, and has a period to grow.
"""

import dataclasses
import itertools

import numpy as np
from scipy.linalg import expm

from glider.verification.dynamics.nominal import Nominal, advanced, table_of
from glider.verification.funnel.settings import FunnelSettings
from glider.verification.sos.forms import linear_part, spread_form, to_ball

ROOM = 1.15
"""Factor on the largest q̇ at a time: for what is between, and norms."""

BEND_ROOM = 1.05
"""Factor on the largest eᵀ M e at a time: for what is between, and norms."""


def _steps(nominal, first, last):
    """Returns Φ (n, n) and Γ (n,) of each step: e ← Φ e + Γ δu."""
    n = nominal.states.shape[1]
    slopes = nominal.open_loop[first : last + 1, :, table_of(n + 1).of_degree(1)]
    square = np.zeros((last - first, n + 1, n + 1))
    step = np.diff(nominal.times[first : last + 1])[:, None, None]
    square[:, :n] = 0.5 * step * (slopes[:-1] + slopes[1:])
    both = expm(square)[:, :n]
    return list(zip(both[..., :n], both[..., n], strict=True))


def effect_of_hold(nominal: Nominal, first: int, last: int) -> np.ndarray:
    """Returns what a command that is held does to the state, (n,) [s]."""
    total = np.zeros(nominal.states.shape[1])
    for move, push in _steps(nominal, first, last):
        total = move @ total + push
    return total


def undo_hold(nominal: Nominal, first: int, last: int, gains: np.ndarray) -> None:
    """Writes the feedback of a hold that ends with gains (n,) into a flight."""
    nominal.gains[last] = gains
    for k, (move, push) in reversed([*enumerate(_steps(nominal, first, last), first)]):
        gains = gains @ move / (1.0 + gains @ push)
        nominal.gains[k] = gains
    here = slice(first, last + 1)
    nominal.bends[here] = 0.0
    nominal.closed_loop[here] = nominal.part(here).closed_loop
    ends = _bend_rates(nominal, here)
    for k, step in enumerate(np.diff(nominal.times[here])):

        def rate(share, M, k=k):
            between = ((1.0 - share) * of[k] + share * of[k + 1] for of in ends)
            return _bend_slope(M, *between)

        M = advanced(rate, nominal.bends[first + k], step)
        nominal.bends[first + k + 1] = 0.5 * (M + M.T)


def with_held_gains(nominal: Nominal) -> Nominal:
    """Returns a flight with the feedback of commands that are held, as computed.

    Of its gains, those at the samples count.
    """
    nominal = nominal.writable()
    for first in nominal.samples:
        gains = nominal.gains[first]
        last = np.flatnonzero(nominal.starts == first)[-1]
        for move, push in _steps(nominal, first, last):
            gains = np.linalg.solve((move - np.outer(push, gains)).T, gains)
        undo_hold(nominal, first, last, gains)
    return dataclasses.replace(nominal)  # Expanded again, as a whole.


def _bend_rates(nominal, here=slice(None)):
    """Returns K F₂ (K, n, n), K B (K,) and A (K, n, n) at some times."""
    n = nominal.states.shape[1]
    rates = nominal.closed_loop[here]
    gains = nominal.gains[here]
    push = nominal.push_slopes[here][:, :, 0, 0]
    own = np.einsum("ti,tim->tm", gains, rates)
    square = spread_form(own[:, table_of(n).of_degree(2)], n, 2)
    return square, np.einsum("ti,ti->t", gains, push), linear_part(rates)


def _bend_slope(M, square, pull, A):
    """Returns Ṁ (..., n, n), given M and what `_bend_rates` returns."""
    product = M @ A
    return square + pull * M - product - product.swapaxes(-1, -2)


def hold_slopes(nominal: Nominal) -> tuple[np.ndarray, np.ndarray]:
    """Returns K̇ (T, n) and Ṁ (T, n, n) of commands that are held."""
    squares, pulls, A = _bend_rates(nominal)
    slopes = _bend_slope(nominal.bends, squares, pulls[:, None, None], A)
    return -np.einsum("ti,tij->tj", nominal.gains, A), slopes


def form_size(tensors: np.ndarray) -> np.ndarray:
    """Returns bounds (T,) of forms on the unit ball, given tensors (T, n, ..., n)."""
    orders = itertools.permutations(range(1, tensors.ndim))
    total = np.mean([tensors.transpose(0, *order) for order in orders], axis=0)
    if total.ndim == 2:
        return np.linalg.norm(total, axis=1)
    rows = tensors.shape[-1] ** ((tensors.ndim - 1) // 2)
    return np.linalg.norm(total.reshape(len(total), rows, -1), 2, axis=(1, 2))


def bend_sizes(S: np.ndarray, bends: np.ndarray) -> np.ndarray:
    """Returns the largest |eᵀ M e| of sets at times in order, and their neighbors."""
    near = np.clip(np.arange(len(S)) + np.array([[-1], [0], [1]]), 0, len(S) - 1)
    turn = to_ball(S)[1][near]
    forms = turn.swapaxes(2, 3) @ bends @ turn
    return np.linalg.norm(forms, 2, axis=(2, 3)).max(axis=0)


def command_errors(
    nominal: Nominal,
    S: np.ndarray,
    at: np.ndarray,
    settings: FunnelSettings,
    beta: np.ndarray | None = None,
    focus: np.ndarray | None = None,
) -> np.ndarray:
    """Returns how far held commands may be off u₀ - K e + eᵀ M e at K times, (K,).

    At all times each error has grown from the one before it; at some of them, ever
    since its sample as it does there. β and F of R count for little; zero if None.
    """
    beta = np.zeros(S.shape[:2]) if beta is None else beta
    focus = np.zeros_like(S) if focus is None else focus
    growth, pulls, apart = _error_growth(nominal, S, at, beta, focus, settings.wind)
    starts = nominal.starts
    first = settings.command_error
    if len(at) < len(starts):
        since = nominal.times[at] - nominal.times[starts[at]]
        return (first + ROOM * since * growth) * np.exp(since * pulls) + apart
    step = np.diff(nominal.times)
    q = np.full(len(S), first)
    for i in np.flatnonzero(starts < at):
        last = slice(i - 1, i + 1)
        q[i] = q[i - 1] + step[i - 1] * ROOM * growth[last].max()
        q[i] *= np.exp(step[i - 1] * pulls[last].max())
    return q + apart


def _apart(nominal, S, at):
    """Returns how far K e - eᵀ M e is from straight lines around K times, nearly."""
    k = nominal.flows
    turn = to_ball(S)[1]
    steps = np.diff(nominal.times)[k]
    bends = [np.zeros((2, *v.shape)) for v in (nominal.gains, nominal.bends)]
    for bend, slopes in zip(bends, hold_slopes(nominal), strict=True):
        change = (slopes[k + 1] - slopes[k]).T * steps / 6.0
        bend[0, k] = change.T
        bend[1, k + 1] = change.T
    of_gains, of_bends = (bend[:, at] for bend in bends)
    size = np.linalg.norm((of_gains[:, :, None] @ turn)[:, :, 0], axis=2)
    square = np.linalg.norm(turn.swapaxes(1, 2) @ of_bends @ turn, 2, axis=(2, 3))
    return (size + square).max(axis=0)


def _error_growth(nominal, S, at, beta, focus, wind):
    """Returns a, b (K,) of |q̇| <= a + b |q|, nearly, and what lines leave out of q."""
    n = S.shape[-1]
    table = table_of(S.shape[-1])
    turn = to_ball(S)[1]
    gains = nominal.gains[at]
    M = nominal.bends[at]
    rates = nominal.closed_loop[at]
    G = nominal.push_slopes[at]
    square = spread_form(rates[..., table.of_degree(2)], n, 2)
    square = square + np.einsum("ti,tab->tiab", G[:, :, 0, 0], M)
    cube = spread_form(rates[..., table.of_degree(3)], n, 3)
    cube = cube + np.einsum("tia,tbc->tiabc", G[:, :, 0, 1:], M)
    third = np.einsum("ti,tiabc->tabc", gains, cube)
    third = third - 2.0 * np.einsum("tai,tibc->tabc", M, square)
    fourth = np.einsum("tai,tibcd->tabcd", M, cube)
    moves = [turn] * 4
    third = np.einsum("tabc,tai,tbj,tck->tijk", third, *moves[:3], optimize=True)
    fourth = np.einsum("tabcd,tai,tbj,tck,tdl->tijkl", fourth, *moves, optimize=True)
    bend = np.linalg.norm(turn.swapaxes(1, 2) @ focus @ turn, 2, axis=(1, 2))
    most = np.abs(gains) + 2.0 * np.linalg.norm(M @ turn, axis=2)
    growth = form_size(third) + 2.0 * form_size(fourth)
    growth += np.sum(most * beta, axis=1) * (1.0 + bend)
    # (K - 2 eᵀ M)(G₀ + G₁ e) of each push, but for its part of second order.
    along = np.einsum("ti,tikj->tkj", gains, G)
    tilt = along[..., 1:] - 2.0 * np.einsum("tai,tik->tka", M, G[..., 0])
    pulls = np.abs(along[..., 0]) + np.linalg.norm(tilt @ turn, axis=2)
    growth += wind * np.linalg.norm(pulls[:, 1:], axis=1)
    apart = ROOM * _apart(nominal, S, at)
    growth += 2.0 * pulls[:, 0] * apart  # Once for the slopes of the cubics.
    return growth, pulls[:, 0], apart
