"""Random points of spheres, for tests."""

import numpy as np

from glider.verification.sos.sphere import normalized


def sphere_points(count, n, seed=0):
    """Returns points (count, n) of the unit sphere."""
    return normalized(np.random.default_rng(seed).normal(size=(count, n)))


def sphere_values(tables, coefficients, z):
    """Returns the values (B,) of a polynomial (C,) at points z (B, n) of the sphere."""
    exponents = np.array(tables.cubic + tables.quartic)
    return np.prod(z[:, None] ** exponents, axis=2) @ coefficients
