"""Lengths, times, angles and gears in a wrong scale are refused, or warned of."""

import dataclasses
import re
from pathlib import Path

import numpy as np
import pytest

from glider.campaign.checks.fall import _measure_fall, check_fall
from glider.campaign.checks.forces import measure_motions
from glider.campaign.checks.inspection import inspect
from glider.campaign.checks.servo import measure_elevators
from glider.campaign.checks.travel import _calc_travel
from glider.campaign.reader import load_campaign
from glider.errors import InputError
from glider.physics.effects import KINDS
from tests.campaign.checks import breaking as b
from tests.campaign.checks.test_effects_pass import fly
from tests.helpers.campaigns import campaign_path

MEASURED = Path(__file__).parents[4] / "shared" / "measured" / "motion_studio_v3"


@pytest.fixture(scope="module")
def campaign():
    return load_campaign(campaign_path("attached_lift"))


@pytest.fixture(scope="module")
def throws():
    """Measured throws of a foam plane, or simulated ones where there are none."""
    return load_campaign(MEASURED if MEASURED.is_dir() else "head_wind")


def edited(campaign, edit):
    """A campaign whose rates are those of its rows: nothing else shows a time scale."""
    rows = dataclasses.replace(b.change(campaign, edit), command_rate=None)
    steps = [np.diff(flight.time) for flight in rows.flights]
    rate = 1.0 / float(np.median(np.concatenate(steps)))
    return dataclasses.replace(rows, pose_rate=rate)


@pytest.mark.parametrize("of", ["campaign", "throws"])
@pytest.mark.parametrize(
    ("edit", "length", "time"),
    [
        (b.scale(0.7, 0.7, 1.0), 1.43, 0.84),
        (b.scale(0.8, 0.8, 1.0), 1.25, 0.89),
        (b.scale(1.4, 1.4, 1.0), 0.71, 1.18),
        (b.stretch_time(1.25), 1.56, 0.8),
        (b.stretch_time(0.8), 0.64, 1.25),
    ],
)
def test_a_wrong_scale_is_refused_with_both_remedies(request, of, edit, length, time):
    with pytest.raises(InputError, match=r"flights fall at .*'units: length'") as info:
        inspect(edited(request.getfixturevalue(of), edit))
    found = re.findall(r"([\d.]+) times as large", str(info.value))
    assert np.allclose([float(n) for n in found], [length, time], rtol=0.1)


def test_a_scale_that_is_a_little_off_is_warned_of(campaign):
    [words] = inspect(b.change(campaign, b.scale(1.09, 1.09, 1.0))).warnings
    assert words.startswith("Scale: the flights fall at 11")


def test_few_flights_say_how_little_they_show(campaign):
    """The stated error covers the true one."""
    for count in (3, 5, 10, 40):
        fall, error = _measure_fall(measure_motions(campaign.flights[:count], {}))
        assert abs(np.log(fall / 9.81)) < 2.0 * error
        assert error < 0.15


def test_throws_of_one_plan_count_as_one_flight(campaign):
    """What their forces lack is the same in all: the scatter does not show it."""
    flight, rng = campaign.flights[0], np.random.default_rng(0)
    throws = [
        dataclasses.replace(
            flight,
            name=f"throw {i}",
            pose=flight.pose + rng.normal(0.0, 1e-3, size=flight.pose.shape),
        )
        for i in range(10)
    ]
    repeated = dataclasses.replace(campaign, flights=tuple(throws))
    scaled = edited(repeated, b.scale(0.7, 0.7, 1.0))
    check_fall(scaled, measure_motions(scaled.flights, {}))  # At most a warning.
    flown = edited(campaign, b.scale(0.7, 0.7, 1.0))
    with pytest.raises(InputError, match="flights fall at"):
        check_fall(flown, measure_motions(flown.flights, {}))


@pytest.mark.parametrize("of", ["campaign", "throws"])
def test_radians_taken_for_degrees_are_refused(request, of):
    edit = b.scale(1.0, 1.0, np.pi / 180.0)
    with pytest.raises(InputError, match=r"'pitch' fits the motion 57\.3 times"):
        inspect(b.change(request.getfixturevalue(of), edit))


@pytest.mark.parametrize("gear", [2.0, 0.5, 1.3])
def test_a_servo_that_is_geared_differently_is_refused(campaign, gear):
    edit = b.with_servo(elevator=lambda f: gear * f.elevator)
    loose = dataclasses.replace(campaign, elevator_limits=None)
    with pytest.raises(InputError, match=r"turns .* as far as commanded") as info:
        inspect(b.change(loose, edit))
    [found] = re.findall(r"turns ([\d.]+) times", str(info.value))
    assert float(found) == pytest.approx(gear, rel=0.05)


@pytest.mark.parametrize(
    ("kind", "values"),
    [
        ("servo_lag", {"time_constant": 0.1}),
        ("servo_lag", {"time_constant": 0.3}),
        ("command_delay", {"delay": 0.3}),
    ],
)
def test_a_slow_servo_turns_as_far_as_commanded(kind, values):
    gain, error = _calc_travel(measure_elevators(fly((KINDS[kind](**values),)), {}))
    assert abs(np.log(gain)) < max(0.03, 4.0 * error)
