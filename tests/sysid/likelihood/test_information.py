"""Steps within bounds, and standard errors that own up to scatter over flights."""

import numpy as np
import pytest

from glider.sysid.likelihood.information import bounded_step, covariance, solve


def test_bounds_hold_and_the_others_adjust():
    rng = np.random.default_rng(0)
    table = rng.normal(size=(50, 4))
    information = table.T @ table
    free = solve(information)
    limit = free[0] - 0.1
    upper = np.array([limit, np.inf, np.inf])
    step = bounded_step(information, np.full(3, -np.inf), upper)
    assert step[0] == pytest.approx(limit)
    rest = np.linalg.lstsq(table[:, 1:3], table[:, 3] - limit * table[:, 0], rcond=None)
    np.testing.assert_allclose(step[1:], rest[0], rtol=1e-6)


def flights_of(rng, own, flights=200, rows=30):
    """Two columns; the first coefficient differs by `own` from flight to flight."""
    x = rng.normal(size=(flights, rows, 2))
    y = rng.normal(size=(flights, rows))
    y += own * rng.normal(size=flights)[:, None] * x[:, :, 0]
    table = np.concatenate([x, y[:, :, None]], axis=2)
    grams = np.einsum("fni,fnj->fij", table, table)
    step = solve(grams.sum(axis=0))
    shift = np.eye(3)
    shift[:2, 2] = -step  # The error there.
    return np.einsum("ij,fik,kl->fjl", shift, grams, shift)


def test_independent_errors_have_the_classical_errors():
    grams = flights_of(np.random.default_rng(0), own=0.0)
    std = np.sqrt(np.diag(covariance(grams)))
    np.testing.assert_allclose(std, 1.0 / np.sqrt(200 * 30), rtol=0.15)


def test_what_differs_from_flight_to_flight_widens_the_errors():
    grams = flights_of(np.random.default_rng(0), own=0.5)
    std = np.sqrt(np.diag(covariance(grams)))
    assert std[0] == pytest.approx(0.5 / np.sqrt(200), rel=0.2)
    assert std[1] == pytest.approx(1.0 / np.sqrt(200 * 30), rel=0.3)


def test_what_is_known_beforehand_narrows_them():
    grams = flights_of(np.random.default_rng(0), own=0.0)
    found = covariance(grams, np.array([1e9, 0.0]))
    assert np.sqrt(found[0, 0]) < 1e-4
    assert np.sqrt(found[1, 1]) == pytest.approx(1.0 / np.sqrt(200 * 30), rel=0.15)


def test_errors_cover_where_flights_are_few_for_the_coefficients():
    """Twelve flights with slopes of their own, nine coefficients: 90 to 99 %."""
    rng = np.random.default_rng(0)
    covered = []
    for _ in range(400):
        x = rng.normal(size=(12, 20, 9)) * np.exp(0.5 * rng.normal(size=(12, 1, 9)))
        own = 0.5 * rng.normal(size=(12, 1, 9))
        y = rng.normal(size=(12, 20)) + np.sum(own * x, axis=2)
        table = np.concatenate([x, y[:, :, None]], axis=2)
        grams = np.einsum("fni,fnj->fij", table, table)
        step = solve(grams.sum(axis=0))
        shift = np.eye(10)
        shift[:9, 9] = -step
        found = covariance(np.einsum("ai,fab,bj->fij", shift, grams, shift))
        covered.append(np.abs(step) < 1.96 * np.sqrt(np.diag(found)))
    assert 0.9 < np.mean(covered) < 0.99
