"""The part of a funnel's check that is about its set of gliders, in floating point.

The exact check is of the estimate's glider, in the funnel about the nominal. What it
proves of V̇ at a time, for any remainder no larger than β, is true of the others as
well, each about its own center x₀ + X δ, if R is no larger there: that is seen
(`check.remainder_seen`), and only `flight_proof` proves it. That they have room for it
is looked at here.
"""

import math

import numpy as np
import scipy.linalg

from glider.verification.funnel.funnel import Funnel
from glider.verification.funnel.limits import bounds_about, goal_reach, room
from glider.verification.proof.exact_check import GOAL_ROUNDING


def gliders_faults(funnel: Funnel) -> list[str]:
    """Returns why a funnel cannot be of its set of gliders, a sentence each.

    In floating point: at its times the servo does not meet its limits about any
    glider's center, and the last set is in the goal about each.
    """
    if not funnel.gliders:
        return []
    faults = []
    directions, bounds = bounds_about(funnel.nominal, funnel.gliders, shrink=1.0)
    try:
        reach = room(funnel.S, directions, bounds)
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
        return ["The set is no ellipsoid somewhere."]
    if not end <= 1.0 + GOAL_ROUNDING:
        faults.append(
            "The last set is not within the goal about every glider's center: it "
            f"reaches {end:.4g} times as far."
        )
    return faults
