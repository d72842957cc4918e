"""iLQR finds the least cost, with its feedback, and keeps the servo's limits."""

import dataclasses

import numpy as np
import pytest

from glider.compiled.flight import fly_tapes
from glider.errors import InputError
from glider.paths import models_path
from glider.physics.model import GliderModel
from glider.physics.parameters import load_parameters
from glider.physics.servo import STOPPING_TIME
from ilqr import ARTICLE, DivergedError, IlqrSettings, goal_cost, goal_problem, ilqr
from ilqr_kernels import linearize_steps
from tests.helpers.flights import LAGGING, NOMINAL, QUICK
from tests.helpers.physics import random_states

HEAVY = GliderModel(parameters=load_parameters(models_path("vehicles", "heavy.yaml")))
FREELY = goal_problem(rate_cost=0.0)
"""The article's: the commands cost nothing."""

REGULAR, UNLIMITED = goal_problem(), IlqrSettings(within_limits=False)
"""The article's goal with a fixed cost of the way, which other solvers know too."""


@pytest.fixture(scope="module")
def regular_plan():
    return ilqr(HEAVY, REGULAR, UNLIMITED, tolerance=1e-6)


def fly(model, planned, order=1, gains=None, start=None):
    """Returns the states of a plan's flight by the compiled rollouts.

    With gains, one step at a time.
    """
    x = planned.states[0] if start is None else start
    if gains is None:
        return fly_tapes(
            model, x[None], planned.inputs[None], planned.times[1], order=order
        )[0]
    states = [x]
    for k in range(len(planned.inputs)):
        u = planned.inputs[k] + gains[k] @ (states[k] - planned.states[k])
        end = fly_tapes(
            model, states[k][None], np.array([[u]]), planned.times[1], order=order
        )
        states.append(end[0, 1])
    return np.array(states)


def fixed_cost(problem, settings, states, inputs):
    """The cost of IlqrSettings' docstring, by other code."""
    error = states[:-1] - np.array(problem.goal)
    stage = np.sum(error**2 @ np.array(settings.state_weights))
    stage += problem.rate_cost * settings.step * np.sum(inputs**2)
    last = states[-1] - np.array(problem.goal)
    return stage + last @ (np.array(problem.goal_weights) * last)


def test_the_articles_goal_with_a_regular_cost_is_what_crocoddyl_finds(regular_plan):
    """16.731 by BoxFDDP: half of 1e-3 about the goal and 0.1 u², Euler, 75 steps."""
    assert regular_plan.converged
    assert regular_plan.cost == pytest.approx(16.731, abs=1e-3)
    assert np.max(np.abs(regular_plan.inputs)) < 13.0


def test_no_other_commands_cost_less(regular_plan):
    """Neither along any one command, by differences, nor anywhere near."""
    inputs, size = regular_plan.inputs, 1e-4
    near = np.random.default_rng(0).normal(0.0, 0.1, (100, len(inputs)))
    step = size * np.eye(len(inputs))
    commands = inputs + np.vstack([step, -step, near])
    start = np.tile(regular_plan.states[0], (len(commands), 1))
    states = fly_tapes(HEAVY, start, commands, regular_plan.times[1], order=1)
    costs = np.array(
        [
            fixed_cost(REGULAR, UNLIMITED, *pair)
            for pair in zip(states, commands, strict=True)
        ]
    )
    up, down = costs[: len(inputs)], costs[len(inputs) : 2 * len(inputs)]
    # The cost bends by at least 0.1: no command is farther than 0.02 rad/s off.
    assert np.max(np.abs(up - down)) / (2.0 * size) < 2e-3
    assert np.min(costs[2 * len(inputs) :]) > regular_plan.cost + 0.01


@pytest.mark.parametrize("order", [1, 4])
def test_a_plan_is_a_flight_and_its_cost_is_that_of_the_flight(order):
    settings = dataclasses.replace(UNLIMITED, order=order)
    planned = ilqr(HEAVY, REGULAR, settings)
    assert planned.is_held
    np.testing.assert_allclose(fly(HEAVY, planned, order), planned.states, atol=1e-9)
    cost = fixed_cost(REGULAR, settings, planned.states, planned.inputs)
    assert planned.cost == pytest.approx(cost, rel=1e-12)
    assert planned.costs[-1] == min(planned.costs) < planned.costs[0]
    assert planned.duration == pytest.approx(0.75)
    assert planned.times[-1] == pytest.approx(planned.duration)
    assert goal_cost(REGULAR, planned.states[-1]) < cost


@pytest.mark.parametrize("order", [pytest.param(1, marks=pytest.mark.nightly), 4])
def test_a_quick_servo_costs_what_none_costs(order):
    settings = IlqrSettings(order=order)
    plans = [ilqr(model, REGULAR, settings) for model in (NOMINAL, QUICK)]
    assert plans[1].converged
    error = 0.01 if order == 4 else 0.05  # Euler's own, of 10 ms.
    assert plans[1].cost == pytest.approx(plans[0].cost, rel=error)


@pytest.mark.parametrize("order", [1, 4])
def test_the_slopes_of_a_step_are_exact(order):
    nominal, start = GliderModel(), random_states(3, seed=2)
    inputs, step = np.array([2.0, -5.0, 9.0]), 0.02
    states = np.vstack([start, start[:1]])
    jacobian = linearize_steps(nominal, step, order, states, inputs)
    assert jacobian.shape == (3, 7, 8)

    def end(x, u):
        return fly_tapes(nominal, x[None], np.array([[u]]), step, order=order)[0, 1]

    for k in range(3):
        z, size = np.append(start[k], inputs[k]), 1e-6
        for j, unit in enumerate(size * np.eye(8)):
            up, down = z + unit, z - unit
            slope = (end(up[:7], up[7]) - end(down[:7], down[7])) / (2.0 * size)
            np.testing.assert_allclose(jacobian[k, :, j], slope, atol=2e-6, rtol=1e-6)


def test_the_feedback_is_the_best_one_about_the_plan(regular_plan):
    """K is the slope of the command that the same problem, begun aside, asks for."""
    exact = dataclasses.replace(UNLIMITED, hold_state=0.0, hold_rate=0.0)
    planned = ilqr(HEAVY, REGULAR, exact, guess=regular_plan.inputs, tolerance=1e-12)
    aside = 1e-3 * np.array([1.0, -1.0, 1.0, 1.0, 1.0, 1.0, 1.0])
    start = planned.states[0] + aside
    guided = fly(HEAVY, planned, gains=planned.gains, start=start)
    blind = fly(HEAVY, planned, start=start)
    launched = dataclasses.replace(REGULAR, launch=start.tolist())
    best = ilqr(HEAVY, launched, exact, guess=planned.inputs, tolerance=1e-12).cost
    commands = planned.inputs + np.sum(
        planned.gains * (guided[:-1] - planned.states[:-1]), axis=1
    )
    lost = [
        fixed_cost(REGULAR, exact, path, tape) - best
        for path, tape in ((guided, commands), (blind, planned.inputs))
    ]
    assert 0.0 <= lost[0] < 0.02 * lost[1]


def test_the_servos_limits_are_kept_and_used():
    """Without a cost of its own the article's plan takes all that the servo gives."""
    planned = ilqr(HEAVY, FREELY, ARTICLE)
    free = ilqr(HEAVY, FREELY, dataclasses.replace(ARTICLE, within_limits=False))
    low, high = HEAVY.parameters.elevator_limits
    rate = HEAVY.parameters.elevator_rate_limit
    elevator = planned.states[:, 3]
    assert np.max(np.abs(planned.inputs)) == pytest.approx(rate)
    assert high - 0.02 < np.max(elevator) <= high
    assert np.min(elevator) >= low - 1e-12
    assert np.max(free.states[:, 3]) > high + 0.05
    assert np.max(np.abs(free.inputs)) > rate + 1.0
    at_rate = np.abs(np.abs(planned.inputs) - rate) < 1e-9
    blind = np.all(planned.gains[at_rate] == 0.0, axis=1)
    assert np.mean(blind) > 0.7  # The others are about to leave the limit.
    ahead = planned.times[1] + STOPPING_TIME
    at_stop = np.abs(planned.inputs - (high - elevator[:-1]) / ahead) < 1e-9
    stopped = planned.gains[at_stop & ~at_rate]
    assert len(stopped) > 0
    np.testing.assert_allclose(stopped[:, 3], -1.0 / ahead)
    np.testing.assert_array_equal(np.delete(stopped, 3, axis=1), 0.0)
    assert goal_cost(FREELY, planned.states[-1]) < 1.0


def test_a_slow_servo_is_planned_for():
    """Its state counts: the commands of a quick one would cost far more."""
    model = dataclasses.replace(HEAVY, effects=LAGGING.effects)
    problem = goal_problem(rate_cost=0.5)
    lagging = ilqr(model, problem, ARTICLE)
    assert lagging.converged
    assert lagging.state_names == model.state_names
    assert lagging.gains.shape == (75, 8)
    nominal = ilqr(HEAVY, problem, ARTICLE)
    unaware = ilqr(model, problem, ARTICLE, guess=nominal.inputs, iterations=1).costs[0]
    assert nominal.cost < lagging.cost < 0.3 * unaware
    assert lagging.states[-1, 3] == pytest.approx(
        lagging.states[0, 3] + 0.01 * np.sum(lagging.states[:-1, 7])
    )


def test_a_good_guess_saves_iterations(regular_plan):
    again = ilqr(HEAVY, REGULAR, UNLIMITED, guess=regular_plan.inputs)
    assert len(again.costs) <= 3 < len(regular_plan.costs)


def test_a_plan_that_is_cut_short_says_so_and_its_feedback_is_about_its_end():
    one = ilqr(HEAVY, REGULAR, UNLIMITED, iterations=1)
    assert not one.converged
    assert len(one.costs) == 2
    step = UNLIMITED.step
    [last] = linearize_steps(HEAVY, step, 1, one.states[-2:], one.inputs[-1:])
    A, B, F = last[:, :7], last[:, 7], np.diag(REGULAR.goal_weights)
    stiffness = REGULAR.rate_cost * step + UNLIMITED.hold_rate + B @ F @ B
    np.testing.assert_allclose(one.gains[-1], -B @ F @ A / stiffness, rtol=1e-9)


def no_weights():
    return ilqr(HEAVY, FREELY, dataclasses.replace(ARTICLE, hold_rate=0.0))


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (
            lambda: dataclasses.replace(REGULAR, launch=[0.0] * 6),
            "'launch' is .* 7 finite numbers",
        ),
        (
            lambda: dataclasses.replace(REGULAR, goal_weights=[-1.0] + [1.0] * 6),
            "'goal_weights' .* nothing negative",
        ),
        (
            lambda: IlqrSettings(state_weights=(1.0,) * 6),
            "'state_weights' is .* 7 finite numbers",
        ),
        (
            lambda: IlqrSettings(state_weights=(-1.0,) + (1.0,) * 6),
            "'state_weights' .* none negative",
        ),
        (lambda: IlqrSettings(hold_state=float("nan")), "'hold_state' is nan"),
        (no_weights, "'rate_cost' and 'hold_rate' are both 0"),
        (lambda: IlqrSettings(steps=0), "0 steps of 0.01 s"),
        (lambda: IlqrSettings(order=2), "the order is 2"),
    ],
)
def test_a_problem_that_makes_no_sense_is_refused(make, words):
    with pytest.raises(InputError, match=words):
        make()


def test_a_guess_that_does_not_fit_or_diverges_is_refused():
    with pytest.raises(InputError, match=r"shape \(3,\); \(75,\)"):
        ilqr(HEAVY, REGULAR, UNLIMITED, guess=np.zeros(3))
    with pytest.raises(InputError, match="tolerance is 0"):
        ilqr(HEAVY, REGULAR, UNLIMITED, tolerance=0.0)
    with pytest.raises(DivergedError):
        ilqr(HEAVY, REGULAR, UNLIMITED, guess=np.full(75, 1e9))
