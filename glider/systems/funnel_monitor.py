"""A funnel in a diagram: its monitor (is the glider inside?) and its feedback."""

import numpy as np
from pydrake.systems.framework import LeafSystem
from pydrake.systems.primitives import TrajectoryAffineSystem

from glider.systems.regulator import policy_regulator
from glider.verification.funnel.funnel import Funnel, funnel_policy


class FunnelMonitor(LeafSystem):
    """A monitor of where a state is in a funnel.

    Input ports:
        state (n): a plant's for the truth, or an estimator's for what is believed.

    Output ports:
        margin (1): 1 - √V: 1 at the nominal flight, 0 at the boundary, negative
            outside; the share of its way to the boundary that a deviation may still
            grow.
        inside (1): 1 where V <= 1, else 0.

    V is about the nominal flight, also of a funnel of a set of gliders: the center of
    the one that flies is nowhere known. After the end the last set counts.
    """

    def __init__(self, funnel: Funnel):
        """Takes a funnel; the state has its `num_states`."""
        LeafSystem.__init__(self)
        self.set_name("funnel")
        self._funnel = funnel
        self._state = self.DeclareVectorInputPort("state", funnel.num_states)
        self.DeclareVectorOutputPort("margin", 1, self._calc_margin)
        self.DeclareVectorOutputPort("inside", 1, self._calc_inside)

    def _level(self, context):
        return self._funnel.level(context.get_time(), self._state.Eval(context))

    def _calc_margin(self, context, output):
        output.SetFromVector([1.0 - np.sqrt(self._level(context))])

    def _calc_inside(self, context, output):
        output.SetFromVector([float(self._level(context) <= 1.0)])


def funnel_regulator(funnel: Funnel) -> TrajectoryAffineSystem:
    """Returns a funnel's own feedback as a Drake System, as `policy_regulator`."""
    return policy_regulator(funnel_policy(funnel))
