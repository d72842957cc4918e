"""The servo as a Drake System is the law of `glider.physics.servo`."""

import numpy as np
import pytest
from pydrake.autodiffutils import ExtractGradient, ExtractValue, InitializeAutoDiff

from glider.errors import InputError
from glider.physics.effects import SERVO_LAG
from glider.physics.model import GliderModel
from glider.physics.parameters import GliderParameters
from glider.physics.servo import STOPPING_TIME, Servo, limited_rate
from glider.systems.elevator_servo import ElevatorServo

LAGGING = GliderModel(effects=(SERVO_LAG(time_constant=0.1),))
LAGGING = GliderModel(effects=(SERVO_LAG(time_constant=0.1),))
LOW, HIGH, LIMIT = -0.4463, 0.9473, 13.0


def evaluate(servo, command, state):
    context = servo.CreateDefaultContext()
    servo.GetInputPort("command").FixValue(context, command)
    servo.GetInputPort("state").FixValue(context, state)
    return servo.GetOutputPort("elevator_rate").Eval(context)


def test_the_limits_act_before_a_lag():
    """The elevator stands 0.6 rad from its stop, and the lag takes it there."""
    servo = ElevatorServo(LAGGING)
    rng = np.random.default_rng(1)
    for state in rng.uniform(-1.0, 1.0, (20, 8)):
        state[7] = 5.0 * state[7]
        [command] = rng.uniform(-30.0, 30.0, 1)
        rate = evaluate(servo, [command], state)
        limits = Servo(LOW, HIGH, LIMIT)
        expected = limited_rate(command, state[3] + 0.1 * state[7], limits)
        assert rate == [pytest.approx(expected, abs=1e-12)]
    state = np.zeros(8)
    state[[3, 7]] = HIGH - 0.6, 6.0
    assert evaluate(servo, [10.0], state) == [pytest.approx(0.0, abs=1e-9)]


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
    servo = ElevatorServo().ToAutoDiffXd()
    ad = InitializeAutoDiff([command, 0, 0, 0, elevator, 0, 0, 0]).ravel()
    rate = evaluate(servo, ad[:1], ad[1:])
    assert ExtractValue(rate)[0, 0] == pytest.approx(value)
    gradient = ExtractGradient(rate)[0]
    assert gradient[[0, 4]] == pytest.approx([by_command, by_elevator])
    assert not gradient[[1, 2, 3, 5, 6, 7]].any()


def test_a_copy_keeps_its_limits():
    parameters = GliderParameters(elevator_limits=[-0.1, 0.2], elevator_rate_limit=2.0)
    model = GliderModel(parameters=parameters)
    servo = ElevatorServo(model).ToAutoDiffXd().ToScalarType[float]()
    assert evaluate(servo, [5.0], np.zeros(7)) == [2.0]
    state = np.zeros(7)
    state[3] = 0.2
    assert evaluate(servo, [5.0], state) == [0.0]


def test_a_model_can_be_the_path_of_its_file(tmp_path):
    LAGGING.save(tmp_path / "lagging.yaml")
    assert ElevatorServo(tmp_path / "lagging.yaml").GetInputPort("state").size() == 8
    with pytest.raises(InputError, match="expected a GliderModel or the path"):
        ElevatorServo(GliderParameters())


def test_too_few_states_are_refused():
    with pytest.raises(InputError, match="num_states is 7; expected at least the"):
        ElevatorServo(LAGGING, 7)
