"""Commands from a clock, as a continuous feedback: its gains, and what it leaves out.

A command that is held is u₀ - K(t) e + eᵀ M(t) e + q: docs/certificate.md has K̇, Ṁ and
q̇. eᵀ M e is known. Of q̇, without what vanishes,
    q̇ = K F₃ - 2 eᵀ M (F₂ + B eᵀ M e) + ... + (K - 2 eᵀ M)(R + G (q, w)),
so that q is of third order in e: it starts again at each sample, from what the command
is off by there, and has a period to grow.
"""

import numpy as np
from scipy.linalg import expm

from glider.verification.dynamics.nominal import Nominal, advanced, table_of
from glider.verification.funnel.boundary import (
    Rates,
    command_forms,
    pull_forms,
    rates_of,
)
from glider.verification.funnel.settings import FunnelSettings
from glider.verification.sos.exact import Sampled
from glider.verification.sos.forms import linear_part, spread_form, to_ball

_ROOM = 1.15
"""Factor on the largest q̇ at a time: for what is between the times, and norms."""

BEND_ROOM = 1.05
"""The same factor on the largest eᵀ M e."""


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


def form_size(forms: np.ndarray, n: int, degree: int) -> np.ndarray:
    """Returns bounds (T,) of forms (T, C) in n variables on the unit ball."""
    tensors = spread_form(forms, n, degree)
    matrices = tensors.reshape(len(tensors), n ** (degree // 2), -1)
    return np.linalg.norm(matrices, 2, axis=(1, 2))


def bend_sizes(S: np.ndarray, bends: np.ndarray) -> np.ndarray:
    """Returns the largest |eᵀ M e| of sets at times in order, and their neighbors."""
    last = len(S) - 1
    offsets = np.array([[-1], [0], [1]])
    near = np.clip(np.arange(len(S)) + offsets, 0, last)
    turns = to_ball(S)[1]
    forms = _in_ball(bends, turns[near])
    return _largest_values(forms).max(axis=0)


def _in_ball(forms, turns):
    """Returns forms (..., n, n) in the coordinates of balls, given L⁻ᵀ (..., n, n)."""
    return turns.swapaxes(-1, -2) @ forms @ turns


def _largest_values(matrices):
    """Returns the largest singular values (...) of matrices (..., n, n)."""
    return np.linalg.norm(matrices, 2, axis=(-2, -1))


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
        grown = first + _ROOM * since * growth
        return grown * np.exp(since * pulls) + apart
    steps = np.diff(nominal.times)
    errors = np.full(len(S), first)
    for k in np.flatnonzero(starts < at):
        step = steps[k - 1]
        ends = slice(k - 1, k + 1)
        grown = errors[k - 1] + step * _ROOM * growth[ends].max()
        errors[k] = grown * np.exp(step * pulls[ends].max())
    return errors + apart


def _apart(nominal, S, at):
    """Returns how far K e - eᵀ M e is from straight lines around K times, nearly."""
    gain_slopes, bend_slopes = hold_slopes(nominal)
    of_gains = _departures(nominal, gain_slopes)[:, at]
    of_bends = _departures(nominal, bend_slopes)[:, at]
    turns = to_ball(S)[1]
    linear = of_gains[:, :, None] @ turns
    sizes = np.linalg.norm(linear[:, :, 0], axis=2)
    sizes += _largest_values(_in_ball(of_bends, turns))
    return sizes.max(axis=0)


def _departures(nominal, slopes):
    """Returns how far cubics with slopes (T, ...) bend from lines, (2, T, ...).

    That is in the interval after each time, and in the one before it.
    """
    k = nominal.flows
    steps = np.diff(nominal.times)[k]
    changes = (slopes[k + 1] - slopes[k]).T * steps / 6.0
    departures = np.zeros((2, *slopes.shape))
    departures[0, k] = changes.T
    departures[1, k + 1] = changes.T
    return departures


def _error_growth(nominal, S, at, beta, focus, wind):
    """Returns a, b (K,) of |q̇| <= a + b |q|, nearly, and what lines leave out of q."""
    turns = to_ball(S)[1]
    gains = nominal.gains[at]
    M = nominal.bends[at]
    rates = Rates(**rates_of(nominal, Sampled, at))
    B = Sampled(turns)
    bent_in_ball = B.T @ rates.bends
    given = B, Sampled(gains), bent_in_ball, bent_in_ball @ B
    _, _, third, fourth = command_forms(rates, *given)
    n = S.shape[-1]
    curved = 1.0 + _largest_values(_in_ball(focus, turns))
    bent = np.linalg.norm(M @ turns, axis=2)
    remainder = np.sum((np.abs(gains) + 2.0 * bent) * beta, axis=1)
    growth = remainder * curved
    growth += form_size(third.numbers, n, 3)
    growth += form_size(fourth.numbers, n, 4)
    pulls = []
    for k in range(3):  # Of each push, but for its part of second order.
        along, tilt, _ = pull_forms(rates.push_slopes[:, k], *given[:3])
        pulls.append(np.abs(along.numbers) + np.linalg.norm(tilt.numbers, axis=1))
    of_command = pulls[0]
    of_wind = np.hypot(*pulls[1:])
    apart = _ROOM * _apart(nominal, S, at)
    # Once more for the slopes of the cubics.
    growth += wind * of_wind + 2.0 * of_command * apart
    return growth, of_command, apart
