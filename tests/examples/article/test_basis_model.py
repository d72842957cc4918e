"""Lessons 1 and 2: published scores and their fault, best features, refinement."""

import matplotlib.image
import numpy as np
import pytest

import basis_model
from basis_model import (
    CONFIGURATIONS,
    CONSISTENT,
    FEATURES,
    GLIDER,
    PUBLISHED,
    STEP,
    BasisModel,
    best_choice,
    feature_columns,
    fit,
    flow_of,
    fly_exercise,
    rollout,
)
from basis_refinement import position_error, refine

SCORES = {
    PUBLISHED: [
        *(113727, 183944, 120629, 104607, 192647),
        *(63831, 157343, 96418, 129489, 174510),
    ],
    CONSISTENT: [
        *(116008, 197861, 114153, 93612, 210773),
        *(4013, 131394, 28827, 128622, 210798),
    ],
}


@pytest.fixture(scope="module")
def flights():
    return fly_exercise()


@pytest.fixture(scope="module")
def fitted(flights):
    states, rates = flights
    return states[1:], rates[1:]


@pytest.mark.parametrize("sign", [PUBLISHED, CONSISTENT])
def test_scores_are_the_published_ones_to_the_integer(fitted, sign):
    choices = CONFIGURATIONS.values()
    assert [int(fit(*fitted, own, sign)[1]) for own in choices] == SCORES[sign]


def test_the_published_model_ends_where_the_article_says(flights, fitted):
    states, rates = flights
    model, _ = fit(*fitted, CONFIGURATIONS[6], PUBLISHED)
    x, z, pitch = rollout(model, states[0, 0], rates[0])[-1, :3]
    assert 3.34 <= x <= 3.36 and 4.99 <= z <= 5.10 and -0.54 <= pitch <= -0.52


def test_the_best_triples_leave_next_to_nothing(fitted):
    """Features 1, 3 and 5 depend on each other: together they are no subset."""
    triples = best_choice(*fitted, 3)
    assert triples == ((5, 15, 24), (1, 26, 30), (15, 26, 30))
    assert fit(*fitted, triples, CONSISTENT)[1] == pytest.approx(2.55, abs=0.005)
    columns = feature_columns(*fitted, (1, 3, 5), CONSISTENT)
    assert np.linalg.matrix_rank(columns) == 2


def test_the_best_pair_is_the_best_of_all_pairs(fitted):
    """By least squares one after the other."""
    pair = best_choice(*fitted, 2)
    others = [((a, b), (1,), (11,)) for a in FEATURES for b in FEATURES if a < b]
    along = min(others, key=lambda choice: fit(*fitted, choice, CONSISTENT)[1])
    assert pair[0] == along[0]


def test_features_are_smooth_where_complex_steps_take_them(flights):
    """The imaginary part of a complex step is the derivative, of every feature."""
    states, rates = flights[0][1, :-1], flights[1][1]
    direction = np.random.default_rng(0).normal(size=7)

    def values(step):
        flow = flow_of(states + step * direction, rates, CONSISTENT)
        return np.array([formula(flow) for _, formula in FEATURES.values()])

    exact = values(1e-30j).imag / 1e-30
    numeric = (values(1e-6) - values(-1e-6)) / 2e-6
    scale = np.abs(exact).max(axis=1, keepdims=True) + 1e-9
    np.testing.assert_allclose(exact / scale, numeric / scale, atol=1e-6)


def test_a_model_without_forces_falls_freely(flights):
    states, rates = flights
    nothing = BasisModel(((1,), (1,), (11,)), np.zeros(3), CONSISTENT)
    flown = rollout(nothing, states[0, 0], rates[0])
    start, seconds = states[0, 0], STEP * rates.shape[1]
    fall = [0.0, GLIDER.parameters.gravity * seconds, 0.0]
    np.testing.assert_allclose(flown[-1, 4:], start[4:] - fall)
    np.testing.assert_allclose(flown[:, 3], states[0, :, 3], atol=1e-12)


def test_a_model_refined_on_its_own_flights_is_found_again(fitted):
    states, rates = fitted[0][[0, 3, 7]], fitted[1][[0, 3, 7]]
    true, _ = fit(states, rates, CONFIGURATIONS[6], CONSISTENT)
    flown = rollout(true, states[:, 0], rates)
    off = true._replace(coefficients=1.1 * true.coefficients)
    found = refine(off, flown, rates)
    np.testing.assert_allclose(found.coefficients, true.coefficients, rtol=1e-6)


def test_a_refined_model_flies_the_held_out_flight_closer(flights, fitted):
    states, rates = flights
    model, _ = fit(*fitted, CONFIGURATIONS[6], CONSISTENT)
    before = position_error(model, states[0], rates[0])
    after = position_error(refine(model, *fitted), states[0], rates[0])
    assert before == pytest.approx(6.84e-3, rel=0.01)
    assert after == pytest.approx(3.26e-3, rel=0.01)


def test_the_lesson_prints_and_draws(tmp_path, capsys):
    picture = tmp_path / "lesson.png"
    found = basis_model.main(["--figure", str(picture)])
    output = capsys.readouterr().out
    assert "z̈: V² sin a + V² cos³ a + V q cos a" in output
    assert found["Squared error of configuration 6, the best of ten"] == "63,831"
    pixels = matplotlib.image.imread(picture)
    assert np.mean(pixels[..., :3].min(axis=-1) < 0.95) > 0.03
