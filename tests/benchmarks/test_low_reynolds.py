"""A glider that is shipped is what its module makes, and no weights over angles are."""

import numpy as np

from benchmarks.low_reynolds import low_reynolds_coefficients, low_reynolds_residual
from glider.physics.effects.free_functions import COEFFICIENTS
from glider.physics.model import GliderModel
from residual_coefficients import features, gaussian_grid, residual_at

TRUTH = GliderModel.load("low_reynolds")


def test_the_shipped_truth_is_what_its_module_fits():
    found = low_reynolds_residual(TRUTH.parameters)
    [planted] = TRUTH.free_functions
    np.testing.assert_allclose(planted.centers, found.centers)
    weights = np.array([planted.weights[name] for name in COEFFICIENTS]).T
    assert weights.shape == (126, 3)
    np.testing.assert_allclose(weights, found.weights, rtol=1e-4, atol=1e-6)


def test_the_truth_follows_its_effect_and_no_field_without_airspeed_can():
    rng = np.random.default_rng(0)
    alpha, elevator = rng.uniform(0.0, 1.5, 4000), rng.uniform(-0.3, 0.9, 4000)
    speed = rng.uniform(1.5, 7.5, 4000)
    wanted = low_reynolds_coefficients(alpha, elevator, speed, TRUTH.parameters)
    values = np.column_stack([alpha, elevator, speed])
    residual = low_reynolds_residual(TRUTH.parameters)
    left = np.std(wanted - residual_at(residual, values), axis=0)
    grid = gaussian_grid()
    blind = features(values[:, :2], grid.centers, grid.widths)
    best, *_ = np.linalg.lstsq(blind, wanted, rcond=None)
    assert np.all(left < 0.25 * np.std(wanted, axis=0))
    assert np.all(np.std(wanted - blind @ best, axis=0) > 1.8 * left)
