"""The one vector of a glider's numbers: names, places, bounds, packing."""

import dataclasses
import pickle

import numpy as np
import pytest

from glider.errors import InputError
from glider.physics.effects import KINDS, LIBRARY, PROFILE_DRAG, SERVO_LAG, WIND
from glider.physics.model import GliderModel
from glider.physics.parameter_space import space_of
from glider.physics.parameters import PARAMETER_NAMES, GliderParameters

STALL = KINDS["dynamic_stall"]
SPACE = space_of((PROFILE_DRAG, STALL, SERVO_LAG))


def test_coefficients_follow_the_parameters_in_the_order_of_their_effects():
    assert SPACE.names[:9] == PARAMETER_NAMES
    assert SPACE.names[9] == "profile_drag.cd0"
    assert SPACE.names[-1] == "servo_lag.time_constant"
    assert SPACE.slots_of("dynamic_stall") == (10, 11)
    assert SPACE.slots_of("wind") == ()
    assert SPACE.places(["wing_offset", "servo_lag.time_constant"]) == [4, 12]
    assert [SPACE.owners[i] for i in (0, 9, 12)] == [
        "parameters",
        "profile_drag",
        "servo_lag",
    ]


def test_each_number_has_the_unit_and_the_bounds_of_its_coefficient():
    wing, lag = SPACE.places(["wing_area", "servo_lag.time_constant"])
    assert SPACE.entries[wing].unit == "m²"
    [coefficient] = SERVO_LAG.coefficients
    assert SPACE.entries[lag] is coefficient
    assert (SPACE.lower[lag], SPACE.upper[lag]) == (0.0, coefficient.upper)
    assert SPACE.scale[lag] == coefficient.scale
    # A parameter has the name at its place, and a bound where it must be positive.
    assert tuple(entry.name for entry in SPACE.entries[:9]) == PARAMETER_NAMES
    assert SPACE.lower[0] > 0.0 > SPACE.lower[SPACE.index["wing_offset"]]


def test_states_of_actuators_lead():
    assert SPACE.states == {"servo_lag": range(7, 8), "dynamic_stall": range(8, 9)}
    assert SPACE.state_names[7:] == (
        "servo_lag.servo_rate",
        f"dynamic_stall.{STALL.states[0]}",
    )
    assert SPACE.num_states == len(SPACE.state_scale) == 9


def test_unpacking_returns_what_was_packed():
    parameters = GliderParameters(mass=0.11, elevator_rate_limit=9.0)
    effects = (WIND(x=-0.5, z=0.1), SERVO_LAG(time_constant=0.03))
    space = space_of((WIND, SERVO_LAG))
    vector = space.pack(parameters, effects)
    assert vector[space.index["wind.x"]] == -0.5
    limits = GliderParameters(elevator_rate_limit=9.0)
    assert space.unpack(vector, limits) == (parameters, effects)
    vector[space.index["servo_lag.time_constant"]] = -1.0
    with pytest.raises(InputError, match="time_constant"):
        space.unpack(vector, limits)


def test_effects_that_are_not_given_do_nothing():
    space = space_of(LIBRARY)
    parameters, effects = space.unpack(
        space.pack(GliderParameters()), GliderParameters()
    )
    assert parameters == GliderParameters()
    assert all(effect.values == effect.kind.defaults for effect in effects)
    assert len(effects) == len(LIBRARY)


def test_a_model_packs_its_own_numbers():
    model = GliderModel(effects=(WIND(x=-0.5), PROFILE_DRAG(cd0=0.05)))
    assert model.space is space_of((WIND, PROFILE_DRAG))
    theta = model.numbers
    np.testing.assert_array_equal(model.vector, [*theta.p, *theta.c])
    assert theta.p._asdict().items() <= vars(model.parameters).items()


def test_numbers_of_replayed_signals_come_last():
    space = space_of((SERVO_LAG, WIND), True)
    assert space.names[9:] == ("wind.x", "wind.z", "servo_lag.time_constant")
    assert (space.flown, space.replayed) == ((WIND,), (SERVO_LAG,))
    vector = space.pack(GliderParameters(), (SERVO_LAG(time_constant=0.05),))
    assert space.num_flown == 11
    assert space.replay(vector).time_constant == 0.05
    assert space.num_states == 7  # The lag has none of its own there.


def test_states_act_where_a_coefficient_is_not_at_its_default():
    vector = SPACE.pack(GliderParameters())
    assert SPACE.acting_states(vector) == [*range(7)]
    vector[SPACE.slots_of("dynamic_stall")[0]] = 0.5
    assert SPACE.acting_states(vector) == [*range(7), 8]


def test_another_process_receives_the_same_space():
    own = dataclasses.replace(PROFILE_DRAG, kind="my_drag")
    for kinds in ((PROFILE_DRAG, WIND), (own, WIND)):
        space = space_of(kinds)
        assert pickle.loads(pickle.dumps(space)) is space
    sent = pickle.dumps(space_of(LIBRARY))
    assert len(sent) < 2000  # Names, no formulas.
