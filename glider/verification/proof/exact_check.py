"""The part of a funnel's check that is in exact arithmetic.

At each time that is checked S is positive definite, the set keeps the servo within its
limits, and V̇ <= -slack V on the whole boundary: -V̇ - slack V has a positive definite
Gram matrix, for the third-order dynamics whose coefficients are the doubles of
`Nominal.closed_loop`, any |R_k| <= β_k, and the nominal's largest defect in the
intervals about that time. At the end the set lies in the goal.
"""

from collections.abc import Sequence

import numpy as np

from glider.progress import Shares, silent
from glider.verification.funnel.funnel import Funnel
from glider.verification.proof.interval import at_time, keeps_servo
from glider.verification.proof.interval_growth import BALL_BITS, growth_forms
from glider.verification.sos.exact import exact, is_positive_definite, joined, rounded
from glider.verification.sos.forms import exact_product, has_definite_gram, to_ball
from glider.verification.sos.sphere import represent, sphere

_SLACK_SHARE = 0.1
"""Share of the margin of V̇/V that is proven; what is left of it is for rounding."""

_GRAM_BITS = 26
"""Binary places of Gram matrices: 1.5e-8, with least eigenvalues of 1e-3 and more."""

GOAL_ROUNDING = 1e-9
"""Share by which S(T) may be below the goal's: where they are equal, as in the shipped
funnels, their difference is not definite."""


def proven_slack(funnel: Funnel) -> float:
    """Returns the slack of V̇ <= -slack V that is to be proven [1/s]."""
    return _SLACK_SHARE * funnel.settings.margin


def exact_faults(
    funnel: Funnel, at: Sequence[int], defect: np.ndarray, progress: Shares = silent
) -> tuple[list[str], float]:
    """Checks a funnel in exact arithmetic, given the growth (T,) by its defect [1/s].

    Returns what is wrong, a sentence each, and the largest change of an eigenvalue by
    what rounding left over.
    """
    slack = proven_slack(funnel)
    rounding = 0.0
    found: dict[str, list[float]] = {}
    for number, k in enumerate(at):
        faults, change = check_time(funnel, k, slack + defect[k])
        rounding = max(rounding, change)
        for fault in faults:
            found.setdefault(fault, []).append(funnel.nominal.times[k])
        progress((number + 1) / len(at))
    sentences = [f"{fault} {_when(times)}." for fault, times in found.items()]
    if not _within_goal(funnel):
        sentences.append("The last set is not within the goal.")
    return sentences, rounding


def _when(times):
    """Returns words for some times [s]."""
    if len(times) == 1:
        return f"at {times[0]:.4f} s"
    return f"at {len(times)} times, from {times[0]:.4f} to {times[-1]:.4f} s"


def check_time(funnel: Funnel, k: int, slack: float) -> tuple[list[str], float]:
    """Returns what is not proven at one time, a clause each, and what rounding took.

    Where floating point fails to propose a Gram matrix, nothing is.
    """
    S = funnel.S[k]
    beta = funnel.beta[k]
    weights = funnel.weights[k]
    if not np.all(np.isfinite(funnel.nominal.closed_loop[k])):
        return ["The glider's dynamics have no Taylor polynomial"], 0.0
    if not is_positive_definite(exact(S)):
        return ["The set is not an ellipsoid"], 0.0
    rises = "The Gram matrix does not prove that V falls"
    if np.any(beta < 0.0) or np.any(weights < 0.0):
        return [rises], 0.0
    if np.any((funnel.unknown_pushes[k] > 0.0) & (funnel.push_weights[k] == 0.0)):
        return ["A weight of the command's error or the wind is zero"], 0.0
    tables = sphere(len(S))
    faults = []
    try:
        here = at_time(funnel, k)
        if not keeps_servo(here):
            faults = ["The servo would meet its limits"]
        basis = rounded(to_ball(S)[1], BALL_BITS)
        A, cubic, quartic, G = growth_forms(here, basis, exact(slack))
        # In floating point: a Gram matrix of nearly this polynomial. The one in the
        # file may or may not have the nominal's defect in it.
        even = quartic + exact_product(A, G)
        doubles = joined(cubic, even, axis=1).to_float()
        entries = funnel.grams[k].astype(float)
        entries -= 0.5 * slack * tables.entries(np.eye(tables.size))
        gram = tables.matrix(represent(tables, entries, doubles))
        whole = rounded(gram * np.outer(tables.scales, tables.scales), _GRAM_BITS)
    except (np.linalg.LinAlgError, OverflowError, ValueError):
        return [*faults, rises], 0.0
    corner = whole[: tables.n, : tables.n]
    others = joined(cubic, quartic + exact_product(A - corner, G), axis=1)
    falls, change = has_definite_gram(tables, whole, corner, others)
    return faults if falls else [*faults, rises], change


def _within_goal(funnel):
    """Returns whether S(T) is at least the goal's, but for GOAL_ROUNDING."""
    axes = funnel.settings.goal_axes(funnel.num_states)
    goal = exact(np.diag(1.0 / axes**2) * (1.0 - GOAL_ROUNDING))
    return is_positive_definite(exact(funnel.S[-1]) - goal)
