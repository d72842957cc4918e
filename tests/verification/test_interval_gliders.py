"""Between two times, what is proven of one glider is proven of all of a set."""

import dataclasses

import numpy as np
import pytest
from scipy.interpolate import CubicHermiteSpline

from glider import effects
from glider.paths import models_path
from glider.physics.confidence import ConfidenceSet, glider_at
from glider.physics.covariance import Covariance
from glider.physics.effects import KINDS
from glider.physics.model import GliderModel
from glider.physics.servo import STOPPING_TIME
from glider.physics.state import ELEVATOR
from glider.verification.dynamics.moving_center import make_moving_center
from glider.verification.dynamics.nominal import (
    ORDER,
    nonlinear_parts,
    open_loop_rates,
    table_of,
)
from glider.verification.dynamics.numbers import monomials
from glider.verification.funnel.funnel import load_funnel
from glider.verification.proof.enclosure import make_remainder
from glider.verification.proof.interval import (
    _centers_reach,
    acts_elsewhere,
    gliders_defect,
    keeps_servo,
    make_interval,
    tight_cover,
)
from glider.verification.proof.interval_proof import prove_interval
from glider.verification.sos.exact import exact
from tests.verification.points import center_at, of_one

AT = 120


@pytest.fixture(scope="module")
def funnel():
    return load_funnel(models_path("funnels", "head_wind_95.npz"))


def of_set(funnel, share=1.0):
    """The piece of an interval, for a set that many times as wide."""
    known = funnel.gliders.confidence.covariance
    known = Covariance(names=known.names, matrix=share**2 * known.matrix)
    wide = ConfidenceSet(covariance=known)
    gliders = make_moving_center(funnel.nominal, wide)
    return dataclasses.replace(funnel, gliders=gliders).between(AT, AT + 1)


def true_parts(piece, basis, points):
    """R / β (r, B) and the defect of the linear rates (n - r, B) at points (d, B).

    Straight from f(x₀ + X δ + y, u₀ - K X δ + y; c₀ + δ) - ẋ₀ - Ẋ δ - P(y), each with
    its own glider and at its own time.
    """
    nominal, n, center = piece.nominal, piece.num_states, piece.gliders
    which, rows = nonlinear_parts(nominal.model)
    m, (start, stop) = len(basis), nominal.times
    path = nominal.path
    shift = CubicHermiteSpline(center.times, center.shifts, center.slopes)
    P = nominal.open_loop[:, rows]
    P[..., 0] = 0.0
    ratios, defects = [], []
    for point in points.T:
        share = 0.5 * (1.0 + point[-1])
        t = start + share * (stop - start)
        delta = center.confidence.factor @ point[m:-1]
        y = np.zeros(n + 1)
        y[which] = basis @ point[:m]
        K = (1.0 - share) * nominal.gains[0] + share * nominal.gains[1]
        u0 = (1.0 - share) * nominal.inputs[0] + share * nominal.inputs[1]
        moved = shift(t) @ delta
        glider = glider_at(nominal.model, center.confidence.names, delta)
        states = list(path(t) + moved + y[:-1])
        rates = np.array(open_loop_rates(glider, states, u0 - K @ moved + y[-1]))
        ends = P @ table_of(n + 1).values(y[None])[0]
        model = (1.0 - share) * ends[0] + share * ends[1]
        beta = (1.0 - share) * piece.beta[0] + share * piece.beta[1]
        drift = path(t, 1) + shift(t, 1) @ delta
        ratios.append((rates - drift)[rows] - model)
        ratios[-1] = np.abs(ratios[-1]) / beta[rows]
        at_center = [*(path(t) + moved), u0 - K @ moved]
        own = np.array(open_loop_rates(glider, at_center[:-1], at_center[-1]))
        defects.append(np.delete(np.abs(own - drift), rows))
    return np.array(ratios).T, np.array(defects).T


@pytest.mark.parametrize(("share", "size"), [(1.0, 0.03), (20.0, 0.3)])
def test_no_remainder_of_a_glider_is_larger_than_its_bound(funnel, share, size):
    piece, rng = of_set(funnel, share), np.random.default_rng(1)
    remainder = make_remainder(piece, tight_cover(make_interval(piece))[0])
    m, d, count, tries = len(remainder.basis), remainder.dimension, 6, 30
    assert d == m + 3
    center = rng.normal(size=(d, count))
    for ball in remainder.balls:
        center[ball] *= 0.9 / np.linalg.norm(center[ball], axis=0)
    center[-1] = rng.uniform(-0.7, 0.7, count)
    half = size * rng.uniform(0.3, 1.0, (d, count))
    bounds, reached, _ = remainder.bounds(center, half)
    w = center + half * rng.uniform(-1.0, 1.0, (tries, d, 1))
    points = np.moveaxis(w, 1, 0).reshape(d, -1)
    found, _ = true_parts(piece, remainder.basis, points)
    inside = np.linalg.norm(points[:m], axis=0) <= 1.0
    largest = np.where(inside, found, 0.0).reshape(-1, tries, count).max(axis=1)
    assert np.all(largest <= bounds)
    assert np.all(reached <= bounds)
    if size == 0.03:
        assert np.median(bounds / largest) < 1.6


def test_centers_reach_and_lack_no_more_than_their_bounds(funnel):
    piece, rng = of_set(funnel, 3.0), np.random.default_rng(2)
    allowed, (start, stop) = piece.gliders.confidence, piece.nominal.times
    v = rng.normal(size=(400, 2))
    deltas = allowed.on_boundary(v)
    times = rng.uniform(start, stop, 400)
    share = (times - start) / (stop - start)
    K = (1.0 - share)[:, None] * piece.nominal.gains[0]
    K = K + share[:, None] * piece.nominal.gains[1]
    moved = center_at(piece.gliders, times, deltas)
    commands = -np.sum(K * moved, axis=1)
    travels = moved[:, ELEVATOR] + STOPPING_TIME * commands
    bounds = _centers_reach(piece, exact(stop) - exact(start))
    for bound, along in zip(bounds, (commands, travels), strict=True):
        assert 0.95 * bound < np.abs(along).max() <= bound

    basis = tight_cover(make_interval(piece))[0]
    w = np.linalg.lstsq(allowed.factor, deltas.T, rcond=None)[0]
    s = 2.0 * (times - start) / (stop - start) - 1.0
    points = np.vstack([np.zeros((len(basis), 400)), w, s])
    _, defects = true_parts(piece, basis, points)
    bounds = gliders_defect(piece)
    assert np.all(defects.max(axis=1) <= bounds[:4] + 1e-6)  # The nominal has its own.

    # Polynomials of degree 3 in (v, s) lack the centers' last terms, no more.
    remainder = make_remainder(piece, basis)
    inputs = monomials(remainder.dimension, ORDER).values(points.T) @ remainder.inputs.T
    centers = piece.nominal.path(times)
    moved = [center_at(piece.gliders, t, d) for t, d in zip(times, deltas, strict=True)]
    lacks = np.abs(inputs[:, :-1] - centers - moved).max(axis=0)
    assert np.all(lacks <= remainder.beyond[:-1] + 1e-13)
    assert lacks.max() > 1e-9
    alone = of_one(piece)
    assert not gliders_defect(alone).any()
    assert bounds[3] > 0.0 and not bounds[4:].any()


@pytest.mark.nightly
def test_an_interval_is_proven_of_a_set_and_not_of_a_wider_one(funnel):
    own = prove_interval(of_set(funnel))
    assert own.proven
    alone = prove_interval(of_one(of_set(funnel)))
    assert alone.proven and alone.boxes < own.boxes
    assert prove_interval(of_set(funnel, 300.0)).fault.startswith("the servo would")


@pytest.mark.nightly
def test_a_set_may_be_too_wide_for_the_remainder_alone(funnel):
    wide = of_set(funnel, 20.0)
    assert keeps_servo(make_interval(wide))
    proof = prove_interval(wide)
    assert "the remainder is" in proof.fault and proof.ratio > 1.0


def test_a_number_on_which_a_linear_rate_depends_is_seen():
    lag = KINDS["servo_lag"]
    coefficients = {c.name: c.scale for c in lag.coefficients}
    model = GliderModel(effects=(lag(**coefficients),))
    names = tuple(f"servo_lag.{name}" for name in coefficients)
    rows = nonlinear_parts(model)[1]
    assert set(rows) < set(nonlinear_parts(model, names)[1])
    assert rows == nonlinear_parts(model, ("mass",))[1]


@effects.scalar
def _offset(rate, by):
    return rate + by


@effects.scalar
def _buoyancy(flow, slope):
    return slope * flow.z


def _effect(kind, stage, adds_to, formula, name, words):
    number = effects.Coefficient(name=name, unit="-", scale=0.1, lower=-1.0, upper=1.0)
    return effects.EffectKind(
        kind=kind,
        stage=stage,
        adds_to=adds_to,
        coefficients=(number,),
        formula=formula,
        words=words,
        depends_on=(),
    )


OFFSET = _effect("rate_offset", "actuator", (), _offset, "by", "a rate that is off")
BUOYANCY = _effect(
    "buoyancy", "wrench", ("force_z",), _buoyancy, "slope", "a force by height"
)


@pytest.mark.parametrize(
    ("effect", "name", "unproven"),
    [
        (OFFSET(by=0.1), "rate_offset.by", True),
        (BUOYANCY(slope=0.1), "buoyancy.slope", False),
        (OFFSET(by=0.1), "wing_area", False),
    ],
)
def test_a_number_that_acts_where_the_remainder_does_not_is_seen(
    funnel, effect, name, unproven
):
    """As added to a linear rate; a force by height is rotated, and so is in R."""
    model = GliderModel(effects=(effect,))
    known = Covariance(names=(name,), matrix=np.array([[1e-12]]))
    nominal = dataclasses.replace(funnel.nominal, model=model)
    gliders = make_moving_center(nominal, ConfidenceSet(covariance=known))
    piece = dataclasses.replace(funnel, nominal=nominal, gliders=gliders)
    piece = piece.between(AT, AT + 1)
    assert bool(acts_elsewhere(piece)) == unproven
    if unproven:
        assert "deviates" in prove_interval(piece).fault
