"""A loop whose clock knows nothing of the launch: a funnel for each of its phases.

docs/certificate.md has the theorem: where each funnel is proven and `phase_faults`
finds nothing, every flight from the launch funnel's inlet is in that of a funnel of
held commands, with V <= LEVEL, when its first command begins to act, at any time t₁
from T - h to T. T is what the launch funnel lasts, h the period, T - h the latency.

Its set at t₁, x₀ + e with eᵀ S e <= 1, is in that inlet, of center c and matrix S_j, if
with d = x₀ - c, for some λ >= 0,
     λ S - S_j     -S_j d
     -dᵀ S_j       LEVEL - λ - dᵀ S_j d
is positive definite: LEVEL - (d + e)ᵀ S_j (d + e) > λ (1 - eᵀ S e) >= 0. The center of
a set's glider has moved by X δ: where √((X δ)ᵀ S_j X δ) <= ρ, LEVEL - 2 ρ is in its
place.

A loop chooses the funnel i in which the predicted state x̂ has the least V. √V_k(x̂) is
within PREDICTED of √V_k(x), for all k (`glider.verification.proof.latency`). Then
    √V_i(x) <= √V_i(x̂) + PREDICTED <= √V_j(x̂) + PREDICTED <= √LEVEL + 2 PREDICTED <= 1.
"""

from collections.abc import Sequence
from fractions import Fraction

import numpy as np
import scipy.optimize

from glider.errors import expect
from glider.planning.constraints import constraints_of
from glider.planning.problem import PerchingProblem
from glider.verification.funnel.funnel import Funnel
from glider.verification.proof.interval import stays_definite
from glider.verification.proof.purpose import (
    launch_faults,
    model_faults,
    path_faults,
    unmet,
)
from glider.verification.sos.exact import exact, hermite, rounded

LEVEL = 0.98
"""Largest V at which flights begin in a funnel of held commands: 0.99² at most."""

_WIDENED = 1e-9
"""Rounding allowance on a sampled bound of √V."""

PREDICTED = 0.005
"""Largest error of √V of a predicted state, in any of the inlets."""

_MULTIPLIER_BITS = 20
"""Binary places of λ, which is below 1. Every λ >= 0 is valid."""

GRID_ROOM = 1e-9
"""Time by which the launch funnel's times may miss the earliest command [s]."""


def phase_faults(
    launch: Funnel,
    rests: Sequence[Funnel],
    problem: PerchingProblem | None = None,
    latency: float | None = None,
) -> list[str]:
    """Returns the reasons why funnels are not one loop at any phase, in sentences.

    Args:
        launch: of the flight until the first command acts.
        rests: of held commands, from then on.
        problem: whose launch the first must have; any if None.
        latency: time from a sample to its command; any if None [s].

    Raises:
        InputError: there is none for held commands.
    """
    expect(len(rests) > 0, "the phases' funnels", len(rests), "at least one")
    nominal = launch.nominal
    periods = sorted({own.settings.period for own in rests})
    for own in rests:
        if faults := model_faults(own, nominal.model):
            return faults
    if not all(own.allowed.is_same(launch.allowed) for own in rests):
        return ["The phases' funnels are of different sets of gliders; expected one."]
    if periods[0] == 0.0 or len(periods) > 1:
        found = ", ".join(f"{1e3 * period:g}" for period in periods)
        words = f"The phases' funnels are for commands held for {found} ms; expected "
        return [f"{words}one period for all."]
    commands = nominal.inputs, nominal.gains, nominal.bends, launch.settings.period
    earliest, end = first_commands(launch, rests)
    first = 1e3 * earliest
    last = 1e3 * end
    period = 1e3 * periods[0]
    wanted = earliest if latency is None else latency
    faults = _problem_faults(launch, rests, problem) if problem else []
    faults += unmet(
        (
            not any(np.any(values) for values in commands),
            "The launch's funnel commands the elevator before the clock does.",
        ),
        (
            earliest >= -GRID_ROOM,
            f"The launch's funnel ends after {last:g} ms, but the first command may "
            f"act {period:g} ms after the launch.",
        ),
        (
            earliest < periods[0],
            f"The first command may act {first:g} ms after its sample; expected less "
            f"than the {period:g} ms between samples.",
        ),
        (
            abs(earliest - wanted) <= GRID_ROOM,
            f"The funnels are for a latency of {first:g} ms; expected "
            f"{1e3 * wanted:g} ms.",
        ),
    )
    for k in () if faults else phase_intervals(launch, rests):
        if not any(is_inside(launch.between(k, k + 1), own) for own in rests):
            first, last = 1e3 * nominal.times[k : k + 2]
            return [
                f"A flight whose first command acts {first:.4g} to {last:.4g} ms after "
                "the launch is not proven to be in any of the phases' funnels."
            ]
    return faults


def _problem_faults(launch, rests, problem):
    """Returns where the flight until the end is not the problem's, but for its end."""
    longest = launch.nominal.times[-1] + max(own.nominal.times[-1] for own in rests)
    most = constraints_of(problem).duration.high
    words = f"A flight may last {longest:.4f} s; the problem allows {most:.4g} s."
    faults = launch_faults(launch, problem) + path_faults(launch, problem)
    return faults + unmet((longest <= most, words))


def choose(rests: Sequence[Funnel], states: np.ndarray) -> np.ndarray:
    """Returns indices (...) of the funnels in which V of states (..., n) is least."""
    return np.argmin([own.level(0.0, states) for own in rests], axis=0)


def first_commands(launch: Funnel, rests: Sequence[Funnel]) -> tuple[float, float]:
    """Returns when the first command may begin to act, earliest and latest [s]."""
    end = float(launch.nominal.times[-1])
    return end - rests[0].settings.period, end


def phase_intervals(launch: Funnel, rests: Sequence[Funnel]) -> list[int]:
    """Returns the indices of the launch funnel's intervals in which that may be."""
    earliest, _ = first_commands(launch, rests)
    ends = launch.nominal.times[1:]
    return np.flatnonzero(ends > earliest + GRID_ROOM).tolist()


@np.errstate(all="ignore")
def is_inside(piece: Funnel, rest: Funnel) -> bool:
    """Determines whether in an interval's sets V of another inlet is at most LEVEL."""
    nominal = piece.nominal
    n = piece.num_states
    first, last = map(exact, nominal.times)
    try:
        S, _ = hermite(piece.S, piece.slopes, last - first)
        path, _ = hermite(nominal.states, nominal.slopes, last - first)
        away = path - exact(rest.nominal.states[0])
        inlet = exact(rest.S[0])
        level = LEVEL - 2.0 * _centers_reach(piece, rest.S[0])
        multiplier = rounded(_multiplier(S, away, rest.S[0], level), _MULTIPLIER_BITS)
        least = exact(level)
    except (np.linalg.LinAlgError, OverflowError, ValueError):
        return False
    own = exact(np.eye(n, n + 1))
    one = exact(np.eye(n + 1)[[n]])
    reach = own + away[:, None] @ one
    left = (own.T @ S @ own - one.T @ one) * multiplier
    left = left + one.T @ one * least - reach.T @ inlet @ reach
    return stays_definite(left)


def _centers_reach(piece, inlet):
    """Returns how far a set's centers move in an interval, as √V in another inlet."""
    allowed = piece.allowed
    gliders = piece.gliders
    if gliders is None or not allowed.dimension:
        return 0.0
    step = exact(piece.nominal.times[1]) - exact(piece.nominal.times[0])
    X, _ = hermite(gliders.shifts, gliders.slopes, step)
    moved = X @ exact(allowed.factor)
    R = np.linalg.cholesky(inlet).T
    widest = np.linalg.norm(R @ moved.bernstein(), 2, axis=(1, 2)).max() + _WIDENED
    square = exact(widest) * exact(widest) * exact(np.eye(allowed.dimension))
    if not stays_definite(square - moved.T @ exact(inlet) @ moved):
        return np.inf
    # Of v in a box, |v| is √r at most.
    return widest * allowed.dimension ** (0.5 if allowed.shape == "box" else 0.0)


def _multiplier(S, away, inlet, level):
    """Returns the λ that leaves most at both ends and in the middle, nearly."""
    n = len(inlet)
    R = np.linalg.cholesky(inlet).T
    R_inv = np.linalg.inv(R)
    one = np.diag([0.0] * n + [1.0])
    sets = []
    rests = []
    for share in (Fraction(0), Fraction(1, 2), Fraction(1)):
        reach = np.hstack([np.eye(n), R @ away.at(share).to_float()[:, None]])
        rests.append(level * one - reach.T @ reach)
        sets.append(np.pad(R_inv.T @ S.at(share).to_float() @ R_inv, (0, 1)) - one)

    def lacking(multiplier):
        left = multiplier * np.array(sets) + rests
        return -np.linalg.eigvalsh(left).min()

    return scipy.optimize.minimize_scalar(lacking, bounds=(0.0, 1.0)).x
