"""Random points of spheres, for tests."""

import dataclasses

import numpy as np

from glider.verification import trials
from glider.verification.dynamics.moving_center import make_moving_center
from glider.verification.funnel.remainder import _remainder_of
from glider.verification.sos.sphere import normalized


def sphere_points(count, n, seed=0):
    """Returns points (count, n) of the unit sphere."""
    return normalized(np.random.default_rng(seed).normal(size=(count, n)))


def sphere_values(tables, coefficients, z):
    """Returns the values (B,) of a polynomial (C,) at points z (B, n) of the sphere."""
    exponents = np.array(tables.cubic + tables.quartic)
    return np.prod(z[:, None] ** exponents, axis=2) @ coefficients


def flown_by(funnel, loop, genes):
    """Returns V (B,) of flights with genes: largest, largest later and at the end."""
    found = trials._fly(funnel, loop, 0, genes)
    return found["levels"], found["later"], found["ends"]


def held_flight(funnel, loop, genes):
    """Returns such flights of held commands, launched."""
    states = trials.boundary_states(funnel, 0, genes[:, : funnel.num_states])
    return trials._HeldFlight(funnel, loop, genes, states, np.zeros((len(genes), 0)))


def of_one(funnel):
    """Returns a funnel as one of the estimated glider alone."""
    return dataclasses.replace(funnel, gliders=make_moving_center(funnel.nominal))


def remainder_of_one(nominal, at, errors, **given):
    """Returns R (K, B, n) of the nominal's own glider."""
    center = make_moving_center(nominal)
    return _remainder_of(nominal, at, errors, center, errors[..., :0], **given)
