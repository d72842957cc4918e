"""Throws keep within the limits of the launch, the servo and the flight."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from glider.compiled.rollouts import fly_tapes
from glider.design.limits import ThrowLimits
from glider.design.proposal import propose
from glider.design.throws import GENES, Range, throw_of
from glider.errors import InputError
from glider.physics.model import GliderModel
from glider.physics.state import STATE_NAMES, VELOCITY

LIMITS = ThrowLimits(
    launch_height=[0.0, 0.3],
    launch_speed=[6.5, 7.5],
    launch_climb=[-0.1, 0.1],
    launch_pitch=[-0.2, 0.1],
    x=[-4.0, 3.0],
    z=[-1.0, 1.0],
    pitch=[-1.0, 1.0],
    speed=9.0,
    elevator=[-0.4463, 0.9473],
    elevator_rate=13.0,
)
PLACE = Range(
    limits=LIMITS,
    x=-3.5,
    rest=0.02,
    stops=(-0.4463, 0.9473),
    duration=0.85,
    pose_rate=120.0,
    command_rate=50.0,
)


@given(st.lists(st.floats(0.0, 1.0), min_size=GENES, max_size=GENES))
@settings(max_examples=60, deadline=None)
def test_any_genes_make_a_throw_within_the_limits(genes):
    throw = throw_of(np.array(genes), PLACE)
    assert 0.0 <= throw.launch[1] <= 0.3
    assert 6.5 - 1e-9 <= throw.speed <= 7.5 + 1e-9
    assert -0.1 - 1e-9 <= throw.climb <= 0.1 + 1e-9
    assert -0.2 <= throw.launch[STATE_NAMES.index("pitch")] <= 0.1
    assert np.abs(throw.commands).max() <= LIMITS.elevator_rate
    angle = PLACE.rest + np.cumsum(throw.commands) / PLACE.command_rate
    assert LIMITS.elevator[0] < angle.min()
    assert angle.max() < LIMITS.elevator[1]
    assert np.allclose(np.diff(throw.times), 0.02)


def test_proposed_throws_are_safe_where_the_launch_is_missed(late, proposal):
    """Flown by the plate alone from launches as fast and as slow as is told."""
    limits = proposal.place.limits
    for throw in proposal.throws:
        period = throw.times[1]
        tape = np.repeat(throw.commands, 10)
        for sign in (-1.0, 1.0):
            start = throw.launch.copy()
            start[VELOCITY] *= 1.0 + sign * limits.missed_speed / throw.speed
            states = fly_tapes(GliderModel(), start[None], tape[None], period / 10.0)[0]
            flown = states[: int(throw.duration / period * 10)]
            # The servo's two milliseconds move it by some millimetres.
            assert flown[:, 1].min() > limits.z[0] - 0.02
            assert np.linalg.norm(flown[:, VELOCITY], axis=1).max() < limits.speed


def test_a_floor_above_the_launch_leaves_no_throw(late, monkeypatch):
    monkeypatch.setattr("glider.design.proposal.ROUNDS", 1)
    with pytest.raises(InputError, match="floor"):
        propose(*late, launches=1, limits=ThrowLimits(z=[1.0, 2.0]))
