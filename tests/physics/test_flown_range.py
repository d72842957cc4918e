"""Where a model was flown: kept in its file, and said where a path leaves it."""

import dataclasses
import warnings

import numpy as np
import pytest

from glider import GliderModel, InputError, effects, plan
from glider.physics.effects.free_functions import FreeFunction
from glider.physics.flown_range import describe_departures, ranges_of

MODEL = GliderModel(
    effects=(effects.WIND(x=-0.6),), flown={"alpha": (-0.1, 0.5), "V": (2.0, 8.0)}
)


def states_at(alphas, speeds):
    """States in level flight, (K, 7), with angles of attack in still air."""
    states = np.zeros((len(alphas), 7))
    states[:, 2] = -np.asarray(alphas)
    states[:, 4] = speeds
    return states


def departures(model, states):
    zeros = np.zeros(len(states))
    return describe_departures(model, zeros, states, zeros)


def test_states_within_the_ranges_or_an_eighth_beyond_are_not_mentioned():
    still = dataclasses.replace(MODEL, effects=())
    assert departures(still, states_at([-0.17, 0.57], [1.3, 8.7])) == ""


@pytest.mark.parametrize(
    ("alpha", "speed", "words"),
    [
        (0.58, 5.0, "alpha from 0 to 0.58 rad (flown: -0.1 to 0.5)"),
        (-0.2, 5.0, "alpha from -0.2 to 0 rad (flown: -0.1 to 0.5)"),
        (0.0, 8.8, "V from 5 to 8.8 m/s (flown: 2 to 8)"),
    ],
)
def test_a_variable_beyond_its_range_is_given_with_both(alpha, speed, words):
    still = dataclasses.replace(MODEL, effects=())
    assert departures(still, states_at([0.0, alpha], [5.0, speed])) == words


def test_the_air_that_moves_counts():
    """A head wind of 0.6 m/s adds to the airspeed."""
    assert "V from 7.7" in departures(
        dataclasses.replace(MODEL, flown={"V": (2.0, 7.0)}), states_at([0.0], [7.1])
    )


def test_a_model_that_was_not_traced_warns_of_nothing():
    assert departures(GliderModel(), states_at([3.0], [100.0])) == ""


def test_ranges_are_of_what_corrections_depend_on():
    values = {name: np.array([-1.0, 2.0] * 2) for name in ("alpha", "V", "x", "z")}
    part = FreeFunction(variables=["x"], centers=[[0.0]], widths=[1.0], weights={})
    model = GliderModel(effects=(effects.GROUND_EFFECT(),), free_functions=(part,))
    values["z"] = np.array([0.1, 0.4] * 2)
    assert ranges_of(model, values, np.array([0, 0, 1, 1])) == {
        "x": (-1.0, 2.0),
        "z": (0.1, 0.4),
        "alpha": (-1.0, 2.0),
    }


def test_what_one_flight_alone_reached_is_not_in_the_range():
    flight = np.repeat([0, 1, 2], 2)
    values = {"V": np.array([2.0, 7.0, 4.0, 9.0, 3.0, 8.0])}
    part = FreeFunction(variables=["V"], centers=[[0.0]], widths=[1.0], weights={})
    model = GliderModel(free_functions=(part,))
    assert ranges_of(model, values, flight) == {"V": (3.0, 8.0)}
    one = {"V": values["V"][:2]}
    assert ranges_of(model, one, flight[:2]) == {"V": (2.0, 7.0)}


def test_a_file_keeps_them(tmp_path):
    MODEL.save(tmp_path / "model.yaml")
    assert GliderModel.load(tmp_path / "model.yaml").flown == MODEL.flown


@pytest.mark.parametrize(
    "flown",
    [
        {"alpha": (1.0, 0.0)},
        {"alpha": (0.0, np.nan)},
        {"angle": (0.0, 1.0)},
        {"alpha": 3.0},
        {"alpha": (0.0, 1.0, 2.0)},
    ],
)
def test_what_is_no_range_is_refused(flown):
    with pytest.raises(InputError, match="flown"):
        GliderModel(flown=flown)


def test_a_plan_beyond_the_flown_range_is_a_warning():
    with pytest.warns(UserWarning, match="The plan leaves .* alpha from"):
        plan(MODEL)
    wide = dataclasses.replace(MODEL, flown={"alpha": (-1.0, 3.0)})
    with warnings.catch_warnings():
        warnings.simplefilter("error", UserWarning)
        plan(wide)
