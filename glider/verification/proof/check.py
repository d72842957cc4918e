"""The check of a funnel's certificate, exactly and without a solver.

`purpose`: the funnel is one of the intended problem and glider. `dynamics.defect`: its
nominal is a flight, or nearly. `held`: what commands that are held are off by.
`interval_proof`: V falls on the boundary at all times, for the third-order dynamics and
any remainder within its bound. Then, in floating point, ascent from new random points
finds no larger remainder; `flight_proof` proves that there is none.
"""

import dataclasses
import functools
import secrets

import numpy as np
from threadpoolctl import threadpool_limits

from glider.errors import InputError
from glider.progress import Shares, silent
from glider.verification.dynamics.defect import defect_bounds, defect_growth
from glider.verification.dynamics.moving_center import make_moving_center
from glider.verification.funnel.funnel import Funnel
from glider.verification.funnel.remainder import (
    LEAST_REMAINDER,
    SAMPLES,
    sample_remainder,
)
from glider.verification.funnel.servo_limits import goal_about
from glider.verification.proof.held import held_faults
from glider.verification.proof.interval_proof import (
    each_interval,
    prove_interval,
    proven_slack,
    some_intervals,
)
from glider.verification.proof.purpose import Purpose, unmet
from glider.verification.sos.exact import exact, is_positive_definite
from glider.verification.sos.sphere import normalized

_ANY = Purpose()
"""Any purpose."""

_GOAL_ROUNDING = 1e-9
"""Share by which S(T) may be below the goal's: where they are equal, as in the shipped
funnels, their difference is not definite."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Verdict:
    """The outcome of a funnel's check; its fields are keys of `check-funnel --json`."""

    intervals: int  #: Number of intervals that were checked exactly.
    of_intervals: int  #: Number of intervals that the funnel has.
    #: Faults of the certificate, a sentence each; empty where it holds. Where the
    #: funnel is not the intended one, or not a flight, nothing else is checked.
    faults: tuple[str, ...]
    slack: float  #: Slack of V̇ <= -slack V, which is proven on these intervals [1/s].
    defect: float  #: Largest V̇/V by the nominal's defect, which is counted [1/s].
    #: Largest |R_k| / β_k found by ascent at their times; infinite where only β_k is
    #: zero; zero where the certificate accounts for no remainder at all.
    remainder_seen: float
    seed: int  #: Seed of the points where the ascents start.
    #: Level of the model's set of gliders that the funnel's contains; None where there
    #: is no set, or none to compare it with.
    set_level: float | None = None

    @property
    def holds(self) -> bool:
        """Whether nothing is wrong."""
        return not self.faults

    @property
    def is_whole(self) -> bool:
        """Whether all intervals were checked."""
        return self.intervals == self.of_intervals


@threadpool_limits.wrap(limits=1, user_api="blas")  # Small matrices.
@np.errstate(all="ignore")  # What is infinite or NaN holds nothing.
def check_funnel(
    funnel: Funnel,
    every: int = 1,
    *,
    purpose: Purpose = _ANY,
    seed: int | None = None,
    workers: int = -1,
    progress: Shares = silent,
) -> Verdict:
    """Checks a funnel.

    Args:
        every: check every so many intervals only, the first and last included.
        purpose: what it must be good for.
        seed: of the points where ascents start; one that no file can know if None.
        workers: processes; as many as there are cores if -1.
        progress: called with the share that is done, of held commands, then of
            intervals.
    """
    wanted = some_intervals(funnel, every)
    growth = defect_growth(funnel.S, defect_bounds(funnel.nominal))
    seed = secrets.randbits(32) if seed is None else seed
    faults = purpose.faults_of(funnel) + _defect_faults(funnel, growth)
    faults = faults or held_faults(funnel, progress)
    level = None
    if purpose.covariance and funnel.is_of_set:
        level = purpose.set_level(funnel.allowed)
    seen = 0.0
    if not faults:
        faults = _certificate_faults(funnel, wanted, workers, progress)
    if not faults and funnel.beta.any():
        at = np.unique([[k, k + 1] for k in wanted]).tolist()
        seen = remainder_seen(funnel, at, np.random.default_rng(seed))
        words = f"The remainder is {seen:.3g} times its bound."
        faults = unmet((seen <= 1.0, words))
    return Verdict(
        intervals=len(wanted),
        of_intervals=len(funnel.nominal.flows),
        faults=tuple(faults),
        slack=proven_slack(funnel),
        defect=float(growth.max()),
        remainder_seen=seen,
        seed=seed,
        set_level=level,
    )


def _defect_faults(funnel, growth):
    """Returns whether the nominal is no flight, given the growth (T,) by its defect."""
    worst = int(np.argmax(growth))
    margin = funnel.settings.margin
    words = "The nominal is not a flight: its defect makes V̇/V as large as"
    where = f"{growth[worst]:.2g} 1/s at {funnel.nominal.times[worst]:.4f} s"
    fault = f"{words} {where}; the margin is {margin:.2g} 1/s."
    return unmet((growth[worst] <= margin, fault))


def _certificate_faults(funnel, wanted, workers, progress):
    """Returns the first interval whose certificate does not hold, and of the goal."""
    faults = []
    times = funnel.nominal.times
    prove = functools.partial(prove_interval, remainder=False)
    for k, found in each_interval(prove, funnel, wanted, workers, progress):
        if not found.proven:
            when = f"from {times[k]:.4f} to {times[k + 1]:.4f} s."
            faults.append(f"{found.fault[0].upper()}{found.fault[1:]} {when}")
            break
    where = " about every glider's center" if funnel.is_of_set else ""
    outside = f"The last set is not within the goal{where}."
    return faults + unmet((_within_goal(funnel), outside))


def _within_goal(funnel):
    """Returns whether the last set is in the goal, about the center of every glider.

    That is to _GOAL_ROUNDING; where the centers end is in floating point.
    """
    axes = funnel.settings.goal_axes(funnel.num_states)
    try:
        needed = goal_about(axes, funnel.gliders)
        goal = exact(needed * (1.0 - _GOAL_ROUNDING))
        return is_positive_definite(exact(funnel.S[-1]) - goal)
    except (InputError, ValueError):  # The centers alone leave it.
        return False


def remainder_seen(funnel: Funnel, at: list[int], rng: np.random.Generator) -> float:
    """Returns the largest |R_k| / β_k found at some times, also of a set's gliders."""
    pushes = funnel.pushes[at] if funnel.pushes.any() else None
    worst = 0.0
    centers = [funnel.gliders]
    if funnel.is_of_set:
        centers.insert(0, make_moving_center(funnel.nominal))
    for center in centers:
        total = funnel.num_states + center.confidence.dimension
        total += 0 if pushes is None else 3
        directions = normalized(rng.normal(size=(SAMPLES, total)))
        given = directions, np.array(at), center, funnel.focus[at], pushes
        found = sample_remainder(funnel.nominal, funnel.S[at], *given)
        with np.errstate(divide="ignore", invalid="ignore"):
            # What is no number counts.
            ratios = np.where(found <= LEAST_REMAINDER, 0.0, found / funnel.beta[at])
        worst = float(np.maximum(worst, ratios.max()))  # np's keep a NaN, max does not.
    return worst
