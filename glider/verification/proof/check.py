"""The check of a funnel's certificate, exactly and without a solver.

`glider.verification.proof.exact_check` proves in whole numbers that V falls on the
boundary at each time. Beside that, here, with floating point: the nominal is a flight,
and V̇ is negative between the times too. That the true remainder is within β_k is for
`glider.verification.proof.remainder_proof`.
"""

import dataclasses
from collections.abc import Callable

import numpy as np
from threadpoolctl import threadpool_limits

from glider.verification.dynamics.nominal_path import nominal_drift
from glider.verification.funnel.funnel import Funnel
from glider.verification.funnel.growth import (
    SHARES,
    GrowthBetween,
)
from glider.verification.proof.exact_check import (
    exact_faults,
    proven_slack,
)
from glider.verification.sos.sphere import normalized

LARGEST_DRIFT = 1e-4
"""Drift that the nominal of a funnel may have [m, rad, m/s, rad/s]. That of the shipped
ones is below 1e-8."""

STARTS = 8
"""Points where the ascent to the largest growth starts, besides the axes of its
quadratic part."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Verdict:
    """The outcome of a funnel's check; its fields are keys of `check-funnel --json`."""

    times: int
    """Number of times that were checked exactly."""

    faults: tuple[str, ...]
    """Faults of the certificate, a sentence each; empty where it holds."""

    slack: float
    """Slack of V̇ <= -slack V, which is proven at these times [1/s]."""

    rounding: float
    """Largest change of an eigenvalue by what rounding and solver left over [1/s]."""

    between: float
    """Largest V̇/V found between the times, in floating point [1/s]; infinite where
    something else is wrong already."""

    drift: float
    """Largest error of the nominal over a step [m, rad, m/s, rad/s]."""

    @property
    def holds(self) -> bool:
        """Whether nothing is wrong."""
        return not self.faults


@threadpool_limits.wrap(limits=1, user_api="blas")  # Small matrices.
def check_funnel(
    funnel: Funnel,
    every: int = 1,
    progress: Callable[[float], None] | None = None,
) -> Verdict:
    """Checks a funnel.

    Args:
        funnel: the funnel.
        every: check every so many times only, the first and last included.
        progress: called with the share that is done.
    """
    at = funnel.some_times(every)
    faults, rounding = exact_faults(funnel, at, progress)
    drift, between = nominal_drift(funnel.nominal), np.inf
    if not drift < LARGEST_DRIFT:
        faults.append(f"The nominal is no flight: it drifts by {drift:.2g} in a step.")
    if not faults:
        between = largest_between(funnel, every)
        if not between < 0.0:
            faults.append(f"Between the times V̇/V reaches {between:.2g} 1/s.")
    return Verdict(
        times=len(at),
        faults=tuple(faults),
        slack=proven_slack(funnel),
        rounding=rounding,
        between=between,
        drift=drift,
    )


def largest_between(funnel: Funnel, every: int = 1) -> float:
    """Returns the largest V̇/V found between the times, by ascent [1/s].

    Args:
        funnel: the funnel.
        every: look into every so many intervals only.
    """
    rng = np.random.default_rng(0)
    starts = normalized(rng.normal(size=(STARTS, funnel.num_states)))
    return max(
        float(
            GrowthBetween(funnel.nominal, share, every)
            .largest(funnel.S, funnel.slopes, funnel.beta, funnel.weights, starts)
            .max()
        )
        for share in SHARES
    )
