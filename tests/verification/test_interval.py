"""An interval of a funnel: its polynomials are V̇ and the sets, and halving is exact."""

import dataclasses
from fractions import Fraction

import numpy as np
import pytest

from glider.physics.servo import STOPPING_TIME
from glider.physics.state import ELEVATOR
from glider.verification.dynamics.nominal import open_loop_rates, table_of
from glider.verification.funnel.boundary import growth_forms
from glider.verification.proof import interval_growth
from glider.verification.proof.interval import (
    covers,
    keeps_servo,
    make_interval,
    stays_definite,
    tight_cover,
)
from glider.verification.proof.interval_growth import gram_guesses, prove_growth
from glider.verification.proof.interval_proof import _needed_slack, proven_slack
from glider.verification.sos.exact import exact, in_time, line, rounded
from glider.verification.sos.forms import to_ball
from glider.verification.sos.sphere import sphere
from tests.verification.points import forms_of, sphere_points, sphere_values

K = 60
SLACK = 0.25


@pytest.fixture(scope="module")
def piece(proven):
    return proven.between(K, K + 1)


@pytest.fixture(scope="module")
def interval(piece):
    return make_interval(piece)


def focused(piece):
    """A piece whose bound of the remainder is large in some directions."""
    reach = np.sqrt(np.diag(np.linalg.inv(piece.S[0])))
    factor = np.random.default_rng(7).normal(size=(7, 2)) / reach[:, None]
    factor = factor * np.array([1.0, 1.1])[:, None, None]
    factor[..., :2, :] = 0.0  # R does not depend on the place.
    return dataclasses.replace(piece, focus=factor @ np.swapaxes(factor, 1, 2))


def at(polynomial, share):
    return polynomial.at(Fraction(share)).to_float()


def sets_at(piece, share):
    """S, its slope, K and P at a share of the interval, as the funnel has them."""
    start, stop = piece.nominal.times
    time, share = start + share * (stop - start), float(share)
    ends = [1.0 - share, share]
    gains = ends @ piece.nominal.gains
    rates = np.tensordot(ends, piece.nominal.open_loop, 1)
    rates[:, 0] = 0.0
    return piece.shape(time), piece.curve(time, 1), gains, rates


@pytest.mark.parametrize("share", [0, Fraction(3, 8), 1])
@pytest.mark.parametrize("change", [lambda piece: piece, focused])
def test_the_forms_are_the_growth_of_v_on_the_boundary(piece, change, share):
    piece = change(piece)
    interval = make_interval(piece)
    S, slope, gains, rates = sets_at(piece, share)
    basis = rounded(to_ball(piece.S[0])[1], 30)
    forms = growth_forms(interval, basis, exact(SLACK))
    A, cubic, quartic, G = (at(form, share) for form in forms)
    z = sphere_points(20, 7)
    z /= np.sqrt(np.einsum("bi,ij,bj->b", z, G, z))[:, None]
    tables, e = sphere(7), z @ basis.to_float().T
    coefficients = tables.coefficients(0.0 * A, cubic, quartic)
    found = sphere_values(tables, coefficients, z)
    found += np.einsum("bi,ij,bj->b", z, A, z)
    variables = np.hstack([e, -(e @ gains)[:, None]])
    rates = table_of(8).values(variables) @ rates.T
    growth = np.einsum("bi,ij,bj->b", e, slope, e)
    growth += 2.0 * np.einsum("bi,ij,bj->b", e, S, rates) + SLACK
    ends = [1.0 - float(share), float(share)]
    weights = ends @ piece.weights
    bearing = ends @ np.divide(
        piece.beta**2, piece.weights, where=piece.weights > 0.0, out=0.0 * piece.beta
    )
    bent = np.einsum("bi,ij,bj->b", e, np.tensordot(ends, piece.focus, 1), e)
    growth += ((e @ S) ** 2 @ weights + bearing.sum()) * (1.0 + bent)
    h = np.diff(piece.nominal.times)[0]
    assert found == pytest.approx(-h * growth, rel=1e-6, abs=1e-9)


def test_at_an_end_they_bear_what_the_certificate_there_bears(piece, interval):
    L_inv_T = to_ball(piece.S[0])[1]
    forms = growth_forms(interval, rounded(L_inv_T, 30), exact(0.0))
    without = dataclasses.replace(
        interval, weights=line(np.zeros((2, 7))), bearing=line(np.zeros((2, 7)))
    )
    bare = growth_forms(without, rounded(L_inv_T, 30), exact(0.0))
    h = np.diff(piece.nominal.times)[0]
    none = forms_of(piece, beta=0.0 * piece.beta, weights=0.0 * piece.weights)
    expected = (forms_of(piece).quadratic - none.quadratic)[0]
    found = (at(bare.A, 0) - at(forms.A, 0)) / h
    assert found == pytest.approx(expected, rel=1e-6, abs=1e-6)


def test_a_focus_counts_only_in_the_states_that_the_remainder_depends_on(piece):
    """On the others the proof of R would not have it."""
    focus = np.broadcast_to(-np.eye(7), (2, 7, 7))
    found = make_interval(dataclasses.replace(piece, focus=focus)).focus
    assert at(found, 0) == pytest.approx(np.diag([0.0, 0.0, *[-1.0] * 5]))


def test_halves_have_the_same_polynomials(interval):
    for side, half in enumerate(interval.halves()):
        for name in ("S", "outputs", "linear", "cubic", "weights", "bearing"):
            whole, part = getattr(interval, name), getattr(half, name)
            share = Fraction(3, 8)
            assert at(part, share) == pytest.approx(at(whole, (share + side) / 2))


def test_v_falls_throughout_and_not_for_larger_sets(piece, interval):
    guesses = gram_guesses(piece, 0.003)
    assert prove_growth(interval, exact(0.003), guesses)
    assert not prove_growth(interval, exact(2.0), guesses, halvings=1)
    larger = dataclasses.replace(piece, S=0.7 * piece.S, slopes=0.7 * piece.slopes)
    guesses = gram_guesses(larger, 0.003)
    assert not prove_growth(make_interval(larger), exact(0.003), guesses, 1)


def test_each_half_has_to_be_proven(interval, monkeypatch):
    """A proof of one of them, or of neither, is no proof."""
    parts = [(-1.0, 1.0), (-1.0, 0.0), (0.0, 1.0)]

    for failing, found in (
        ([], True),
        (parts[:1], True),
        (parts[:2], False),
        (parts[::2], False),
        (parts, False),
    ):

        def prove(part, slack, grams, failing=failing):
            return "a guess", part.span not in failing

        monkeypatch.setattr(interval_growth, "_prove_whole", prove)
        is_proven = prove_growth(interval, exact(0.0), (0, 1), halvings=1)
        assert is_proven == found


def test_a_defect_of_the_linear_rates_needs_its_slack(piece):
    """2 √(dᵀ S d), where the elevator does not follow its command."""
    states = piece.nominal.states.copy()
    states[1, ELEVATOR] += 1e-2
    nominal = dataclasses.replace(piece.nominal, states=states)
    moved = dataclasses.replace(piece, nominal=nominal)
    found = _needed_slack(moved, make_interval(moved)) - proven_slack(moved)
    most = 0.0
    for share in np.linspace(0.0, 1.0, 9):
        time = nominal.times[0] + share * np.diff(nominal.times)[0]
        x, u0 = nominal.path(time), [1.0 - share, share] @ nominal.inputs
        d = nominal.path(time, 1) - np.array(open_loop_rates(nominal.model, x, u0))
        d[4:] = 0.0  # The others are in R.
        most = max(most, 2.0 * np.sqrt(d @ moved.shape(time) @ d))
    assert 0.8 * found < most <= found


def test_an_interval_that_is_halved_is_proven_too(proven):
    piece = proven.between(39, 40)
    interval, guesses = make_interval(piece), gram_guesses(piece, 0.003)
    assert not prove_growth(interval, exact(0.003), guesses, halvings=0)
    assert prove_growth(interval, exact(0.003), guesses)


def test_a_matrix_that_is_indefinite_between_is_seen():
    one = exact(np.eye(2))
    dip = in_time(one, -one, one)  # 1 - 3 τ (1 - τ): 0.25 at least.
    assert stays_definite(dip)
    deep = in_time(one, one * -3, one)  # 1 - 5 τ (1 - τ): -0.25 at least.
    assert not stays_definite(deep)
    touching = in_time(one, one * -2, one)  # Zero in the middle.
    assert not stays_definite(touching)


def test_the_ball_covers_the_sets_and_hardly_more(interval):
    basis, stretch = tight_cover(interval)
    assert 1.0 < stretch < 1.03
    assert covers(interval, basis)
    assert not covers(interval, 0.99 * basis)
    for share in (0.0, 0.4, 1.0):
        S, C = at(interval.S, share), at(interval.outputs, share)[interval.which]
        e = to_ball(S)[1] @ sphere_points(500, 7).T
        assert np.linalg.norm(np.linalg.solve(basis, C @ e), axis=0).max() < 1.0


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize("limit", ["rate", "stop"])
def test_each_limit_of_the_servo_counts_alone(piece, limit, sign):
    """Where others are far: what the sets need, with an error of the command."""
    nominal, error, fast, far = piece.nominal, 10.0, 1e3, 6.0
    inputs, angle = np.full(2, 2.0 * sign), nominal.states[:, ELEVATOR]
    along, middle, off = nominal.gains, inputs, error
    if limit == "stop":
        along = np.eye(7)[ELEVATOR] - STOPPING_TIME * along
        middle, off = angle + STOPPING_TIME * inputs, STOPPING_TIME * error
    reach = np.sqrt(np.einsum("ti,tij,tj->t", along, np.linalg.inv(piece.S), along))
    needed = float(np.max(sign * middle + reach + off))
    nominal = dataclasses.replace(nominal, inputs=inputs)
    room = 0.01 * reach.max()
    for bound, kept in ((needed + room, True), (needed - room, False)):
        stops = [-bound, far] if sign < 0 else [-far, bound]
        parameters = dataclasses.replace(
            nominal.model.parameters,
            elevator_rate_limit=bound if limit == "rate" else fast,
            elevator_limits=stops if limit == "stop" else [-far, far],
        )
        model = dataclasses.replace(nominal.model, parameters=parameters)
        given = dataclasses.replace(nominal, model=model), np.full(2, error)
        own = dict(zip(("nominal", "errors"), given, strict=True))
        found = make_interval(dataclasses.replace(piece, **own))
        assert keeps_servo(found) == kept


def test_the_servo_is_watched_between_the_times(proven):
    piece = proven.between(196, 197)
    assert keeps_servo(make_interval(piece))
    model = piece.nominal.model
    # At both ends a stop of 0.94497 rad is not met; between them it is.
    for stop, kept in ((0.945, True), (0.94498, False)):
        limits = [model.parameters.elevator_limits[0], stop]
        parameters = dataclasses.replace(model.parameters, elevator_limits=limits)
        weaker = dataclasses.replace(model, parameters=parameters)
        nominal = dataclasses.replace(piece.nominal, model=weaker)
        changed = dataclasses.replace(piece, nominal=nominal)
        assert keeps_servo(make_interval(changed)) == kept
