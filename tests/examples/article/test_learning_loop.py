"""Lesson 9: the planner improves, weights are those of the truth, the loop learns."""

import numpy as np
import pytest

from learning_loop import (
    LAUNCH,
    PLATE,
    STEP,
    STEPS,
    TRUTH,
    backward,
    equations_of,
    execute,
    forward,
    ilqr,
    learn,
    linearize,
    step_on,
    terminal_cost,
    true_residual,
)
from residual_coefficients import gaussian_grid
from tests.helpers.physics import random_states


@pytest.fixture(scope="module")
def planned():
    return ilqr(gaussian_grid(), LAUNCH, np.zeros(STEPS))


def test_a_step_is_the_glider_s_own():
    """G w is what the library's glider with the same residual has."""
    states = random_states(6, seed=1).T
    inputs = np.linspace(-5.0, 5.0, 6)
    rates = TRUTH.chain.derivatives(0.0, states, inputs, 0.0, 0.0, TRUTH.numbers)
    expected = states + STEP * np.array(np.broadcast_arrays(*rates))
    found = step_on(true_residual(), states, inputs)
    np.testing.assert_allclose(found, expected, atol=1e-9)


def test_the_plan_is_a_flight_that_comes_to_the_goal(planned):
    again, _ = execute(gaussian_grid(), planned, LAUNCH)
    np.testing.assert_allclose(again, planned.states, atol=1e-9)
    assert terminal_cost(planned.states[-1]) < 1.0


def test_the_feed_forward_promises_what_a_small_share_of_it_brings():
    """The slope of the terminal cost along it, by differences."""
    plate = gaussian_grid()
    inputs = np.linspace(0.0, 2.0, STEPS)
    states, now = [LAUNCH], LAUNCH
    for u in inputs:
        now = step_on(plate, now[:, None], np.array([u]))[:, 0]
        states.append(now)
    states = np.array(states)
    feed, gains = backward(plate, states, inputs)
    better, _ = forward(plate, (states, inputs), (feed, gains))
    assert terminal_cost(better[-1]) < 0.7 * terminal_cost(states[-1])


def test_the_slopes_are_those_of_the_steps(planned):
    A, B = linearize(gaussian_grid(), planned.states, planned.inputs)
    assert A.shape == (STEPS, 7, 7) and B.shape == (STEPS, 7)
    np.testing.assert_allclose(B[:, 3], STEP)
    np.testing.assert_allclose(A[:, 0, 4], STEP)
    k, aside = 40, 1e-3 * np.ones(7)
    ends = [
        step_on(gaussian_grid(), x[:, None], planned.inputs[k : k + 1])[:, 0]
        for x in (planned.states[k] + aside, planned.states[k])
    ]
    np.testing.assert_allclose(ends[0] - ends[1], A[k] @ aside, atol=1e-4)


def test_the_feedback_brings_a_glider_back(planned):
    launch = LAUNCH + np.array([0.0, 0.0, 0.0, 0.0, 0.3, 0.0, 0.0])
    blind = planned._replace(gains=0.0 * planned.gains)
    guided, left = (execute(gaussian_grid(), p, launch)[0] for p in (planned, blind))
    assert terminal_cost(guided[-1]) < 0.4 * terminal_cost(left[-1])


def test_weights_learned_from_clean_flights_are_those_of_the_truth(planned):
    """Where it flew: 26 weights are more than two flights determine."""
    rng = np.random.default_rng(0)
    grid = gaussian_grid()
    weights = rng.normal(0.0, 0.2, (26, 3)) * [1.0, 1.0, 0.05]
    truth = grid._replace(weights=weights)
    information, target = 1e-9 * np.eye(78), np.zeros(78)
    for bend in (0.0, 1.0):
        bent = planned._replace(inputs=planned.inputs + bend, gains=0 * planned.gains)
        states, inputs = execute(truth, bent, LAUNCH)
        more, aims = equations_of(states, inputs, grid)
        information, target = information + more, target + aims
    solved = np.linalg.solve(information, target).reshape(3, -1).T
    found = grid._replace(weights=solved)
    now = states[:-1].T
    steps = [step_on(own, now, inputs) for own in (found, truth, grid)]
    assert np.max(np.abs(steps[1] - steps[2])) > 0.005
    np.testing.assert_allclose(steps[0], steps[1], atol=1e-6)


def test_the_truth_has_what_the_planner_cannot_learn():
    assert true_residual().weights.shape == (126, 3)
    assert true_residual().centers.shape[1] == 3
    assert gaussian_grid().centers.shape[1] == 2
    assert PLATE.parameters == TRUTH.parameters


@pytest.mark.nightly
def test_the_terminal_cost_and_the_change_of_the_weights_fall():
    rng = np.random.default_rng(0)
    rounds = learn(true_residual(), 6, rng, say=lambda text: None)
    costs = [terminal_cost(own.nominal[-1]) for own in rounds]
    assert np.median(costs[2:]) < 0.3 * costs[0]
    assert rounds[-1].change < 0.5 * rounds[0].change
    speeds = [own.flight[0, 4] for own in rounds]
    assert 6.5 < min(speeds) < max(speeds) < 7.5
    assert all(own.nominal[0, 4] == 7.0 for own in rounds)
