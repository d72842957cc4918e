"""The loop of learning: what flies, is logged, is learned, and improves the flights."""

import dataclasses

import numpy as np
import pytest

from coefficients import basis_values, residual_basis, with_weights
from flight_weights import solve_weights, weight_equations
from glider.errors import InputError
from glider.paths import models_path
from glider.physics.effects.free_functions import COEFFICIENTS
from glider.physics.model import GliderModel
from glider.physics.parameters import load_parameters
from glider.simulation.flown_flights import closest_pass
from ilqr import goal_cost, ilqr
from learn_residual import weight_changes
from learning import (
    CAPTURE,
    STATE_NOISE,
    fit_weights,
    fly_planned,
    knots_of,
    knowing,
    launched,
    learn,
    learning_problem,
    learning_settings,
    log,
    trace_effects,
)
from low_reynolds import low_reynolds_coefficients, low_reynolds_residual
from regression import least_squares
from tests.helpers.flights import LAGGING

HEAVY = GliderModel(parameters=load_parameters(models_path("vehicles", "heavy.yaml")))
PROBLEM = learning_problem()


@pytest.fixture(scope="module")
def planned():
    return ilqr(HEAVY, PROBLEM, learning_settings())


def accelerations(model, states, inputs):
    """Returns (N, 3) of ẍ, z̈, θ̈ by the composed chain."""
    chain, theta = model.chain, model.numbers
    rates = chain.derivatives(0.0, states.T, inputs, 0.0, 0.0, theta)
    return np.stack(rates[4:7], axis=1)


# ------------------------------------------------------------------------ flights


def test_a_glider_flies_as_it_was_planned(planned):
    """With the planner's model, from its launch, to the error of its steps."""
    flown = fly_planned(HEAVY, planned, PROBLEM)
    np.testing.assert_allclose(knots_of(flown, planned), planned.states, atol=2e-3)
    np.testing.assert_allclose(flown.commands[0, :75], planned.inputs, atol=2e-3)
    assert flown.commands.shape == (1, 85)  # For 0.1 s after the plan.
    np.testing.assert_array_equal(flown.commands[0, 75:], 0.0)
    flight = flown.flight(0)
    assert flight.miss == pytest.approx(
        closest_pass(flight.times, flight.states, np.zeros(2)).miss, abs=1e-5
    )
    assert flight.perched


@pytest.mark.parametrize("change", [-0.3, 0.3])
def test_the_feedback_brings_a_glider_back(planned, change):
    """Launched too slowly or too fast [m/s], by what the goal asks for."""
    launch = launched(PROBLEM, PROBLEM.launch[4] + change)
    blind = dataclasses.replace(planned, gains=0.0 * planned.gains)
    guided, left = (fly_planned(HEAVY, p, launch) for p in (planned, blind))
    knots = knots_of(guided, planned)
    costs = [goal_cost(PROBLEM, k[-1]) for k in (knots, knots_of(left, planned))]
    assert costs[0] < 0.4 * costs[1]
    assert guided.miss[0] < 0.5 * left.miss[0]
    errors = knots[:-1] - planned.states[:-1]
    wanted = planned.inputs + np.sum(planned.gains * errors, axis=1)
    room = HEAVY.parameters.elevator_limits[1] - knots[:-1, 3]
    free = (np.abs(wanted) < 12.0) & (room > 0.07)  # No stop is near.
    assert np.sum(free) > 30
    np.testing.assert_allclose(guided.commands[0, :75][free], wanted[free], atol=1e-9)


def test_the_servos_limits_hold_in_flight(planned):
    wild = dataclasses.replace(planned, inputs=3.0 * planned.inputs)
    flown = fly_planned(HEAVY, wild, PROBLEM)
    elevator = flown.flight(0).states[:, 3]
    low, high = HEAVY.parameters.elevator_limits
    assert np.max(np.abs(flown.commands)) <= HEAVY.parameters.elevator_rate_limit
    assert low - 1e-6 <= np.min(elevator)
    assert np.max(elevator) <= high + 1e-6


def test_motion_capture_sees_the_flight_with_noise(planned):
    flown = fly_planned(HEAVY, planned, PROBLEM)
    logs = [
        log(HEAVY, flown, planned, np.random.default_rng(seed), "flight_000.csv")
        for seed in range(20)
    ]
    spread = np.std([seen.states - knots_of(flown, planned) for seen in logs])
    assert spread == pytest.approx(STATE_NOISE, rel=0.1)
    films = [seen.capture for seen in logs]
    time = films[0].time
    assert len(time) == 103
    path = [np.interp(time, flown.times, column) for column in flown.paths[0].T]
    errors = [film.pose - np.stack(path[:3], 1) for film in films]
    spread = np.std(np.concatenate(errors), axis=0)
    np.testing.assert_allclose(spread, CAPTURE.std[:3], rtol=0.1)
    spread = np.std([film.elevator - path[3] for film in films])
    assert spread == pytest.approx(CAPTURE.std[3], rel=0.1)
    # Row 12 is at 0.1 s, where the eleventh command begins.
    assert films[0].command[12] == flown.commands[0, 10]
    assert films[0].command[11] == flown.commands[0, 9]


def test_a_flight_that_diverges_is_not_logged(planned):
    flown = fly_planned(HEAVY, planned, PROBLEM)
    lost = dataclasses.replace(flown, paths=np.full_like(flown.paths, np.nan))
    with pytest.raises(InputError, match=r"flight_7\.csv: the flight diverges"):
        log(HEAVY, lost, planned, np.random.default_rng(0), "flight_7.csv")


# ------------------------------------------------------------------------ weights


def euler_flight(model, planned, bend=0.0):
    """Returns states of a flight by Euler steps of a model, its commands bent."""
    inputs = planned.inputs + bend
    x = [planned.states[0]]
    for u in inputs:
        a = accelerations(model, x[-1][None], np.array([u]))[0]
        x.append(x[-1] + planned.times[1] * np.concatenate([x[-1][4:], [u], a]))
    return np.array(x), inputs


def test_weights_learned_from_clean_euler_flights_are_those_of_the_truth(planned):
    """Where it flew: 26 weights are more than two flights run_main apart."""
    rng, basis = np.random.default_rng(0), residual_basis()
    weights = rng.normal(0.0, 0.2, (26, 3)) * [1.0, 1.0, 0.05]
    truth = dataclasses.replace(
        HEAVY, free_functions=[with_weights(basis, COEFFICIENTS, weights)]
    )
    equations = []
    for bend in (0.0, 1.0):
        states, inputs = euler_flight(truth, planned, bend)
        step = planned.times[1]
        equations.append(weight_equations(HEAVY, basis, states, inputs, step))
    both = equations[0] + equations[1]
    found = with_weights(basis, COEFFICIENTS, solve_weights(both, 1e-9))
    learned = dataclasses.replace(HEAVY, free_functions=[found])
    got = accelerations(learned, states[:-1], inputs)
    wanted = accelerations(truth, states[:-1], inputs)
    plate = accelerations(HEAVY, states[:-1], inputs)
    assert np.max(np.abs(wanted - plate)) > 0.5
    np.testing.assert_allclose(got, wanted, atol=1e-4)
    ridged = solve_weights(both)
    assert np.linalg.norm(ridged) < np.linalg.norm(solve_weights(both, 1e-9))
    np.testing.assert_allclose(  # The normal equations of the ridge.
        both.information @ ridged.ravel() + 0.1 * ridged.ravel(), both.target, rtol=1e-9
    )


def test_what_the_weights_cannot_be_learned_for_is_refused(planned):
    basis, states, inputs = residual_basis(), planned.states, planned.inputs
    with pytest.raises(InputError, match="without effects that have states"):
        weight_equations(LAGGING, basis, states, inputs, 0.01)
    with pytest.raises(InputError, match=r"\(75, 7\) and there are 75 inputs"):
        weight_equations(HEAVY, basis, states[:-1], inputs, 0.01)


# --------------------------------------------------------------------- the truth


def test_the_shipped_truth_is_what_its_module_fits():
    truth = GliderModel.load(models_path("truths", "low_reynolds.yaml"))
    assert truth.parameters == HEAVY.parameters
    field = low_reynolds_residual(HEAVY.parameters)
    [planted] = truth.free_functions
    assert planted.centers == field.centers
    assert [len(w) for w in field.weights.values()] == [126] * 3
    for name in COEFFICIENTS:
        np.testing.assert_allclose(
            truth.free_functions[0].weights[name],
            field.weights[name],
            rtol=1e-4,
            atol=1e-6,
        )


def test_the_truth_follows_its_effect_and_no_field_without_airspeed_can():
    rng = np.random.default_rng(0)
    alpha, elevator = rng.uniform(0.0, 1.5, 4000), rng.uniform(-0.3, 0.9, 4000)
    speed = rng.uniform(1.5, 7.5, 4000)
    wanted = low_reynolds_coefficients(alpha, elevator, speed, HEAVY.parameters)
    values = {"alpha": alpha, "elevator": elevator, "V": speed}
    field = low_reynolds_residual(HEAVY.parameters)
    weights = np.array([field.weights[name] for name in COEFFICIENTS]).T
    left = np.std(wanted - basis_values(field, values) @ weights, axis=0)
    blind = basis_values(residual_basis(), values)
    best = least_squares(blind, wanted).coefficients
    assert np.all(left < 0.25 * np.std(wanted, axis=0))
    assert np.all(np.std(wanted - blind @ best, axis=0) > 1.8 * left)


# ----------------------------------------------------------------------- the loop


def test_all_that_identify_get_the_same_flights():
    """Until their models differ; a round repeats from the same generator state."""
    once, again = (
        learn(HEAVY, knowing(HEAVY), 2, np.random.default_rng(3), launches=1)
        for _ in range(2)
    )
    assert [r.miss for r in once] == [r.miss for r in again]
    assert [r.terminal_cost for r in once] == [r.terminal_cost for r in again]
    speeds = [r.flights[0].states[0, 4] for r in once]
    assert 6.5 < min(speeds) < max(speeds) < 7.5
    assert max(r.miss for r in once) < 0.02
    assert weight_changes(once) == [0.0]


def test_a_launch_differs_in_speed_alone():
    launch = np.array(launched(PROBLEM, 6.6).launch)
    assert launch[4] == 6.6
    rest = np.delete(launch, 4)
    np.testing.assert_array_equal(rest, np.delete(PROBLEM.launch, 4))


def test_the_tracer_waits_for_three_flights_and_a_loop_for_one(planned):
    flown, rng = fly_planned(HEAVY, planned, PROBLEM), np.random.default_rng(0)
    logged = log(HEAVY, flown, planned, rng, "flight_000.csv")
    assert logged.step == pytest.approx(0.01)
    np.testing.assert_array_equal(logged.rates, flown.commands[0, :75])
    assert trace_effects(HEAVY, [logged, logged]).model is HEAVY
    assert fit_weights(HEAVY, [logged]).effects == ("rbf_residual",)
    with pytest.raises(InputError, match="0 rounds of 3 launches"):
        learn(HEAVY, fit_weights, 0, np.random.default_rng(0))
