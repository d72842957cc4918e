"""A steady glide: the trim is steady, and a disturbed flight returns to it."""

import numpy as np
import pytest

from examples import cruise
from glider.errors import InputError
from glider.physics.effects import DYNAMIC_STALL, SERVO_LAG, THRUST, WIND
from glider.physics.effects.free_functions import FreeFunction
from glider.physics.model import GliderModel
from glider.physics.parameters import GliderParameters
from tests.helpers.examples import run_main

POWERED = GliderModel(effects=(THRUST(force=0.1),))
POWERED_WITH_STATES = GliderModel(
    effects=(
        THRUST(force=0.1),
        SERVO_LAG(time_constant=0.03),
        DYNAMIC_STALL(strength=0.5),
    )
)
WINDY = GliderModel(effects=(WIND(x=-1.0, z=0.2),))


@pytest.mark.parametrize(
    ("model", "speed"),
    [(GliderModel(), 7.0), (WINDY, 6.0), (POWERED, None), (POWERED_WITH_STATES, None)],
    ids=["glide", "wind", "level", "level with states"],
)
def test_a_disturbed_cruise_returns_to_its_trim(model, speed):
    flown = cruise.fly(model, speed, seconds=25.0)
    first, last = flown.offsets
    assert first > 0.04
    assert last < 1e-3
    end = flown.flights[0].states[-1] - flown.trim
    np.testing.assert_allclose(end[2:], 0.0, atol=1e-3)


def test_trims_are_steady_at_the_speed_or_level():
    glide = cruise.find_trim(GliderModel(), 7.0)
    assert np.hypot(*glide[4:6]) == pytest.approx(7.0)
    assert -0.3 < cruise.slope_of(glide) < -0.1
    assert cruise.slope_of(cruise.find_trim(POWERED)) == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("speed", [None, 1.0], ids=["level", "too slow"])
def test_a_flight_that_cannot_be_steady_is_refused(speed):
    with pytest.raises(InputError, match="No steady"):
        cruise.find_trim(GliderModel(), speed)


def test_a_flight_beyond_the_elevator_s_travel_is_refused():
    angle = cruise.find_trim(GliderModel(), 7.0)[3]
    assert angle > 0.02
    stuck = GliderParameters(elevator_limits=[-0.5, 0.9 * angle])
    with pytest.raises(InputError, match=f"elevator of {angle:.3f} rad; its travel"):
        cruise.find_trim(GliderModel(parameters=stuck), 7.0)


def test_a_cruise_through_changing_air_is_refused():
    field = FreeFunction(
        variables=["x"], centers=[[0.5]], widths=[1.0], weights={"wind_z": [0.3]}
    )
    trim = cruise.find_trim(GliderModel(), 7.0)
    with pytest.raises(InputError, match="along the line"):
        cruise.cruise_regulator(GliderModel(free_functions=(field,)), trim)


def test_the_result_is_reported(tmp_path):
    flown = cruise.fly(GliderModel(), 7.0, seconds=2.0)
    output = run_main(cruise, flown, tmp_path, "--speed=6", writes=("--json", "--html"))
    assert output.figures == flown.key_figures()
    assert output.figures["speed"] == pytest.approx(7.0)
    assert "Trimmed at 7.00 m/s" in output.words
    assert output.asked.call_args.args[1] == 6.0
    assert ">disturbed glide<" in output.page
