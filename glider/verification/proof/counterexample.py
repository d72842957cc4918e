"""Where a flight most likely leaves a funnel of two times: a state and a time.

V̇ of the full dynamics, the servo's limits apart, is climbed on the boundary at a few
times. Where it is positive, flights leave there; else the certificate may still be too
weak to prove that none does.
"""

import dataclasses

import numpy as np
from scipy.interpolate import CubicHermiteSpline

from glider.verification.dynamics.error_dynamics import open_loop_rates
from glider.verification.dynamics.nominal import nominal_between, nominal_path
from glider.verification.funnel.ascent import climb_sphere
from glider.verification.funnel.funnel import Funnel
from glider.verification.sos.forms import to_ball
from glider.verification.sos.sphere import normalized

TIMES = 9
"""Times of the interval that are looked at."""

STARTS = 200
"""Points where the climb starts at each of them."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Candidate:
    """A state on the boundary where V rises most, or falls least.

    Attributes:
        time: time [s].
        state: state (n,).
        growth: V̇/V of the full dynamics there [1/s].
    """

    time: float
    state: tuple[float, ...]
    growth: float


def worst_candidate(piece: Funnel) -> Candidate:
    """Returns the worst state and time that were found on the boundary.

    Args:
        piece: a funnel of two times.
    """
    nominal, n = piece.nominal, piece.num_states
    times = np.linspace(nominal.times[0], nominal.times[1], TIMES)
    shares = np.linspace(0.0, 1.0, TIMES)
    here = [nominal_between(nominal, share) for share in shares]
    inputs = np.concatenate([one.inputs for one in here])
    gains = np.concatenate([one.gains for one in here])
    path = nominal_path(nominal)
    centers, drift = path(times), path(times, 1)
    shape = CubicHermiteSpline(nominal.times, piece.S, piece.slopes)
    S, slopes = shape(times), shape(times, 1)
    turn = np.swapaxes(to_ball(S)[1], 1, 2)

    def growth(z):
        """Returns V̇ (TIMES, B) at points (TIMES, B, n) of the spheres."""
        e = z @ turn
        states = np.moveaxis(centers[:, None] + e, 2, 0)
        command = inputs[:, None] - np.einsum("tbi,ti->tb", e, gains)
        found = open_loop_rates(nominal.model, list(states), command)
        rates = np.stack([np.broadcast_to(r, e.shape[:2]) for r in found], axis=2)
        rise = 2.0 * np.einsum("tbi,tij,tbj->tb", e, S, rates - drift[:, None])
        return rise + np.einsum("tbi,tij,tbj->tb", e, slopes, e)

    starts = normalized(np.random.default_rng(0).normal(size=(STARTS, n)))
    starts = np.broadcast_to(starts, (TIMES, STARTS, n))
    values, points = climb_sphere(growth, starts)
    at, which = np.unravel_index(np.argmax(values), values.shape)
    state = centers[at] + points[at, which] @ turn[at]
    return Candidate(
        time=float(times[at]),
        state=tuple(map(float, state)),
        growth=float(values[at, which]),
    )
