"""Defects of a collocated path and their slopes, beside Drake's."""

import numpy as np
import pytest
from pydrake.autodiffutils import ExtractGradient, InitializeAutoDiff
from pydrake.planning import DirectCollocationConstraint

from glider.planning.path import Path
from glider.systems.plant import GliderPlant
from tests.helpers.flights import LAGGING, NOMINAL

STEP = 0.03


def no_flight(model, knots=6):
    """Returns a path that is no flight."""
    points = 0.3 * np.random.default_rng(0).normal(size=(knots, model.num_states + 1))
    points[:, 4] += 6.0
    return Path(model, STEP * np.arange(knots), points[:, :-1], points[:, -1])


@pytest.mark.parametrize("model", [NOMINAL, LAGGING], ids=["flat", "lag"])
def test_defects_and_their_slopes_are_drake_s(model):
    """Drake multiplies defects by 3 / (2 h), and orders (h, x0, x1, u0, u1)."""
    path = no_flight(model)
    plant = GliderPlant(model)
    constraint = DirectCollocationConstraint(plant, plant.CreateDefaultContext())
    n = model.num_states
    order = np.r_[1 : n + 1, 2 * n + 1, n + 1 : 2 * n + 1, 2 * n + 2, 0]
    slopes = path.defect_slopes()
    for k, defect in enumerate(path.defects):
        first, last = path.knots[k], path.knots[k + 1]
        point = np.concatenate([[STEP], first[:n], last[:n], first[n:], last[n:]])
        theirs = constraint.Eval(InitializeAutoDiff(point)[:, 0])
        values = np.array([value.value() for value in theirs])
        factor = 1.5 / STEP
        np.testing.assert_allclose(defect * factor, values, atol=1e-9)
        gradient = ExtractGradient(theirs)[:, order]
        gradient[:, -1] += values / STEP  # The factor depends on h too.
        np.testing.assert_allclose(slopes[k] * factor, gradient, atol=1e-8)
