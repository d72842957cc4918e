"""A plan with held commands is a flight, and a plan is pickled without its splines."""

import pickle

import numpy as np
import pytest

from glider.compiled.flight import fly_tapes
from sampling_planners import held_plan
from tests.helpers.flights import LAGGING, PROBLEM


def test_a_held_plan_is_the_flight_of_its_commands():
    """Its slopes are those of the flight, and its commands have no ramps."""
    rng, step = np.random.default_rng(0), 0.002
    inputs = rng.uniform(-5.0, 5.0, 30)
    start = LAGGING.initial_state(PROBLEM.launch)
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


def test_a_plan_survives_a_journey(article_plan):
    article_plan.state_trajectory, article_plan.input_trajectory  # noqa: B018
    again = pickle.loads(pickle.dumps(article_plan))
    np.testing.assert_array_equal(again.states, article_plan.states)
    assert again.seconds == article_plan.seconds
    assert "state_trajectory" not in vars(again)
    np.testing.assert_array_equal(
        again.state_trajectory.value(0.3), article_plan.state_trajectory.value(0.3)
    )
