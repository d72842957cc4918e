"""Motion capture is as noisy as it says, and logs the flight that was flown."""

import dataclasses

import numpy as np
import pytest

from glider.campaign.logs import campaign_of
from glider.campaign.motion_capture import MotionCapture
from glider.campaign.reader import load_campaign
from glider.campaign.writer import save_campaign
from glider.errors import InputError
from glider.physics.effects import ANGLE_SIGN, MARKER_OFFSET, POSE_LATENCY, SERVO_LAG
from glider.physics.model import GliderModel
from glider.sysid.replay.record import measure_noise
from tests.helpers.campaigns import PRACTICE, campaign_path

QUIET = MotionCapture(position=0.0, pitch=0.0, elevator=0.0)
SWITCHES = np.arange(43) / 50.0
RATES = np.random.default_rng(1).normal(size=43)


def path(time):
    """Returns cubics for x, z and pitch, a straight elevator, and their rates."""
    t = np.asarray(time)
    return np.stack(
        [
            -3.5 + 7.0 * t - 2.0 * t**2 + 0.5 * t**3,
            0.1 + 0.3 * t + 2.0 * t**2 - 1.5 * t**3,
            0.2 - 1.5 * t + 3.0 * t**2 - 4.0 * t**3,
            0.3 - 0.4 * t,
            7.0 - 4.0 * t + 1.5 * t**2,
            0.3 + 4.0 * t - 4.5 * t**2,
            -1.5 + 6.0 * t - 12.0 * t**2,
        ],
        axis=1,
    )


def film(capture=QUIET, model=None, *, end=0.85, states=None, seed=0):
    """Logs the known flight, integrated at steps that samples fall between."""
    times = np.linspace(0.0, end, 70)
    return capture.log(
        GliderModel() if model is None else model,
        times,
        path(times) if states is None else states,
        (SWITCHES, RATES),
        np.random.default_rng(seed),
        "flight_007.csv",
    )


# -------------------------------------------------------------------- the numbers


def test_the_defaults_are_those_of_the_practice_campaigns():
    capture = MotionCapture()
    np.testing.assert_array_equal(capture.std, [0.0004, 0.0004, 0.0025, 0.005])
    for name in PRACTICE:
        campaign = load_campaign(campaign_path(name))
        assert campaign.pose_rate == capture.rate
        noise = measure_noise(campaign)
        assert noise.position == pytest.approx(capture.position, rel=0.05)
        assert noise.pitch == pytest.approx(capture.pitch, rel=0.05)
        if name != "slow_servo":  # There the elevator parts from its commands.
            assert noise.elevator == pytest.approx(capture.elevator, rel=0.05)


@pytest.mark.parametrize("name", ["rate", "position", "pitch", "elevator"])
@pytest.mark.parametrize("value", [-1e-3, np.nan, np.inf, -np.inf])
def test_a_number_that_cannot_be_is_refused_in_one_sentence(name, value):
    with pytest.raises(InputError, match=f"'{name}' is {value}; ") as refusal:
        MotionCapture(**{name: value})
    message = str(refusal.value)
    assert message.startswith("MotionCapture: ")
    assert "; expected a finite number, " in message
    assert "\n" not in message


def test_a_sensor_may_be_without_noise_but_not_without_samples():
    np.testing.assert_array_equal(QUIET.std, np.zeros(4))
    with pytest.raises(InputError, match=r"'rate' is 0\.0; .* positive"):
        MotionCapture(rate=0.0)


def test_it_is_not_changed_once_it_is_made():
    """A number set later would not be checked."""
    with pytest.raises(dataclasses.FrozenInstanceError):
        QUIET.rate = -1.0


# ---------------------------------------------------------------------- the noise


def test_noise_has_the_deviations_that_it_says():
    capture = MotionCapture(position=0.002, pitch=0.03, elevator=0.4)
    noise = capture.draw(np.random.default_rng(0), 100, 300)
    assert noise.shape == (100, 300, 4)
    rows = noise.reshape(-1, 4) / [0.002, 0.002, 0.03, 0.4]
    np.testing.assert_allclose(np.std(rows, axis=0), 1.0, rtol=0.02)
    np.testing.assert_allclose(np.mean(rows, axis=0), 0.0, atol=0.03)
    np.testing.assert_allclose(np.corrcoef(rows.T), np.eye(4), atol=0.03)
    lag = np.mean(noise[:, 1:] * noise[:, :-1], axis=(0, 1)) / capture.std**2
    np.testing.assert_allclose(lag, 0.0, atol=0.03)  # Nor with the sample before.


def test_noise_is_one_row_or_many_and_follows_from_the_seed():
    assert MotionCapture().draw(np.random.default_rng(0)).shape == (4,)
    one, again, other = (
        MotionCapture().draw(np.random.default_rng(seed), 5) for seed in (0, 0, 1)
    )
    np.testing.assert_array_equal(one, again)
    assert np.all(one != other)


def test_a_log_has_the_noise_that_is_drawn():
    capture = MotionCapture(position=0.002, pitch=0.03, elevator=0.4)
    noisy, true = film(capture, seed=3), film(QUIET)
    noise = capture.draw(np.random.default_rng(3), len(true.time))
    np.testing.assert_allclose(noisy.pose - true.pose, noise[:, :3], atol=1e-12)
    np.testing.assert_allclose(noisy.elevator - true.elevator, noise[:, 3], atol=1e-12)
    np.testing.assert_array_equal(noisy.command, true.command)


# ------------------------------------------------------------------------ the log


@pytest.mark.parametrize(
    ("rate", "end", "rows"), [(120.0, 0.85, 103), (100.0, 0.29, 30), (50.0, 0.845, 43)]
)
def test_samples_begin_with_the_flight_and_end_within_it(rate, end, rows):
    log = film(dataclasses.replace(QUIET, rate=rate), end=end)
    np.testing.assert_allclose(log.time, np.arange(rows) / rate, rtol=1e-12)
    assert end - 1.0 / rate < log.time[-1] <= end + 1e-9
    assert log.name == "flight_007.csv"


def test_a_known_flight_shows_its_pose_and_elevator():
    """Between the integrator's steps a pose follows its rate: cubics come exactly."""
    log = film()
    expected = path(log.time)
    np.testing.assert_allclose(log.pose, expected[:, :3], atol=1e-12)
    np.testing.assert_allclose(log.elevator, expected[:, 3], atol=1e-12)


def test_a_command_is_held_and_shows_from_the_first_row_after_it():
    """At 120 rows and 50 commands a second, row k shows command 5 k // 12."""
    log = film()
    shown = 5 * np.arange(len(log.time)) // 12
    np.testing.assert_array_equal(log.command, RATES[shown])
    assert shown[11] == 4 and shown[12] == 5  # Both begin at 0.1 s.


def test_it_shows_what_the_glider_s_sensors_show():
    """A marker off the center of mass, seen late; the elevator's sensor is apart."""
    model = GliderModel(
        effects=(MARKER_OFFSET(ahead=0.1, above=0.02), POSE_LATENCY(latency=0.01))
    )
    log = film(model=model)
    x, z, pitch, elevator, xdot, zdot, pitchdot = path(log.time).T
    marker_x = x + 0.1 * np.cos(pitch) + 0.02 * np.sin(pitch) - 0.01 * xdot
    marker_z = z - 0.1 * np.sin(pitch) + 0.02 * np.cos(pitch) - 0.01 * zdot
    expected = np.stack([marker_x, marker_z, pitch - 0.01 * pitchdot], axis=1)
    # The rates that the latency acts by are interpolated by straight lines.
    np.testing.assert_allclose(log.pose, expected, atol=1e-5)
    np.testing.assert_allclose(log.elevator, elevator, atol=1e-12)


def test_a_log_with_wrong_signs_has_them_in_every_column():
    signs = {"pitch": -1.0, "elevator": -1.0, "command": -1.0}
    right, wrong = film(), film(model=GliderModel(effects=(ANGLE_SIGN(**signs),)))
    np.testing.assert_array_equal(wrong.pose, right.pose * [1.0, 1.0, -1.0])
    np.testing.assert_array_equal(wrong.elevator, -right.elevator)
    np.testing.assert_array_equal(wrong.command, -right.command)


def test_the_effects_own_states_are_not_shown():
    times = np.linspace(0.0, 0.85, 70)
    states = np.column_stack([path(times), np.cos(times)])
    lagging = GliderModel(effects=(SERVO_LAG(time_constant=0.03),))
    log, plain = film(model=lagging, states=states), film()
    np.testing.assert_array_equal(log.pose, plain.pose)
    np.testing.assert_array_equal(log.elevator, plain.elevator)


def test_a_log_is_a_flight_of_a_campaign(tmp_path):
    log = film(MotionCapture())
    parameters = GliderModel().parameters
    save_campaign(tmp_path, campaign_of("filmed", parameters, [log], 120.0, 50.0))
    [loaded] = load_campaign(tmp_path).flights
    assert loaded.name == log.name
    for name in ("time", "pose", "elevator", "command"):
        np.testing.assert_allclose(getattr(loaded, name), getattr(log, name), atol=1e-6)


@pytest.mark.parametrize("value", [np.nan, np.inf])
@pytest.mark.parametrize("row", [30, -1])
def test_a_flight_that_diverges_is_refused_by_its_name(value, row):
    states = path(np.linspace(0.0, 0.85, 70))
    states[row, 6] = value
    with pytest.raises(InputError, match=r"^flight_007\.csv: the flight diverges"):
        film(states=states)
