"""A loop whose clock knows nothing of the launch: a funnel for each of its phases.

Commands are held for a period h. The first begins to act at some time t₁ after the
launch, from T - h to T: T is h and the latency, and the phase of the clock decides. A
launch funnel, 0 <= t <= T, is of the flight before, in which no command moves the
elevator. From t₁ on the flight is in one of the funnels of held commands, whose times
count from t₁.

Theorem. Let each funnel be proven as `glider.verification.proof` has it, and let
`phase_faults` find nothing. Then every flight that starts in the launch funnel's inlet
is, whatever t₁, in the inlet of a funnel of held commands when its first command begins
to act; under that one's feedback it stays inside, and ends in the goal.

Proof. At t₁ the flight is in E(t₁) of the launch funnel, x₀ + e with eᵀ S e <= 1. With
d = x₀ - c, this lies in the inlet of center c and matrix S_j if, for some λ >= 0,
     λ S - S_j     -S_j d
     -dᵀ S_j       1 - λ - dᵀ S_j d
is positive definite: 1 - (d + e)ᵀ S_j (d + e) > λ (1 - eᵀ S e) >= 0. On each interval
of the launch funnel from T - h on, the matrix is a polynomial in time of degree 6, and
definite throughout, in exact arithmetic, for one j and λ. The funnel that has the least
V at t₁ need not be that j, but V <= 1 in it too: a loop need not know when it was
launched.
"""

import dataclasses
from collections.abc import Sequence
from fractions import Fraction

import numpy as np
import scipy.optimize

from glider.errors import expect
from glider.physics.model import model_text
from glider.planning.problem import PerchingProblem
from glider.verification.funnel.funnel import Funnel
from glider.verification.proof.interval import stays_definite
from glider.verification.proof.purpose import launch_faults
from glider.verification.sos.exact import exact, hermite, rounded

MULTIPLIER_BITS = 20
"""Binary places of λ, which is below 1. Any that is not negative is right."""

GRID_ROOM = 1e-9
"""Time by which the launch funnel's times may miss the earliest command [s]."""


def phase_faults(
    launch: Funnel, rests: Sequence[Funnel], problem: PerchingProblem | None = None
) -> list[str]:
    """Returns why funnels are not one loop at any phase of its clock, in sentences.

    Args:
        launch: of the flight until the first command acts.
        rests: of held commands, from then on.
        problem: whose launch the first must have; any if None.

    Raises:
        InputError: there is none for held commands.
    """
    expect(len(rests) > 0, "the phases' funnels", len(rests), "at least one")
    nominal, periods = launch.nominal, sorted({own.settings.period for own in rests})
    if any(model_text(own.nominal.model) != model_text(nominal.model) for own in rests):
        return ["The funnels are of different gliders."]
    if any(own.gliders for own in (launch, *rests)):
        return ["A funnel is of a set of gliders; expected one glider for any phase."]
    if periods[0] == 0.0 or len(periods) > 1:
        found = ", ".join(f"{1e3 * period:g}" for period in periods)
        return [
            f"The phases' funnels are for commands held for {found} ms; expected one "
            "period for all."
        ]
    faults = launch_faults(launch, problem) if problem else []
    if launch.settings.period or nominal.inputs.any() or nominal.gains.any():
        faults.append(
            "The launch's funnel commands the elevator before the clock does."
        )
    if first_commands(launch, rests)[0] < -GRID_ROOM:
        faults.append(
            f"The launch's funnel ends after {1e3 * nominal.times[-1]:g} ms, but the "
            f"first command may act {1e3 * periods[0]:g} ms after the launch."
        )
    for k in phase_intervals(launch, rests):
        if not faults and not any(
            is_inside(launch.between(k, k + 1), own) for own in rests
        ):
            first, last = 1e3 * nominal.times[k : k + 2]
            faults = [
                f"A flight whose first command acts {first:.4g} to {last:.4g} ms after "
                "the launch is not proven to be in any of the phases' funnels."
            ]
    return faults


def launched_at(problem: PerchingProblem, state: np.ndarray) -> PerchingProblem:
    """Returns the problem of a flight from another state (n,) on."""
    return dataclasses.replace(problem, launch=state[: len(problem.launch)].tolist())


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
    """Determines whether all sets of an interval are in another's inlet, for sure."""
    nominal, n = piece.nominal, piece.num_states
    first, last = map(exact, nominal.times)
    try:
        S, _ = hermite(piece.S, piece.slopes, last - first)
        path, _ = hermite(nominal.states, nominal.slopes, last - first)
        away, inlet = path - exact(rest.nominal.states[0]), exact(rest.S[0])
        multiplier = rounded(_multiplier(S, away, rest.S[0]), MULTIPLIER_BITS)
    except (np.linalg.LinAlgError, OverflowError, ValueError):
        return False
    own, one = exact(np.eye(n, n + 1)), exact(np.eye(n + 1)[[n]])
    reach = own + away[:, None] @ one
    left = (own.T @ S @ own - one.T @ one) * multiplier
    return stays_definite(left + one.T @ one - reach.T @ inlet @ reach)


def _multiplier(S, away, inlet):
    """Returns the λ that leaves most at both ends and in the middle, nearly."""
    n, R = len(inlet), np.linalg.cholesky(inlet).T
    R_inv, one = np.linalg.inv(R), np.diag([0.0] * n + [1.0])
    sets, rests = [], []
    for share in (Fraction(0), Fraction(1, 2), Fraction(1)):
        reach = np.hstack([np.eye(n), R @ away.at(share).to_float()[:, None]])
        rests.append(one - reach.T @ reach)
        sets.append(np.pad(R_inv.T @ S.at(share).to_float() @ R_inv, (0, 1)) - one)

    def lacking(multiplier):
        left = multiplier * np.array(sets) + rests
        return -np.linalg.eigvalsh(left).min()

    return scipy.optimize.minimize_scalar(lacking, bounds=(0.0, 1.0)).x
