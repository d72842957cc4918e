"""iLQR finds the least cost, with its feedback, and keeps the servo's limits."""

import dataclasses

import numpy as np
import pytest

from glider.compiled.kernel import compiled
from glider.errors import InputError
from glider.paths import models_path
from glider.physics.model import GliderModel
from glider.physics.parameters import (
    load_parameters,
    parameter_vector,
)
from glider.planning.ilqr import (
    DivergedError,
    GoalProblem,
    article_problem,
    goal_cost,
    plan,
)
from glider.systems.plant import GliderPlant
from tests.helpers.flights import LAGGING
from tests.helpers.physics import PARAMETERS, random_states

HEAVY = GliderModel(parameters=load_parameters(models_path("vehicles", "heavy.yaml")))
ARTICLE = article_problem()
REGULAR = GoalProblem(within_limits=False)
"""The article's goal with a fixed cost of the way, which other solvers know too."""


@pytest.fixture(scope="module")
def regular_plan():
    return plan(HEAVY, REGULAR, tolerance=1e-6)


def fly(model, planned, order=1, gains=None, start=None):
    """Returns the states of a stepped flight by the compiled rollouts.

    With gains, one step at a time.
    """
    kernel, plant = compiled(), GliderPlant(model)
    p, c = parameter_vector(model.parameters), plant.model.coefficients
    states = np.empty((1, len(planned.inputs) + 1, 7))
    states[0, 0] = planned.states[0] if start is None else start
    tail = (planned.step, p, c, model.residual_field, order)
    if gains is None:
        kernel.rollouts(states[:, 0].copy(), planned.inputs[None], *tail, states)
        return states[0]
    for k in range(len(planned.inputs)):
        u = planned.inputs[k] + gains[k] @ (states[0, k] - planned.states[k])
        end = np.empty((1, 1, 7))
        kernel.rollouts(states[:, k].copy(), np.array([[u]]), *tail, end)
        states[0, k + 1] = end[0, 0]
    return states[0]


def fixed_cost(problem, states, inputs):
    """The cost of GoalProblem's docstring, by other code."""
    error = states[:-1] - np.array(problem.goal)
    stage = np.sum(error**2 @ np.array(problem.state_weights))
    stage += problem.rate_weight * np.sum(inputs**2)
    last = states[-1] - np.array(problem.goal)
    return 0.5 * stage + 0.5 * last @ (np.array(problem.goal_weights) * last)


def test_the_articles_goal_with_a_regular_cost_is_what_crocoddyl_finds(regular_plan):
    """16.731 by BoxFDDP: 1e-3 about the goal, 0.1 u², Euler, 75 steps."""
    assert regular_plan.converged
    assert regular_plan.cost == pytest.approx(16.731, abs=1e-3)
    assert np.max(np.abs(regular_plan.inputs)) < 13.0


def test_no_other_commands_cost_less(regular_plan):
    """Neither along any one command, by differences, nor anywhere near."""
    inputs, size = regular_plan.inputs, 1e-4
    near = np.random.default_rng(0).normal(0.0, 0.1, (100, len(inputs)))
    step = size * np.eye(len(inputs))
    commands = inputs + np.vstack([step, -step, near])
    states = np.empty((len(commands), len(inputs) + 1, 7))
    start = np.tile(regular_plan.states[0], (len(commands), 1))
    p = parameter_vector(HEAVY.parameters)
    tail = (p, np.zeros(0), HEAVY.residual_field, 1, states)
    compiled().rollouts(start, commands, regular_plan.step, *tail)
    costs = np.array(
        [fixed_cost(REGULAR, *pair) for pair in zip(states, commands, strict=True)]
    )
    up, down = costs[: len(inputs)], costs[len(inputs) : 2 * len(inputs)]
    # The cost bends by at least 0.1: no command is farther than 0.02 rad/s off.
    assert np.max(np.abs(up - down)) / (2.0 * size) < 2e-3
    assert np.min(costs[2 * len(inputs) :]) > regular_plan.cost + 0.01


@pytest.mark.parametrize("order", [1, 4])
def test_a_plan_is_a_flight_and_its_cost_is_that_of_the_flight(order):
    problem = dataclasses.replace(REGULAR, order=order)
    planned = plan(HEAVY, problem)
    np.testing.assert_allclose(fly(HEAVY, planned, order), planned.states, atol=1e-9)
    cost = fixed_cost(problem, planned.states, planned.inputs)
    assert planned.cost == pytest.approx(cost, rel=1e-12)
    assert planned.costs[-1] == min(planned.costs) < planned.costs[0]
    assert planned.duration == pytest.approx(0.75)
    assert planned.times[-1] == pytest.approx(planned.duration)
    assert goal_cost(problem, planned.states[-1]) < cost


@pytest.mark.parametrize("order", [1, 4])
def test_the_slopes_of_a_step_are_exact(order):
    kernel, start = compiled(), random_states(3, seed=2)
    inputs, step = np.array([2.0, -5.0, 9.0]), 0.02
    p, c, field = PARAMETERS, np.zeros(0), HEAVY.residual_field
    jacobian = np.empty((3, 7, 8))
    states = np.vstack([start, start[:1]])
    kernel.ilqr_linearize(step, order, states, inputs, p, c, field, jacobian)

    def end(x, u):
        out = np.empty((1, 1, 7))
        kernel.rollouts(x[None], np.array([[u]]), step, p, c, field, order, out)
        return out[0, 0]

    for k in range(3):
        z, size = np.append(start[k], inputs[k]), 1e-6
        for j, unit in enumerate(size * np.eye(8)):
            up, down = z + unit, z - unit
            slope = (end(up[:7], up[7]) - end(down[:7], down[7])) / (2.0 * size)
            np.testing.assert_allclose(jacobian[k, :, j], slope, atol=2e-6, rtol=1e-6)


def test_the_feedback_is_the_best_one_about_the_plan(regular_plan):
    """K is the slope of the command that the same problem, begun aside, asks for."""
    exact = dataclasses.replace(REGULAR, hold_state=0.0, hold_rate=0.0)
    planned = plan(HEAVY, exact, guess=regular_plan.inputs, tolerance=1e-12
    )
    aside = 1e-3 * np.array([1.0, -1.0, 1.0, 1.0, 1.0, 1.0, 1.0])
    start = planned.states[0] + aside
    guided = fly(HEAVY, planned, gains=planned.gains, start=start)
    blind = fly(HEAVY, planned, start=start)
    launched = dataclasses.replace(exact, launch=tuple(start))
    best = plan(HEAVY, launched, guess=planned.inputs, tolerance=1e-12
    ).cost
    commands = planned.inputs + np.sum(
        planned.gains * (guided[:-1] - planned.states[:-1]), axis=1
    )
    lost = [
        fixed_cost(exact, path, tape) - best
        for path, tape in ((guided, commands), (blind, planned.inputs))
    ]
    assert 0.0 <= lost[0] < 0.02 * lost[1]


def test_the_servos_limits_are_kept_and_used():
    """Without a cost of its own the article's plan takes all that the servo gives."""
    planned = plan(HEAVY, ARTICLE)
    free = plan(HEAVY, dataclasses.replace(ARTICLE, within_limits=False))
    low, high = HEAVY.parameters.elevator_limits
    rate = HEAVY.parameters.elevator_rate_limit
    elevator = planned.states[:, 3]
    assert np.max(np.abs(planned.inputs)) == pytest.approx(rate)
    assert np.max(elevator) == pytest.approx(high)
    assert np.min(elevator) >= low - 1e-12
    assert np.max(free.states[:, 3]) > high + 0.05
    assert np.max(np.abs(free.inputs)) > rate + 1.0
    at_rate = np.abs(np.abs(planned.inputs) - rate) < 1e-9
    blind = np.all(planned.gains[at_rate] == 0.0, axis=1)
    assert np.mean(blind) > 0.8  # The others are about to leave the limit.
    at_stop = np.abs(elevator[1:] - high) < 1e-9
    stopped = planned.gains[at_stop & ~at_rate]
    assert len(stopped) > 0
    np.testing.assert_allclose(stopped[:, 3], -1.0 / planned.step)
    np.testing.assert_array_equal(np.delete(stopped, 3, axis=1), 0.0)
    assert goal_cost(ARTICLE, planned.states[-1]) < 1.0


def test_a_slow_servo_is_planned_for():
    """Its state counts: the commands of a quick one would cost far more."""
    model = dataclasses.replace(HEAVY, effects=LAGGING.effects)
    plant, problem = GliderPlant(model), article_problem(rate_weight=0.01)
    lagging = plan(plant, problem)
    assert lagging.converged
    assert lagging.state_names == tuple(plant.state_names)
    assert lagging.gains.shape == (75, 8)
    drawn = plan(HEAVY, problem)
    untold = plan(plant, problem, guess=drawn.inputs, iterations=1).costs[0]
    assert drawn.cost < lagging.cost < 0.3 * untold
    assert lagging.states[-1, 3] == pytest.approx(
        lagging.states[0, 3] + 0.01 * np.sum(lagging.states[:-1, 7])
    )


def test_a_good_guess_saves_iterations(regular_plan):
    again = plan(HEAVY, REGULAR, guess=regular_plan.inputs)
    assert len(again.costs) <= 3 < len(regular_plan.costs)


def test_a_plan_that_is_cut_short_says_so_and_its_feedback_is_about_its_end():
    one = plan(HEAVY, REGULAR, iterations=1)
    assert not one.converged
    assert len(one.costs) == 2
    last = np.empty((1, 7, 8))
    compiled().ilqr_linearize(
        one.step,
        1,
        one.states[-2:].copy(),
        one.inputs[-1:].copy(),
        parameter_vector(HEAVY.parameters),
        np.zeros(0),
        HEAVY.residual_field,
        last,
    )
    A, B, F = last[0, :, :7], last[0, :, 7], np.diag(REGULAR.goal_weights)
    stiffness = REGULAR.rate_weight + REGULAR.hold_rate + B @ F @ B
    np.testing.assert_allclose(one.gains[-1], -B @ F @ A / stiffness, rtol=1e-9)


@pytest.mark.parametrize(
    ("fields", "words"),
    [
        ({"launch": (0.0,) * 6}, "'launch' is .* 7 finite numbers"),
        ({"goal_weights": (-1.0,) + (1.0,) * 6}, "'goal_weights' .* not be negative"),
        ({"hold_state": float("nan")}, "'hold_state' is nan"),
        (
            {"hold_rate": 0.0, "rate_weight": 0.0},
            "'rate_weight' and 'hold_rate' are both 0",
        ),
        ({"steps": 0}, "0 steps of 0.01 s"),
        ({"order": 2}, "the order is 2"),
    ],
)
def test_a_problem_that_makes_no_sense_is_refused(fields, words):
    with pytest.raises(InputError, match=words):
        GoalProblem(**fields)


def test_a_guess_that_does_not_fit_or_diverges_is_refused():
    plant = GliderPlant(HEAVY)
    with pytest.raises(InputError, match=r"shape \(3,\); \(75,\)"):
        plan(plant, REGULAR, guess=np.zeros(3))
    with pytest.raises(InputError, match="tolerance is 0"):
        plan(plant, REGULAR, tolerance=0.0)
    with pytest.raises(DivergedError):
        plan(plant, REGULAR, guess=np.full(75, 1e9))
