"""The check of a funnel's certificate, exactly and without a solver.

`purpose`: the funnel is one of the intended problem and glider.
`glider.verification.dynamics.defect`: its nominal is a flight, or nearly.
`gliders_faults`: each glider of its set has margin about its own center.
`exact_check`: V falls on the boundary at each time, in exact arithmetic. Then, in
floating point: no remainder larger than β_k is seen, and V falls between the times too.
Both are proven, in continuous time, by `flight_proof`; the theorem is in
`glider.verification.proof`.
"""

import dataclasses
import math
from collections.abc import Callable

import numpy as np
import scipy.linalg
from threadpoolctl import threadpool_limits

from glider.physics.model import GliderModel
from glider.planning.problem import PerchingProblem
from glider.verification.dynamics.defect import defect_bounds, defect_growth
from glider.verification.dynamics.nominal import nonlinear_parts
from glider.verification.funnel.funnel import Funnel
from glider.verification.funnel.growth import SHARES, growth_between
from glider.verification.funnel.remainder import (
    LEAST_REMAINDER,
    remainder_of,
    split_directions,
)
from glider.verification.funnel.servo_limits import (
    goal_reach,
    margin_to_limits,
    servo_bounds,
)
from glider.verification.proof.exact_check import (
    GOAL_ROUNDING,
    exact_faults,
    proven_slack,
)
from glider.verification.proof.purpose import hook_faults, model_faults, problem_faults
from glider.verification.sos.forms import to_ball
from glider.verification.sos.sphere import normalized

SAMPLES = 1000
"""Points of the boundary where the remainder is sampled, at each time."""

SAMPLES_OF_SET = 4000
"""Points of the boundary, with a glider of the set's boundary each."""

STARTS = 8
"""Points where the ascent to the largest growth starts, besides the axes of its
quadratic part."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Verdict:
    """The outcome of a funnel's check; its fields are keys of `check-funnel --json`."""

    times: int  #: Number of times that were checked exactly.
    of_times: int  #: Number of times that the funnel has.
    #: Faults of the certificate, a sentence each; empty where it holds. Where the
    #: funnel is not the intended one, or not a flight, nothing else is checked.
    faults: tuple[str, ...]
    slack: float  #: Slack of V̇ <= -slack V, which is proven at these times [1/s].
    #: Largest V̇/V that the nominal's defect may make, which is counted [1/s].
    defect: float
    #: Largest change of an eigenvalue by what rounding and solver left over [1/s].
    rounding: float
    #: Largest |R_k| / β_k seen at these times, in floating point; infinite where β_k is
    #: zero and R_k is not; zero where the certificate accounts for no remainder at all.
    remainder_seen: float
    #: Largest V̇/V found between the times, in floating point [1/s]; infinite after any
    #: other fault.
    between: float

    @property
    def holds(self) -> bool:
        """Whether nothing is wrong."""
        return not self.faults

    @property
    def is_whole(self) -> bool:
        """Whether all times were checked."""
        return self.times == self.of_times


@threadpool_limits.wrap(limits=1, user_api="blas")  # Small matrices.
def check_funnel(
    funnel: Funnel,
    every: int = 1,
    progress: Callable[[float], None] | None = None,
    *,
    problem: PerchingProblem | None = None,
    model: GliderModel | None = None,
    hook: bool = False,
) -> Verdict:
    """Checks a funnel.

    Args:
        every: check every so many times only, the first and last included.
        progress: called with the share that is done.
        problem: the problem that it must be a funnel of; any if None.
        model: the glider that it must be a funnel of; any if None.
        hook: whether the problem's hook must accept every state of the last set.
    """
    last = len(funnel.nominal.times) - 1
    at = sorted({*range(0, last, every), last})
    growth = defect_growth(funnel.S, defect_bounds(funnel.nominal))
    faults = model_faults(funnel, model) if model else []
    faults += problem_faults(funnel, problem) if problem else []
    faults += hook_faults(funnel, problem) if hook and problem else []
    faults += _defect_faults(funnel, growth)
    faults += gliders_faults(funnel)
    rounding = seen = 0.0
    between = np.inf
    if not faults:
        faults, rounding = exact_faults(funnel, at, growth, progress)
    if not faults and funnel.beta.any():
        seen = remainder_seen(funnel, at)
        if not seen <= 1.0:
            faults.append(f"The remainder is {seen:.3g} times its bound.")
    if not faults:
        between = largest_between(funnel, growth, every)
        if not between < 0.0:
            faults.append(f"Between the times V̇/V reaches {between:.2g} 1/s.")
    return Verdict(
        times=len(at),
        of_times=len(funnel.nominal.times),
        faults=tuple(faults),
        slack=proven_slack(funnel),
        defect=float(growth.max()),
        rounding=rounding,
        remainder_seen=seen,
        between=between,
    )


def _defect_faults(funnel, growth):
    """Returns a fault where the nominal's defect alone exceeds the margin."""
    worst = int(np.argmax(growth))
    if growth[worst] <= funnel.settings.margin:
        return []
    return [
        "The nominal is not a flight: its defect makes V̇/V as large as "
        f"{growth[worst]:.2g} 1/s at {funnel.nominal.times[worst]:.4f} s; the margin "
        f"is {funnel.settings.margin:.2g} 1/s."
    ]


def remainder_seen(funnel: Funnel, at: list[int]) -> float:
    """Returns the largest |R_k| / β_k at random points of the boundary at some times.

    For a funnel of a set of gliders, it is R of random ones on the set's boundary too.
    """
    nominal, n, center = funnel.nominal, funnel.num_states, funnel.gliders
    ratios, rng = [0.0], np.random.default_rng(0)
    points = normalized(rng.normal(size=(SAMPLES, n)))
    _, rows = nonlinear_parts(nominal.model)
    trials: list[tuple] = [(None, points, rows)]
    if center:
        names, r = center.confidence.names, center.confidence.dimension
        _, rows = nonlinear_parts(nominal.model, names)
        more = rng.normal(size=(SAMPLES_OF_SET, n + r))
        trials.append((center, normalized(more), rows))
    for k in at:
        L_inv = to_ball(funnel.S[k])[1].T[None]
        for about, directions, of in trials:
            errors, deviations = split_directions(
                nominal, about, L_inv, directions[None]
            )
            found = remainder_of(nominal, np.array([k]), errors, about, deviations)
            largest = np.abs(found[0]).max(axis=0)[of]
            counts = ~(largest <= LEAST_REMAINDER)  # What is no number counts.
            with np.errstate(divide="ignore"):
                ratios.extend((largest / funnel.beta[k, of])[counts])
    return float(np.max(ratios))  # np.max keeps a NaN, max does not.


def largest_between(funnel: Funnel, defect: np.ndarray, every: int = 1) -> float:
    """Returns the largest V̇/V found between the times, by ascent [1/s].

    It includes growth (T,) by the nominal's defect [1/s], and is infinite where a set
    between them is no ellipsoid.
    """
    rng = np.random.default_rng(0)
    starts = normalized(rng.normal(size=(STARTS, funnel.num_states)))
    around = np.maximum(defect[:-1], defect[1:])[::every]
    try:
        found = [growth_between(funnel, share, starts, every) for share in SHARES]
    except np.linalg.LinAlgError:
        return np.inf
    return float(np.max(np.array(found) + around))


def gliders_faults(funnel: Funnel) -> list[str]:
    """Returns why a funnel cannot be of its set of gliders, a sentence each.

    In floating point: at its times the servo does not meet its limits about any
    glider's center, and the last set is in the goal about each.
    """
    if not funnel.gliders:
        return []
    faults = []
    directions, bounds = servo_bounds(funnel.nominal, funnel.gliders, shrink=1.0)
    try:
        reach = margin_to_limits(funnel.S, directions, bounds)
        met = ~((reach >= 1.0) & np.all(bounds > 0.0, axis=1))
        if np.any(met):
            faults.append(
                "The servo would meet its limits with gliders of the set, first at "
                f"{funnel.nominal.times[np.argmax(met)]:.4f} s."
            )
        axes = funnel.settings.goal_axes(funnel.num_states)
        largest = scipy.linalg.eigh(
            np.diag(1.0 / axes**2), funnel.S[-1], eigvals_only=True
        )[-1]
        end = math.sqrt(largest) + goal_reach(axes, funnel.gliders)
    except (np.linalg.LinAlgError, ValueError):
        return ["The set is not an ellipsoid somewhere."]
    if not end <= 1.0 + GOAL_ROUNDING:
        faults.append(
            "The last set is not within the goal about every glider's center: it "
            f"reaches {end:.4g} times as far."
        )
    return faults
