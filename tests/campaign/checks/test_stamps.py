"""Stamps that jitter are known from a motion that is smoother at even steps."""

import dataclasses

import numpy as np
import pytest

from glider.campaign.checks.inspection import inspect
from glider.campaign.checks.stamps import find_even_times
from glider.campaign.importing.campaign_import import import_campaign
from glider.campaign.reader import load_campaign
from tests.campaign.importing import foreign
from tests.helpers.campaigns import LIFELIKE, PRACTICE, campaign_path
from tests.helpers.tasks import fly

RATE = 120.0


@pytest.fixture(scope="module")
def campaign():
    return fly(flights=4)


def logs_of(campaign, jitter=0.0, seed=0, lost=()):
    """Returns stamps with jitter and positions without lost rows, and true times."""
    rng = np.random.default_rng(seed)
    logs = []
    truth = []
    for flight in campaign.flights:
        kept = np.isfinite(flight.pose).all(axis=1)
        kept[[*lost]] = False
        stamps = flight.time + rng.normal(0.0, jitter, len(flight.time))
        logs.append((np.sort(stamps)[kept], flight.pose[kept, :2]))
        truth.append(flight.time[kept])
    return logs, truth


@pytest.mark.parametrize("name", PRACTICE + LIFELIKE)
def test_stamps_are_kept_unless_they_jitter(name):
    campaign = load_campaign(campaign_path(name))
    found, words = find_even_times(logs_of(campaign)[0], None)
    assert not any(found)
    assert words == ""
    found, _ = find_even_times(logs_of(campaign, 0.2e-3)[0], None)
    assert all(even is not None for even in found)


@pytest.mark.parametrize("lost", [(), (30, 31, 60), (2, 50, 51, 52, 97), (1, 2, 60)])
@pytest.mark.parametrize("jitter", [1e-3, 6e-3])
def test_even_steps_are_restored_about_lost_frames(campaign, jitter, lost):
    logs, truth = logs_of(campaign, jitter, lost=lost)
    found, words = find_even_times(logs, RATE)
    for even, time in zip(found, truth, strict=True):
        assert np.std(even.time - time) < 1e-4
        assert even.jitter == pytest.approx(jitter, rel=0.5)
    assert "The times of 4 of 4 logs jitter by" in words
    assert "pose_rate" not in words


def test_a_rate_that_is_unknown_is_estimated_with_a_word(campaign):
    found, words = find_even_times(logs_of(campaign, 1e-3)[0], None)
    assert {even.rate for even in found} == {found[0].rate}
    assert found[0].rate == pytest.approx(RATE, rel=2e-3)
    assert "specify 'pose_rate'" in words


def test_frames_whose_loss_the_motion_does_not_show_are_not_guessed(campaign):
    logs, _ = logs_of(campaign, 1e-3, lost=range(40, 60, 2))
    assert find_even_times(logs, RATE)[0] == [None] * 4


def test_steps_that_are_truly_uneven_stay(campaign):
    rng = np.random.default_rng(0)
    logs = []
    for flight in campaign.flights:
        time = np.sort(flight.time + rng.normal(0.0, 1e-3, len(flight.time)))
        smooth = [np.interp(time, flight.time, flight.pose[:, k]) for k in (0, 1)]
        logs.append((time, np.column_stack(smooth)))
    assert find_even_times(logs, RATE)[0] == [None] * 4


def test_inspection_restores_them_and_doubts_the_servos_clock(campaign):
    rng = np.random.default_rng(1)
    late = [
        dataclasses.replace(
            f, time=np.sort(f.time + rng.exponential(2e-3, f.time.size))
        )
        for f in campaign.flights
    ]
    jittered = dataclasses.replace(campaign, flights=tuple(late), pose_rate=RATE)
    found = inspect(jittered)
    for flight in found.campaign.flights:
        np.testing.assert_allclose(np.diff(flight.time), 1.0 / RATE, atol=1e-9)
    assert found.campaign.servo.clock_std == pytest.approx(2e-3, rel=0.4)
    assert any("jitter by" in words for words in found.warnings)


@pytest.mark.parametrize("rate", ["", f"pose_rate: {RATE:g}\n"])
def test_an_import_restores_them_before_flights_are_cut(tmp_path, rate):
    campaign = foreign.flights("attached_lift", 6)
    rng = np.random.default_rng(2)
    table = "time,x,z,pitch,elevator,elevator_rate_command"
    for flight in campaign.flights:
        time = np.sort(flight.time + rng.normal(0.0, 3e-3, flight.time.size))
        columns = time, flight.pose, flight.elevator, flight.command
        file = tmp_path / flight.name.replace("flight", "log")
        foreign.write_table(file, table, *columns)
    names = ", ".join(f"{name}: {name}" for name in table.split(","))
    own = tmp_path / "MAP.yaml"
    own.write_text(f"columns: {{{names}}}\n{foreign.VEHICLE}{rate}")
    files = sorted(tmp_path.glob("log*.csv"))
    result = import_campaign(files, own, tmp_path / "throws")
    assert any("jitter by" in words for words in result.warnings)
    assert result.campaign.servo.clock_std == pytest.approx(3e-3, rel=0.3)
    for made, flight in zip(result.campaign.flights, campaign.flights, strict=True):
        assert made.time.size == flight.time.size
        np.testing.assert_allclose(np.diff(made.time), 1.0 / RATE, rtol=3e-3)
    # Its rate is written where it was specified alone.
    again = load_campaign(tmp_path / "throws")
    assert again.pose_rate == (RATE if rate else None)
