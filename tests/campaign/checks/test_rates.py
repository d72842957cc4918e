"""A clock that is wrong is known from those that made the log's rows and commands."""

import dataclasses

import numpy as np
import pytest

from glider.campaign.checks.inspection import inspect
from glider.campaign.checks.rates import check_commands, check_rates
from glider.errors import InputError
from tests.campaign.checks import breaking as b
from tests.helpers.tasks import fly


@pytest.fixture(scope="module")
def campaign():
    return fly(flights=4)


@pytest.mark.parametrize("share", [1.05, 0.95, 1.03])
def test_a_clock_that_is_off_is_refused(campaign, share):
    words = f"it runs {share:.3g} times too fast"
    with pytest.raises(InputError, match=f"'command_rate' says 50; .*{words}"):
        inspect(b.change(campaign, b.stretch_time(share)))


def test_a_pose_rate_that_is_wrong_alone_is_warned_of(campaign):
    told = dataclasses.replace(campaign, pose_rate=100.0)
    (warning,) = inspect(told).warnings
    assert "rows come at 120 Hz where field 'pose_rate' says 100" in warning
    unknown = dataclasses.replace(told, command_rate=None)
    assert check_rates(unknown) == (warning,)


@pytest.mark.parametrize(
    "change",
    [
        lambda time: time,
        lambda time: 12.0 + np.round(time, 3),
        lambda time: 1.005 * time,
        lambda time: time + 5e-4 * np.sin(1e3 * time),
    ],
    ids=["as it is", "in milliseconds", "a little off", "that jitters"],
)
def test_a_clock_that_is_right_passes(campaign, change):
    timed = b.change(campaign, b.values("time", change))
    assert check_rates(timed) == ()


def test_rows_that_are_missing_or_left_out_pass(campaign):
    rng = np.random.default_rng(0)
    for edit in (b.lose_some(0.2, rng), b.thin(2)):
        assert check_rates(b.change(campaign, edit)) == ()


def test_commands_that_no_servo_got_are_refused(campaign):
    rng = np.random.default_rng(0)

    def asked(flight):
        command = flight.command + 0.1 * rng.normal(size=len(flight.time))
        return dataclasses.replace(flight, command=command)

    flights = tuple(asked(flight) for flight in campaign.flights)
    told = dataclasses.replace(campaign, flights=flights)
    with pytest.raises(InputError, match=r"changes 119 times a second; expected 50"):
        check_commands(told)
    check_commands(dataclasses.replace(told, command_rate=None))
