"""A steady glide: the trim is steady, and a disturbed flight returns to it."""

import re

import numpy as np
import pytest

from diagrams import closed_loop, simulate_flights
from examples import cruise
from glider.errors import InputError
from glider.physics.effects import DYNAMIC_STALL, SERVO_LAG, WIND
from glider.physics.effects.free_functions import FreeFunction
from glider.physics.model import GliderModel
from glider.physics.parameters import GliderParameters

WITH_STATES = GliderModel(
    effects=(SERVO_LAG(time_constant=0.03), DYNAMIC_STALL(strength=0.5))
)
WINDY = GliderModel(effects=(WIND(x=-1.0, z=0.2),))


@pytest.mark.parametrize(
    ("model", "speed"), [(WINDY, 6.0), (WITH_STATES, 7.0)], ids=["wind", "states"]
)
def test_a_disturbed_cruise_returns_to_its_trim(model, speed):
    trim = cruise.find_trim(model, speed)
    assert np.hypot(*trim[4:6]) == pytest.approx(speed)
    loop = closed_loop(model, cruise.cruise_regulator(model, trim), all_states=True)
    start = trim.copy()
    start[:7] += cruise.DISTURBANCE
    [flight] = simulate_flights(loop, start[None], 25.0)
    np.testing.assert_allclose(flight.states[-1, 2:], trim[2:], atol=1e-3)
    slope = cruise.slope_of(trim)
    across = flight.states[:, :2] @ [-np.sin(slope), np.cos(slope)]
    assert abs(across[0]) > 0.04
    assert abs(across[-1]) < 1e-3


def test_what_is_printed_and_shown(tmp_path, capsys):
    page = tmp_path / "page.html"
    cruise.main(["--headless", f"--html={page}"])
    words = capsys.readouterr().out
    assert "Trimmed at 7.00 m/s: path -" in words
    first, last = re.search(r"(\S+) mm off .*, (\S+) mm after 12 s", words).groups()
    assert float(last) < 5.0 < 40.0 < float(first)
    assert ">disturbed glide<" in page.read_text(encoding="utf-8")


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
