"""The part of a funnel's check that is in exact arithmetic.

At each time that is checked S is positive definite, the set keeps the servo within its
limits, and V̇ <= -slack V on the whole boundary: -V̇ - slack V has a positive definite
Gram matrix, for the third-order dynamics whose coefficients are the doubles of
`Nominal.closed_loop`, any |R_k| <= β_k, and the nominal's largest defect in the
intervals about that time. At the end the set lies in the goal.
"""

from collections.abc import Sequence

import numpy as np

from glider.errors import InputError
from glider.progress import Shares, silent
from glider.verification.funnel.funnel import Funnel
from glider.verification.funnel.servo_limits import goal_about
from glider.verification.proof.interval import at_time, keeps_servo
from glider.verification.proof.interval_growth import falls_at, gram_guesses
from glider.verification.sos.exact import exact, is_positive_definite

_SLACK_SHARE = 0.1
"""Share of the margin of V̇/V that is proven; the rest is left to rounding."""

_GOAL_ROUNDING = 1e-9
"""Share by which S(T) may be below the goal's: where they are equal, as in the shipped
funnels, their difference is not definite."""


def proven_slack(funnel: Funnel) -> float:
    """Returns the slack of V̇ <= -slack V that is to be proven [1/s]."""
    return _SLACK_SHARE * funnel.settings.margin


def exact_faults(
    funnel: Funnel, at: Sequence[int], defect: np.ndarray, progress: Shares = silent
) -> list[str]:
    """Checks a funnel in exact arithmetic, given the growth (T,) by its defect [1/s].

    Returns what is wrong, a sentence each.
    """
    slack = proven_slack(funnel)
    times_of: dict[str, list[float]] = {}
    for number, k in enumerate(at, 1):
        for fault in _check_time(funnel, k, slack + defect[k]):
            times_of.setdefault(fault, []).append(funnel.nominal.times[k])
        progress(number / len(at))
    sentences = [f"{fault} {_when(times)}." for fault, times in times_of.items()]
    if not _within_goal(funnel):
        where = " about every glider's center" if funnel.is_of_set else ""
        sentences.append(f"The last set is not within the goal{where}.")
    return sentences


def _when(times):
    """Returns words for some times [s]."""
    if len(times) == 1:
        return f"at {times[0]:.4f} s"
    return f"at {len(times)} times, from {times[0]:.4f} to {times[-1]:.4f} s"


def _check_time(funnel: Funnel, k: int, slack: float) -> list[str]:
    """Returns what is not proven at one time, a clause each."""
    beta = funnel.beta[k]
    weights = funnel.weights[k]
    if not np.all(np.isfinite(funnel.nominal.closed_loop[k])):
        return ["The glider's dynamics have no Taylor polynomial"]
    if not is_positive_definite(exact(funnel.S[k])):
        return ["The set is not an ellipsoid"]
    rises = "The Gram matrix does not prove that V falls"
    if np.any(beta < 0.0) or np.any(weights < 0.0):
        return [rises]
    if np.any((funnel.unknown_pushes[k] > 0.0) & (funnel.push_weights[k] == 0.0)):
        return ["A weight of the command's error or the wind is zero"]
    faults = []
    try:
        here = at_time(funnel, k)
        if not keeps_servo(here):
            faults.append("The servo would meet its limits")
        needed = exact(slack)
        # The one in the file may or may not have the nominal's defect in it.
        [gram] = gram_guesses(funnel.between(k, k), slack)
        falls = falls_at(here, needed, gram)
    except (np.linalg.LinAlgError, OverflowError, ValueError):
        falls = False  # Floating point fails to propose a Gram matrix.
    if not falls:
        faults.append(rises)
    return faults


def _within_goal(funnel):
    """Returns whether the last set is in the goal, about the center of every glider.

    That is to _GOAL_ROUNDING; where the centers end is in floating point.
    """
    axes = funnel.settings.goal_axes(funnel.num_states)
    try:
        needed = goal_about(axes, funnel.gliders)
        goal = exact(needed * (1.0 - _GOAL_ROUNDING))
    except (InputError, ValueError):  # The centers alone leave it.
        return False
    return is_positive_definite(exact(funnel.S[-1]) - goal)
