"""What a model leaves to chance: enough to be believed, or too much."""

import dataclasses

import numpy as np
import pytest

from glider.physics.effects import KINDS
from glider.sysid.likelihood.scales import CEILING
from glider.sysid.verdict import _BOUNDED, _elevator_gain, find_doubt
from tests.campaign.checks import breaking as b
from tests.helpers.tasks import fit_kinds, fly, task_of


@pytest.fixture(scope="module")
def campaign():
    return fly(KINDS["servo_lag"](time_constant=0.04), flights=6, duration=0.6)


@pytest.fixture(scope="module")
def fitted(campaign):
    return fit_kinds(campaign, "servo_lag")


def test_a_model_that_explains_the_flights_is_believed(fitted):
    assert find_doubt(*fitted) is None
    gain, error = _elevator_gain(*fitted)
    assert gain == pytest.approx(1.0, abs=0.01)
    assert 0.0 < error < 0.01


@pytest.mark.parametrize("name", _BOUNDED)
def test_a_scale_at_its_ceiling_is_no_throw(fitted, name):
    task, model = fitted
    scales = dataclasses.replace(model.scales, **{name: getattr(CEILING, name)})
    doubt = find_doubt(task, dataclasses.replace(model, scales=scales))
    assert doubt is not None
    assert f"{getattr(CEILING, name):.2g} " in doubt


def test_moments_of_chance_are_held_against_pitch_accelerations(fitted):
    task, model = fitted
    turning = np.concatenate([r.acceleration[:, 2] for r in task.records])
    for share, is_doubted in ((0.1, False), (0.5, True)):
        scales = dataclasses.replace(model.scales, moment=share * float(turning.std()))
        doubt = find_doubt(task, dataclasses.replace(model, scales=scales))
        assert (doubt is not None) == is_doubted


@pytest.mark.parametrize("share", [0.5, 0.95, 1.1])
def test_an_elevator_that_moves_less_or_more_than_ordered_is_doubted(campaign, share):
    other = b.change(campaign, b.with_servo(lambda f: share * f.elevator))
    _, model = fit_kinds(campaign, "servo_lag")
    theirs, _ = fit_kinds(other, "servo_lag")
    gain, _ = _elevator_gain(theirs, model)
    assert gain == pytest.approx(share, abs=0.01)
    assert f"{gain:.3f} times" in find_doubt(theirs, model)


def with_play(path, play=0.03):
    """Angles of an elevator that follows a path with a play either way."""
    found = [path[0]]
    for wanted in path[1:]:
        found.append(np.clip(found[-1], wanted - play, wanted + play))
    return np.array(found)


@pytest.mark.parametrize("share", [1.0, 0.95])
def test_a_play_of_the_servo_is_no_wrong_unit(campaign, fitted, share):
    """It loses travel at reversals alone."""
    _, model = fitted
    servo = b.with_servo(lambda f: share * with_play(f.elevator))
    theirs, _ = task_of(b.change(campaign, servo))
    gain, _ = _elevator_gain(theirs, model)
    assert gain == pytest.approx(share, abs=0.02)


def test_a_servo_whose_form_is_known_has_no_gain(campaign, fitted):
    _, model = fitted
    servo = b.with_servo(lambda f: 0.9 * f.elevator)
    theirs, _ = task_of(b.change(campaign, servo))
    known = [dataclasses.replace(r, departure_is_named=True) for r in theirs.records]
    assert _elevator_gain(theirs.on(known), model) == (1.0, np.inf)


def test_without_a_servo_there_is_no_gain(fitted):
    task, model = fitted
    bare = task.on([dataclasses.replace(r, has_servo=False) for r in task.records])
    assert _elevator_gain(bare, model) == (1.0, np.inf)
    assert find_doubt(bare, model) is None


def test_an_elevator_that_was_never_seen_has_no_gain(fitted):
    """As where it is reconstructed from the commands."""
    task, model = fitted
    unseen = task.records[0].seen & np.array([True, True, True, False])
    hidden = dataclasses.replace(task.records[0], seen=unseen)
    assert _elevator_gain(task.on([hidden] * 3), model) == (1.0, np.inf)


def test_thrown_gliders_that_nobody_weighed_are_not_asked(fitted):
    task, model = fitted
    vehicle = dataclasses.replace(task.vehicle, knows_forces=False)
    scales = dataclasses.replace(model.scales, trim=CEILING.trim)
    trimmed = dataclasses.replace(model, scales=scales)
    assert find_doubt(dataclasses.replace(task, vehicle=vehicle), trimmed) is None
