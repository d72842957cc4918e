"""Steps within bounds are the best ones."""

import numpy as np
import pytest
from scipy.optimize import lsq_linear

from glider.sysid.likelihood.information import bounded_step, solve


def test_bounds_hold_and_the_others_adjust():
    rng = np.random.default_rng(0)
    table = rng.normal(size=(50, 4))
    information = table.T @ table
    free = solve(information)
    limit = free[0] - 0.1
    upper = np.array([limit, np.inf, np.inf])
    step = bounded_step(information, np.full(3, -np.inf), upper)
    assert step[0] == limit
    rest = np.linalg.lstsq(table[:, 1:3], table[:, 3] - limit * table[:, 0], rcond=None)
    np.testing.assert_allclose(step[1:], rest[0], rtol=1e-6)


def test_a_coefficient_leaves_the_bound_that_it_only_passed():
    """The optimum (2, 1.2) is beyond both upper bounds, but only one holds."""
    hessian = np.array([[1.0, -0.95], [-0.95, 1.0]])
    information = np.zeros((3, 3))
    information[:2, :2], information[:2, 2] = hessian, hessian @ [2.0, 1.2]
    step = bounded_step(information, -np.ones(2), np.ones(2))
    np.testing.assert_allclose(step, [1.0, 0.25], rtol=1e-9)


@pytest.mark.parametrize("size", range(1, 9))
def test_no_change_within_the_bounds_is_better(size):
    """Of columns of any units, alike or the same, as SciPy solves them."""
    rng = np.random.default_rng(size)
    for _ in range(60):
        table = rng.normal(size=(size + 4, size + 1))
        if size > 1 and rng.random() < 0.7:
            table[:, 1] = table[:, 0] + rng.choice([0.0, 0.01, 0.3]) * table[:, 1]
        table[:, :-1] *= 10.0 ** rng.uniform(-4.0, 4.0, size)
        norms = np.linalg.norm(table[:, :-1], axis=0)
        lower, upper = -rng.uniform(0.01, 1.0, size), rng.uniform(0.01, 1.0, size)
        lower[rng.random(size) < 0.2] = -np.inf
        best = lsq_linear(
            table[:, :-1] / norms, table[:, -1], (lower, upper), tol=1e-14
        )
        step = bounded_step(table.T @ table, lower / norms, upper / norms)
        assert np.all(step >= lower / norms) and np.all(step <= upper / norms)
        left = table @ np.append(step, -1.0)
        assert 0.5 * left @ left <= best.cost * (1.0 + 1e-6)


def test_without_information_on_a_coefficient_the_step_is_finite():
    information = np.zeros((3, 3))
    information[0, 0], information[0, 2] = 4.0, 8.0
    step = bounded_step(information, -np.ones(2), np.ones(2))
    np.testing.assert_allclose(step, [1.0, 0.0], atol=1e-9)


def test_what_diverges_is_no_number():
    information = np.full((3, 3), np.nan)
    assert np.all(np.isnan(bounded_step(information, -np.ones(2), np.ones(2))))
