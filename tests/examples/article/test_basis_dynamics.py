"""The identification exercise: its features, models, signs, choice and files."""

import dataclasses

import numpy as np
import pytest
import yaml

from basis_choice import configured, cross_validate
from basis_dynamics import (
    BasisDynamics,
    best_numbers,
    fit_basis,
    fly_again,
    sampled_features,
)
from basis_exercise import EXERCISE, fly_exercise, load_exercise
from basis_features import FEATURES, OURS, PAPER, basis_flow
from basis_logs import exercise_campaign
from basis_recipe import Recipe
from basis_refinement import refine, rollout_error
from basis_study import fit_configurations
from glider.errors import InputError
from glider.physics.parameters import GliderParameters
from glider.sysid.replay.vehicle import make_vehicle
from glider.sysid.search.signs import find_signs
from regression import least_squares


@pytest.fixture(scope="module")
def exercise():
    return load_exercise()


def test_numbers_that_are_read_rightly_show_no_fault(exercise):
    log = exercise_campaign(exercise, "nose_down")
    vehicle = make_vehicle(log)
    assert find_signs(log, log.flights[:2], {}, vehicle).are_right


def test_a_ridge_is_paid_for_in_error(exercise):
    plain, shrunk = (fit_configurations(exercise, ridge) for ridge in (0.0, 1e3))
    for signs, fits in plain.items():
        for name, fit in fits.items():
            assert shrunk[signs][name].score > fit.score


def turned(flights):
    """Returns the flights with all angles counted the other way round."""
    signs = [1.0, 1.0, -1.0, -1.0, 1.0, 1.0, -1.0]
    return dataclasses.replace(
        flights, states=flights.states * signs, rates=-flights.rates
    )


def test_how_angles_are_counted_does_not_matter_where_it_is_said(exercise):
    numbers = exercise.configurations["6"]
    here, there = exercise.frame("nose_down"), exercise.frame("nose_up")
    down = fit_basis(exercise.fitted, here, numbers)
    up = fit_basis(turned(exercise.fitted), there, numbers)
    np.testing.assert_allclose(up.model.coefficients, down.model.coefficients)
    flown = fly_again(up.model, turned(exercise.held_out))
    signs = [1.0, 1.0, -1.0, -1.0, 1.0, 1.0, -1.0]
    expected = fly_again(down.model, exercise.held_out)
    np.testing.assert_allclose(flown * signs, expected, atol=1e-12)


def test_an_unknown_way_to_count_angles_is_refused(exercise):
    with pytest.raises(
        InputError, match="'sideways'; expected one of nose_up, nose_down"
    ):
        exercise.frame("sideways")


def test_there_are_41_features_and_ours_are_distinguished_from_the_papers():
    assert len(FEATURES) == 41 and len(PAPER) == 20
    assert max(PAPER) == 41 and min(OURS) == 101
    assert len({words for words, _ in FEATURES.values()}) == 41


def test_angles_of_attack_are_positive_above_the_velocity():
    """A glider with its nose up in level flight; its elevator is deflected up."""
    state = np.array([0.0, 5.0, -0.2, 0.1, 7.0, 0.0, 0.0])
    flow = basis_flow(state, np.zeros(()), 0.292, "nose_down")
    assert flow.sin_a == pytest.approx(np.sin(0.2))
    assert flow.sin_b == pytest.approx(np.sin(0.1))
    np.testing.assert_allclose([flow.V, flow.W], 7.0)
    # A tail that moves up meets the air from above.
    state[-1] = 1.0
    moving = basis_flow(state, np.zeros(()), 0.292, "nose_down")
    assert moving.sin_b < flow.sin_b


def test_features_are_smooth_where_complex_steps_take_them(exercise):
    """The imaginary part of a complex step is the derivative, of every feature."""
    states = exercise.fitted.states[0, :-1]
    rates = exercise.fitted.rates[0]
    direction = np.random.default_rng(0).normal(size=7)
    formulas = [formula for _, formula in FEATURES.values()]

    def values(step):
        flow = basis_flow(states + step * direction, rates, 0.292, "nose_down")
        return np.array([formula(flow) for formula in formulas])

    exact = values(1e-30j).imag / 1e-30
    numeric = (values(1e-6) - values(-1e-6)) / 2e-6
    scale = np.abs(exact).max(axis=1, keepdims=True) + 1e-9
    np.testing.assert_allclose(exact / scale, numeric / scale, atol=1e-6)


def test_features_that_depend_on_each_other_are_reported(exercise):
    """V² sin a = V² sin a cos² a + V² sin³ a, so no data run_main the three apart."""
    frame = exercise.frame("nose_down")
    columns = sampled_features(exercise.fitted, frame, (1, 3, 5))
    assert least_squares(columns, columns[:, 0]).rank == 2


def test_a_model_without_forces_falls_freely(exercise):
    flights = exercise.held_out
    nothing = BasisDynamics(
        numbers=((1,), (1,), (11,)),
        coefficients=np.zeros(3),
        frame=exercise.frame("nose_down"),
    )
    flown = fly_again(nothing, flights)[0]
    start, steps = flights.states[0, 0], flights.rates.shape[1]
    time = steps * flights.step
    np.testing.assert_allclose(flown[-1, 4:], start[4:] - [0.0, 9.81 * time, 0.0])
    assert flown[-1, 0] == pytest.approx(start[0] + start[4] * time)
    np.testing.assert_allclose(flown[:, 3], flights.states[0, :, 3], atol=1e-12)


def test_a_model_refined_on_its_own_flights_is_found_again(exercise):
    frame, flights = exercise.frame("nose_down"), exercise.fitted.pick([0, 3, 7])
    true = fit_basis(flights, frame, exercise.configurations["6"]).model
    flown = dataclasses.replace(flights, states=fly_again(true, flights))
    start = dataclasses.replace(true, coefficients=1.1 * true.coefficients)
    found = refine(start, flown)
    np.testing.assert_allclose(found.coefficients, true.coefficients, rtol=1e-6)
    assert rollout_error(found, flown).weighted < 1e-6


def test_only_weighted_channels_are_refined(exercise):
    """With weights on the pitch alone, the pitch is flown best."""
    frame, flights = exercise.frame("nose_up"), exercise.fitted.pick([0, 1, 2])
    model = fit_basis(flights, frame, exercise.configurations["6"]).model
    pitch = (np.inf, np.inf, 0.1, np.inf, np.inf, np.inf, np.inf)
    place = (0.1, 0.1, np.inf, np.inf, np.inf, np.inf, np.inf)
    angles, places = (
        rollout_error(refine(model, flights, scales), flights)
        for scales in (pitch, place)
    )
    assert angles.pitch_rad < places.pitch_rad
    assert places.position_m < angles.position_m


def test_a_model_that_blows_up_is_not_refined(exercise):
    frame = exercise.frame("nose_down")
    model = fit_basis(exercise.fitted, frame, exercise.configurations["8"]).model
    wild = dataclasses.replace(model, coefficients=1e3 * model.coefficients)
    assert rollout_error(wild, exercise.fitted).weighted == np.inf
    with pytest.raises(InputError, match="diverges"):
        refine(wild, exercise.fitted)


def test_a_search_does_not_see_the_flights_left_out(exercise):
    seen = []
    frame = exercise.frame("nose_down")

    def spy(flights):
        seen.append({tuple(rates) for rates in flights.rates})
        return best_numbers(flights, frame, tuple(PAPER), 1)

    candidates = {"spy": spy, "6": configured(exercise.configurations["6"])}
    errors = cross_validate(exercise.fitted, frame, candidates, folds=7)
    everything = {tuple(rates) for rates in exercise.fitted.rates}
    left_out = [everything - part for part in seen]
    assert [len(part) for part in left_out] == [2] * 7
    assert set().union(*left_out) == everything
    assert 0.0 < errors["spy"] < errors["6"]


def test_candidates_that_no_flight_tells_apart_are_refused_without_a_ridge(exercise):
    frame = exercise.frame("nose_down")
    dependent = {"odd": configured(((1, 26), (1, 3, 5), (11,)))}
    words = "'odd' has features 1, 3, 5 in the normal channel, of rank 2"
    with pytest.raises(InputError, match=words):
        cross_validate(exercise.fitted, frame, dependent)
    little, much = (
        cross_validate(exercise.fitted, frame, dependent, ridge=ridge)["odd"]
        for ridge in (1.0, 1e6)
    )
    assert 0.0 < little < much < np.inf


def test_a_channel_without_features_is_refused(exercise):
    frame = exercise.frame("nose_down")
    with pytest.raises(InputError, match="the normal channel has no features"):
        fit_basis(exercise.fitted, frame, ((1,), (), (11,)))


def test_one_fold_is_refused(exercise):
    with pytest.raises(InputError, match="folds is 1; 2 to 14"):
        cross_validate(exercise.fitted, exercise.frame("nose_down"), {}, folds=1)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"flights": "three"}, "'flights' is 'three'; expected a whole number"),
        ({"flights": 1, "held_out": 0}, "'flights' is missing or 1; 2 or more"),
        ({"held_out": 99}, "a flight from 0 to 14"),
        ({"held_out": -1}, "a flight from 0 to 14"),
        ({"seed": 2**32}, "'seed'"),
        ({"step": -0.01}, "'step' is missing or -0.01; a positive number"),
        ({"step": float("inf")}, "'step'"),
        ({"launch": [0, 1]}, r"'launch' is missing or \[0.0, 1.0\]; 7 finite"),
        ({"launch": [0, 5, 0, 0, 7, 0, float("nan")]}, "'launch'"),
        ({"launch_spread": -0.1}, "'launch_spread'"),
        ({"tape_spread": float("nan")}, "'tape_spread'"),
        ({"tape": "abc"}, "'tape' is 'abc'; expected a list"),
        ({"tape": []}, "one finite rate a step"),
        ({"configurations": [1]}, "expected a mapping"),
        ({"configurations": {}}, "'configurations'"),
        ({"configurations": {"a": [[1], [3]]}}, "for each of 3 channels"),
        ({"configurations": {"a": [[1], [], [3]]}}, "for each of 3 channels"),
        ({"configurations": {"a": [[1], [5], [999]]}}, "'a' names feature 999"),
        ({"surplus": 1}, "surplus"),
    ],
)
def test_a_file_that_is_no_exercise_is_one_sentence(tmp_path, changes, words):
    path = tmp_path / "exercise.yaml"
    data = yaml.safe_load(EXERCISE.read_text(encoding="utf-8"))
    path.write_text(yaml.safe_dump({**data, **changes}))
    with pytest.raises(InputError, match=words) as output:
        load_exercise(path)
    assert str(path) in str(output.value) and "\n" not in str(output.value)


@pytest.mark.parametrize("name", [f.name for f in dataclasses.fields(Recipe)])
def test_every_field_of_an_exercise_is_needed(tmp_path, name):
    path = tmp_path / "exercise.yaml"
    data = yaml.safe_load(EXERCISE.read_text(encoding="utf-8"))
    del data[name]
    path.write_text(yaml.safe_dump(data))
    with pytest.raises(InputError, match=f"'{name}' is missing"):
        load_exercise(path)


def test_launches_of_another_size_are_refused():
    """The compiled loops do not look at sizes: they would write beside the array."""
    with pytest.raises(InputError, match=r"launches are \(2, 2\)"):
        fly_exercise(GliderParameters(), np.zeros((2, 2)), np.zeros((2, 5)), 0.01, 1)
    with pytest.raises(InputError, match=r"tapes \(3, 5\)"):
        fly_exercise(GliderParameters(), np.zeros((2, 7)), np.zeros((3, 5)), 0.01, 1)
