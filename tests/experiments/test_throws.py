"""Throws keep within the limits of the launch, the servo and the flight."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from glider.experiments.throw_limits import ThrowLimits
from glider.experiments.throws import GENES, Range, departures_of, throw_of
from glider.physics.model import GliderModel
from glider.physics.servo import Servo
from glider.physics.state import STATE_NAMES

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
    servo=Servo(-0.4463, 0.9473, 13.0),
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


def test_a_throw_beyond_the_flown_range_is_described():
    """As it is flown: a model that has not been traced knows no range."""
    throw = throw_of(np.full(GENES, 0.5), PLACE)
    model = GliderModel(flown={"V": (7.0, 7.0), "elevator": (-0.5, 1.0)})
    said = departures_of(model, throw, PLACE)
    assert said.startswith("V from ") and said.endswith("m/s (flown: 7 to 7)")
    wide = GliderModel(flown={"V": (0.0, 9.0), "elevator_rate": (-13.0, 13.0)})
    assert departures_of(wide, throw, PLACE) == ""
    assert departures_of(GliderModel(), throw, PLACE) == ""


def test_all_of_a_throw_counts_and_nothing_after_it():
    throw = throw_of(np.full(GENES, 0.5), PLACE)
    said = departures_of(GliderModel(flown={"t": (0.0, 0.4)}), throw, PLACE)
    assert said == "t from 0 to 0.85 s (flown: 0 to 0.4)"
