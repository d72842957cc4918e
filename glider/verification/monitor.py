"""A Drake System that watches a funnel: is the glider inside, and by how much?"""

import numpy as np
from pydrake.systems.framework import LeafSystem

from glider.verification.funnel.funnel import Funnel


class FunnelMonitor(LeafSystem):
    """A monitor of where a state is in a funnel.

    state -> [ FunnelMonitor ] -> margin
                               -> inside

    Input port:
        state: (n,) a plant's for the truth, or an estimator's for what is believed.

    Output ports:
        margin: 1 - √V: 1 at the nominal flight, 0 at the boundary, negative outside;
            the share of its way to the boundary that a deviation may still grow.
        inside: 1 where V <= 1, else 0.

    After the funnel's end the last set counts, about the last nominal state.
    """

    def __init__(self, funnel: Funnel):
        """Takes a funnel; the state has its `num_states`."""
        LeafSystem.__init__(self)
        self.set_name("funnel")
        self._funnel = funnel
        self._state = self.DeclareVectorInputPort("state", funnel.num_states)
        needed = {self.input_port_ticket(self._state.get_index()), self.time_ticket()}
        self.DeclareVectorOutputPort("margin", 1, self._calc_margin, needed)
        self.DeclareVectorOutputPort("inside", 1, self._calc_inside, needed)

    def _level(self, context):
        return self._funnel.level(context.get_time(), self._state.Eval(context))

    def _calc_margin(self, context, output):
        output.SetFromVector([1.0 - np.sqrt(self._level(context))])

    def _calc_inside(self, context, output):
        output.SetFromVector([float(self._level(context) <= 1.0)])
