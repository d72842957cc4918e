"""Records of flights with gaps and with rows that are excluded."""

import dataclasses

import numpy as np
import pytest

from glider.campaign.checks.inspection import inspect
from glider.campaign.checks.masks import Masks
from glider.campaign.logs import ServoLog
from glider.compiled.replay import OFFSET
from glider.physics.effects import NO_GAUSSIANS
from glider.physics.model import GliderModel
from glider.physics.servo import NO_LIMITS
from glider.sysid.constants import Z
from glider.sysid.likelihood.filtering import _rests, start_variances
from glider.sysid.likelihood.linear_flight import linearize
from glider.sysid.likelihood.scales import Scales
from glider.sysid.replay.log_space import vector_of
from glider.sysid.replay.record import measure_noise, prepare
from tests.helpers.tasks import fly

MISSING = slice(30, 70)


@pytest.fixture(scope="module")
def campaign():
    return fly(flights=4)


def records_of(campaign, masks=None):
    return prepare(
        campaign.flights, campaign, measure_noise(campaign, masks), masks=masks
    )


def without_rows(flight, rows):
    keep = np.ones(len(flight.time), dtype=bool)
    keep[rows] = False
    return dataclasses.replace(
        flight,
        time=flight.time[keep],
        pose=flight.pose[keep],
        elevator=flight.elevator[keep],
        command=flight.command[keep],
    )


def test_nodes_fill_a_gap_and_count_as_unseen(campaign):
    whole = records_of(campaign)[0]
    first, *others = campaign.flights
    flights = (without_rows(first, MISSING), *others)
    record = records_of(dataclasses.replace(campaign, flights=flights))[0]
    np.testing.assert_allclose(record.time, whole.time, atol=1e-9)
    seen = np.ones(len(whole.time), dtype=bool)
    seen[MISSING] = False
    assert np.array_equal(record.seen, np.tile(seen[:, None], 4))
    np.testing.assert_array_equal(record.pose[seen], whole.pose[seen])
    np.testing.assert_array_equal(record.elevator[seen], whole.elevator[seen])
    assert np.all(record.elevator[~seen] == 0.0)
    assert len(record.bank) == len(record.pitch) == len(record.time) - 1
    # A third of a second in which nobody looked: a smooth arc, near enough.
    apart = record.nodes[:, :2] - whole.nodes[:, :2]
    assert np.abs(apart[seen]).max() < 0.02
    assert np.abs(apart).max() < 0.5


def test_irregular_times_get_no_more_nodes_than_gaps_need(campaign):
    flight = without_rows(campaign.flights[0], [10, 40, 41])
    log = dataclasses.replace(campaign, flights=(flight, *campaign.flights[1:]))
    record = records_of(log)[0]
    assert len(record.time) == len(flight.time) + 3
    assert not record.seen[[10, 40, 41]].any()


def test_commands_before_a_gap_that_hides_some_do_not_count(campaign):
    flight = without_rows(campaign.flights[0], slice(5, 45))
    log = dataclasses.replace(campaign, flights=(flight, *campaign.flights[1:]))
    record, *others = records_of(log, inspect(log).masks)
    assert len(record.time) == len(flight.time) - 5
    assert record.switch_times.min() >= 0.0
    assert record.rest == flight.elevator[5]
    near = dataclasses.replace(record, rest=0.0)  # As if it were moving through there.
    scales = Scales(elevator=0.005, rest=1e-4)
    assert not _rests(near, scales) and all(_rests(own, scales) for own in others)
    linear = linearize(near, vector_of(GliderModel()), NO_GAUSSIANS)
    launch = start_variances(linear, scales)
    assert np.sqrt(launch[OFFSET]) == pytest.approx(Z * Scales.elevator)


def test_rows_that_are_set_aside_do_not_count(campaign):
    whole = records_of(campaign)[0]
    first, *others = campaign.flights
    pose, elevator = first.pose.copy(), first.elevator.copy()
    pose[20:24] += 3.0
    elevator[50:53] = 9.0
    flights = (dataclasses.replace(first, pose=pose, elevator=elevator), *others)
    broken = dataclasses.replace(campaign, flights=flights)
    masks = Masks(
        pose=np.isin(np.arange(len(pose)), range(20, 24)),
        elevator=np.isin(np.arange(len(pose)), range(50, 53)),
    )
    record = records_of(broken, {first.name: masks})[0]
    assert not record.seen[20:24, :3].any() and record.seen[20:24, 3].all()
    assert not record.seen[50:53, 3].any() and record.seen[50:53, :3].all()
    assert record.seen.sum() == record.seen.size - 4 * 3 - 3
    np.testing.assert_allclose(record.pose[20:24], whole.pose[20:24], atol=0.05)
    np.testing.assert_allclose(record.nodes[:, :2], whole.nodes[:, :2], atol=0.005)


def test_rows_at_the_ends_that_are_set_aside_are_cut_off(campaign):
    first = campaign.flights[0]
    rows = np.arange(len(first.time))
    aside = (rows < 5) | (rows >= len(rows) - 7)
    masks = Masks(pose=aside, elevator=np.zeros(len(rows), dtype=bool))
    record = records_of(campaign, {first.name: masks})[0]
    assert len(record.time) == len(rows) - 12
    assert record.time[0] == 0.0
    np.testing.assert_array_equal(record.pose, first.pose[5:-7])
    # The commands are on the same clock.
    assert record.switch_times[0] == pytest.approx(-(first.time[5] - first.time[0]))


def test_frozen_rows_are_set_aside_and_not_taken_for_measured(campaign):
    first, *others = campaign.flights
    pose = first.pose.copy()
    pose[40:52] = pose[40]
    flights = (dataclasses.replace(first, pose=pose), *others)
    inspection = inspect(dataclasses.replace(campaign, flights=flights))
    (aside,) = inspection.excluded
    assert aside.file == first.name
    record = records_of(inspection.campaign, inspection.masks)[0]
    assert not record.seen[42:52, :3].any()
    assert record.seen[:40].all() and record.seen[52:].all()
    whole = records_of(campaign)[0]
    np.testing.assert_allclose(record.nodes[:, :2], whole.nodes[:, :2], atol=0.01)


def test_a_measured_angles_own_rates_meet_no_limits(campaign):
    """What moved the elevator is all in them."""
    log = ServoLog(command="reconstructed")
    assert campaign.limits.rate == campaign.elevator_rate_limit
    assert dataclasses.replace(campaign, servo=log).limits == NO_LIMITS
