"""Polynomials in time in exact arithmetic are what they say, without rounding."""

from fractions import Fraction

import numpy as np
import pytest
from scipy.interpolate import CubicHermiteSpline

from glider.verification.sos.exact import exact, hermite

STEP = 0.3
SHARES = [Fraction(k, 8) for k in range(9)]


@pytest.fixture(scope="module")
def curves():
    values, slopes = np.random.default_rng(0).normal(size=(2, 2, 3, 3))
    cubic, rise = hermite(values, slopes, exact(STEP))
    return cubic, rise, CubicHermiteSpline([0.0, STEP], values, slopes)


def test_a_cubic_has_its_values_and_slopes(curves):
    cubic, rise, curve = curves
    for share in SHARES:
        time = float(share) * STEP
        assert cubic.at(share).to_float() == pytest.approx(curve(time))
        found = rise.at(share).to_float()
        assert found == pytest.approx(STEP * curve(time, 1))


def test_operations_are_those_of_the_values(curves):
    cubic, rise, _ = curves
    both = cubic @ rise
    added = both + cubic * 3
    high = cubic.raised(7)
    assert (both.degree, added.degree, high.degree) == (5, 5, 7)
    for share in SHARES:
        p, q = (one.at(share).to_float() for one in (cubic, rise))
        assert both.at(share).to_float() == pytest.approx(p @ q)
        assert added.at(share).to_float() == pytest.approx(p @ q + 3.0 * p)
        assert np.array_equal(high.at(share).to_float(), p)  # Exactly.


def test_halves_are_the_same_polynomial_exactly(curves):
    cubic = curves[0]
    for side, half in enumerate(cubic.halves()):
        for share in SHARES:
            whole = cubic.at((share + side) / 2)
            part = half.at(share)
            assert not np.any((whole - part).numbers)


def test_bernsteins_coefficients_hold_the_values(curves):
    cubic = curves[0]
    coefficients = cubic.bernstein()
    values = np.array([cubic.at(share).to_float() for share in SHARES])
    assert np.all(values >= coefficients.min(axis=0) - 1e-12)
    assert np.all(values <= coefficients.max(axis=0) + 1e-12)
    assert coefficients[[0, -1]] == pytest.approx(values[[0, -1]])
