"""Curves that no formula has: what a simple formula says is left to it."""

import numpy as np
import pytest

from glider.physics.effects.field import FIELD_TERMS, gaussians, make_field
from glider.sysid.likelihood.curves import TERMS, make_curves
from tests.helpers.tasks import fly, task_of

SHAPES = {
    "constant drag": lambda s, c: {"c_drag": 1.0 + 0.0 * s},
    "camber": lambda s, c: {"c_lift": c * c, "c_drag": s * c},
    "more area": lambda s, c: {"c_lift": s * c, "c_drag": s * s},
    "axial drag": lambda s, c: {"c_lift": -s, "c_drag": c},
    "constant moment": lambda s, c: {"c_moment": 1.0 + 0.0 * s},
    "shifted center of pressure": lambda s, c: {"c_moment": s},
    "larger elevator": lambda s, c: {"elevator_factor": 1.0 + 0.0 * s},
}
OTHERS = {
    "drag of stall": lambda s, c: {"c_drag": (2.0 * s * c) ** 2},
    "lift of stall": lambda s, c: {"c_lift": np.exp(-(((s - 0.3) / 0.1) ** 2))},
    "bump of moment": lambda s, c: {"c_moment": np.exp(-(((s - 0.4) / 0.1) ** 2))},
    "wake on the tail": lambda s, c: {"elevator_factor": s * s},
}


@pytest.fixture(scope="module")
def curves():
    task, _ = task_of(fly(flights=4))
    return make_curves(task.records, task.vehicle.theta)


def shape_at(alpha, shape):
    parts = shape(np.sin(alpha), np.cos(alpha))
    return np.stack([parts.get(term, 0.0 * alpha) for term in TERMS], axis=1)


def explained(curves, shape):
    """Returns the share of a shape that the curves can say."""
    alpha = curves.angles
    values = [curves.values(unit, alpha).ravel() for unit in np.eye(curves.count)]
    wanted = shape_at(alpha, shape).ravel()
    table = np.array(values).T
    found = table @ np.linalg.lstsq(table, wanted, rcond=1e-9)[0]
    return found @ found / (wanted @ wanted)


@pytest.mark.parametrize("name", SHAPES)
def test_what_a_simple_formula_says_has_no_coordinates(curves, name):
    assert explained(curves, SHAPES[name]) < 1e-9


@pytest.mark.parametrize("name", OTHERS)
def test_other_shapes_are_theirs(curves, name):
    assert explained(curves, OTHERS[name]) > 0.1


def test_the_field_in_a_model_file_has_the_curves_values(curves):
    coordinates = np.random.default_rng(0).normal(size=curves.count)
    alpha = np.linspace(curves.centers[0], curves.centers[-1], 31)
    expected = curves.values(coordinates, alpha)
    assert np.all(np.abs(expected).max(axis=0) > 1e-4)
    for field in (make_field(curves.data(coordinates)), curves.field(coordinates)):
        column = [FIELD_TERMS.index(term) for term in TERMS]
        variable = int(np.flatnonzero(field.inverse_widths[0])[0])
        values = gaussians(field, [variable], alpha[:, None]) @ field.weights
        np.testing.assert_allclose(values[:, column], expected, atol=1e-12)
        others = [k for k in range(len(FIELD_TERMS)) if k not in column]
        assert np.all(values[:, others] == 0.0)


def test_curves_of_nothing_are_no_field(curves):
    assert len(curves.field(np.zeros(curves.count)).weights) == 0
