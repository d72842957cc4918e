"""The servo of the elevator as a Drake System."""

import numpy as np
from pydrake.autodiffutils import AutoDiffXd
from pydrake.systems.framework import LeafSystem_
from pydrake.systems.scalar_conversion import TemplateSystem

from glider.physics.model import GliderModel
from glider.physics.servo import limited_rate


@TemplateSystem.define("ElevatorServo_", T_list=[float, AutoDiffXd])
def ElevatorServo_(T):
    class Impl(LeafSystem_[T]):
        """A servo that keeps its rate limit and slows down before its stops.

        command -> [               ]
        state ---> [ ElevatorServo ] -> elevator_rate

        See `glider.physics.servo` for the law. The elevator follows through the
        model's actuators.

        Args:
            model: the glider whose servo it is.
        """

        def _construct(self, model=None, converter=None):
            LeafSystem_[T].__init__(self, converter)
            self.set_name("servo")
            self._model = GliderModel() if model is None else model
            self._numbers = self._model.numbers
            self._command = self.DeclareVectorInputPort("command", 1)
            self._state = self.DeclareVectorInputPort("state", self._model.num_states)
            self.DeclareVectorOutputPort("elevator_rate", 1, self._calc_rate)

        def _construct_copy(self, other, converter=None):
            Impl._construct(self, other._model, converter=converter)

        def _calc_rate(self, context, output):
            command = self._command.Eval(context)[0]
            state = self._state.Eval(context)
            angle = self._model.chain.demanded_angle(state, self._numbers.c)
            rate = limited_rate(command, angle, self._model.parameters.servo)
            # A limit alone is a float; the sum is a T.
            output.SetFromVector(np.array([rate + 0.0 * angle]))

    return Impl


ElevatorServo = ElevatorServo_[None]  # The float instantiation.
