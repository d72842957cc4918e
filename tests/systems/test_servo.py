"""The servo keeps its limits, and lets everything else pass."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydrake.autodiffutils import ExtractGradient, ExtractValue, InitializeAutoDiff

from glider.physics.parameters import GliderParameters
from glider.physics.servo import STOPPING_TIME, Servo, limited_rate
from glider.systems.elevator_servo import ElevatorServo

LOW, HIGH, LIMIT = -0.4463, 0.9473, 13.0
COMMANDS = st.floats(-100.0, 100.0)
ANGLES = st.floats(-3.0, 3.0)


def servo_rate(command, elevator):
    return limited_rate(command, elevator, Servo(LOW, HIGH, LIMIT))


@given(COMMANDS, ANGLES)
def test_the_rate_limit_holds_anywhere(command, elevator):
    assert abs(servo_rate(command, elevator)) <= LIMIT


@given(st.floats(-LIMIT, LIMIT), st.floats(LOW + 0.066, HIGH - 0.066))
def test_within_the_limits_a_command_passes(command, elevator):
    assert servo_rate(command, elevator) == command


@given(COMMANDS, COMMANDS, ANGLES)
def test_more_command_is_never_less_rate(one, other, elevator):
    rates = [servo_rate(command, elevator) for command in sorted((one, other))]
    assert rates[0] <= rates[1]


@pytest.mark.parametrize(("command", "stop"), [(20.0, HIGH), (-20.0, LOW)])
def test_the_elevator_comes_to_its_stop_and_not_beyond(command, stop):
    elevator, step = 0.0, 0.1 * STOPPING_TIME
    for _ in range(500):
        elevator += step * servo_rate(command, elevator)
        assert LOW <= elevator <= HIGH
    assert elevator == pytest.approx(stop, abs=1e-6)


@pytest.mark.parametrize("command", [-20.0, 0.0, 20.0])
def test_an_elevator_beyond_a_stop_returns(command):
    assert servo_rate(command, HIGH + 0.01) < 0.0
    assert servo_rate(command, LOW - 0.01) > 0.0


def evaluate(servo, command, state):
    context = servo.CreateDefaultContext()
    servo.GetInputPort("command").FixValue(context, command)
    servo.GetInputPort("state").FixValue(context, state)
    return servo.GetOutputPort("elevator_rate").Eval(context)


def test_the_system_is_the_formula():
    servo = ElevatorServo(GliderParameters(), 8)
    rng = np.random.default_rng(1)
    for state in rng.uniform(-1.0, 1.0, (20, 8)):
        [command] = rng.uniform(-30.0, 30.0, 1)
        rate = evaluate(servo, [command], state)
        assert rate == [servo_rate(command, state[3])]


@pytest.mark.parametrize(
    ("command", "elevator", "value", "by_command", "by_elevator"),
    [
        (5.0, 0.1, 5.0, 1.0, 0.0),
        (-50.0, 0.1, -LIMIT, 0.0, 0.0),
        (10.0, HIGH - 0.01, 0.01 / STOPPING_TIME, 0.0, -1.0 / STOPPING_TIME),
        (-10.0, LOW + 0.01, -0.01 / STOPPING_TIME, 0.0, -1.0 / STOPPING_TIME),
    ],
)
def test_its_slopes_are_exact(command, elevator, value, by_command, by_elevator):
    servo = ElevatorServo(GliderParameters(), 7).ToAutoDiffXd()
    ad = InitializeAutoDiff([command, 0, 0, 0, elevator, 0, 0, 0]).ravel()
    rate = evaluate(servo, ad[:1], ad[1:])
    assert ExtractValue(rate)[0, 0] == pytest.approx(value)
    gradient = ExtractGradient(rate)[0]
    assert gradient[[0, 4]] == pytest.approx([by_command, by_elevator])
    assert not gradient[[1, 2, 3, 5, 6, 7]].any()


def test_a_copy_keeps_its_limits():
    parameters = GliderParameters(elevator_limits=[-0.1, 0.2], elevator_rate_limit=2.0)
    servo = ElevatorServo(parameters, 9).ToAutoDiffXd().ToScalarType[float]()
    assert evaluate(servo, [5.0], np.zeros(9)) == [2.0]
    state = np.zeros(9)
    state[3] = 0.2
    assert evaluate(servo, [5.0], state) == [0.0]
