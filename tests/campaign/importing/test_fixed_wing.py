"""Logs of powered aircraft: gliding phases are flights, the rest is refused at once."""

import re

import numpy as np
import pytest

from glider.campaign.importing import campaign_import
from glider.campaign.importing.campaign_import import read_flights
from glider.campaign.importing.guess import guess_mapping
from glider.campaign.importing.onboard_checks import _averaged
from glider.campaign.importing.selection import Stream
from glider.campaign.reader import load_campaign
from glider.campaign.writer import save_campaign
from glider.errors import InputError
from tests.campaign.importing import fixed_wing

COUNT = 3
MOTOR = 5.0  # Seconds with the motor on, then off.
GLIDE = 8.0


@pytest.fixture(scope="module")
def flown():
    rng = np.random.default_rng(5)
    return [fixed_wing.fly(rng, MOTOR, GLIDE) for _ in range(COUNT)]


def write(folder, flights, text=fixed_wing.MAP, **options):
    rng = np.random.default_rng(6)
    files = [
        fixed_wing.write(folder / f"log_{k}.ulg", flight, rng, **options)
        for k, flight in enumerate(flights)
    ]
    path = folder / "MAP.yaml"
    path.write_text(text)
    return files, path


def write_csv(folder, flight, noise=0.003):
    """Position and pitch alone, as of a log without a throttle."""
    rng = np.random.default_rng(7)
    x, z, pitch = flight.states.T[:3]
    table = np.column_stack([flight.time, x, z, pitch])
    table[:, 1:] += rng.normal(size=(len(x), 3)) * [noise, noise, 0.001]
    file, path = folder / "flight.csv", folder / "MAP.yaml"
    np.savetxt(file, table, "%.7g", ",", header="time,x,z,pitch", comments="")
    path.write_text("columns: {x: x, z: z, pitch: pitch}\nvehicle: {elevator: fixed}\n")
    return file, path


def test_phases_with_the_motor_off_are_flights(tmp_path, flown):
    """No noise is taken for a hand, and nothing of the glide is lost but the start."""
    imported = read_flights(*write(tmp_path, flown))
    assert len(imported.campaign.flights) == COUNT
    for recording in imported.recordings:
        [flight] = recording.flights
        assert flight.span[0] == pytest.approx(9.0 + MOTOR + 0.5, abs=0.03)
        assert flight.span[1] == pytest.approx(9.0 + MOTOR + GLIDE, abs=0.03)
        assert "the motor is off" in flight.why


def test_a_throttle_that_no_map_names_is_heeded(tmp_path, flown):
    lines = fixed_wing.MAP.splitlines()
    text = "\n".join(line for line in lines if "throttle" not in line)
    imported = read_flights(*write(tmp_path, flown, text))
    assert all("motor is off" in r.flights[0].why for r in imported.recordings)


def test_a_powered_log_is_refused_in_one_sentence(tmp_path):
    powered = fixed_wing.fly(np.random.default_rng(5), 8.0, 0.0)
    with pytest.raises(InputError, match="motor runs wherever the aircraft flies"):
        read_flights(*write(tmp_path, [powered]))


def test_a_powered_log_without_throttle_is_refused(tmp_path):
    """It loses less energy than any glider."""
    powered = fixed_wing.fly(np.random.default_rng(5), 8.0, 0.0)
    file, path = write_csv(tmp_path, powered)
    with pytest.raises(InputError, match="motor runs"):
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
    for topic in ("actuator_servos.control[2]", "actuator_motors.control[0]"):
        assert topic in text
    path = tmp_path / "GUESS.yaml"
    path.write_text(text + "  elevator_rate_limit: 6.0\n")
    assert len(read_flights(files, path).campaign.flights) == COUNT


@pytest.fixture(scope="module")
def glides():
    rng = np.random.default_rng(5)
    return [fixed_wing.fly(rng, 0.0, GLIDE) for _ in range(COUNT)]


def sensed(folder, flights, units="", **options):
    text = fixed_wing.MAP.replace("units: {", f"units: {{{units}")
    return read_flights(*write(folder, flights, text, **options))


def test_right_sensors_say_nothing(tmp_path, glides):
    imported = sensed(tmp_path, glides)
    assert not any("airspeed" in w or "times" in w for w in imported.undecided)


def test_the_gyro_is_a_column_that_a_campaign_keeps(tmp_path, glides):
    imported = sensed(tmp_path, glides).campaign
    save_campaign(tmp_path / "out", imported)
    for flight, flown in zip(
        load_campaign(tmp_path / "out").flights, glides, strict=True
    ):
        true = np.interp(flight.time, flown.time, flown.states[:, 6])
        assert flight.pitch_rate is not None
        known = np.isfinite(flight.pitch_rate)
        assert known.mean() > 0.98
        assert np.std((flight.pitch_rate - true)[known]) == pytest.approx(0.01, rel=0.2)


def test_a_slow_gyro_counts_in_rows_of_its_own(tmp_path):
    rate = np.arange(5) * 0.05  # A fifth as often as the rows.
    slow = Stream(rate, np.ones((5, 3)), "")
    means = _averaged(slow, np.arange(20) * 0.01)
    np.testing.assert_array_equal(
        np.flatnonzero(np.isfinite(means[:, 0])), [0, 5, 10, 15]
    )


def test_the_airspeed_shows_the_wind(tmp_path, glides):
    imported = sensed(tmp_path, glides, wind=-2.0)
    [warning] = [w for w in imported.undecided if "airspeed" in w]
    assert re.search(r"is -[12]\.\d\d to -1\.\d\d m/s off the airspeed of 13", warning)


@pytest.mark.parametrize(
    ("units", "words"),
    [
        ("angular_velocity: deg/s, ", r"57.* ± .* times as much as 'angular_velocity'"),
        (
            "angular_velocity: {gain: -1.0}, ",
            "-0.99.* ± .* times as much as 'angular_velocity'",
        ),
        ("acceleration: g, ", "times as much as 'acceleration'"),
        (
            "length: {gain: 0.7}, ",
            r"change 0\.[67]\d+ ± .* times as much as 'acceleration'",
        ),
        ("time: {gain: 1.25e-6}, ", "times as much as 'angular_velocity'"),
    ],
)
def test_a_wrong_unit_shows_in_rates_or_accelerations(
    tmp_path, glides, units, words, monkeypatch
):
    monkeypatch.setattr(campaign_import, "advise", lambda error, *_: error)
    with pytest.raises(InputError, match=words):
        sensed(tmp_path, glides, units)


def test_short_flights_are_not_judged_by_their_sensors(tmp_path):
    rng = np.random.default_rng(5)
    short = [fixed_wing.fly(rng, 0.0, duration) for duration in (0.4, 0.6, 1.0)]
    imported = sensed(tmp_path, short, "angular_velocity: deg/s, ")
    assert len(imported.campaign.flights) == len(short)


def test_an_airspeed_that_is_never_valid_is_none(tmp_path, glides):
    imported = sensed(tmp_path, glides, wind=np.nan)
    assert not any("airspeed" in words for words in imported.undecided)


def test_a_rate_about_another_axis_is_reported(tmp_path, glides):
    stem = "vehicle_angular_velocity.xyz"
    axes = ", ".join(f'"{stem}[{k}]"' for k in (1, 0, 2))
    files, path = write(tmp_path, glides, fixed_wing.MAP.replace(stem, f"[{axes}]"))
    [warning] = [w for w in read_flights(files, path).undecided if "times as" in w]
    assert "angular_velocity" in warning
