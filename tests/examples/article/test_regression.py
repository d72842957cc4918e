"""Least squares that knows its rank, and subsets as exhaustive search finds them."""

import itertools

import numpy as np
import pytest

import regression
from glider.errors import InputError
from regression import best_subsets, least_squares


def table(seed=0, rows=60, columns=8, targets=3):
    rng = np.random.default_rng(seed)
    return rng.normal(size=(rows, columns)), rng.normal(size=(rows, targets))


def test_least_squares_leaves_a_residual_normal_to_its_columns():
    columns, targets = table()
    solved = least_squares(columns, targets)
    left = targets - columns @ solved.coefficients
    np.testing.assert_allclose(columns.T @ left, 0.0, atol=1e-12)
    np.testing.assert_allclose(solved.squared_error, np.sum(left**2, axis=0))
    assert solved.has_full_rank and solved.rank == 8


def test_units_change_neither_rank_nor_error():
    """A column in other units is the same column."""
    columns, targets = table()
    units = 10.0 ** np.arange(-12, 12, 3)
    solved, scaled = (least_squares(c, targets) for c in (columns, columns * units))
    assert scaled.has_full_rank
    assert scaled.condition == pytest.approx(solved.condition)
    np.testing.assert_allclose(scaled.squared_error, solved.squared_error)
    np.testing.assert_allclose(scaled.coefficients.T * units, solved.coefficients.T)


def test_a_direction_that_the_data_never_excite_is_reported_and_stays_at_zero():
    columns, targets = table()
    columns[:, 5] = columns[:, 1] - 2.0 * columns[:, 3]
    solved = least_squares(columns, targets[:, 0])
    assert solved.rank == 7 and not solved.has_full_rank
    assert solved.condition == np.inf
    assert np.abs(solved.coefficients).max() < 10.0
    others = least_squares(np.delete(columns, 5, axis=1), targets[:, 0])
    assert solved.squared_error == pytest.approx(float(others.squared_error))


def test_ridge_is_that_of_the_normal_equation():
    columns, targets = table()
    solved = least_squares(columns, targets, ridge=0.7)
    gram = columns.T @ columns + 0.7 * np.eye(8)
    expected = np.linalg.solve(gram, columns.T @ targets)
    np.testing.assert_allclose(solved.coefficients, expected)


@pytest.mark.parametrize(
    ("columns", "targets", "ridge", "words"),
    [
        (np.ones((3, 2)), np.ones(4), 0.0, r"\(3, 2\)"),
        (np.ones((3, 0)), np.ones(3), 0.0, "p > 0"),
        (np.ones((3, 1)), np.array([1.0, np.nan, 0.0]), 0.0, "not finite"),
        (np.ones((0, 2)), np.ones(0), 0.0, "n, p > 0"),
        (np.ones((3, 1)), np.ones((3, 1, 1)), 0.0, r"\(3, 1, 1\)"),
        (np.ones((3, 1)), np.ones(3), -1.0, "ridge is -1"),
        (np.ones((3, 1)), np.ones(3), np.inf, "ridge is inf"),
    ],
)
def test_bad_input_is_one_sentence(columns, targets, ridge, words):
    with pytest.raises(InputError, match=words):
        least_squares(columns, targets, ridge)


def exhaustive(columns, target, most):
    """Returns the least squared error and its subset by trying them all."""
    tried = []
    for size in range(1, most + 1):
        for subset in itertools.combinations(range(columns.shape[1]), size):
            chosen = columns[:, subset]
            fitted = chosen @ np.linalg.lstsq(chosen, target, rcond=None)[0]
            tried.append((np.sum((target - fitted) ** 2), subset))
    return min(tried)


@pytest.mark.parametrize("most", [1, 2, 3])
@pytest.mark.parametrize("seed", range(3))
def test_best_subsets_are_those_of_exhaustive_search(seed, most, monkeypatch):
    """Even if the elimination alone decides, among columns that resemble each other."""
    monkeypatch.setattr(regression, "SOLVED_AGAIN", 1)
    columns, targets = table(seed)
    columns += columns @ np.random.default_rng(seed).normal(size=(8, 8))
    columns *= 10.0 ** np.arange(-4, 4)
    for k, subset in enumerate(best_subsets(columns, targets, most)):
        error, chosen = exhaustive(columns, targets[:, k], most)
        assert subset.columns == chosen
        assert subset.regression.squared_error == pytest.approx(error)
        assert subset.regression.has_full_rank


def test_dependent_columns_are_never_in_one_subset():
    columns, targets = table()
    columns[:, 0] = columns[:, 3] + columns[:, 6]
    columns[:, 1] = 3.0 * columns[:, 2]
    targets[:, 0] = columns[:, 0] + 1e-9 * targets[:, 0]
    targets[:, 1] = columns[:, 1] + columns[:, 4] + columns[:, 5]
    first, second, _ = best_subsets(columns, targets)
    assert not {0, 3, 6} <= set(first.columns)
    assert len({1, 2} & set(second.columns)) == 1
    assert second.regression.squared_error == pytest.approx(0.0, abs=1e-20)


def test_there_may_be_fewer_columns_than_a_subset_holds():
    columns, targets = table(columns=2)
    (subset, *_) = best_subsets(columns, targets)
    assert subset.columns == (0, 1)


def test_columns_of_zeros_are_refused():
    _, targets = table()
    with pytest.raises(InputError, match="every column is zero"):
        best_subsets(np.zeros((60, 4)), targets)


def test_a_subset_of_four_is_refused():
    with pytest.raises(InputError, match="most is 4"):
        best_subsets(*table(), most=4)


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_a_number_that_is_not_finite_is_reported_in_any_column(bad):
    columns, targets = table()
    columns[3, 4] = bad
    with pytest.raises(InputError, match=r"best_subsets: .* not finite"):
        best_subsets(columns, targets)


@pytest.mark.parametrize(("apart", "is_found"), [(1e-4, True), (1e-6, False)])
def test_pivots_are_squares_of_how_far_columns_lie_apart(apart, is_found):
    """Singular values run_main the two columns apart where pivots no longer do."""
    columns, _ = table()
    target = columns[:, 1].copy()
    columns[:, 1] = columns[:, 0] + apart * target
    assert least_squares(columns, target).has_full_rank
    (subset,) = best_subsets(columns, target[:, None], most=2)
    assert (subset.columns == (0, 1)) == is_found
