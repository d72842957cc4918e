"""Errors of the command and wind, of any time course: bounded, proven, counted."""

import copy
import dataclasses
import json
from fractions import Fraction

import numpy as np
import pytest

from glider.__main__ import main
from glider.errors import InputError
from glider.paths import models_path
from glider.verification.dynamics import nominal as dynamics
from glider.verification.dynamics.nominal import (
    nonlinear_parts,
    open_loop_rates,
    table_of,
)
from glider.verification.funnel.boundary import boundary_forms, growth_forms
from glider.verification.funnel.remainder import push_weights, sample_remainder
from glider.verification.funnel.servo_limits import servo_bounds
from glider.verification.funnel.settings import FunnelSettings
from glider.verification.proof.check import remainder_seen
from glider.verification.proof.enclosure import make_remainder
from glider.verification.proof.interval import (
    acts_elsewhere,
    keeps_servo,
    make_interval,
    tight_cover,
)
from glider.verification.proof.interval_proof import prove_interval
from glider.verification.sos.exact import exact, rounded
from glider.verification.sos.forms import spread_form, to_ball
from tests.verification.forging import forge
from tests.verification.points import (
    forms_of,
    remainder_of_one,
    sphere_points,
    without_pushes,
)

ERROR, WIND = 0.5, 0.03


def pushed(funnel, error=ERROR, wind=WIND):
    """The same funnel, that claims to account for pushes, with good weights."""
    settings = dataclasses.replace(
        funnel.settings, command_error=error, wind=wind, remainder=1.1
    )
    sizes = np.diag(np.square(settings.size_axes(funnel.num_states)))
    slopes = funnel.nominal.push_slopes
    errors = np.full(len(funnel.S), error)
    made = dataclasses.replace(funnel, settings=settings, errors=errors, rests=errors)
    weights = push_weights(funnel.S, made.pushes, slopes, sizes)
    return dataclasses.replace(made, push_weights=weights)


@pytest.fixture(scope="module")
def piece(proven):
    return pushed(proven.between(60, 61))


def pushes_of(count, seed=0):
    """Pushes (count, 3) on the boundary of what is allowed."""
    rng = np.random.default_rng(seed)
    angles = rng.uniform(0.0, 2.0 * np.pi, count)
    wind = WIND * np.array([np.cos(angles), np.sin(angles)])
    return np.vstack([ERROR * rng.choice([-1.0, 1.0], count), wind]).T


def by_pushes(piece):
    """What pushes alone add to V̇/V on the boundaries."""
    both = forms_of(piece), forms_of(without_pushes(piece))
    return [more - less for more, less in zip(*both, strict=True)]


def along(slopes, e):
    """G (B, n, 3) at deviations e (B, n), of slopes (n, 3, 1 + n)."""
    return slopes[..., 0] + np.einsum("ijl,bl->bij", slopes[..., 1:], e)


def test_their_slopes_are_those_of_the_dynamics(piece):
    """At deviations e, to first order in e."""
    nominal, step, size = piece.nominal, 1e-6, 1e-4
    rng = np.random.default_rng(0)
    for e in size * np.vstack([np.zeros(7), rng.normal(size=(5, 7))]):
        states = list((nominal.states + e).T)
        for k, push in enumerate(step * np.eye(3)):
            more, less = (
                np.array(
                    [
                        rate + 0.0 * nominal.inputs
                        for rate in open_loop_rates(
                            nominal.model,
                            states,
                            nominal.inputs + sign * push[0],
                            wind=sign * push[1:],
                        )
                    ]
                )
                for sign in (1.0, -1.0)
            )
            slopes = (more - less).T / (2.0 * step)
            own = [along(G, e[None])[0, :, k] for G in nominal.push_slopes]
            assert np.array(own) == pytest.approx(slopes, abs=3e-6)


def test_no_push_makes_v_rise_faster_than_they_say(piece):
    """2 eᵀ S G q is at most the forms, and there are e and q that nearly reach them.

    What they have for half of the wind, or without the deviation in G, is too little.
    """
    S, G = piece.S[:1], piece.nominal.push_slopes
    L_T, L_inv_T = (turn[0] for turn in to_ball(S))
    z, q = sphere_points(20_000, 7), pushes_of(20_000)
    e = z @ L_inv_T.T
    towards = np.einsum("bi,bij->bj", z @ L_T, along(G[0], e))
    q[:, 0] = ERROR * np.sign(towards[:, 0])
    q[:, 1:] = WIND * towards[:, 1:] / np.linalg.norm(towards[:, 1:], axis=1)[:, None]
    pull = 2.0 * np.sum(towards * q, axis=1)

    def given(slopes, wind=WIND):
        settings = dataclasses.replace(piece.settings, wind=wind)
        made = dataclasses.replace(piece, settings=settings)
        both = boundary_forms(made, slopes), forms_of(without_pushes(piece))
        forms = [more[:1] - less[:1] for more, less in zip(*both, strict=True)]
        third, fourth = (
            spread_form(f, 7, d)[0] for d, f in ((3, forms[1]), (4, forms[2]))
        )
        found = np.einsum("bi,ij,bj->b", z, forms[0][0], z)
        found += np.einsum("bi,bj,bk,ijk->b", z, z, z, third)
        return found + np.einsum(
            "bi,bj,bk,bl,ijkl->b", z, z, z, z, fourth, optimize=True
        )

    most = given(G)
    assert np.all(pull <= most) and (pull / most).max() > 0.8
    assert np.any(pull > given(G, 0.5 * WIND))
    flat = np.concatenate([G[..., :1], 0.0 * G[..., 1:]], axis=-1)
    assert np.any(pull > given(flat))


def test_the_proof_bears_what_the_certificate_bears(piece):
    """At an end; halving, the error counts half as much where it does alone."""
    whole, basis = make_interval(piece), rounded(to_ball(piece.S[0])[1], 30)
    h = np.diff(piece.nominal.times)[0]
    bare = make_interval(pushed(piece, 0.0, 0.0))
    own, all_forms = (growth_forms(i, basis, exact(0.0)) for i in (bare, whole))
    expected = by_pushes(piece)
    for less, more, form in zip(own[:3], all_forms[:3], expected, strict=True):
        ends = (value.at(Fraction(0)).to_float() for value in (less, more))
        found = np.subtract(*ends) / h
        assert found == pytest.approx(form[0], rel=1e-6, abs=1e-6)
        assert np.abs(found).max() > 1e-3
    half = by_pushes(pushed(piece, 0.5 * ERROR, 0.0))
    twice = by_pushes(pushed(piece, ERROR, 0.0))
    for form, double in zip(half, twice, strict=True):
        assert form == pytest.approx(0.5 * double, abs=1e-9)


def true_ratio(piece, basis, points):
    """|R| / β at points (m + 4, B) of w, q and s, by the physics; F is zero here."""
    nominal, n = piece.nominal, piece.num_states
    which, rows = nonlinear_parts(nominal.model)
    shares = 0.5 * (1.0 + points[-1])
    times = nominal.times[0] + shares * np.diff(nominal.times)
    y = np.zeros((n + 1, len(times)))
    y[which] = basis @ points[:-4]
    u0 = (1.0 - shares) * nominal.inputs[0] + shares * nominal.inputs[1]
    q = points[-4:-1] * piece.pushes[0][[0, 1, 1], None]
    states = nominal.path(times).T + y[:-1]
    rates = open_loop_rates(nominal.model, list(states), u0 + y[-1] + q[0], wind=q[1:])
    P = nominal.open_loop[:, rows]
    P[..., 0] = 0.0
    ends = P @ table_of(n + 1).values(y.T).T
    both = (along(slopes, y[:-1].T) for slopes in nominal.push_slopes[:, rows])
    ends += np.array([np.einsum("bij,jb->ib", G, q) for G in both])
    model = (1.0 - shares) * ends[0] + shares * ends[1]
    beta = piece.beta[:, rows]
    limits = (1.0 - shares) * beta[0][:, None] + shares * beta[1][:, None]
    found = np.array([rates[row] for row in rows]) - nominal.path(times, 1).T[rows]
    return np.abs(found - model) / limits


@pytest.mark.parametrize("size", [1e-4, 0.05, 0.3])
def test_no_remainder_with_pushes_is_larger_than_its_bound(piece, size):
    remainder = make_remainder(piece, tight_cover(make_interval(piece))[0])
    d, rng = remainder.dimension, np.random.default_rng(0)
    assert d == len(remainder.basis) + 4
    assert remainder.balls == (slice(0, d - 4), slice(d - 3, d - 1))
    center = rng.normal(size=(d, 40))
    center[:-4] *= 0.9 / np.linalg.norm(center[:-4], axis=0)
    center[-3:-1] *= 0.9 / np.linalg.norm(center[-3:-1], axis=0)
    center[[-4, -1]] = rng.uniform(-0.7, 0.7, (2, 40))
    half = size * rng.uniform(0.3, 1.0, (d, 40))
    bounds, reached, _ = remainder.bounds(center, half)
    v = rng.uniform(-1.0, 1.0, (200, d, 1))
    points = np.moveaxis(center + half * v, 1, 0)
    found = true_ratio(piece, remainder.basis, points.reshape(d, -1))
    inside = [np.sum(points[b] ** 2, axis=0) <= 1.0 for b in remainder.balls]
    within = np.all(inside, axis=0)
    largest = np.where(within, found.reshape(-1, 200, 40), 0.0).max(axis=1)
    assert np.all(largest <= bounds) and np.all(reached <= bounds)
    if size == 1e-4:  # Bounds without the wind, or of half the error, are too small.
        without = pushed(piece, wind=0.0), [*range(d - 3), d - 1]
        for less, here in (without, (pushed(piece, 0.5 * ERROR), range(d))):
            forgetful = make_remainder(less, tight_cover(make_interval(less))[0])
            few = forgetful.bounds(center[list(here)], half[list(here)])[0]
            assert np.any(largest > few)


def test_the_sampled_remainder_is_that_of_pushes_too(piece):
    S, at, pushes = piece.S[:1], np.array([0]), piece.pushes[:1]
    d, given = sphere_points(500, 10), (at, piece.gliders)
    most = sample_remainder(piece.nominal, S, d, *given, pushes=pushes)[0]
    alone = sample_remainder(piece.nominal, S, d[:, :7], *given)[0]
    assert np.all(most >= alone) and np.any(most > 1.05 * alone)
    e = sphere_points(20_000, 7) @ to_ball(S)[1][0].T
    R = remainder_of_one(piece.nominal, at, e[None], push=pushes_of(20_000)[None])[0]
    assert np.all(np.abs(R).max(axis=0) <= most * (1.0 + 1e-9) + 1e-9)


def test_the_check_sees_a_remainder_that_has_no_wind(proven):
    rng = np.random.default_rng(0)
    assert remainder_seen(proven, [0, 60], rng) < 1.0
    assert remainder_seen(pushed(proven, wind=0.3), [0, 60], rng) > 1.0


def test_the_servo_leaves_room_for_the_error(proven):
    piece = proven.between(60, 61)
    directions, bounds = servo_bounds(
        piece.nominal, piece.settings, piece.gliders, shrink=1.0
    )
    reach = np.einsum("tki,tij,tkj->tk", directions, np.linalg.inv(piece.S), directions)
    room = float((bounds - np.sqrt(reach))[:, 0].min())
    assert keeps_servo(make_interval(pushed(piece, 0.99 * room, 0.0)))
    assert not keeps_servo(make_interval(pushed(piece, 1.02 * room, 0.0)))


def test_a_funnel_that_was_made_without_them_is_not_proven_with_them(piece):
    assert prove_interval(pushed(piece, 0.0, 0.0)).proven
    assert not prove_interval(piece).proven
    bare = dataclasses.replace(piece, push_weights=np.zeros((2, 2)))
    assert "a weight is zero" in prove_interval(bare).fault


@pytest.mark.parametrize("row", [0, 4])
def test_wind_acts_only_where_the_remainder_has_it(piece, row, monkeypatch):
    """The first rate is linear, and the other does not depend on x."""
    assert not acts_elsewhere(piece)
    rates = dynamics.open_loop_rates

    def blown(model, states, command, theta=None, wind=(0.0, 0.0)):
        found = list(rates(model, states, command, theta, wind))
        found[row] = found[row] + wind[0] * states[0]
        return found

    monkeypatch.setattr(dynamics, "open_loop_rates", blown)
    # What the rates of a glider depend on is remembered.
    model = copy.copy(piece.nominal.model)
    nominal = dataclasses.replace(piece.nominal, model=model)
    piece = dataclasses.replace(piece, nominal=nominal)
    assert acts_elsewhere(piece)
    assert not acts_elsewhere(pushed(piece, wind=0.0))


def test_pushes_need_a_remainder():
    with pytest.raises(InputError, match="where there is a command_error, wind"):
        FunnelSettings(wind=0.02)


# ------------------------------------------------------------------------------ files


@pytest.fixture(scope="module")
def source():
    return models_path("funnels", "disturbed_hook.npz")


def _set(name, value):
    def change(arrays, notes):
        notes["settings"][name] = value

    return change


def _error(value):
    """An error of the command that settings and arrays agree on."""

    def change(arrays, notes):
        notes["settings"]["command_error"] = value
        arrays["errors"][:] = value
        arrays["rests"][:] = value

    return change


def _times(name, factor):
    def change(arrays, notes):
        arrays[name] *= factor

    return change


FORGED = {
    "a wind that is no number": (_set("wind", float("nan")), "wind' is nan"),
    "an infinite wind": (_set("wind", float("inf")), "wind' is inf"),
    "a negative wind": (_set("wind", -0.02), "field 'wind' is -0.02"),
    "a wind in words": (_set("wind", "0.02"), "'settings.wind' is '0.02'"),
    "a list of winds": (_set("wind", [0.02]), "'settings.wind' is "),
    "a wind that is true": (_set("wind", True), "wind' is "),
    "a negative error": (_set("command_error", -1.0), "field 'command_error' is -1"),
    "an error of 401 digits": (
        _set("command_error", 10**400),
        "'settings.command_error' is 1000",
    ),
    "pushes without a remainder": (_set("remainder", 0.0), "field 'remainder' is 0.0"),
    "a wind twice as strong": (_set("wind", 0.04), "V was not proven to fall"),
    "an error of the settings alone": (
        _set("command_error", 1.4),
        "error is smaller than the settings'",
    ),
    "an error twice as large": (_error(1.4), "V was not proven to fall"),
    "an error that no servo follows": (_error(13.0), "The servo would meet its limits"),
    "no weights": (_times("push_weights", 0.0), "A weight is zero"),
    "negative weights": (_times("push_weights", -1.0), "'push_weights' is negative"),
    "weights that are no numbers": (_times("push_weights", np.nan), "infinite or NaN"),
    "half of the weights": (_times("push_weights", 0.5), "V was not proven to fall"),
}


@pytest.mark.parametrize("name", FORGED)
def test_a_forged_bound_is_refused_in_a_sentence(name, source, tmp_path, capsys):
    change, words = FORGED[name]
    forge(source, tmp_path / "f.npz", change)
    code = main(["check-funnel", str(tmp_path / "f.npz"), "--hook", "--every", "100"])
    said = capsys.readouterr()
    assert code in (1, 2)
    assert words in " ".join((said.out + said.err).split())
    assert "Traceback" not in said.out + said.err


def test_a_bound_that_was_removed_is_not_claimed(source, tmp_path, capsys):
    """The sets are those of a funnel without pushes too; it says nothing of any."""

    def change(arrays, notes):
        del notes["settings"]["wind"], notes["settings"]["command_error"]
        arrays["errors"][:] = 0.0
        arrays["rests"][:] = 0.0

    forge(source, tmp_path / "f.npz", change)
    asked = ["check-funnel", str(tmp_path / "f.npz"), "--hook", "--every", "100"]
    assert main(asked) == 0
    assert "command error" not in capsys.readouterr().out
    assert main([*asked, "--prove", "--wind", "0.01"]) == 1
    said = " ".join(capsys.readouterr().out.split())
    assert "accounts for wind of 0 m/s; expected at least 0.01." in said


def test_the_check_says_what_it_accounts_for(source, capsys):
    asked = ["check-funnel", str(source), "--hook", "--every", "100"]
    assert main(asked) == 0
    said = " ".join(capsys.readouterr().out.split())
    words = (
        "a command error of at most 0.7 rad/s and wind of at most 2 cm/s at any time"
    )
    assert f"It accounts for {words}." in said
    assert main([*asked, "--json"]) == 0
    report = json.loads(capsys.readouterr().out)
    loop = report["loop"]
    assert (loop["command_error_rad_s"], loop["wind_m_s"]) == (0.7, 0.02)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--hold", "0.02"], "--hold has no effect without --prove"),
        (["--command-error", "0.1"], "--command-error has no effect without"),
        (["--prove", "--hold", "nan"], "--hold: nan is not a number"),
        (["--prove", "--wind", "-1"], "--wind: -1 is not a number"),
        (["--prove", "--command-error", "inf"], "--command-error: inf is not a number"),
        (["--latency", "0.01"], "--latency has no effect without --prove"),
        (["--prove", "--latency", "0.01"], "--latency is proven of held commands"),
    ],
)
def test_options_that_make_no_sense_are_refused(options, words, source, capsys):
    asked = ["check-funnel", str(source), "--hook", "--every", "200", *options]
    assert main(asked) == 2
    assert words in " ".join(capsys.readouterr().err.split())
