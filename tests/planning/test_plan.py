"""A plan goes to a file and back unchanged, and what is no plan is refused."""

import dataclasses
import json
import pickle

import numpy as np
import pytest

from examples.article.tapes import held_plan
from glider.compiled.flight import fly_tapes
from glider.errors import InputError
from glider.physics.model import GliderModel
from glider.planning.plan import load_plan, save_plan
from ilqr import IlqrSettings, goal_problem, ilqr
from tests.helpers.flights import LAGGING


@pytest.fixture(scope="module")
def held():
    """A plan with held commands, gains and the costs of its iterations."""
    return ilqr(GliderModel(), goal_problem(), IlqrSettings(steps=20), iterations=3)


def test_a_held_plan_is_the_flight_of_its_commands():
    """Its slopes are those of the flight, and its commands have no ramps."""
    rng, step = np.random.default_rng(0), 0.002
    inputs = rng.uniform(-5.0, 5.0, 30)
    start = LAGGING.initial_state(goal_problem().launch)
    [states] = fly_tapes(LAGGING, start[None], inputs[None], step)
    plan = held_plan(LAGGING, step, states, inputs, cost=1.0)
    assert plan.is_held
    assert plan.duration == pytest.approx(0.06)
    assert plan.state_names == LAGGING.state_names
    assert plan.slopes.shape == states.shape
    # What begins at a knot; the last one is not flown from.
    np.testing.assert_allclose(plan.slopes[:, :2], states[:, 4:6], atol=1e-12)
    lagging = (np.append(inputs, 0.0) - states[:, 7]) / 0.03
    np.testing.assert_allclose(plan.slopes[:, 7], lagging, atol=1e-9)
    difference = (states[2:, 4:7] - states[:-2, 4:7]) / (2.0 * step)
    np.testing.assert_allclose(plan.slopes[1:-1, 4:7], difference, atol=0.5)
    for k in (0, 7, 29):
        inside = plan.times[k] + np.array([0.1, 0.5, 0.9]) * step
        tape = [plan.input_trajectory.value(t)[0, 0] for t in inside]
        np.testing.assert_array_equal(tape, inputs[k])
        np.testing.assert_allclose(
            plan.state_trajectory.value(plan.times[k])[:, 0], states[k], atol=1e-12
        )


def assert_unchanged(loaded, plan):
    for field in dataclasses.fields(plan):
        np.testing.assert_equal(getattr(loaded, field.name), getattr(plan, field.name))


def test_a_plan_is_saved_and_loaded_unchanged(article_plan, tmp_path):
    save_plan(tmp_path / "plan.json", article_plan)
    loaded = load_plan(tmp_path / "plan.json")
    assert_unchanged(loaded, article_plan)
    assert not loaded.is_held and loaded.gains is None


def test_a_held_plan_is_saved_and_loaded_unchanged(held, tmp_path):
    save_plan(tmp_path / "plan.json", held)
    loaded = load_plan(tmp_path / "plan.json")
    assert_unchanged(loaded, held)
    assert loaded.is_held and not loaded.converged
    assert loaded.gains.shape == (20, 7) and np.any(loaded.gains != 0.0)
    assert len(loaded.costs) == 4 and loaded.cost == loaded.costs[-1]
    assert loaded.path_defect is None
    assert loaded.seconds == held.search_seconds > 0.0


def test_a_plan_survives_a_journey(article_plan):
    article_plan.state_trajectory, article_plan.input_trajectory  # noqa: B018
    again = pickle.loads(pickle.dumps(article_plan))
    np.testing.assert_array_equal(again.states, article_plan.states)
    assert again.attempts == article_plan.attempts
    assert "state_trajectory" not in vars(again)
    np.testing.assert_array_equal(
        again.state_trajectory.value(0.3), article_plan.state_trajectory.value(0.3)
    )


@pytest.mark.parametrize("text", ["", "{}", "[1]", '{"times": [0, 1]}'])
def test_a_file_that_is_no_plan_is_refused(tmp_path, text):
    path = tmp_path / "plan.json"
    path.write_text(text)
    with pytest.raises(InputError, match=r"plan\.json: ") as caught:
        load_plan(path)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"inputs": [0.0] * 5}, "'inputs' is [5]; expected [41]"),
        ({"inputs": 5.0}, "'inputs' is []; expected [41]"),
        ({"states": [[0.0] * 7] * 5}, "'states' is [5, 7]; expected [41, 7]"),
        ({"slopes": [[np.nan] * 7] * 41}, "expected finite numbers"),
        ({"times": list(np.linspace(0.0, -1.0, 41))}, "times that increase from 0"),
        ({"times": list(np.linspace(0.1, 0.9, 41))}, "times that increase from 0"),
        ({"times": [[0.0]] * 41}, "'times' is [41, 1]; expected [41]"),
        ({"cost": "hello"}, "'cost' is 'hello'; expected a number"),
        ({"cost": [1.0]}, "'cost' is [1.0]; expected a number"),
        ({"max_defect": "far"}, "'max_defect' is 'far'; expected a number or null"),
    ],
)
def test_a_plan_that_is_broken_is_refused(article_plan, tmp_path, changes, words):
    path = tmp_path / "plan.json"
    save_plan(path, article_plan)
    path.write_text(json.dumps(json.loads(path.read_text()) | changes))
    with pytest.raises(InputError) as caught:
        load_plan(path)
    assert words in str(caught.value)
    assert "plan.json" in str(caught.value)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"inputs": [0.0] * 19}, "'inputs' is [19]; expected [21]"),
        ({"gains": [[0.0] * 7] * 21}, "'gains' is [21, 7]; expected [20, 7]"),
        ({"gains": [[np.nan] * 7] * 20}, "expected finite numbers"),
        ({"gains": 1.0}, "'gains' is []; expected [20, 7]"),
        ({"costs": ["low"]}, "'costs[0]' is 'low'; expected a number"),
        ({"cost": None}, "'cost' is None; expected a number"),
        ({"path_defect": []}, "'path_defect' is []; expected a number or null"),
    ],
)
def test_a_held_plan_that_is_broken_is_refused(held, tmp_path, changes, words):
    path = tmp_path / "plan.json"
    save_plan(path, held)
    path.write_text(json.dumps(json.loads(path.read_text()) | changes))
    with pytest.raises(InputError) as caught:
        load_plan(path)
    assert words in str(caught.value)
    assert "plan.json" in str(caught.value)
