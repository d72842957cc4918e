"""What a model leaves to chance: enough to be believed, or too much."""

import dataclasses

import numpy as np
import pytest

from glider.physics.effects import KINDS
from glider.sysid.likelihood.scales import CEILING
from glider.sysid.verdict import _BOUNDED, find_doubt
from tests.helpers.tasks import fit_kinds, fly


@pytest.fixture(scope="module")
def campaign():
    return fly(KINDS["servo_lag"](time_constant=0.04), flights=6, duration=0.6)


@pytest.fixture(scope="module")
def fitted(campaign):
    return fit_kinds(campaign, "servo_lag")


def test_a_model_that_explains_the_flights_is_believed(fitted):
    assert find_doubt(*fitted) is None


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


def test_thrown_gliders_that_nobody_weighed_are_not_asked(fitted):
    task, model = fitted
    vehicle = dataclasses.replace(task.vehicle, knows_forces=False)
    scales = dataclasses.replace(model.scales, trim=CEILING.trim)
    trimmed = dataclasses.replace(model, scales=scales)
    assert find_doubt(dataclasses.replace(task, vehicle=vehicle), trimmed) is None
