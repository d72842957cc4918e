"""Held and late commands, as an error of the continuous feedback's.

The feedback's command is c(t, x) = u₀ - K (x - x₀). Along a flight in the funnel
    ċ = u̇₀ - K̇ e - K (P + R + d + G q),  P of e,
d the nominal's defect and q the pushes. If |ċ| <= ρ on the sets of each interval, a
command that was computed at a time s differs at t from the feedback's by at most
|t - s| max ρ. One that is computed from the state a latency L
before it acts, and is held for h, is then off by (h + L) max ρ at most, whatever the
phase of its clock. Until the first that a sample gave acts, that of the launch does.

With e = B z, |z| <= 1 on the interval, the parts of K P are polynomials in z and time,
exactly; norms of their Bernstein coefficients bound them.
"""

import dataclasses

import numpy as np

from glider.errors import expect
from glider.verification.dynamics.defect import defect_bounds
from glider.verification.dynamics.taylor_models import WIDER
from glider.verification.funnel.funnel import Funnel
from glider.verification.funnel.growth import PUSHES
from glider.verification.proof.interval import covers, make_interval, tight_cover
from glider.verification.proof.interval_growth import pulled_forms
from glider.verification.sos.exact import InTime, exact, line, rounded
from glider.verification.sos.forms import spread_form

BASIS_BITS = 30
"""Binary places of the basis B. Any are right; few are fast."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class HeldCommands:
    """What of a funnel's command error held and late commands take."""

    hold: float  #: h [s].
    latency: float  #: L [s].
    rates: np.ndarray  #: Bounds ρ (T - 1,) of the command's rate [rad/s²].
    largest: float  #: (h + L) max ρ [rad/s].
    left: float  #: What is left of the command error that is tolerated [rad/s].


def command_rates(funnel: Funnel) -> np.ndarray:
    """Returns ρ (T - 1,) of all intervals [rad/s²]; infinite where none is proven."""
    count = len(funnel.nominal.times) - 1
    return np.array([_rate(funnel.between(k, k + 1)) for k in range(count)])


def held_commands(
    funnel: Funnel, hold: float, latency: float, rates: np.ndarray
) -> HeldCommands:
    """Returns what is left of a funnel's command error besides held, late commands.

    Args:
        hold: time that a command is held [s].
        latency: time from a state to the command that acts on it [s].
        rates: of `command_rates`.
    """
    delay = hold + latency
    expect(0.0 < delay < np.inf, "hold and latency", delay, "a positive time in all")
    largest = float(delay * rates.max() * WIDER)
    return HeldCommands(
        hold=hold,
        latency=latency,
        rates=rates,
        largest=largest,
        left=funnel.settings.command_error - largest,
    )


@np.errstate(all="ignore")
def _rate(piece):
    """Returns ρ of a funnel of two times; for a set of gliders none is known."""
    nominal, n = piece.nominal, piece.num_states
    if piece.gliders is not None:
        return np.inf
    interval, ends = make_interval(piece), nominal.gains
    whole = InTime((exact(np.eye(n)),))
    states = dataclasses.replace(interval, outputs=whole, which=list(range(n)))
    basis = tight_cover(states)[0]
    B = rounded(basis * (1.0 + 2.0**-20), BASIS_BITS)
    if not covers(states, B.to_float()):
        return np.inf
    gains, step = line(*ends)[None], interval.step
    turn = exact(ends[1]) - exact(ends[0])
    linear = turn[None] @ B + step * (gains @ (interval.linear @ interval.outputs @ B))
    total = np.abs(np.diff(nominal.inputs))[0] + _size(linear[0], n, 1)
    total /= float(step.to_float())
    for degree, form in enumerate(pulled_forms(interval, B, gains.T, 0), start=2):
        total += _size(form, n, degree)
    wide, K = np.abs(B.to_float()), np.abs(ends).max(axis=0)
    bend = np.linalg.norm(wide.T @ np.abs(piece.focus).max(axis=0) @ wide)
    total += K @ (piece.beta.max(axis=0) * (1.0 + bend) + defect_bounds(nominal)[0])
    for k, size in enumerate(piece.settings.pushes[PUSHES]):
        along = (gains @ interval.push_slopes[:, k]).bernstein()[:, 0]
        bend = np.linalg.norm(along[:, 1:] @ B.to_float(), axis=1)
        total += size * (np.abs(along[:, 0]) + bend).max()
    return float(total * WIDER) if np.isfinite(total) else np.inf


def _size(form, n, degree):
    """Returns a bound of |form(z)| for |z| <= 1 at all times."""
    tensors = (spread_form(part, n, degree) for part in form.bernstein())
    if degree == 2:
        return max(np.linalg.norm(tensor, 2) for tensor in tensors)
    return max(np.linalg.norm(tensor.ravel()) for tensor in tensors)
