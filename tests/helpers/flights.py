"""What the tests of feedback and of closed loops fly."""

import functools

from glider.control.tvlqr import tracking_policy
from glider.physics.effects import SERVO_LAG
from glider.physics.model import GliderModel
from glider.planning import dircol
from glider.planning.problem import Hook, PerchingProblem
from tests.helpers.drake_gains import policy_of, tracking_gains

PROBLEM = PerchingProblem()
NO_HOOK = PerchingProblem(hook=Hook(reach=1e-9))
NOMINAL = GliderModel()
LAGGING = GliderModel(effects=(SERVO_LAG(time_constant=0.03),))
QUICK = GliderModel(effects=(SERVO_LAG(time_constant=0.0005),))
"""Glider that flies like the nominal one, but whose servo's state is much quicker than
the steps of the integrators."""


@functools.cache
def plan_of(lagging=False):
    """Returns the plan of the nominal model, or of a glider with a slow servo."""
    return dircol.plan(LAGGING if lagging else NOMINAL, PROBLEM)


@functools.cache
def drake_gains():
    """Returns Drake's gains along the plan of the nominal model."""
    return tracking_gains(GliderModel(), plan_of())


@functools.cache
def drake_policy():
    """Returns Drake's gains along the plan of the nominal model, as a table."""
    return policy_of(drake_gains(), plan_of())


@functools.cache
def policy():
    """Returns the compiled policy along the plan of the nominal model."""
    return tracking_policy(GliderModel(), plan_of())
