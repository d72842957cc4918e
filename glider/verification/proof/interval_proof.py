"""The proof that no flight leaves a funnel between two of its times.

In this order, up to the first that fails: the servo follows its command, |R| <= β, and
V falls on the boundary. Where one fails, V̇ of the full dynamics, without the servo's
limits, is climbed on the boundary at a few times: where it is positive, flights leave;
else the certificate may be too weak to prove that none does.
"""

import dataclasses

import numpy as np
from threadpoolctl import threadpool_limits

from glider.verification.dynamics.defect import defect_bounds
from glider.verification.dynamics.nominal import nonlinear_parts, open_loop_rates
from glider.verification.dynamics.taylor_models import WIDER
from glider.verification.funnel.funnel import Funnel
from glider.verification.funnel.growth import climb_sphere
from glider.verification.proof.exact_check import proven_slack
from glider.verification.proof.interval import (
    Interval,
    keeps_servo,
    make_interval,
    stays_definite,
)
from glider.verification.proof.interval_gliders import gliders_defect, unproven_numbers
from glider.verification.proof.interval_growth import prove_growth
from glider.verification.proof.remainder_proof import BUDGET, prove_remainder
from glider.verification.sos.exact import exact
from glider.verification.sos.forms import to_ball
from glider.verification.sos.sphere import normalized, sphere


@dataclasses.dataclass(frozen=True, kw_only=True)
class IntervalProof:
    """The outcome of a proof on one interval; its fields are keys in a file.

    Attributes:
        fault: reason why nothing is proven, a clause; empty where all is.
        boxes: number of boxes on which the remainder was bounded.
        parts: number of parts of the interval in which V was proven to fall.
        ratio: largest |R| / β that was seen.
    """

    fault: str = ""
    boxes: int = 0
    parts: int = 0
    ratio: float = 0.0

    @property
    def proven(self) -> bool:
        """Whether no flight leaves the sets of this interval."""
        return not self.fault


@threadpool_limits.wrap(limits=1, user_api="blas")  # Small matrices.
def prove_interval(piece: Funnel, budget: int = BUDGET) -> IntervalProof:
    """Tries to prove that no flight leaves a funnel of two times between them.

    Args:
        piece: the funnel, as `Funnel.between` makes it.
        budget: boxes, until the search for a bound of the remainder gives up.
    """
    try:
        return _prove(piece, budget)
    except (np.linalg.LinAlgError, OverflowError, ValueError):
        # Of what floating point has to propose.
        return IntervalProof(fault="its numbers are too large, or its sets too flat")


def _prove(piece, budget):
    if not piece.beta.any():
        return IntervalProof(fault="the certificate accounts for no remainder")
    if np.any((piece.beta > 0.0) & (piece.weights == 0.0)):
        return IntervalProof(fault="a weight of the remainder is zero")
    if unproven_numbers(piece):
        return IntervalProof(fault="a linear rate depends on a number that deviates")
    interval = make_interval(piece)
    if not stays_definite(interval.S):
        return IntervalProof(fault="a set is not an ellipsoid")
    if not keeps_servo(interval):
        return IntervalProof(fault="the servo would meet its limits")
    defect = linear_defect(piece, interval)
    if not np.isfinite(defect):
        return IntervalProof(fault="the nominal's defect is not bounded")
    remainder = prove_remainder(piece, interval, budget)
    found = IntervalProof(boxes=remainder.boxes, ratio=remainder.ratio)
    if not remainder.proven:
        fault = (
            f"the remainder is {remainder.ratio:.4g} times its bound"
            if remainder.ratio > 1.0
            else f"the remainder was not bounded on {remainder.boxes:,} boxes"
        )
        return dataclasses.replace(found, fault=fault)
    slack = proven_slack(piece) + defect
    parts = prove_growth(interval, exact(slack), _gram_guesses(piece, slack))
    if parts is None:
        fault = "V was not proven to fall on the boundary"
        return dataclasses.replace(found, fault=fault)
    return dataclasses.replace(found, parts=parts)


def linear_defect(piece: Funnel, interval: Interval) -> float:
    """Returns what the defect in the rates that are linear adds to V̇/V.

    It is the nominal's and that of the gliders' centers; that of the other rates is in
    R. It is 2 √(δᵀ |S| δ), rounded up, with the largest of Bernstein's coefficients of
    S [1/s].
    """
    delta = defect_bounds(piece.nominal)[0] + gliders_defect(piece)
    delta[nonlinear_parts(piece.nominal.model)[1]] = 0.0
    largest = np.abs(interval.S.bernstein()).max(axis=0)
    return float(2.0 * np.sqrt(delta @ largest @ delta) * WIDER)


def _gram_guesses(piece, slack):
    """Returns the Gram matrices of -V̇/V - slack at both times, in b(e)."""
    tables = sphere(piece.num_states)
    # On the boundary bᵀ b = 2.
    less = 0.5 * slack * np.eye(tables.size)
    turns = map(tables.substitution, to_ball(piece.S)[0])
    first, last = (
        turn.T @ (gram - less) @ turn
        for turn, gram in zip(turns, tables.matrix(piece.grams), strict=True)
    )
    return first, last


TIMES = 9
"""Times of the interval that are sampled."""

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
    """Returns the worst state and time that were found on the boundary."""
    nominal, n = piece.nominal, piece.num_states
    times = np.linspace(nominal.times[0], nominal.times[1], TIMES)
    shares = np.linspace(0.0, 1.0, TIMES)
    here = [nominal.between(share) for share in shares]
    inputs = np.concatenate([one.inputs for one in here])
    gains = np.concatenate([one.gains for one in here])
    centers, drift = nominal.path(times), nominal.path(times, 1)
    S, slopes = piece.curve(times), piece.curve(times, 1)
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
