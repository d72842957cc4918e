"""Limits of throws, from a file and from flown flights."""

import dataclasses
import math

import numpy as np
import pytest

from glider.errors import InputError
from glider.experiments.throw_limits import ThrowLimits, load_limits
from glider.experiments.throws import range_of


def test_what_is_not_given_is_as_it_was_flown(late):
    campaign, task, *_ = late
    records = task.records
    campaign = dataclasses.replace(
        campaign, elevator_limits=(-0.4, 0.9), elevator_rate_limit=13.0
    )
    given = ThrowLimits(z=[-0.3, 2.0], missed_speed=0.4)
    limits = range_of(campaign, records, given).limits
    starts = np.array([r.nodes[0] for r in records])
    assert limits.z == [-0.3, 2.0]
    assert limits.launch_height == (starts[:, 1].min(), starts[:, 1].max())
    assert limits.elevator == (-0.4, 0.9)
    assert limits.elevator_rate == 13.0
    assert limits.missed_speed == 0.4
    assert all(limits.allows(r.nodes) for r in records) == all(
        r.nodes[:, 1].min() >= -0.3 for r in records
    )


@pytest.mark.parametrize("index, value", [(0, 9.0), (1, -1.0), (2, 1.2), (4, 11.0)])
def test_one_row_beyond_a_limit_is_not_allowed(index, value):
    limits = ThrowLimits(x=[-4, 2], z=[-0.5, 1], pitch=[-1, 1], speed=10.0)
    states = np.tile([-3.0, 0.1, 0.0, 0.0, 7.0, 0.0, 0.0], (5, 1))
    assert limits.allows(states)
    states[3, index] = value
    assert not limits.allows(states)
    states[3, index] = math.nan
    assert not limits.allows(states)


@pytest.mark.parametrize(
    ("text", "word"),
    [
        ("z: [1.0, -1.0]", "'z'"),
        ("z: [1.0]", "'z'"),
        ("z: [-.inf, 1.0]", "'z"),
        ("speed: -2.0", "'speed'"),
        ("missed_speed: .nan", "'missed_speed'"),
        ("flor: 3.0", "flor"),
    ],
)
def test_a_wrong_limit_is_reported_by_its_field(tmp_path, text, word):
    path = tmp_path / "limits.yaml"
    path.write_text(text)
    with pytest.raises(InputError, match=word) as error:
        load_limits(path)
    assert "limits.yaml" in str(error.value)
