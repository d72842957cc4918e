"""Unseen flights predicted from their beginnings."""

import dataclasses

import numpy as np
import pytest

from glider.campaign.checks.masks import Masks
from glider.physics.effects import KINDS, NO_GAUSSIANS
from glider.physics.model import GliderModel
from glider.sysid.fit import prediction
from glider.sysid.fit.prediction import (
    RolloutModel,
    beginning_rows,
    errors_from,
    find_launch,
    flown_by,
    mean_squares,
    predict,
    rms,
    rows_of,
    which_count,
)
from glider.sysid.likelihood.scales import start_scales
from glider.sysid.replay.log_space import vector_of
from glider.sysid.replay.replayed import true_nodes
from tests.helpers.known_truth import errors_of
from tests.helpers.tasks import begin, fly, task_of

WIND = KINDS["wind"](x=-0.4, z=0.1)


@pytest.fixture(scope="module")
def windy():
    task, noise = task_of(fly(WIND, flights=4))
    truth = dataclasses.replace(
        begin(task, noise), theta=vector_of(GliderModel(effects=(WIND,)))
    )
    return task, flown_by(task, truth, start_scales(noise))


def test_the_launch_is_fitted_on_the_beginning_only(windy):
    """What happens later does not change the prediction."""
    task, model = windy
    record = task.records[1]
    rows = beginning_rows(record.time, per_flight_trims=False)
    assert 10 <= rows < 0.3 * len(record.time)
    assert beginning_rows(record.time, per_flight_trims=True) > 1.5 * rows
    pose = record.pose.copy()
    pose[rows:] += 5.0
    spoilt = dataclasses.replace(record, pose=pose)
    np.testing.assert_array_equal(
        predict(model, record).pose, predict(model, spoilt).pose
    )


@pytest.mark.parametrize(("rests", "error"), [(1e-4, 3e-4), (0.1, 2e-3)])
def test_an_elevator_that_rests_at_zero_is_not_sought_elsewhere(windy, rests, error):
    """However its first row reads; but one that is far off began there."""
    task, model = windy
    record = max(task.records, key=lambda record: abs(record.rest))
    scales = dataclasses.replace(model.scales, rest=rests)
    model = dataclasses.replace(model, scales=scales)
    start = record.rest + find_launch(model, record)[0][3]
    assert abs(record.rest) > 3e-3 and abs(start) < error
    moved = dataclasses.replace(
        record, rest=record.rest + 0.3, elevator=record.elevator + 0.3
    )
    start = moved.rest + find_launch(model, moved)[0][3]
    assert start == pytest.approx(0.3, abs=0.01)


def test_the_elevator_is_known_along_the_whole_flight(windy):
    """An error of its first rows moves its offset by their share of all."""
    task, model = windy
    record = task.records[1]
    rows = beginning_rows(record.time, per_flight_trims=False)
    elevator = record.elevator.copy()
    elevator[:rows] += 0.03
    spoilt = dataclasses.replace(record, elevator=elevator)
    there, here = (find_launch(model, r)[0][3] for r in (spoilt, record))
    assert 0.0 < there - here < 0.3 * 0.03


def test_the_truth_flies_whole_flights_as_they_were(windy, monkeypatch):
    task, model = windy
    monkeypatch.setattr(prediction, "beginning_rows", lambda time, trims: len(time))
    find_launch.cache_clear()
    for record in task.records:
        error = record.pose - predict(model, record).pose
        assert np.sqrt(np.mean(error[:, :2] ** 2)) < 1.5 * 4e-4
        assert np.sqrt(np.mean(error[:, 2] ** 2)) < 1.3 * 2.5e-3


def test_errors_tell_the_truth_from_the_plate(windy):
    task, model = windy
    plate = dataclasses.replace(model, theta=task.vehicle.theta)
    right = errors_of(model, task.records)
    wrong = errors_of(plate, task.records)
    assert right.position_rms_m < 0.2 * wrong.position_rms_m
    assert right.rollout.position_end_m < 0.2 * wrong.rollout.position_end_m
    assert (
        right.rollout_measured_pitch.position_rms_m
        < 0.2 * wrong.rollout_measured_pitch.position_rms_m
    )
    assert right.equation.tangential < wrong.equation.tangential


def test_errors_are_of_the_rows_that_were_seen(windy):
    """A row that nobody saw adds nothing, whatever stands in it."""
    task, model = windy
    record = task.records[0]
    seen, pose = record.seen.copy(), record.pose.copy()
    seen[60:80] = False
    pose[60:80] = 1e3
    gapped = dataclasses.replace(record, seen=seen, pose=pose)
    errors = errors_of(model, [gapped])
    assert errors.position_rms_m < 0.05


def without_elevator_at_first(campaign, share):
    """The campaign, the elevator masked over the first share of flight 0."""
    flight = campaign.flights[0]
    rows = int(share * len(flight.time))
    hidden = np.arange(len(flight.time)) < rows
    nothing = np.zeros_like(hidden)
    return campaign, {flight.name: Masks(pose=nothing, elevator=hidden)}


def test_a_flight_whose_elevator_is_first_seen_late_is_predicted():
    """The elevator then starts where its commands have it: no error is NaN."""
    campaign, masks = without_elevator_at_first(fly(WIND, flights=4), 0.35)
    task, noise = task_of(campaign, masks=masks)
    rows = beginning_rows(task.records[0].time, per_flight_trims=False)
    assert not task.records[0].seen[:rows, 3].any()
    truth = dataclasses.replace(
        begin(task, noise), theta=vector_of(GliderModel(effects=(WIND,)))
    )
    start = start_scales(noise)
    model = flown_by(task, truth, start)
    # Its scales are fitted too, and not left where they start.
    assert model.scales.position != start.position
    errors = errors_of(model, task.records[:1])
    assert errors.position_rms_m < 0.05 and np.isfinite(errors.rollout.pitch_rms_rad)


def test_a_flight_without_any_elevator_row_is_flown_by_its_commands():
    campaign, masks = without_elevator_at_first(fly(WIND, flights=4), 1.0)
    task, _ = task_of(campaign, masks=masks)
    assert task.records[0].rest == 0.0
    assert np.isfinite(true_nodes(task.records[0], task.vehicle.theta)).all()


def test_a_flight_that_diverges_leaves_the_scales_to_the_others(windy):
    task, model = windy
    wild = dataclasses.replace(task.records[0], nodes=task.records[0].nodes * np.nan)
    start = dataclasses.replace(model.scales, position=1e-2, pitch=1e-1)
    model, rest = dataclasses.replace(model, scales=start), task.records[1:]
    others = model.on(rest).scales
    assert others.position < 0.5 * start.position
    assert model.on([wild, *rest]).scales == others


def far(flown, times):
    return dataclasses.replace(flown, pose=flown.pose * times)


@pytest.mark.parametrize("times", [np.inf, np.nan, 1e200, 1e4])
def test_a_flight_on_which_every_model_diverges_counts_for_none(windy, times):
    """One that some model flies does: there the others are no good."""
    task, model = windy
    good = [predict(model, record) for record in task.records]
    one, two = good.copy(), good.copy()
    one[2] = two[2] = far(good[2], times)
    two[1] = far(good[1], times)
    squares = [mean_squares(task.records, own) for own in (one, two)]
    counts = which_count(squares)
    assert counts.tolist() == [True, True, False, True]
    rows, nothing = rows_of(task.records), rms(np.zeros((1, 3)))
    left = [errors_from(own[counts, :, None], rows[counts], nothing) for own in squares]
    assert left[0].position_rms_m < 0.05
    assert not left[1].position_rms_m < 1e3


def test_where_every_model_diverges_everywhere_the_errors_say_so(windy):
    task, model = windy
    flown = [far(predict(model, record), np.inf) for record in task.records]
    squares = mean_squares(task.records, flown)
    assert which_count([squares]).all()
    nothing = rms(np.zeros((1, 3)))
    errors = errors_from(squares[..., None], rows_of(task.records), nothing)
    assert not np.isfinite(errors.position_rms_m)


def test_a_flights_own_trim_is_found_on_its_beginning(windy):
    _, model = windy
    trimmed = fly(WIND, KINDS["elevator_trim"](angle=0.05), flights=2)
    record = task_of(trimmed)[0].records[0]
    scales = dataclasses.replace(model.scales, trim=0.05)
    own = RolloutModel(
        theta=model.theta, gaussians=NO_GAUSSIANS, scales=scales, per_flight_trims=True
    )
    assert predict(own, record).trim == pytest.approx(0.05, abs=0.02)
