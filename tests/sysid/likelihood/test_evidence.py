"""Marginal likelihoods in closed form are those of Gaussians, written out."""

import dataclasses

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from glider.sysid.likelihood.information import Evidence, Prior, eliminate
from tests.helpers.searches import gain_of

WIDE = np.full(5, 1e6)


@pytest.fixture
def table():
    """Forty whitened rows: five columns and the error."""
    rng = np.random.default_rng(0)
    table = rng.normal(size=(40, 6))
    table[:, 5] += table[:, :2] @ [0.7, -0.4]
    return table


PRECISION = np.array([0.5, 2.0, 0.1, 1.0, 4.0])


def evidence_of(table, lower=-WIDE, upper=WIDE):
    at = np.arange(table.shape[1] - 1)
    return Evidence(gram=table.T @ table, at=at, prior=prior_of(lower, upper))


def prior_of(lower, upper, precision=PRECISION):
    mean = np.zeros(len(precision))
    return Prior(mean=mean, precision=precision, lower=lower, upper=upper)


@pytest.mark.parametrize("columns", [[0], [3], [0, 1], [4, 2, 0], [0, 1, 2, 3, 4]])
def test_the_gain_is_that_of_the_marginal_gaussian(table, columns):
    x, y = table[:, columns], table[:, 5]
    spread = np.eye(len(y)) + x @ np.diag(1.0 / PRECISION[columns]) @ x.T
    expected = multivariate_normal(cov=spread).logpdf(y)
    expected -= multivariate_normal(cov=np.eye(len(y))).logpdf(y)
    found = evidence_of(table)
    assert gain_of(found, columns) == pytest.approx(expected, rel=1e-9)
    assert gain_of(found, columns[::-1]) == pytest.approx(expected, rel=1e-9)


def test_candidates_may_share_columns_with_priors_of_their_own(table):
    """A column and a tenth of it, each expected within one, are two candidates."""
    usual, both = evidence_of(table), np.append(PRECISION, 100.0 * PRECISION)
    shared = dataclasses.replace(
        usual,
        at=np.tile(usual.at, 2),
        prior=prior_of(np.tile(-WIDE, 2), np.tile(WIDE, 2), both),
    )
    smaller = table * np.array([*5 * [0.1], 1.0])
    for columns in ([0], [3, 1]):
        moved = [5 + column for column in columns]
        assert gain_of(shared, columns) == gain_of(usual, columns)
        tenth = evidence_of(smaller)
        expected = gain_of(tenth, columns)
        assert gain_of(shared, moved) == pytest.approx(expected, rel=1e-12)
        step = 0.1 * tenth.step(columns)
        np.testing.assert_allclose(shared.step(moved), step, rtol=1e-12)


def test_nothing_gains_nothing(table):
    assert gain_of(evidence_of(table), []) == 0.0
    assert evidence_of(table).step([]).shape == (0,)


def test_the_step_is_the_posterior_mean(table):
    x, y = table[:, [0, 3]], table[:, 5]
    rows = np.vstack([x, np.diag(np.sqrt(PRECISION[[0, 3]]))])
    expected = np.linalg.lstsq(rows, np.append(y, [0.0, 0.0]), rcond=None)[0]
    np.testing.assert_allclose(evidence_of(table).step([0, 3]), expected)


@pytest.mark.parametrize("side", ["lower", "upper"])
def test_what_is_not_physical_is_impossible(table, side):
    step = evidence_of(table).step([0])[0]
    assert step > 0.5
    bound = {"lower": WIDE.copy(), "upper": WIDE.copy()}
    bound["lower"] *= -1.0
    bound[side][0] = 0.0 if side == "upper" else 2.0 * step
    tight = evidence_of(table, bound["lower"], bound["upper"])
    assert gain_of(tight, [0]) == -np.inf
    assert gain_of(tight, [1]) > -np.inf


def test_what_always_acts_is_integrated_out(table):
    """Their columns widen the noise."""
    always, keep = [1, 4], [0, 2, 3, 5]
    own = np.array([2.0, 0.3])
    x = table[:, always]
    noise = np.eye(len(table)) + x @ np.diag(1.0 / own) @ x.T
    rest = table[:, keep]
    expected = rest.T @ np.linalg.solve(noise, rest)
    found = eliminate(table.T @ table, always, own)[np.ix_(keep, keep)]
    np.testing.assert_allclose(found[:3], expected[:3], rtol=1e-7, atol=1e-8)
    np.testing.assert_allclose(found[:, :3], expected[:, :3], rtol=1e-7, atol=1e-8)


def test_with_nothing_to_eliminate_all_stays(table):
    gram = table.T @ table
    none = eliminate(gram, [], np.zeros(0))
    np.testing.assert_array_equal(none, gram)


@pytest.mark.parametrize("own", [[], [3], [4, 0]])
def test_sets_that_differ_by_some_columns_gain_what_each_gains_alone(table, own):
    more, found = [(1,), (1, 2), ()], evidence_of(table)
    alone = [gain_of(found, [*own, *columns]) for columns in more]
    assert found.extended(own, more) == pytest.approx(alone, rel=1e-9)


def test_a_column_that_others_push_beyond_its_bounds_makes_a_set_impossible(table):
    """Column 1 is within its bounds alone, and not beside column 0."""
    table[:, 1] = table[:, 0] + 0.5 * table[:, 2]
    table[:, 5] = 3.0 * table[:, 1] - 2.5 * table[:, 0]
    upper = WIDE.copy()
    upper[1] = 1.0
    tight = evidence_of(table, upper=upper)
    beside_0, beside_1 = (
        tight.extended([0], [(1,), (3,)]),
        tight.extended([1], [(0,), ()]),
    )
    assert beside_0[0] == beside_1[0] == -np.inf
    assert np.isfinite([beside_0[1], beside_1[1]]).all()


@pytest.mark.parametrize("square", [np.nan, -1e6])
def test_a_column_without_finite_squares_is_in_no_set(table, square):
    found = evidence_of(table)
    found.gram[2, 2] = square
    gains = found.extended([0], [(2,), (1, 2), (1,)])
    assert gains[:2] == [-np.inf, -np.inf] and np.isfinite(gains[2])
    assert found.extended([2], [(1,)]) == [-np.inf]
