"""Steps within bounds."""

import numpy as np
import pytest

from glider.sysid.likelihood.information import bounded_step, solve


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
