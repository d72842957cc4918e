"""Commands from a clock, as a continuous feedback: its gains, and what it leaves out.

A command c = u₀ - K e that acts from a sample on is held. As long as the deviation is
small, ė = A e + B δu, it is u₀ - K(t) e(t) all the while it is held, with
    K̇ = -K (A - B K)
from the gains at the sample on: the flight is undone. So held commands are a continuous
feedback, whose gains jump at each sample, and an error q of its command,
    q̇ = K (P₂ + P₃ + R + G (q, w)),
which is of second order in e: it starts again at each sample, from what the command is
off by there, and has a period to grow.
"""

import numpy as np
from scipy.linalg import expm

from glider.verification.dynamics.nominal import Nominal, table_of
from glider.verification.funnel.growth import Bounds
from glider.verification.sos.forms import spread_form, to_ball

ROOM = 1.2
"""Factor on the largest q̇ at a time: for what is between, and norms of it. The proof
finds 1.0 to 1.16."""

BEND = 0.25
"""Share of what q grows by in a step that K differs by from a straight line. The proof
finds 0.2."""


def hold_starts(times: np.ndarray) -> np.ndarray:
    """Returns the index (T,) of the sample whose command acts at each time."""
    begins = np.append(True, np.diff(times) == 0.0)
    return np.maximum.accumulate(np.where(begins, np.arange(len(times)), 0))


def _steps(nominal, first, last):
    """Yields Φ (n, n) and Γ (n,) of each step: e ← Φ e + Γ δu."""
    n = nominal.states.shape[1]
    slopes = nominal.open_loop[first : last + 1, :, table_of(n + 1).of_degree(1)]
    for k, step in enumerate(np.diff(nominal.times[first : last + 1])):
        square = np.zeros((n + 1, n + 1))
        square[:n] = 0.5 * step * (slopes[k] + slopes[k + 1])
        both = expm(square)[:n]
        yield both[:, :n], both[:, n]


def effect_of_hold(nominal: Nominal, first: int, last: int) -> np.ndarray:
    """Returns what a command that is held does to the state, (n,) [s]."""
    total = np.zeros(nominal.states.shape[1])
    for move, push in _steps(nominal, first, last):
        total = move @ total + push
    return total


def gains_before(nominal: Nominal, k: int, gains: np.ndarray) -> np.ndarray:
    """Returns the gains K (n,) at a time, given those at the next."""
    [(move, push)] = _steps(nominal, k, k + 1)
    return gains @ move / (1.0 + gains @ push)


def command_errors(
    nominal: Nominal,
    S: np.ndarray,
    at: np.ndarray,
    bounds: Bounds,
    start: float,
    wind: float,
) -> np.ndarray:
    """Returns how far held commands may be off u₀ - K e in sets at K times, (K,).

    At all times, in order; or at one, with the growth there ever since its sample.

    Args:
        bounds: of R.
        start: error of a command when it is computed [rad/s].
    """
    n, table = S.shape[-1], table_of(S.shape[-1])
    L_inv_T = to_ball(S)[1]
    gains = nominal.gains[at]
    bend = L_inv_T.swapaxes(1, 2) @ bounds.focus @ L_inv_T
    off = np.sum(np.abs(gains) * bounds.beta, axis=1)
    off *= 1.0 + np.linalg.norm(bend, 2, axis=(1, 2))
    pulls = np.einsum("ti,tik->tk", gains, nominal.push_slopes[at, :, :, 0])
    blown = wind * np.linalg.norm(pulls[:, 1:], axis=1)
    rates = np.einsum("ti,tim->tm", gains, nominal.closed_loop[at])
    square = spread_form(rates[:, table.of_degree(2)], n, 2)
    square = L_inv_T.swapaxes(1, 2) @ square @ L_inv_T
    cube = spread_form(rates[:, table.of_degree(3)], n, 3)
    cube = np.einsum(
        "tabc,tai,tbj,tck->tijk", cube, *[L_inv_T] * 3, optimize=True
    ).reshape(len(S), -1)
    growth = off + blown + np.linalg.norm(square, 2, axis=(1, 2))
    growth += np.linalg.norm(cube, axis=1)
    begins, times = hold_starts(nominal.times)[at], nominal.times[at]
    pulls = np.abs(pulls[:, 0])
    if len(at) == 1:
        since = times - nominal.times[begins]
        return (start + ROOM * since * growth) * np.exp(since * pulls)
    q, grown = np.full((2, len(S)), start)
    for i in np.flatnonzero(begins < at):
        last, step = slice(i - 1, i + 1), times[i] - times[i - 1]
        q[i] = q[i - 1] + step * ROOM * growth[last].max()
        q[i] *= np.exp(step * pulls[last].max())
        grown[i] = q[i] - q[i - 1]
    grown[begins == at] = np.append(grown, 0.0)[1:][begins == at]
    return q + BEND * grown
