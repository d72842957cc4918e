"""The check of a funnel's certificate, exactly and without a solver.

`purpose`: the funnel is one of the intended problem and glider. `dynamics.defect`: its
nominal is a flight, or nearly. `held`: what commands that are held are off by.
`exact_check`: V falls on the boundary at each time, in exact arithmetic. Then, in
floating point: ascent from new random points finds no remainder larger than β_k, and
none where V rises between the times; `flight_proof` proves both, in continuous time.
"""

import dataclasses
import secrets

import numpy as np
from threadpoolctl import threadpool_limits

from glider.progress import Shares, silent
from glider.verification.dynamics.defect import defect_bounds, defect_growth
from glider.verification.dynamics.moving_center import make_moving_center
from glider.verification.funnel.funnel import Funnel
from glider.verification.funnel.growth import SHARES, growth_between
from glider.verification.funnel.remainder import (
    LEAST_REMAINDER,
    SAMPLES,
    sample_remainder,
)
from glider.verification.proof.exact_check import exact_faults, proven_slack
from glider.verification.proof.held import held_faults
from glider.verification.proof.purpose import Purpose, unmet
from glider.verification.sos.sphere import normalized

_ANY = Purpose()
"""Any purpose."""

_STARTS = 8
"""Starting points of the ascent, besides those of `largest_growth`."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Verdict:
    """The outcome of a funnel's check; its fields are keys of `check-funnel --json`."""

    times: int  #: Number of times that were checked exactly.
    of_times: int  #: Number of times that the funnel has.
    #: Faults of the certificate, a sentence each; empty where it holds. Where the
    #: funnel is not the intended one, or not a flight, nothing else is checked.
    faults: tuple[str, ...]
    slack: float  #: Slack of V̇ <= -slack V, which is proven at these times [1/s].
    defect: float  #: Largest V̇/V by the nominal's defect, which is counted [1/s].
    #: Largest |R_k| / β_k found by ascent at these times; infinite where only β_k is
    #: zero; zero where the certificate accounts for no remainder at all.
    remainder_seen: float
    between: float  #: Largest V̇/V found between them; infinite after a fault [1/s].
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
        """Whether all times were checked."""
        return self.times == self.of_times


@threadpool_limits.wrap(limits=1, user_api="blas")  # Small matrices.
@np.errstate(all="ignore")  # What is infinite or NaN holds nothing.
def check_funnel(
    funnel: Funnel,
    every: int = 1,
    *,
    purpose: Purpose = _ANY,
    seed: int | None = None,
    progress: Shares = silent,
) -> Verdict:
    """Checks a funnel.

    Args:
        every: check every so many times only, the first and last included.
        purpose: what it must be good for.
        seed: of the points where ascents start; one that no file can know if None.
        progress: called with the share that is done, of held commands, then of times.
    """
    last = len(funnel.nominal.times) - 1
    at = sorted({*range(0, last, every), last})
    growth = defect_growth(funnel.S, defect_bounds(funnel.nominal))
    seed = secrets.randbits(32) if seed is None else seed
    faults = purpose.faults_of(funnel) + _defect_faults(funnel, growth)
    faults = faults or held_faults(funnel, progress)
    level = None
    if purpose.covariance and funnel.is_of_set:
        level = purpose.set_level(funnel.allowed)
    seen = 0.0
    between = np.inf
    if not faults:
        faults = exact_faults(funnel, at, growth, progress)
    if not faults:
        rng = np.random.default_rng(seed)
        faults, seen, between = _sampled_faults(funnel, at, growth, rng, every)
    return Verdict(
        times=len(at),
        of_times=last + 1,
        faults=tuple(faults),
        slack=proven_slack(funnel),
        defect=float(growth.max()),
        remainder_seen=seen,
        between=between,
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


def _sampled_faults(funnel, at, growth, rng, every):
    """Returns what is wrong by ascent; the largest |R_k| / β_k, and V̇/V in between."""
    seen = remainder_seen(funnel, at, rng) if funnel.beta.any() else 0.0
    if not seen <= 1.0:
        return [f"The remainder is {seen:.3g} times its bound."], seen, np.inf
    between = _largest_between(funnel, growth, rng, every)
    words = f"Between the times V̇/V reaches {between:.2g} 1/s."
    return unmet((between < 0.0, words)), seen, between


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


def _largest_between(
    funnel: Funnel, defect: np.ndarray, rng: np.random.Generator, every: int = 1
) -> float:
    """Returns the largest V̇/V found between the times, by ascent [1/s].

    It includes growth (T,) by the defect, and is infinite where a set is no ellipsoid.
    """
    starts = normalized(rng.normal(size=(_STARTS, funnel.num_states)))
    around = np.maximum(defect[:-1], defect[1:])[funnel.nominal.flows[::every]]
    try:
        found = [growth_between(funnel, share, starts, every) for share in SHARES]
    except np.linalg.LinAlgError:
        return np.inf
    return float(np.max(np.array(found) + around))
