"""Logs of fixed-wing aircraft as PX4 writes them: they glide, or are refused."""

import numpy as np
import pytest
import yaml

from glider.campaign.importing.campaign_import import read_flights
from glider.campaign.importing.guess import guess_mapping
from glider.errors import InputError
from tests.campaign.importing import fixed_wing

COUNT = 3
GLIDE = 8.0  # Seconds with the motor off.


@pytest.fixture(scope="module")
def flown():
    rng = np.random.default_rng(5)
    return [fixed_wing.fly(rng, 0.0, GLIDE) for _ in range(COUNT)]


def write(folder, flights, text=fixed_wing.MAP):
    rng = np.random.default_rng(6)
    files = [
        fixed_wing.write(folder / f"log_{k}.ulg", flight, rng)
        for k, flight in enumerate(flights)
    ]
    path = folder / "MAP.yaml"
    path.write_text(text)
    return files, path


def write_csv(folder, flight, noise=0.003):
    """Position and pitch alone, as of a camera."""
    rng = np.random.default_rng(7)
    x, z, pitch = flight.states.T[:3]
    table = np.column_stack([flight.time, x, z, pitch])
    table[:, 1:] += rng.normal(size=(len(x), 3)) * [noise, noise, 0.001]
    file, path = folder / "flight.csv", folder / "MAP.yaml"
    np.savetxt(file, table, "%.7g", ",", header="time,x,z,pitch", comments="")
    path.write_text("columns: {x: x, z: z, pitch: pitch}\nvehicle: {elevator: fixed}\n")
    return file, path


def test_a_powered_log_is_refused(tmp_path):
    """It loses less energy than any glider."""
    powered = fixed_wing.fly(np.random.default_rng(5), 8.0, 0.0)
    file, path = write_csv(tmp_path, powered)
    with pytest.raises(InputError, match="a motor drives it"):
        read_flights([file], path)


def test_noise_is_no_hand_that_lets_go(tmp_path):
    """Five millimeters of it make accelerations of 6 m/s² while the energy grows."""
    flown = fixed_wing.fly(np.random.default_rng(5), 3.0, 9.0)
    file, path = write_csv(tmp_path, flown, noise=0.005)
    [flight] = read_flights([file], path).recordings[0].flights
    assert flight.span == pytest.approx((0.0, 12.0), abs=0.03)


def test_poses_at_ten_hertz_are_too_few(tmp_path, flown):
    """As PX4 logs positions by default."""
    whole = flown[0]
    rows = slice(None, None, 5)
    fields = {name: values[rows] for name, values in vars(whole).items()}
    slow = fixed_wing.Motored(**fields)
    with pytest.raises(InputError, match=r"poses were logged every 0\.1 s"):
        read_flights(*write(tmp_path, [slow]))


def test_a_guess_finds_the_topics_and_the_servo_of_the_elevator(tmp_path, flown):
    files, _ = write(tmp_path, flown)
    text = guess_mapping(files).text
    assert "actuator_servos.control[2]  # PX4's topic" in text
    found = yaml.safe_load(text)
    assert found["frame"]["axes"] == "NED"
    assert found["units"] == {"elevator_angle_command": {"gain": 1.0}}
    path = tmp_path / "GUESS.yaml"
    path.write_text(text + "  elevator_rate_limit: 6.0\n")
    assert len(read_flights(files, path).campaign.flights) == COUNT
