"""The proof of a funnel's remainder: nothing larger is missed, nothing false proven."""

import dataclasses

import numpy as np
import pytest

from glider.paths import models_path
from glider.physics.effects import KINDS
from glider.physics.model import GliderModel
from glider.verification.dynamics.error_dynamics import evaluate, expand
from glider.verification.dynamics.jets import monomials
from glider.verification.funnel.funnel import load_funnel
from glider.verification.funnel.remainder import remainder_of, true_rates
from glider.verification.proof.boxes import (
    RADIUS,
    bound_in_ball,
)
from glider.verification.proof.enclosure import make_remainder
from glider.verification.proof.remainder_proof import (
    RemainderProof,
    TimeProof,
    describe_proof,
    halve,
    prove_at,
    prove_remainder,
    remainder_status,
)

EARLY, LATE = 20, 150
"""Indices of times at which the glider is fast, and slow."""


@pytest.fixture(scope="module")
def funnel():
    """The nominal model's funnel with a remainder, as it ships."""
    return load_funnel(models_path("funnels", "proven", "drawn.npz"))


@pytest.fixture(scope="module")
def coefficients(funnel):
    return expand(funnel.nominal)


def ball(m, count, seed=0):
    """Points of the unit ball, most of them near its boundary."""
    rng = np.random.default_rng(seed)
    w = rng.normal(size=(m, count))
    return w / np.linalg.norm(w, axis=0) * rng.uniform(size=count) ** (1.0 / m)


def random_boxes(m, count, size):
    rng = np.random.default_rng(1)
    center = ball(m, count, seed=2)
    return center, size * rng.uniform(0.3, 1.0, (m, count))


@pytest.mark.parametrize("k", [EARLY, LATE])
@pytest.mark.parametrize("size", [0.03, 0.3])
def test_no_remainder_on_a_box_is_larger_than_its_bound(funnel, coefficients, k, size):
    remainder = make_remainder(funnel.nominal, k, coefficients, funnel.S[k])
    m = remainder.basis.shape[1]
    center, half = random_boxes(m, 40, size)
    bounds, reached, _ = remainder.bounds(center, half)
    v = np.random.default_rng(3).uniform(-1.0, 1.0, (100, m, 1))
    w = np.moveaxis(center + half * v, 1, 2).reshape(-1, m)
    found = remainder_of(
        funnel.nominal, coefficients, [k], (w @ remainder.basis.T)[None]
    )[0]
    found = np.abs(found[:, remainder.rows]).reshape(100, 40, -1)
    inside = np.linalg.norm(w, axis=1).reshape(100, 40, 1) <= 1.0
    largest = np.where(inside, found, 0.0).max(axis=0).T
    assert np.all(largest <= bounds)
    assert np.all(reached <= bounds)
    if size == 0.03:
        some = largest > 0.3 * largest.max(axis=1, keepdims=True)
        assert np.median((bounds / largest)[some]) < 1.6


def test_what_rounding_drops_from_the_coordinates_is_enclosed(funnel, coefficients):
    k, rng = LATE, np.random.default_rng(6)
    remainder = make_remainder(funnel.nominal, k, coefficients, funnel.S[k])
    assert np.all(remainder.dropped[:2] == 0.0)  # No rate depends on the position.
    assert np.all(remainder.dropped[2:] > 0.0)
    assert np.all(remainder.dropped < 1e-11)
    # As if it were a thousandth.
    missing = np.zeros(8)
    missing[2:7] = 1e-3
    wide = dataclasses.replace(remainder, dropped=missing)
    center, half = random_boxes(remainder.basis.shape[1], 40, 0.001)
    bounds, _, _ = wide.bounds(center, half)
    exactly, _, _ = remainder.bounds(center, half)
    errors = center.T @ remainder.basis.T
    found = np.zeros_like(bounds)
    for _ in range(100):
        moved = errors + missing[:7] * rng.choice([-1.0, 1.0], size=errors.shape)
        rates = true_rates(funnel.nominal, np.array([k]), moved[None])[0]
        off = np.abs(rates - evaluate(coefficients[k], errors))[:, remainder.rows].T
        found = np.maximum(found, off)
    assert np.all(found <= bounds)
    assert not np.all(found <= exactly)


def test_the_bound_in_the_ball_is_above_all_values_and_not_far():
    m, count = 3, 200
    table = monomials(m, 3)
    rng = np.random.default_rng(4)
    coefficients = rng.normal(size=(len(table.degrees), count))
    coefficients[4:] *= 0.1
    center, half = random_boxes(m, count, 0.8)
    bounds = bound_in_ball(
        coefficients, np.full(count, 0.1), center, half, table.exponents
    )
    v = rng.uniform(-1.0, 1.0, (4000, m))
    values = np.abs(table.values(v) @ coefficients) + 0.1
    for i in range(count):
        inside = np.linalg.norm(center[:, i] + v * half[:, i], axis=1) <= RADIUS
        largest = values[inside, i].max(initial=0.0)
        assert largest <= bounds[i]
    # Only half of the ball is in this box: the other half does not count.
    far = np.array([[0.9], [0.0], [0.0]]), np.full((m, 1), 0.5)
    slope = np.zeros((len(table.degrees), 1))
    slope[1] = 1.0
    found = bound_in_ball(slope, np.zeros(1), *far, table.exponents)
    assert found[0] == pytest.approx(1.0)  # The lower end, v = -1.
    slope[0] = 1.0
    found = bound_in_ball(slope, np.zeros(1), *far, table.exponents)
    assert found[0] == pytest.approx(1.0 + 0.2, abs=0.02)  # The ball ends at v = 0.2.


@pytest.mark.parametrize("k", [0, EARLY, LATE])
def test_the_shipped_remainder_is_proven(funnel, coefficients, k):
    proof = prove_at(funnel.nominal, k, coefficients, funnel.S[k], funnel.beta[k])
    assert proof.proven
    assert 100 < proof.boxes < 15_000  # Turned as R varies; else ten times more.
    assert 0.5 < proof.ratio < 1.0


def test_a_remainder_that_is_too_small_is_refuted(funnel, coefficients):
    k, beta = EARLY, funnel.beta[EARLY].copy()
    beta[6] *= 0.5
    proof = prove_at(funnel.nominal, k, coefficients, funnel.S[k], beta)
    assert not proof.proven
    assert proof.ratio > 1.0
    beta = 0.85 * funnel.beta[LATE]  # Random points do not find that it is too small.
    proof = prove_at(funnel.nominal, LATE, coefficients, funnel.S[LATE], beta)
    assert proof.ratio > 1.0
    none = prove_at(funnel.nominal, k, coefficients, funnel.S[k], 0.0 * beta)
    assert not none.proven


def test_a_polynomial_that_is_not_the_dynamics_is_refuted(funnel, coefficients):
    wrong = coefficients.copy()
    wrong[EARLY, 6, 40:] *= 1.1
    proof = prove_at(funnel.nominal, EARLY, wrong, funnel.S[EARLY], funnel.beta[EARLY])
    assert not proof.proven


def test_a_search_gives_up_when_its_boxes_are_used(funnel, coefficients):
    proof = prove_at(
        funnel.nominal, 0, coefficients, funnel.S[0], funnel.beta[0], budget=50
    )
    assert not proof.proven
    assert proof.ratio < 1.0


def test_a_proof_ends_where_the_first_time_fails(funnel):
    beta, times = funnel.beta.copy(), funnel.nominal.times[[0, 100, 200]]
    beta[100] *= 0.3
    proof = prove_remainder(dataclasses.replace(funnel, beta=beta), every=100)
    assert list(proof.times) == list(times)
    assert [one.proven for one in proof.at_times] == [True, False, True]
    assert proof.until == times[0]
    assert remainder_status(funnel, proof).endswith("t=0.0000 at 3 of 201 times")
    proof = prove_remainder(funnel, every=100, budget=1)
    assert proof.until is None
    assert remainder_status(funnel, proof) == "sampled"
    good, bad = (TimeProof(proven=p, boxes=3, ratio=0.5) for p in (True, False))
    proof = RemainderProof(times=np.array([0.0, 0.5, 0.8]), at_times=(good, good, bad))
    assert proof.until == 0.5
    assert proof.boxes == 9
    words = describe_proof(funnel, proof)
    assert "until 0.5000 s, and at 2 of the 3 times that were tried, of 201" in words
    proof = RemainderProof(times=np.array([0.0, 0.5]), at_times=(good, good))
    assert "is proven: at 2 of 201 times" in describe_proof(funnel, proof)
    bare = dataclasses.replace(funnel, beta=0.0 * funnel.beta)
    assert "bears no remainder" in describe_proof(bare, proof)


def test_halving_loses_no_point_of_the_ball():
    rng, points = np.random.default_rng(5), ball(3, 2000)
    center, half = np.zeros((3, 1)), np.full((3, 1), RADIUS)
    for _ in range(8):
        blame = rng.uniform(size=center.shape)
        blame[0, ::3] = np.nan  # Unknown: the widest side.
        center, half = halve(center, half, blame)
    inside = np.abs(points[:, :, None] - center[:, None]) <= half[:, None]
    assert np.all(inside.all(axis=0).any(axis=1))
    assert 100 < center.shape[1] < 2**8
    assert np.all(np.maximum(np.abs(center) - half, 0.0) <= 1.0)


def test_what_is_unknown_is_never_bounded():
    table = monomials(3, 3)
    for k in (0, 2, 5, 12):
        coefficients = np.zeros((len(table.degrees), 1))
        coefficients[k] = np.nan
        box = np.zeros((3, 1)), np.ones((3, 1))
        found = bound_in_ball(coefficients, np.zeros(1), *box, table.exponents)
        assert np.isinf(found[0])


@pytest.mark.parametrize(
    "effects",
    [
        (KINDS["wind"](x=-0.6), KINDS["profile_drag"](cd0=0.05)),
        (KINDS["tail_wake"](loss=0.5), KINDS["added_mass"](mass=0.01)),
    ],
    ids=["wind+drag", "wake+mass"],
)
def test_it_bounds_the_remainder_of_gliders_with_effects(funnel, effects):
    model = GliderModel(effects=effects)
    nominal = dataclasses.replace(funnel.nominal, model=model)
    own, S = expand(nominal), 4.0 * funnel.S[LATE]
    remainder = make_remainder(nominal, LATE, own, S)
    center, half = random_boxes(remainder.basis.shape[1], 40, 0.05)
    bounds, _, _ = remainder.bounds(center, half)
    found = remainder_of(nominal, own, [LATE], (center.T @ remainder.basis.T)[None])[0]
    found = np.abs(found[:, remainder.rows]).T
    assert np.isfinite(bounds).mean() > 0.9
    assert np.all(found <= bounds)
    assert found.max() > 1e-3
