"""The size of a funnel of given shape: the comparison equation.

On the boundary of {eᵀ S e <= ρ}, V̇/V <= h(t); the set stays one that nothing leaves as
long as
    d(log ρ)/dt >= h(t),
integrated backward from ρ(T) = 1. Here h is found by ascent, and the set S/ρ is what is
then certified, with a margin.
"""

from collections.abc import Callable

import numpy as np

ROUNDS = 10
"""Rounds of scaling and looking again; it converges in four or five."""

MARGIN_SHARE = 0.6
"""Share of the margin that is enough, everywhere, to end the rounds."""


def scale_funnel(
    times: np.ndarray,
    S: np.ndarray,
    find_growth: Callable[[np.ndarray], np.ndarray],
    find_room: Callable[[np.ndarray], np.ndarray],
    margin: float,
) -> np.ndarray:
    """Returns S (T, n, n) scaled so that V̇/V stays below zero on its boundary.

    Args:
        times: (T,) [s].
        S: (T, n, n) the shapes.
        find_growth: from S to the largest V̇/V at and around the times, (T,) [1/s].
        find_room: from S to the largest ρ (T,) that the servo allows.
        margin: aimed at for -V̇/V; MARGIN_SHARE of it is enough [1/s].
    """
    for turn in range(ROUNDS):
        growth, room = find_growth(S), find_room(S)
        if growth.max() <= -MARGIN_SHARE * margin and room.min() >= 1.0 - 1e-9:
            break
        excess = growth + margin
        # At first as the equation says; then only what is still missing.
        S = S / _levels(times, excess if turn == 0 else np.maximum(excess, 0.0), room)
    return S


def _levels(times, rate, room):
    """Returns ρ (T, 1, 1), backward from 1 and within the servo's room."""
    log = np.zeros(len(times))
    cap = np.log(room)
    log[-1] = min(0.0, cap[-1])
    for k in range(len(times) - 2, -1, -1):
        mean = 0.5 * (rate[k] + rate[k + 1])
        log[k] = min(log[k + 1] - mean * (times[k + 1] - times[k]), cap[k])
    return np.exp(log)[:, None, None]
