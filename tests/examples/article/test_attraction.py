"""Regions of attraction: proved ones are true ones, and a false proof is refused."""

import dataclasses
from fractions import Fraction

import numpy as np
import pytest

from planar import Squares, gradient, product, values
from van_der_pol import (
    SIZE,
    area,
    boundary,
    certify,
    find_level,
    find_multiplier,
    find_positive,
    grow,
    is_proved,
    largest_level,
    lie_derivative,
    limit_cycle,
    lyapunov_function,
    start_of_degree,
    true_area,
)


@pytest.fixture(scope="module")
def ellipse():
    """The level of the Lyapunov function and the region that it proves."""
    V = lyapunov_function()
    level = largest_level(V)
    return level, certify(V / level, 1)


def drift(x):
    return np.array([-x[1], x[0] + (x[0] ** 2 - 1.0) * x[1]])


# ------------------------------------------------------------------- polynomials


def test_polynomials_are_multiplied_and_differentiated():
    rng = np.random.default_rng(0)
    a, b, x = rng.normal(size=(3, 3)), rng.normal(size=(4, 4)), rng.normal(size=(2, 9))
    np.testing.assert_allclose(values(product(a, b), x), values(a, x) * values(b, x))
    size = 1e-6
    for by, step in zip(gradient(a), size * np.eye(2)[:, :, None], strict=True):
        slope = (values(a, x + step) - values(a, x - step)) / (2.0 * size)
        np.testing.assert_allclose(values(by, x), slope, rtol=1e-6, atol=1e-8)


def test_gram_matrices_give_their_polynomial():
    squares, rng = Squares(3), np.random.default_rng(0)
    entries, x = rng.normal(size=len(squares.pairs)), rng.normal(size=(2, 9))
    expected = np.zeros(9)
    for block, matrix in zip(squares.blocks, squares.matrices(entries), strict=True):
        m = np.array([x[0] ** i * x[1] ** j for i, j in block])
        expected += np.sum(m * (matrix @ m), axis=0)
    np.testing.assert_allclose(values(squares.polynomial(entries), x), expected)
    assert sorted(squares.sizes) == [3, 6]
    exact = squares.polynomial(np.array([Fraction(1, 3)] * len(entries)))
    assert exact[2, 0] == Fraction(1, 3)


# ------------------------------------------------------------------ the oscillator


def test_the_lie_derivative_is_that_of_the_oscillator():
    V, y = lyapunov_function(), np.random.default_rng(1).normal(size=(2, 20))
    slopes = np.array([values(g, y) for g in gradient(V)]) / SIZE
    expected = np.sum(slopes * drift(SIZE * y), axis=0)
    np.testing.assert_allclose(values(lie_derivative(V), y), expected)
    near = 1e-4 * y / SIZE
    np.testing.assert_allclose(
        values(lie_derivative(V), near), -np.sum((SIZE * near) ** 2, axis=0), rtol=1e-5
    )


def test_the_true_region_is_known():
    """13.722, as in the funnel notes; the cycle's amplitude is 2.0086."""
    assert true_area() == pytest.approx(13.722, abs=0.001)
    assert np.max(np.abs(limit_cycle()[0])) == pytest.approx(2.0086, abs=1e-4)


def test_the_articles_level_is_reached_and_proved(ellipse):
    level, region = ellipse
    assert level == pytest.approx(2.3045, abs=0.0005)
    assert area(region.polynomial) / true_area() == pytest.approx(0.472, abs=0.001)
    x = boundary(region.polynomial)
    expected = 1.5 * x[0] ** 2 - x[0] * x[1] + x[1] ** 2
    np.testing.assert_allclose(expected, level, rtol=2e-3)


def test_a_level_is_the_most_that_a_multiplier_proves(ellipse):
    V = lyapunov_function() / ellipse[0]
    margin, L, _ = find_multiplier(V / 0.9, 1)
    assert margin > 1e-5
    level = find_level(V / 0.9, L, 1)
    assert 1.001 < level < 1.0 / 0.9 + 1e-6
    margin, _, _ = find_multiplier(V / 1.01, 1)
    assert margin < 0.0  # Not even by another one.


def test_rounds_of_degree_four_enlarge_the_region(ellipse):
    start = start_of_degree(4, lyapunov_function() / ellipse[0])
    sizes = [area(start)]
    region = certify(grow(start, 2, 2, lambda k, size: sizes.append(size)), 2)
    assert sizes[0] < sizes[1] < sizes[2]
    assert sizes[2] > 0.55 * true_area()
    assert area(region.polynomial) > 0.99 * sizes[2]
    assert not is_proved(dataclasses.replace(region, positive=-region.positive))
    # The whole limit cycle lies outside, as it must.
    assert np.min(values(region.polynomial, limit_cycle() / SIZE)) > 1.0


@pytest.mark.parametrize("name", ["polynomial", "multiplier", "decrease"])
def test_a_false_proof_is_refused(ellipse, name):
    _, region = ellipse
    assert is_proved(region)
    other = getattr(region, name) * (0.99 if name == "polynomial" else -1.0)
    spoiled = dataclasses.replace(region, **{name: other})
    assert not is_proved(spoiled)


def test_a_multiplier_that_is_no_sum_of_squares_is_refused(ellipse):
    """Where nothing else is wrong: the rest has room for so little a change."""
    V, squares = 2.0 * ellipse[1].polynomial, Squares(2)
    _, L, decrease = find_multiplier(V, 2)
    region = dataclasses.replace(
        ellipse[1], polynomial=V, positive=find_positive(V), half=2
    )
    for excess in (-1e-6, 1e-6):
        odd, even = squares.matrices(L)
        sizes, directions = np.linalg.eigh(even)
        even -= (sizes[0] + excess) * np.outer(directions[:, 0], directions[:, 0])
        multiplier = np.concatenate([m[np.tril_indices(len(m))] for m in (odd, even)])
        claimed = dataclasses.replace(region, multiplier=multiplier, decrease=decrease)
        assert is_proved(claimed) == (excess < 0.0)


def test_a_region_beyond_the_limit_cycle_is_refused(ellipse):
    """Whatever a solver says of it."""
    V = 0.9 * ellipse[1].polynomial
    _, L, decrease = find_multiplier(V, 2)
    claimed = dataclasses.replace(
        ellipse[1], polynomial=V, multiplier=L, decrease=decrease, half=2
    )
    assert not is_proved(claimed)
