"""Steps are divided where an effect's own state is quicker than they are."""

import numpy as np
import pytest

from glider.compiled.flight import fly_tapes
from glider.errors import InputError
from glider.physics.effects import COMMAND_DELAY, DYNAMIC_STALL, SERVO_LAG, WIND
from glider.physics.model import SHORTEST, STABLE, GliderModel
from tests.helpers.flights import NOMINAL, PROBLEM, QUICK


@pytest.mark.parametrize(
    ("effects", "rate"),
    [
        ((), 0.0),
        ((WIND(x=-0.6),), 0.0),
        ((SERVO_LAG(time_constant=0.03),), 1.0 / 0.03),
        ((COMMAND_DELAY(delay=0.02),), np.sqrt(12.0) / 0.02),
        ((SERVO_LAG(time_constant=0.3), DYNAMIC_STALL(strength=0.5)), None),
    ],
    ids=["none", "no states", "lag", "delay", "two effects"],
)
def test_the_quickest_of_the_effects_states_tells_how_long_a_step_may_be(effects, rate):
    """A lag's pole is -1/τ, those of the delay's approximant (-3 ± i√3)/T."""
    model = GliderModel(effects=effects)
    if rate is None:
        rate = 1.0 / dict(effects[1].to_dict())["time_constant"]
    assert model.settling_rate == pytest.approx(rate)
    for order in (1, 4):
        step = model.longest_step(order)
        assert step * rate == pytest.approx(STABLE[order]) if rate else step == np.inf
        assert model.count_laps(min(step, 1.0), order) == 1
        assert not rate or model.count_laps(1.01 * step, order) == 2


@pytest.mark.parametrize("order", [1, 4])
def test_a_quick_servo_flies_as_none(order):
    """Its elevator comes τ late: by 13 τ rad at the most, and what comes of it."""
    commands = np.random.default_rng(0).uniform(-8.0, 8.0, (3, 20))
    ends = [
        fly_tapes(
            model,
            np.tile(model.initial_state(PROBLEM.launch), (3, 1)),
            commands,
            0.02,
            order=order,
        )[:, -1, :7]
        for model in (NOMINAL, QUICK)
    ]
    tolerance = 0.02 if order == 4 else 0.3  # Euler's own error, of 20 ms.
    np.testing.assert_allclose(ends[1][:, :4], ends[0][:, :4], atol=tolerance)


def test_a_state_that_no_step_can_follow_is_refused():
    model = GliderModel(effects=(SERVO_LAG(time_constant=0.4 * SHORTEST),))
    with pytest.raises(InputError, match=r"servo_lag\.servo_rate.*without that effect"):
        model.longest_step()
