"""Throws that roll and yaw; attitude in logs, in and out."""

import dataclasses

import numpy as np
import pytest

from glider.campaign.checks.inspection import inspect
from glider.campaign.checks.masks import ALL
from glider.campaign.checks.rows import find_faults
from glider.campaign.reader import load_campaign
from glider.campaign.writer import save_campaign
from glider.errors import InputError
from tests.campaign.checks.breaking import change
from tests.helpers.campaigns import campaign_path


def tilt(roll=0.0, yaw=0.0, course=0.0):
    """Adds an attitude: constant angles, and a course off the plane [rad]."""

    def edit(flight):
        x = flight.pose[:, 0]
        y = np.tan(course) * (x - x[0])
        none = np.zeros(len(x))
        attitude = np.column_stack([y, roll + none, yaw + none])
        return dataclasses.replace(flight, attitude=attitude)

    return edit


@pytest.fixture(scope="module")
def campaign():
    whole = load_campaign(campaign_path("still_air"))
    return dataclasses.replace(whole, flights=whole.flights[:4])


def roll_over(first):
    """Rolls a glider by 6° a row from some row on."""

    def edit(flight):
        rows = np.arange(len(flight.time))
        roll = np.radians(6.0) * np.maximum(rows - first, 0)
        return tilt(roll)(flight)

    return edit


def test_a_throw_ends_where_its_wing_leaves_the_plane(campaign):
    """Also where the glider rolls on and over: it has turned off its course."""
    rolled = dataclasses.replace(
        campaign, flights=(roll_over(60)(campaign.flights[0]), *campaign.flights[1:])
    )
    found = inspect(rolled)
    left = np.flatnonzero(found.masks[campaign.flights[0].name].usable)
    assert left.max() == 60 + 7  # At a roll of 42°; the next is 48°.
    told = [s for s in found.excluded if "out of the plane" in s.why]
    assert [s.file for s in told] == [campaign.flights[0].name]
    assert told[0].rows == f"70-{len(campaign.flights[0].time) + 1}"
    upright = inspect(change(campaign, tilt(0.7, 0.1)))
    assert not upright.excluded


def test_a_glider_that_rolls_on_and_on_has_no_exchanged_markers(campaign):
    found = find_faults(change(campaign, roll_over(0)))
    assert not [rows for rows in found.excluded if "markers" in rows.why]


def test_a_throw_that_begins_out_of_the_plane_is_set_aside(campaign):
    rolled = dataclasses.replace(
        campaign, flights=(tilt(1.2)(campaign.flights[0]), *campaign.flights[1:])
    )
    found = inspect(rolled)
    assert len(found.campaign.flights) == 3
    assert any(s.rows == ALL and "out of the plane" in s.why for s in found.excluded)
    with pytest.raises(InputError, match="out of the plane of flight"):
        inspect(change(campaign, tilt(1.2)))


def test_attitude_comes_back_from_a_folder(campaign, tmp_path):
    tilted = change(campaign, tilt(0.1, -3.5, 0.2))
    save_campaign(tmp_path / "c", tilted)
    again = load_campaign(tmp_path / "c")
    for flight, right in zip(again.flights, tilted.flights, strict=True):
        np.testing.assert_allclose(flight.attitude, right.attitude, atol=1e-8)


@pytest.mark.parametrize(
    ("cell", "sentence"),
    [("nan", "column 'roll', row 5.*finite"), ("40", "column 'roll'.*degrees")],
)
def test_a_bad_attitude_is_refused(campaign, tmp_path, cell, sentence):
    save_campaign(tmp_path / "c", change(campaign, tilt(0.125)))
    file = tmp_path / "c" / campaign.flights[0].name
    lines = file.read_text().split("\n")
    lines[4] = lines[4].replace("0.125", cell)
    file.write_text("\n".join(lines))
    with pytest.raises(InputError, match=sentence):
        load_campaign(tmp_path / "c")


def test_y_without_angles_is_ignored(campaign, tmp_path):
    save_campaign(tmp_path / "c", change(campaign, tilt(0.1)))
    for file in (tmp_path / "c").glob("flight_*.csv"):
        file.write_text(file.read_text().replace("roll", "wobble"))
    assert load_campaign(tmp_path / "c").flights[0].attitude is None
