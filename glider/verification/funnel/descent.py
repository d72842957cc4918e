"""How large a funnel of given shape may be: the comparison equation.

On the boundary of {eᵀ S e <= ρ}, V̇/V <= h(t); the set stays one that nothing leaves as
    d(log ρ)/dt >= h(t),
integrated backward from ρ(T) = 1. Here h is found by ascent and the set S/ρ is what is
then certified, with a margin.
"""

from collections.abc import Callable

import numpy as np

from glider.verification.sos.forms import (
    higher_forms,
    quadratic_form,
    to_ball,
)

ROUNDS = 10
"""Of scaling and looking again; it converges in four or five."""

ENOUGH = 0.6
"""Share of the margin that must be left at last."""


def boundary_forms(
    S: np.ndarray, slopes: np.ndarray, coefficients: np.ndarray, disturbance: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Returns N, c₃, c₄ of V̇/V on the boundary, the disturbance included.

    Args:
        S: (T, n, n).
        slopes: (T, n, n) Ṡ.
        coefficients: (T, n, M) of `expand`.
        disturbance: (T, n, n) D.
    """
    cubic, quartic = higher_forms(S, coefficients)
    _, back = to_ball(S)
    quadratic = quadratic_form(S, slopes, coefficients)
    quadratic = np.swapaxes(back, 1, 2) @ quadratic @ back + disturbance
    return quadratic, cubic, quartic


def scale_funnel(
    times: np.ndarray,
    S: np.ndarray,
    growth_of: Callable[[np.ndarray], np.ndarray],
    room_of: Callable[[np.ndarray], np.ndarray],
    margin: float,
) -> np.ndarray:
    """Returns S (T, n, n) scaled so that V̇/V stays below zero on its boundary.

    Args:
        times: (T,) [s].
        S: (T, n, n) the shapes.
        growth_of: from S to the largest V̇/V at and around the times, (T,) [1/s].
        room_of: from S to the largest ρ (T,) that the servo allows.
        margin: to be left, up to ENOUGH of it [1/s].
    """
    for turn in range(ROUNDS):
        growth, room = growth_of(S), room_of(S)
        if growth.max() <= -ENOUGH * margin and room.min() >= 1.0 - 1e-9:
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
