"""Errors that hold though flights differ, and no glider is exactly a formula."""

import dataclasses

import numpy as np
import pytest

from glider.physics.confidence import ConfidenceSet
from glider.physics.covariance import Covariance
from glider.physics.effects import KINDS
from glider.sysid.constants import Z
from glider.sysid.likelihood.information import solve
from glider.sysid.likelihood.uncertainty import (
    Uncertainty,
    averaged,
    jackknife,
    larger_of,
)
from tests.helpers.linear_campaigns import LinearCampaigns
from tests.helpers.tasks import fit_kinds, fly

CD0 = 0.05
DRAG = KINDS["profile_drag"](cd0=CD0)


@pytest.fixture(scope="module")
def exact():
    """Flights of a drag that is exactly the library's, and their fit."""
    return fit_kinds(fly(DRAG, flights=6), "profile_drag")


def stds_of(grams, precision=(0.0, 0.0)):
    matrix, _ = larger_of(*jackknife(grams, np.array(precision)))
    return np.sqrt(np.diag(matrix))


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
    std = stds_of(grams)
    np.testing.assert_allclose(std, 1.0 / np.sqrt(200 * 30), rtol=0.15)


def test_what_differs_from_flight_to_flight_widens_the_errors():
    grams = flights_of(np.random.default_rng(0), own=0.5)
    std = stds_of(grams)
    assert std[0] == pytest.approx(0.5 / np.sqrt(200), rel=0.2)
    assert std[1] == pytest.approx(1.0 / np.sqrt(200 * 30), rel=0.3)


def test_what_is_known_beforehand_narrows_them():
    grams = flights_of(np.random.default_rng(0), own=0.0)
    std = stds_of(grams, np.array([1e9, 0.0]))
    assert std[0] < 1e-4
    assert std[1] == pytest.approx(1.0 / np.sqrt(200 * 30), rel=0.15)


def test_the_larger_of_both_in_every_direction():
    """Not in each coefficient only: a direction may vary that no axis shows."""
    draws = LinearCampaigns(flights=20, coefficients=3, correlation=0.9, variation=3.0)
    _, grams = draws.draw(np.random.default_rng(0))
    likelihood, changes = jackknife(grams, np.zeros(3))
    matrix, freedom = larger_of(likelihood, changes)
    scatter = changes.T @ changes
    for smaller in (likelihood, scatter):
        size = np.sqrt(np.outer(np.diag(matrix), np.diag(matrix)))
        assert np.linalg.eigvalsh((matrix - smaller) / size).min() > -1e-9
    along = np.random.default_rng(1).normal(size=(50, 3))
    variance = np.einsum("ai,ij,aj->a", along, matrix, along)
    for smaller in (likelihood, scatter):
        own = np.einsum("ai,ij,aj->a", along, smaller, along)
        assert np.all(variance >= own - 1e-12)
    assert 3 <= freedom < 40.0


def test_what_one_flight_alone_shows_does_not_leave_its_prior():
    """Without it the rest says nothing, and a linearization would say anything."""
    grams = np.tile([[1e-6, 0.0], [0.0, 30.0]], (6, 1, 1))
    grams[0] = [[1e4, 300.0], [300.0, 40.0]]
    [std] = stds_of(grams, [0.01])
    assert 10.0 < std < Z / np.sqrt(0.01)


def freedom_of(campaigns, rng):
    _, grams = campaigns.draw(rng)
    return larger_of(*jackknife(grams, np.zeros(3)))[1]


def test_exact_information_has_many_degrees_of_freedom():
    """Flights that scatter as the likelihood says add nothing to be estimated."""
    draws = LinearCampaigns(flights=20, coefficients=3, correlation=0.9)
    rng = np.random.default_rng(0)
    still = [freedom_of(draws, rng) for _ in range(9)]
    assert np.median(still) > 40.0
    uneven = LinearCampaigns(
        flights=20, coefficients=3, correlation=0.9, variation=10.0, leverage=0.7
    )
    few = [freedom_of(uneven, rng) for _ in range(9)]
    assert np.median(few) < 15.0


@pytest.mark.parametrize("variation", [0.0, 1.0, 10.0])
@pytest.mark.parametrize(("count", "flights"), [(2, 20), (5, 20), (8, 40)])
def test_the_joint_set_holds_correlated_coefficients(count, flights, variation):
    """See benchmarks/bench_coverage.py; once 44 to 62 % where they vary."""
    draws = LinearCampaigns(
        flights=flights, coefficients=count, correlation=0.9, variation=variation
    )
    rng = np.random.default_rng(0)
    names = tuple(f"wind.{i}" for i in range(count))
    joint, each = [], []
    for _ in range(150):
        error, grams = draws.draw(rng)
        matrix, freedom = larger_of(*jackknife(grams, np.zeros(count)))
        known = Covariance(names=names, matrix=matrix, degrees_of_freedom=freedom)
        joint.append(ConfidenceSet(covariance=known).holds(error))
        half = ConfidenceSet(
            covariance=dataclasses.replace(
                known, names=names[:1], matrix=matrix[:1, :1]
            )
        )
        each.append(half.holds(error[:1]))
    assert np.mean(joint) > 0.9  # Of 95 %, 2.8 standard errors less.
    assert np.mean(each) > 0.9


def test_sets_that_are_nearly_as_likely_add_what_they_differ_by(exact):
    """Total variance: of a drag that is 0.05 ± 0.001, and absent in one set of five."""
    task, model = exact
    slots = task.space.slots_of("profile_drag")

    def alternative(probability, theta, stds):
        known = Uncertainty(
            free=slots if stds else (),
            named=slots if stds else (),
            places={},
            likelihood=np.diag(np.square(stds)),
            changes=np.zeros((5, len(stds))),
        )
        return probability, dataclasses.replace(model, theta=theta), known

    there = model.theta.copy()
    there[list(slots)] = 0.05
    first = alternative(0.8, there, [0.001] * len(slots))
    absent = alternative(0.2, task.vehicle.theta, [])
    known = averaged(*zip(first, absent, strict=True))
    variance = 0.8 * 0.001**2 + 0.2 * 0.05**2
    assert known.std(slots[0]) == pytest.approx(np.sqrt(variance))
    alone = averaged([1.0], *([own] for own in first[1:]))
    assert alone.std(slots[0]) == pytest.approx(0.001)
    other = there.copy()
    other[list(slots)] = 0.053
    rival = alternative(0.2, other, [0.002] * len(slots))
    variance = 0.8 * 0.001**2 + 0.2 * (0.002**2 + 0.003**2)
    found = averaged(*zip(first, rival, strict=True)).std(slots[0])
    assert found == pytest.approx(np.sqrt(variance))
