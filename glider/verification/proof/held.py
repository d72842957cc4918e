"""The proof that held commands are the funnel's feedback, but for its command error.

A command u₀ - K e + d, |d| <= the settings' command error, acts from a sample on and is
held. As long as it acts it differs from u₀ - K(t) e(t) by a q with
    q̇ = K̇ e + K (P + R + d + G (q, w)),  P of e,
and q = d at the sample, if u₀ is constant and K continuous. The gains of the file make
the linear part of K̇ e + K P vanish (`glider.verification.funnel.clock`) at its times.
In between they are straight lines; the proof follows the cubic polynomials with those
slopes instead, and adds what the two differ by. With e = B z, |z| <= 1 on the interval,
all parts are polynomials in z and time, exactly; norms of their Bernstein coefficients
bound them; where |q̇| <= a + b |q|, |q| grows to (|q| + a t) exp(b t) at most in a time
t. So |q| <= κ, the file's `errors`, until a state leaves the funnel, which
with |q| <= κ none does.
"""

import dataclasses

import numpy as np

from glider.verification.dynamics.defect import defect_bounds
from glider.verification.dynamics.taylor_models import WIDER
from glider.verification.funnel.clock import hold_starts
from glider.verification.funnel.funnel import Funnel
from glider.verification.proof.interval import covers, make_interval, tight_cover
from glider.verification.proof.interval_growth import pulled_forms
from glider.verification.sos.exact import (
    InTime,
    exact,
    hermite,
    is_positive_definite,
    line,
    rounded,
)
from glider.verification.sos.forms import linear_part, spread_form

BASIS_BITS = 30
"""Binary places of the basis B. Any are right; few are fast."""

PERIOD_ROUNDING = 1e-9
"""Time by which the samples in a file may be off the clock's [s]."""


def held_faults(funnel: Funnel) -> list[str]:
    """Returns why held commands are not proven to be the feedback, a sentence each.

    Where the feedback acts at all times there is nothing to prove.
    """
    settings, nominal = funnel.settings, funnel.nominal
    if np.any(funnel.errors < settings.command_error):
        return ["The command's error is smaller than the settings' somewhere."]
    if not settings.period:
        return []
    times, starts = nominal.times, hold_starts(nominal.times)
    clock = settings.period * np.arange(len(np.unique(starts)))
    ends = [*times[np.unique(starts)], times[-1]]
    if np.any(np.abs(ends[:-1] - clock) > PERIOD_ROUNDING) or (
        ends[-1] - clock[-1] > settings.period + PERIOD_ROUNDING
    ):
        return [f"The samples are not {settings.period:g} s apart."]
    if np.any(nominal.inputs != nominal.inputs[starts]):
        return ["The nominal's commands are not held."]
    for k in np.flatnonzero(np.diff(times) == 0.0):
        if not is_positive_definite(exact(funnel.S[k]) - exact(funnel.S[k + 1])):
            return [f"The set after the sample at {times[k]:.4f} s is not larger."]
    error = settings.command_error
    for k in nominal.flows:
        before = settings.command_error if starts[k] == k else error
        error, bend = _error_after(funnel.between(k, k + 1), before)
        allowed = funnel.errors[k : k + 2]
        if not (before + bend <= allowed[0] and error + bend <= allowed[1]):
            return [
                f"The held command may be {error + bend:.3g} rad/s off the feedback at "
                f"{times[k + 1]:.4f} s; the funnel allows {allowed[1]:.3g} rad/s."
            ]
    return []


@np.errstate(all="ignore")
def _error_after(piece: Funnel, before: float) -> tuple[float, float]:
    """Returns bounds of |q| of the cubic gains at the end, and of what they differ.

    Infinity where nothing is proven.
    """
    nominal, n = piece.nominal, piece.num_states
    interval, step = make_interval(piece), np.diff(nominal.times)[0]
    whole = InTime((exact(np.eye(n)),))
    states = dataclasses.replace(interval, outputs=whole, which=list(range(n)))
    basis = tight_cover(states)[0]
    B = rounded(basis * (1.0 + 2.0**-20), BASIS_BITS)
    if not covers(states, B.to_float()):
        return np.inf, np.inf
    slopes = -np.einsum("ti,tij->tj", nominal.gains, linear_part(nominal.closed_loop))
    gains, rise = hermite(nominal.gains, slopes, interval.step)
    gains, rise = gains[None], rise[None]
    linear = rise @ B + interval.step * (
        gains @ (interval.linear @ interval.outputs @ B)
    )
    total = _size(linear[0], n, 1) / step
    for degree, form in enumerate(pulled_forms(interval, B, gains.T, 0), start=2):
        total += _size(form, n, degree)
    wide, K = np.abs(B.to_float()), np.abs(gains.bernstein()).max(axis=0)[0]
    bend = np.linalg.norm(wide.T @ np.abs(piece.focus).max(axis=0) @ wide)
    total += K @ (piece.beta.max(axis=0) * (1.0 + bend) + defect_bounds(nominal)[0])
    pulls = np.zeros(3)  # Of q, and of the wind's parts.
    for k in range(3):
        along = (gains @ interval.push_slopes[:, k]).bernstein()[:, 0]
        bend = np.linalg.norm(along[:, 1:] @ B.to_float(), axis=1)
        pulls[k] = (np.abs(along[:, 0]) + bend).max()
    apart = _size(((gains - line(*nominal.gains)[None]) @ B)[0], n, 1)
    total += pulls @ [apart, piece.settings.wind, piece.settings.wind]
    return (before + step * total) * np.exp(step * pulls[0]) * WIDER, apart * WIDER


def _size(form, n, degree):
    """Returns a bound of |form(z)| for |z| <= 1 at all times."""
    tensors = (spread_form(part, n, degree) for part in form.bernstein())
    if degree == 2:
        return max(np.linalg.norm(tensor, 2) for tensor in tensors)
    return max(np.linalg.norm(tensor.ravel()) for tensor in tensors)
