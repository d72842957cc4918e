"""Poses that software has filtered or filled are known from their noise."""

import numpy as np
import pytest
from scipy.signal import butter, filtfilt

from glider.campaign.checks.rows import find_faults, find_filled
from glider.campaign.reader import load_campaign
from tests.campaign.checks import breaking as b
from tests.helpers.campaigns import LIFELIKE, PRACTICE, campaign_path
from tests.helpers.tasks import fly

FILLED = slice(40, 54)


@pytest.fixture(scope="module")
def campaign():
    return fly(flights=4)


def low_pass(hertz, rate=120.0):
    numbers = butter(2, hertz / (0.5 * rate))
    return lambda pose: filtfilt(*numbers, pose, axis=0)


@pytest.mark.parametrize("hertz", [6.0, 15.0, 30.0, 40.0])
def test_filtered_poses_are_warned_of(campaign, hertz):
    (warning,) = find_faults(
        b.change(campaign, b.values("pose", low_pass(hertz)))
    ).warnings
    assert "they were filtered, or simulated without noise" in warning


@pytest.mark.parametrize("name", PRACTICE + LIFELIKE)
def test_raw_poses_are_neither_filtered_nor_filled(name):
    found = find_faults(load_campaign(campaign_path(name)))
    assert not [words for words in found.warnings if "filtered" in words]
    assert not [rows for rows in found.excluded if "filled" in rows.why]


def fill(pose, first=FILLED.start, last=FILLED.stop):
    """Puts rows on the line between those beside them, as software fills gaps."""
    filled = pose.copy()
    share = np.linspace(0.0, 1.0, last - first + 2)[1:-1, None]
    filled[first:last] = (1.0 - share) * pose[first - 1] + share * pose[last]
    return filled


def test_rows_on_a_straight_line_are_excluded_as_filled(campaign):
    found = find_faults(b.change(campaign, b.values("pose", fill)))
    lines = f"{FILLED.start + 2}-{FILLED.stop + 1}"
    for flight in campaign.flights:
        mask = found.masks[flight.name].pose
        np.testing.assert_array_equal(np.flatnonzero(mask), range(40, 54))
    assert [rows.rows for rows in found.excluded] == [lines] * 4
    assert all("filled, not measured" in rows.why for rows in found.excluded)


@pytest.mark.parametrize("digits", [3, 4, 9])
def test_filled_rows_are_found_in_rounded_positions(campaign, digits):
    pose = campaign.flights[0].pose
    time = campaign.flights[0].time
    assert not find_filled(time, np.round(pose[:, :2], digits)).any()
    place = fill(np.round(pose[:, :2], digits))
    is_filled = find_filled(time, place)
    if digits > 3:  # In whole millimeters noise is too coarse to tell.
        np.testing.assert_array_equal(np.flatnonzero(is_filled), range(40, 54))


def test_a_body_that_rests_is_not_filled():
    time = np.arange(100) / 120.0
    assert not find_filled(time, np.zeros((100, 2))).any()
    assert not find_filled(time, np.column_stack([7.0 * time, 0.0 * time])).any()
