"""Regions of attraction: proved ones are true ones, and a false proof is refused."""

import dataclasses
from fractions import Fraction

import numpy as np
import pytest
from pydrake.symbolic import Polynomial

import van_der_pol
from van_der_pol import (
    RAYS,
    SIZE,
    Y,
    area,
    boundary,
    certify,
    find_multiplier,
    find_positive,
    grow,
    is_positive_definite,
    is_proved,
    lie_derivative,
    limit_cycle,
    lyapunov_function,
    rounded,
    share_of,
    true_area,
)


@pytest.fixture(scope="module")
def level():
    """The largest level of the Lyapunov function."""
    return lyapunov_function()[1]


@pytest.fixture(scope="module")
def proved(level):
    """Regions by degree, after one round."""
    V, _ = lyapunov_function()
    return van_der_pol.prove(V * (1.0 / level), rounds=1)


@pytest.fixture(scope="module")
def ellipse(proved):
    """Region that the Lyapunov function proves."""
    return proved[2]


def values(V, points):
    return V.EvaluateIndeterminates(Y, points)


# ------------------------------------------------------------------- the oscillator


def test_the_lie_derivative_is_that_of_the_oscillator():
    V, _ = lyapunov_function()
    y = np.random.default_rng(1).normal(size=(2, 20))
    x = SIZE * y
    drift = np.array([-x[1], x[0] + (x[0] ** 2 - 1.0) * x[1]])
    slopes = np.array([values(V.Differentiate(v), y) for v in Y]) / SIZE
    np.testing.assert_allclose(values(lie_derivative(V), y), np.sum(slopes * drift, 0))
    near = 1e-4 * y / SIZE
    np.testing.assert_allclose(
        values(lie_derivative(V), near), -np.sum((SIZE * near) ** 2, axis=0), rtol=1e-5
    )


def test_the_true_region_is_known():
    """13.722, as in the funnel notes; the cycle's amplitude is 2.0086."""
    assert true_area() == pytest.approx(13.722, abs=0.001)
    assert np.max(np.abs(limit_cycle()[0])) == pytest.approx(2.0086, abs=1e-4)


def test_the_articles_level_is_reached_and_proved(level, ellipse):
    assert level == pytest.approx(2.3045, abs=0.0005)
    assert share_of(ellipse) == pytest.approx(0.472, abs=0.001)
    x = boundary(ellipse.V)
    expected = 1.5 * x[0] ** 2 - x[0] * x[1] + x[1] ** 2
    np.testing.assert_allclose(expected, level, rtol=2e-3)


def test_no_multiplier_proves_a_larger_level(level):
    V, _ = lyapunov_function()
    assert find_multiplier(V * (1.0 / (0.99 * level)), 1)[0] > 1e-5
    assert find_multiplier(V * (1.0 / (1.01 * level)), 1)[0] < 0.0


def test_rounds_of_degree_four_enlarge_the_region(ellipse):
    start = ellipse.V * 1.01
    two = certify(grow(start, 4, 2), 2)
    assert area(start) < area(two.V)
    assert area(two.V) > 0.55 * true_area()
    assert not is_proved(dataclasses.replace(two, positive=[-G for G in two.positive]))


@pytest.mark.nightly
def test_many_rounds_prove_nearly_all():
    shares = list(van_der_pol.main([]).values())
    assert shares == ["2.3045", "47.2%", "85.3%", "99.5%"]


def test_a_v_of_higher_degree_proves_more(proved):
    shares = {degree: share_of(region) for degree, region in proved.items()}
    assert list(shares) == [2, 4, 6]
    assert 0.47 < shares[2] < shares[4] < 1.0
    assert shares[2] < shares[6] < 1.0


def test_what_is_found_is_proved_and_true(proved):
    """The whole limit cycle lies outside, as it must."""
    for region in proved.values():
        assert is_proved(region)
        assert np.min(values(region.V, limit_cycle() / SIZE)) > 1.0
        np.testing.assert_allclose(
            values(region.V, RAYS * van_der_pol.radii(region.V)), 1.0, atol=1e-5
        )


# ------------------------------------------------------------------ the exact check


@pytest.mark.parametrize("name", ["V", "multiplier", "decrease"])
def test_a_false_proof_is_refused(ellipse, name):
    assert is_proved(ellipse)
    given = getattr(ellipse, name)
    other = given * 0.99 if name == "V" else [-G for G in given]
    assert not is_proved(dataclasses.replace(ellipse, **{name: other}))


def test_a_multiplier_that_is_no_sum_of_squares_is_refused(ellipse):
    """Where nothing else is wrong: the rest has margin for so little a change."""
    V = ellipse.V * 2.0
    _, _, (odd, even), decrease = find_multiplier(V, 2)
    sizes, directions = np.linalg.eigh(even)
    line = np.outer(directions[:, 0], directions[:, 0])
    for excess in (-1e-6, 1e-6):
        claimed = dataclasses.replace(
            ellipse,
            V=V,
            positive=find_positive(V),
            multiplier=[odd, even - (sizes[0] + excess) * line],
            decrease=decrease,
            half=2,
        )
        assert is_proved(claimed) == (excess < 0.0)


def test_a_region_beyond_the_limit_cycle_is_refused(ellipse):
    """Whatever a solver says of it."""
    V = ellipse.V * 0.9
    _, _, L, decrease = find_multiplier(V, 2)
    claimed = dataclasses.replace(ellipse, V=V, multiplier=L, decrease=decrease, half=2)
    assert not is_proved(claimed)


def test_a_monomial_without_a_square_is_refused(ellipse):
    odd = ellipse.V + Polynomial(1e-9 * Y[0], Y)
    assert not is_proved(dataclasses.replace(ellipse, V=odd))


@pytest.mark.parametrize("smallest", [1e-9, -1e-9])
def test_pivots_distinguish_definite_matrices(smallest):
    turn = np.linalg.qr(np.random.default_rng(2).normal(size=(4, 4)))[0]
    matrix = turn @ np.diag([3.0, 2.0, 1.0, 1e-3 + smallest]) @ turn.T
    [exact] = rounded([0.5 * (matrix + matrix.T) - 1e-3 * np.outer(*2 * [turn[:, 3]])])
    assert is_positive_definite(exact) == (smallest > 0.0)
    assert not is_positive_definite(np.full((2, 2), Fraction(1)))  # Singular.
