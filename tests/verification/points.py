"""Random points of spheres, for tests."""

import dataclasses

import numpy as np

from glider.verification.dynamics.moving_center import make_moving_center
from glider.verification.dynamics.nominal import hermite_path
from glider.verification.funnel.remainder import _remainder_of
from glider.verification.sos.sphere import normalized


def sphere_points(count, n, seed=0):
    """Returns points (count, n) of the unit sphere."""
    return normalized(np.random.default_rng(seed).normal(size=(count, n)))


def sphere_values(tables, coefficients, z):
    """Returns the values (B,) of a polynomial (C,) at points z (B, n) of the sphere."""
    exponents = np.array(tables.cubic + tables.quartic)
    return np.prod(z[:, None] ** exponents, axis=2) @ coefficients


def of_one(funnel):
    """Returns a funnel as one of the estimated glider alone."""
    return dataclasses.replace(funnel, gliders=make_moving_center(funnel.nominal))


def center_at(center, times, deviations):
    """Returns X δ (..., n) of a moving center at times (...), for δ (..., m)."""
    X = hermite_path(center.times, center.shifts, center.slopes)(times)
    return np.einsum("...nm,...m->...n", X, deviations)


def remainder_of_one(nominal, at, errors, **given):
    """Returns R (K, B, n) of the nominal's own glider."""
    center = make_moving_center(nominal)
    return _remainder_of(nominal, at, errors, center, errors[..., :0], **given)
