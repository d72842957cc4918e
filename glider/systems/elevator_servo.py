"""The servo of the elevator as a Drake System."""

import numpy as np
from pydrake.autodiffutils import AutoDiffXd
from pydrake.systems.framework import LeafSystem_
from pydrake.systems.scalar_conversion import TemplateSystem

from glider.physics.parameters import GliderParameters
from glider.physics.servo import limited_rate
from glider.physics.state import ELEVATOR, NUM_STATES
from glider.systems.template import float_class


@TemplateSystem.define("ElevatorServo_", T_list=[float, AutoDiffXd])
def ElevatorServo_(T):
    class Impl(LeafSystem_[T]):
        """A servo that keeps its rate limit and slows down before its stops.

        See `limited_rate` for the formula. Where the glider's own actuator lags
        (effect servo_lag), the elevator can overshoot a stop by what the lag
        still moves it.

        Input ports:
            command (1): rate that is asked for [rad/s].
            state (n): state of the glider; its elevator angle is used [rad].

        Output ports:
            elevator_rate (1): rate within the limits [rad/s].

        Args:
            parameters: whose elevator_limits and elevator_rate_limit to keep.
            num_states: size n of `state`.
        """

        def _construct(self, parameters=None, num_states=NUM_STATES, converter=None):
            LeafSystem_[T].__init__(self, converter)
            self.set_name("servo")
            parameters = GliderParameters() if parameters is None else parameters
            self._parameters = parameters
            self._command = self.DeclareVectorInputPort("command", 1)
            self._state = self.DeclareVectorInputPort("state", num_states)
            self.DeclareVectorOutputPort("elevator_rate", 1, self._calc_rate)

        def _construct_copy(self, other, converter=None):
            size = other._state.size()
            Impl._construct(self, other._parameters, size, converter=converter)

        def _calc_rate(self, context, output):
            command = self._command.Eval(context)[0]
            elevator = self._state.Eval(context)[ELEVATOR]
            rate = limited_rate(command, elevator, self._parameters.servo)
            # A limit alone is a float; the sum is a T.
            output.SetFromVector(np.array([rate + 0.0 * elevator]))

    return Impl


ElevatorServo = float_class(ElevatorServo_)
