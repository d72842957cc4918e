"""Motion capture is as noisy as it says."""

import dataclasses

import numpy as np
import pytest

from glider.campaign.motion_capture import MotionCapture
from glider.campaign.reader import load_campaign
from glider.errors import InputError
from glider.sysid.replay.record import measure_noise
from tests.helpers.campaigns import PRACTICE, campaign_path

QUIET = MotionCapture(position=0.0, pitch=0.0, elevator=0.0)

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
