"""The servo of the elevator as a Drake System."""

import numpy as np
from pydrake.autodiffutils import AutoDiffXd
from pydrake.systems.framework import LeafSystem_
from pydrake.systems.scalar_conversion import TemplateSystem

from glider.errors import expect
from glider.physics.model import GliderModel, as_model
from glider.physics.servo import limited_rate
from glider.systems.template import float_class


@TemplateSystem.define("ElevatorServo_", T_list=[float, AutoDiffXd])
def ElevatorServo_(T):
    class Impl(LeafSystem_[T]):
        """A servo that keeps its rate limit and slows down before its stops.

        It converts to AutoDiffXd. See `glider.physics.servo` for the law. The elevator
        follows through the model's actuators.

        Input ports:
            command (1): rate that is asked for [rad/s].
            state (n): state of the glider; its elevator angle is used [rad].

        Output ports:
            elevator_rate (1): rate within the limits [rad/s].

        Args:
            model: the glider whose servo it is, or the path of its file.
            num_states: size n of `state`, which begins with the model's states; None:
                as many.
        """

        def _construct(self, model=None, num_states=None, converter=None):
            LeafSystem_[T].__init__(self, converter)
            self.set_name("servo")
            self._model = GliderModel() if model is None else as_model(model)
            self._numbers = self._model.numbers
            self._command = self.DeclareVectorInputPort("command", 1)
            least = self._model.num_states
            size = least if num_states is None else num_states
            needed = f"at least the model's {least}"
            expect(size >= least, "ElevatorServo: num_states", size, needed)
            self._state = self.DeclareVectorInputPort("state", size)
            self.DeclareVectorOutputPort("elevator_rate", 1, self._calc_rate)

        def _construct_copy(self, other, converter=None):
            size = other._state.size()
            Impl._construct(self, other._model, size, converter=converter)

        def _calc_rate(self, context, output):
            command = self._command.Eval(context)[0]
            state = self._state.Eval(context)
            angle = self._model.chain.demanded_angle(state, self._numbers.c)
            rate = limited_rate(command, angle, self._model.parameters.servo)
            # A limit alone is a float; the sum is a T.
            output.SetFromVector(np.array([rate + 0.0 * angle]))

    return Impl


ElevatorServo = float_class(ElevatorServo_)
