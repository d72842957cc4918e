"""Random points of spheres, for tests."""

import dataclasses

import numpy as np

from glider.verification.dynamics.moving_center import make_moving_center
from glider.verification.dynamics.nominal import hermite_path
from glider.verification.dynamics.numbers import exponents_of
from glider.verification.funnel.boundary import boundary_forms
from glider.verification.funnel.remainder import _remainder_of
from glider.verification.sos.sphere import normalized


def sphere_points(count, n, seed=0):
    """Returns points (count, n) of the unit sphere."""
    return normalized(np.random.default_rng(seed).normal(size=(count, n)))


def sphere_values(tables, coefficients, z):
    """Returns the values (B,) of a polynomial (C,) at points z (B, n) of the sphere."""
    exponents = np.concatenate([exponents_of(tables.n, d) for d in (3, 4)])
    return np.prod(z[:, None] ** exponents, axis=2) @ coefficients


def of_one(funnel):
    """Returns a funnel as one of the estimated glider alone."""
    return dataclasses.replace(funnel, gliders=make_moving_center(funnel.nominal))


def forms_of(funnel, **changes):
    """Returns V̇/V on the boundaries of a funnel's sets, some of it changed."""
    made = dataclasses.replace(funnel, **changes)
    return boundary_forms(made, made.nominal.push_slopes)


def without_pushes(funnel):
    """Returns a funnel in which neither command error nor wind acts."""
    none = 0.0 * funnel.errors
    return dataclasses.replace(
        funnel,
        settings=dataclasses.replace(funnel.settings, wind=0.0),
        nominal=dataclasses.replace(funnel.nominal, bends=0.0 * funnel.nominal.bends),
        push_weights=0.0 * funnel.push_weights,
        errors=none,
        rests=none,
    )


def slopes_at(formula, points):
    """Returns ∂/∂x (R, n, B) of a formula's results at points (n, B), complexly."""
    slopes = []
    for axis in range(len(points)):
        moved = points.astype(complex)
        moved[axis] += 1e-30j
        results = formula(*moved)
        slopes.append([np.imag(value) + np.zeros(points.shape[1]) for value in results])
    return np.moveaxis(np.array(slopes), 0, 1) / 1e-30


def center_at(center, times, deviations):
    """Returns X δ (..., n) of a moving center at times (...), for δ (..., m)."""
    X = hermite_path(center.times, center.shifts, center.slopes)(times)
    return np.einsum("...nm,...m->...n", X, deviations)


def remainder_of_one(nominal, at, errors, **given):
    """Returns R (K, B, n) of the nominal's own glider."""
    center = make_moving_center(nominal)
    return _remainder_of(nominal, at, errors, center, errors[..., :0], **given)
