"""Observer of what is not measured: the states of the planner's own effects."""

import numpy as np
from pydrake.autodiffutils import AutoDiffXd
from pydrake.systems.framework import LeafSystem_
from pydrake.systems.scalar_conversion import TemplateSystem

from glider.physics.model import GliderModel
from glider.physics.state import NUM_STATES
from glider.systems.template import float_class


@TemplateSystem.define("ExtraStates_", T_list=[float, AutoDiffXd])
def ExtraStates_(T):
    class Impl(LeafSystem_[T]):
        """Runs a model's effect states beside a flight, without correction.

        A regulator of a model with servo_lag, say, uses the lagged rate, which
        is not measured. The initial values of these states decay (a stable lag), so
        that integrating the model's own formulas is enough.

        Input ports:
            measured (7): state without the effects' own.
            elevator_rate (1): rate of the servo [rad/s].

        Output ports:
            state (n): what is measured, then the effects' own states.

        Args:
            model: the planner's.
        """

        def _construct(self, model=None, converter=None):
            LeafSystem_[T].__init__(self, converter)
            self.set_name("observer")
            self.model = GliderModel() if model is None else model
            self.state_names = self.model.state_names
            self._derivatives = self.model.chain.derivatives
            self._theta = self.model.numbers
            self._measured = self.DeclareVectorInputPort("measured", NUM_STATES)
            self._rate = self.DeclareVectorInputPort("elevator_rate", 1)
            n = len(self.state_names)
            self.DeclareContinuousState(n - NUM_STATES)
            self.DeclareVectorOutputPort(
                "state",
                n,
                self._calc_state,
                {self.xc_ticket(), self.input_port_ticket(self._measured.get_index())},
            )

        def _construct_copy(self, other, converter=None):
            Impl._construct(self, other.model, converter=converter)

        def at_rest(self, state):
            """Returns the effect states that a launch begins with."""
            return self.model.initial_state(state)[NUM_STATES:]

        def _full(self, context):
            extra = context.get_continuous_state_vector().CopyToVector()
            return np.concatenate([self._measured.Eval(context), extra])

        def _calc_state(self, context, output):
            output.SetFromVector(self._full(context))

        def DoCalcTimeDerivatives(self, context, derivatives):
            rates = self._derivatives(
                context.get_time(),
                self._full(context),
                self._rate.Eval(context)[0],
                0.0,
                0.0,
                self._theta,
            )
            derivatives.get_mutable_vector().SetFromVector(np.array(rates[NUM_STATES:]))

    return Impl


ExtraStates = float_class(ExtraStates_)
