"""The proof of a funnel's remainder: nothing larger is missed, nothing false proven."""

import dataclasses

import numpy as np
import pytest

from glider.compiled.taylor import ROUNDING
from glider.physics.effects import KINDS
from glider.physics.model import GliderModel
from glider.verification.dynamics.nominal import (
    nonlinear_parts,
    open_loop_rates,
    table_of,
)
from glider.verification.dynamics.numbers import monomials
from glider.verification.proof import interval_proof
from glider.verification.proof.boxes import run_on_boxes, tops_in_balls
from glider.verification.proof.enclosure import make_remainder
from glider.verification.proof.interval import make_interval, tight_cover
from glider.verification.proof.interval_proof import (
    _PATIENCE,
    IntervalProof,
    _prove_remainder,
    bound_remainder,
    halve,
)

EARLY, LATE = 60, 150
"""Indices of intervals in which the glider is fast, and slow."""


@pytest.fixture(scope="module")
def pieces(proven):
    return {k: proven.between(k, k + 1) for k in (0, EARLY, LATE)}


def focused(piece, size=1.0):
    """A piece whose bound is large in some directions, and changes in time."""
    reach = np.sqrt(np.diag(np.linalg.inv(piece.S[0])))
    factor = np.random.default_rng(7).normal(size=(7, 2)) / reach[:, None]
    factor = factor * np.array([1.0, 1.01])[:, None, None]
    factor[..., :2, :] = 0.0
    focus = size * factor @ np.swapaxes(factor, 1, 2)
    beta = piece.beta * [[0.95], [1.0]]
    return dataclasses.replace(piece, focus=focus, beta=beta)


def remainder_on(piece):
    return make_remainder(piece, tight_cover(make_interval(piece))[0])


def ball(m, count, seed=0):
    """Points of the unit ball, most of them near its boundary."""
    rng = np.random.default_rng(seed)
    w = rng.normal(size=(m, count))
    return w / np.linalg.norm(w, axis=0) * rng.uniform(size=count) ** (1.0 / m)


def random_boxes(m, count, size):
    """Boxes of (w, s), of any time."""
    rng = np.random.default_rng(1)
    center = np.vstack([ball(m, count, seed=2), rng.uniform(-0.7, 0.7, (1, count))])
    return center, size * rng.uniform(0.3, 1.0, (m + 1, count))


def true_ratio(piece, basis, points):
    """|R| / (β (1 + eᵀ F e)) (r, B) at points (m + 1, B), straight from its words.

    By the physics: all of f(x₀ + y, u₀ + y) - ẋ₀ - P(y), each at its own time.
    """
    nominal, n = piece.nominal, piece.num_states
    which, rows = nonlinear_parts(nominal.model)
    shares = 0.5 * (1.0 + points[-1])
    path, (start, stop) = nominal.path, nominal.times
    times = start + shares * (stop - start)
    y = np.zeros((n + 1, len(times)))
    y[which] = basis @ points[:-1]
    u0 = (1.0 - shares) * nominal.inputs[0] + shares * nominal.inputs[1]
    states = path(times).T + y[:-1]
    rates = open_loop_rates(nominal.model, list(states), u0 + y[-1])
    P = nominal.open_loop[:, rows]
    P[..., 0] = 0.0
    ends = P @ table_of(n + 1).values(y.T).T  # (2, r, B)
    model = (1.0 - shares) * ends[0] + shares * ends[1]
    beta = piece.beta[:, rows]
    limits = (1.0 - shares) * beta[0][:, None] + shares * beta[1][:, None]
    first, last = np.einsum("ib,tij,jb->tb", y[:-1], piece.focus, y[:-1])
    limits = limits * (1.0 + (1.0 - shares) * first + shares * last)
    found = np.array([rates[row] for row in rows]) - path(times, 1).T[rows] - model
    return np.abs(found) / limits


@pytest.mark.parametrize("k", [EARLY, LATE])
@pytest.mark.parametrize("size", [1e-4, 0.03, 0.3])
@pytest.mark.parametrize("change", [lambda piece: piece, focused])
def test_no_remainder_on_a_box_is_larger_than_its_bound(pieces, k, size, change):
    piece = change(pieces[k])
    remainder = remainder_on(piece)
    m = len(remainder.basis)
    center, half = random_boxes(m, 40, size)
    bounds, reached, _ = remainder.bounds(center, half)
    v = np.random.default_rng(3).uniform(-1.0, 1.0, (100, m + 1, 1))
    w = np.moveaxis(center + half * v, 1, 0).reshape(m + 1, -1)
    found = true_ratio(piece, remainder.basis, w).reshape(-1, 100, 40)
    inside = np.linalg.norm(w[:-1], axis=0).reshape(100, 40) <= 1.0
    largest = np.where(inside, found, 0.0).max(axis=1)
    assert np.all(largest <= bounds)
    assert np.all(reached <= bounds)
    if size == 1e-4:  # Bounds that are 1 % too small are seen.
        some = largest > 0.3 * largest.max(axis=1, keepdims=True)
        assert np.median((bounds / largest)[some]) < 1.005
    if size == 0.03:
        some = largest > 0.3 * largest.max(axis=1, keepdims=True)
        assert np.median((bounds / largest)[some]) < (2.0 if change is focused else 1.6)


def test_bounds_are_no_larger_than_those_of_the_file(pieces):
    """Also in the middle of the time, where both of their factors change much."""
    piece = focused(pieces[EARLY])
    factor = np.array([1.0, 3.0])[:, None, None]
    piece = dataclasses.replace(
        piece, beta=piece.beta * [[0.3], [1.0]], focus=piece.focus * factor
    )
    remainder, rows = remainder_on(piece), nonlinear_parts(piece.nominal.model)[1]
    m, s = len(remainder.basis), np.tile(np.linspace(-1.0, 1.0, 5), 600)
    w = ball(m, len(s))
    found = monomials(m + 1, 3).values(np.vstack([w, s]).T) @ remainder.limits.T
    shares = 0.5 * np.array([1.0 - s, 1.0 + s])
    e = np.zeros((7, len(s)))
    e[2:] = (remainder.basis @ w)[:-1]  # The last is the command.
    bent = np.einsum("ib,tij,jb->tb", e, piece.focus, e)
    allowed = (shares.T @ piece.beta[:, rows]).T * (1.0 + np.sum(shares * bent, axis=0))
    assert np.all(allowed >= found.T)
    assert np.median(found.T / allowed) > 0.5


def test_a_bound_that_is_not_positive_proves_nothing(pieces):
    """Where 1 + eᵀ F e is negative, V̇ would seem to fall, and |R / β| may be small."""
    piece = focused(pieces[LATE], size=-1.0)
    remainder = remainder_on(piece)
    values = monomials(7, 3).values(np.vstack([ball(6, 2000), np.zeros(2000)]).T)
    assert np.any(remainder.limits @ values.T < 0.0)
    center, half = random_boxes(6, 2000, 1e-4)
    bounds, _, _ = remainder.bounds(center, half)
    limits = remainder.limits @ monomials(7, 3).values(center.T).T
    assert np.any(limits < 0.0)
    assert np.all(np.isinf(bounds[limits <= 0.0]))


def test_the_nominals_defect_is_part_of_it(pieces):
    piece = pieces[EARLY]
    states = piece.nominal.states.copy()
    states[1, 4] += 1e-3  # 0.2 m/s² over an interval of 4.4 ms.
    nominal = dataclasses.replace(piece.nominal, states=states)
    bounds, _, _ = remainder_on(dataclasses.replace(piece, nominal=nominal)).bounds(
        np.zeros((7, 1)), np.full((7, 1), 1e-3)
    )
    before, _, _ = remainder_on(piece).bounds(np.zeros((7, 1)), np.full((7, 1), 1e-3))
    assert before.max() < 0.1
    assert bounds[0] > 2.0


def test_what_the_polynomials_lack_is_part_of_it(pieces):
    remainder = remainder_on(pieces[EARLY])
    box = np.zeros((7, 1)), np.full((7, 1), 1e-3)
    before = remainder.bounds(*box)[0]
    beta = pieces[EARLY].beta.max(axis=0)[remainder.rows]
    lacking = dataclasses.replace(remainder, rounding=beta)
    assert np.all(lacking.bounds(*box)[0] > before + 0.9)
    lacking = dataclasses.replace(remainder, beyond=np.full(8, 0.1))
    assert np.all(lacking.bounds(*box)[0] > before + 0.5)


@pytest.mark.parametrize(("terms", "factor"), [(100, 1.0), (900, 3.0)])
def test_the_rounding_of_a_long_sum_is_counted(terms, factor):
    """As many variables as a set of six numbers has, with a wind and an error."""

    class Program:
        def run(self, found, lost):
            return found, lost

    table = monomials(16, 3)
    polynomials = np.zeros((1, len(table.degrees)))
    polynomials[:, :terms] = 1.0
    center, half = np.full((16, 1), 0.5), np.full((16, 1), 0.25)
    found, lost = run_on_boxes(Program(), table, polynomials, np.zeros(1), center, half)
    largest = np.sum(0.75 ** table.degrees[:terms])
    assert found.sum() == pytest.approx(largest)
    assert lost[0, 0] == pytest.approx(factor * ROUNDING * largest)


def top_in_balls(coefficients, remainder, center, half, table, balls):
    """Bounds (B,) of p(v) + remainder on the parts of boxes in unit balls."""
    given = coefficients[None], remainder[None], center, half, balls
    return tops_in_balls(table, *given)[0]


def bound_in_balls(coefficients, *others):
    """The same of |p(v)| + remainder."""
    both = [top_in_balls(c, *others) for c in (coefficients, -coefficients)]
    return np.maximum(*both)


def test_the_bound_in_the_ball_is_above_all_values_and_not_far():
    m, count = 3, 200
    table = monomials(m, 3)
    rng = np.random.default_rng(4)
    coefficients = rng.normal(size=(len(table.degrees), count))
    coefficients[4:] *= 0.1
    center, half = ball(m, count, seed=2), 0.8 * rng.uniform(0.3, 1.0, (m, count))
    bounds = bound_in_balls(
        coefficients, np.full(count, 0.1), center, half, table, [slice(0, m)]
    )
    v = rng.uniform(-1.0, 1.0, (4000, m))
    values = np.abs(table.values(v) @ coefficients) + 0.1
    for i in range(count):
        inside = np.linalg.norm(center[:, i] + v * half[:, i], axis=1) <= 1.0
        largest = values[inside, i].max(initial=0.0)
        assert largest <= bounds[i]
    # Only half of the ball is in this box: the other half does not count.
    far = np.array([[0.9], [0.0], [0.0]]), np.full((m, 1), 0.5)
    slope = np.zeros((len(table.degrees), 1))
    slope[1] = 1.0

    def bound_in(*balls):
        return bound_in_balls(slope, np.zeros(1), *far, table, balls)[0]

    assert bound_in(slice(0, m)) == pytest.approx(1.0)  # The lower end, v = -1.
    slope[0] = 1.0
    # The ball ends at v = 0.2.
    assert bound_in(slice(0, m)) == pytest.approx(1.0 + 0.2, abs=0.02)
    # Time is free of the ball.
    assert bound_in(slice(1, m)) == pytest.approx(2.0)


def test_the_top_in_the_ball_is_above_all_values_and_may_be_negative():
    m, count = 3, 200
    table, rng = monomials(m, 3), np.random.default_rng(6)
    coefficients = 0.02 * rng.normal(size=(len(table.degrees), count))
    coefficients[0] -= 1.0
    center, half = ball(m, count, seed=2), 0.5 * rng.uniform(0.3, 1.0, (m, count))
    boxes = center, half, table, [slice(0, m)]
    tops = top_in_balls(coefficients, np.full(count, 0.1), *boxes)
    values = table.values(rng.uniform(-1.0, 1.0, (4000, m)))
    v = values[:, 1 : m + 1, None]
    inside = np.linalg.norm(center + v * half, axis=1) <= 1.0
    largest = np.where(inside, values @ coefficients, -np.inf).max(axis=0) + 0.1
    assert np.all(largest <= tops)
    assert np.all(tops < 0.0) and np.median(tops - largest) < 0.2


def test_mixed_and_cubic_terms_are_bounded_by_the_ball():
    m, count = 4, 200
    table, rng = monomials(m, 3), np.random.default_rng(8)
    coefficients = rng.normal(size=(len(table.degrees), count))
    coefficients[: 1 + m] *= 0.1
    square = (table.degrees == 2) & (table.exponents.max(axis=1) == 2)
    coefficients[square, ::2] -= 2.0
    center, half = ball(m, count, seed=2), rng.uniform(0.3, 1.0, (m, count))
    center[:, ::4], half[:, ::4] = 0.0, 1.0  # The whole ball.
    boxes = center, half, table, [slice(0, m)]
    tops = top_in_balls(coefficients, np.zeros(count), *boxes)
    v = rng.uniform(-1.0, 1.0, (20_000, m))
    v[::2] /= np.linalg.norm(v[::2], axis=1, keepdims=True)
    values = table.values(v)
    for i in range(count):
        inside = np.linalg.norm(center[:, i] + v * half[:, i], axis=1) <= 1.0 + 1e-12
        assert (values[inside] @ coefficients[:, i]).max(initial=-np.inf) <= tops[i]
    whole = np.zeros((m, 1)), np.ones((m, 1)), *boxes[2:]
    for exponents, most in (
        ([1, 1, 0, 0], 0.5),
        ([1, 1, 1, 0], 1 / 3),
        ([2, 1, 0, 0], 2 / 3),
    ):
        alone = np.zeros((len(table.degrees), 1))
        alone[table.place(exponents)] = -1.0
        found = top_in_balls(alone, np.zeros(1), *whole)[0]
        assert found == pytest.approx(most)


def test_each_of_two_balls_has_a_bound_of_its_own():
    balls = [slice(0, 3), slice(3, 5)]
    table = monomials(6, 3)
    rng = np.random.default_rng(4)
    count, some = 100, len(table.degrees)
    coefficients = np.zeros((some, count))
    coefficients[: 1 + 6] = rng.normal(size=(1 + 6, count))
    coefficients[7:] = 0.05 * rng.normal(size=(some - 7, count))
    center = np.concatenate([ball(3, count, seed=2), ball(2, count, seed=3)])
    center = np.concatenate([center, rng.uniform(-0.5, 0.5, (1, count))])
    half = rng.uniform(0.2, 1.0, (6, count))
    arguments = coefficients, np.zeros(count), center, half, table
    bounds, loose = (bound_in_balls(*arguments, of) for of in (balls, balls[:1]))
    v = rng.uniform(-1.0, 1.0, (20_000, 6))
    values = np.abs(table.values(v) @ coefficients)
    for i in range(count):
        at = center[:, i] + v * half[:, i]
        inside = np.all(
            [np.linalg.norm(at[:, b], axis=1) <= 1.0 for b in balls], axis=0
        )
        assert values[inside, i].max(initial=0.0) <= bounds[i]
    assert np.all(bounds <= loose * (1.0 + 1e-9))
    # Of a slope across a whole ball its length counts, not that of its parts.
    linear, whole = np.zeros((some, 1)), (np.zeros((6, 1)), np.ones((6, 1)))
    linear[1:7, 0] = 1.0
    found = bound_in_balls(linear, np.zeros(1), *whole, table, balls)
    assert found[0] == pytest.approx(np.sqrt(3.0) + np.sqrt(2.0) + 1.0)


@pytest.mark.parametrize("k", [0, EARLY])
def test_the_shipped_remainder_is_proven(pieces, k):
    proof = _prove_remainder(pieces[k], make_interval(pieces[k]))
    assert proof.proven
    assert 100 < proof.boxes < 15_000  # Turned as R varies; else ten times more.
    assert 0.1 < proof.ratio < 1.0


def test_a_remainder_that_is_too_small_is_refuted(pieces):
    def changed(k, factor):
        beta = pieces[k].beta.copy()
        beta[:, 6] *= factor
        return dataclasses.replace(pieces[k], beta=beta)

    proof = bound_remainder(remainder_on(changed(EARLY, 0.5)))
    assert not proof.proven
    assert proof.ratio > 1.0
    # Near its largest value it takes few boxes to find that it is too small.
    proof = bound_remainder(remainder_on(changed(LATE, 0.8)))
    assert not proof.proven
    assert proof.ratio > 1.0 and proof.boxes < 20_000
    assert not bound_remainder(remainder_on(changed(EARLY, 0.0))).proven


def test_a_search_gives_up_when_its_boxes_are_used(pieces):
    proof = bound_remainder(remainder_on(pieces[0]), budget=50)
    assert not proof.proven
    assert proof.ratio < 1.0


def test_an_interval_may_be_proven_in_halves(pieces):
    piece, interval = pieces[EARLY], make_interval(pieces[EARLY])
    whole = _prove_remainder(piece, interval, halvings=0)
    first, second = (
        _prove_remainder(piece, half, halvings=0) for half in interval.halves()
    )
    assert first.proven and second.proven
    assert max(first.ratio, second.ratio) == pytest.approx(whole.ratio, rel=0.1)


@pytest.mark.parametrize("failing", [(-1.0, 0.0), (0.0, 1.0), None])
def test_each_half_has_to_be_bounded(pieces, failing, monkeypatch):
    def bound(remainder, budget):
        fails = remainder.span in ((-1.0, 1.0), failing)
        return IntervalProof(fault="stubborn" if fails else "", boxes=7)

    monkeypatch.setattr(interval_proof, "bound_remainder", bound)
    given = pieces[EARLY], make_interval(pieces[EARLY])
    proof = _prove_remainder(*given, halvings=1)
    assert proof.proven == (failing is None)
    assert proof.boxes == (14 if failing == (-1.0, 0.0) else 21)


def test_a_ball_that_takes_too_many_boxes_leaves_some_for_its_halves(
    pieces, monkeypatch
):
    real = interval_proof.bound_remainder

    def stubborn(remainder, budget):
        if remainder.span == (-1.0, 1.0):
            return IntervalProof(fault="stubborn", boxes=budget, ratio=0.9)
        return real(remainder, budget)

    monkeypatch.setattr(interval_proof, "bound_remainder", stubborn)
    piece = pieces[EARLY]
    proof = _prove_remainder(piece, make_interval(piece))
    assert proof.proven
    assert proof.boxes < 2 * _PATIENCE


def test_halving_loses_no_point_of_the_ball():
    rng, points = np.random.default_rng(5), ball(3, 2000)
    points = np.vstack([points, rng.uniform(-1.0, 1.0, (1, 2000))])
    center, half = np.zeros((4, 1)), np.ones((4, 1))
    for _ in range(8):
        blame = rng.uniform(size=center.shape)
        blame[0, ::3] = np.nan  # Unknown: the widest side.
        center, half, _ = halve(center, half, blame)
    inside = np.abs(points[:, :, None] - center[:, None]) <= half[:, None]
    assert np.all(inside.all(axis=0).any(axis=1))
    assert 100 < center.shape[1] <= 2**8
    assert half.prod(axis=0).sum() < 0.85  # Of the cube.
    assert np.all(np.maximum(np.abs(center) - half, 0.0) <= 1.0)


def test_a_half_is_no_larger_than_what_of_it_is_in_its_balls():
    center, half = np.zeros((4, 1)), np.ones((4, 1))
    blame = np.array([1.0, 0.0, 0.0, 0.0])[:, None]
    for _ in range(2):  # 0 to 1, then 0.5 to 1, of the first coordinate.
        center, half, _ = halve(center, half, blame, (slice(0, 3),))
        center, half = center[:, [-1]], half[:, [-1]]
    rest = np.sqrt(0.75)
    assert center[:, 0] == pytest.approx([0.75, 0.0, 0.0, 0.0])
    assert half[:, 0] == pytest.approx([0.25, rest, rest, 1.0])
    # Off its middle, that of a ball of its own does not count.
    center, half = np.array([[0.7], [0.7], [0.7]]), np.array([[0.3], [0.3], [0.2]])
    center, half, of = halve(center, half, blame[1:], (slice(0, 2), slice(2, 3)))
    assert of.tolist() == [0, 0]
    low, high = center - half, center + half
    assert low[:, 0] == pytest.approx([0.4, 0.4, 0.5])
    assert high[:, 0] == pytest.approx([0.7, np.sqrt(0.84), 0.9])
    assert high[:, 1] == pytest.approx([np.sqrt(0.84), np.sqrt(0.51), 0.9])


class Invented:
    """Bounds of no remainder: large, unknown, or good, by chance, on wide boxes."""

    dimension, balls, span, kept = 4, (slice(0, 3),), (-0.5, 1.0), ()

    def __init__(self):
        self.rng, self.kept = np.random.default_rng(9), []

    def bounds(self, center, half):
        some = [0.9, 1.0, 1.5, 3.0, np.nan, np.inf]
        bounds = self.rng.choice(some, size=(2, center.shape[1]))
        bounds[:, half.prod(axis=0) < 1e-3] = 0.5
        good = np.all(bounds <= 1.0, axis=0)
        self.kept.append(np.concatenate([center, half])[:, good])
        blame = self.rng.uniform(size=(2, *center.shape))
        blame[:, :, ::5] = np.nan
        return bounds, np.zeros_like(bounds), blame


def test_every_point_of_the_ball_is_in_a_box_that_was_bounded():
    invented = Invented()
    assert bound_remainder(invented).proven
    points = np.vstack([ball(3, 3000), np.linspace(-0.5, 1.0, 3000)])
    center, half = np.split(np.concatenate(invented.kept, axis=1), 2)
    inside = np.abs(points[:, :, None] - center[:, None]) <= half[:, None]
    assert np.all(inside.all(axis=0).any(axis=1))
    assert center.shape[1] > 300


def test_what_is_unknown_is_never_bounded():
    table = monomials(3, 3)
    for k in (0, 2, 5, 12):
        coefficients = np.zeros((len(table.degrees), 1))
        coefficients[k] = np.nan
        box = np.zeros((3, 1)), np.ones((3, 1))
        arguments = coefficients, np.zeros(1), *box, table
        for balls in ([slice(0, 3)], [slice(0, 1), slice(1, 2)], []):
            assert np.isinf(bound_in_balls(*arguments, balls)[0])


@pytest.mark.parametrize(
    "effects",
    [
        (KINDS["wind"](x=-0.6), KINDS["profile_drag"](cd0=0.05)),
        (KINDS["tail_wake"](loss=0.5), KINDS["added_mass"](mass=0.01)),
    ],
    ids=["wind+drag", "wake+mass"],
)
def test_it_bounds_the_remainder_of_gliders_with_effects(pieces, effects):
    model = GliderModel(effects=effects)
    nominal = dataclasses.replace(pieces[LATE].nominal, model=model)
    piece = dataclasses.replace(pieces[LATE], nominal=nominal)
    remainder = remainder_on(piece)
    center, half = random_boxes(len(remainder.basis), 40, 0.05)
    bounds, _, _ = remainder.bounds(center, half)
    found = true_ratio(piece, remainder.basis, center)
    assert np.isfinite(bounds).mean() > 0.9
    assert np.all(found <= bounds)
    assert found.max() > 1e-2
