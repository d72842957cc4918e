"""A clock that is wrong is known from those that made the log's rows and commands."""

import dataclasses

import numpy as np
import pytest

from glider.campaign.checks.inspection import inspect
from glider.campaign.checks.rates import check_rates
from glider.errors import InputError
from tests.helpers.tasks import fly


@pytest.fixture(scope="module")
def campaign():
    return fly(flights=4)


def timed(campaign, change):
    """Returns the campaign with the times of each flight changed."""
    flights = [dataclasses.replace(f, time=change(f.time)) for f in campaign.flights]
    return dataclasses.replace(campaign, flights=tuple(flights))


@pytest.mark.parametrize("share", [1.05, 0.95, 1.03])
def test_a_clock_that_is_off_is_refused(campaign, share):
    words = f"it runs {share:.3g} times too fast"
    with pytest.raises(InputError, match=f"'command_rate' says 50; .*{words}"):
        inspect(timed(campaign, lambda time: share * time))


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
    assert check_rates(timed(campaign, change)) == ()


def test_rows_that_are_missing_or_left_out_pass(campaign):
    rng = np.random.default_rng(0)
    for rows in (lambda n: rng.random(n) > 0.2, lambda n: np.arange(n) % 2 == 0):
        flights = [
            dataclasses.replace(
                f,
                time=f.time[keep],
                pose=f.pose[keep],
                elevator=f.elevator[keep],
                command=f.command[keep],
            )
            for f in campaign.flights
            for keep in [rows(len(f.time))]
        ]
        assert check_rates(dataclasses.replace(campaign, flights=tuple(flights))) == ()
