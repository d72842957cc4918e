"""Held commands of other gliders: of a set, and under another one's feedback."""

import dataclasses

import numpy as np
import pytest

from glider.errors import InputError
from glider.physics.confidence import glider_at
from glider.physics.servo import STOPPING_TIME
from glider.physics.state import ELEVATOR
from glider.verification.funnel.build import make_funnel
from glider.verification.funnel.clock import BEND_ROOM, bend_sizes, command_errors
from glider.verification.funnel.funnel import funnel_policy
from glider.verification.funnel.remainder import sample_remainder
from glider.verification.proof import held
from glider.verification.proof.held import held_faults
from glider.verification.proof.interval import _centers_reach
from glider.verification.sos.exact import exact
from glider.verification.sos.forms import to_ball
from tests.helpers.held_flights import HeldFlights, Launches
from tests.helpers.second_flight import advance, rates_of
from tests.verification.clocked import ERROR, WIND, part
from tests.verification.points import center_at, of_one, sphere_points
from tests.verification.test_gliders import NAMES, allowed_by, among

# ---------------------------------------------------------------------- sets of gliders


@pytest.fixture(scope="module")
def clocked_set(clocked):
    """The same for a set of gliders; still not a certificate."""
    funnel = among(clocked, allowed_by())
    nominal, S, at = funnel.nominal, funnel.S, np.arange(len(funnel.S))
    errors = np.tile([10.0, WIND], (len(S), 1))  # Of commands, more than there are.
    given = sphere_points(300, 12), at, funnel.gliders, None, errors
    beta = 1.1 * sample_remainder(nominal, S, *given)
    rests = command_errors(nominal, S, at, funnel.settings, beta, funnel.focus)
    errors = rests + BEND_ROOM * bend_sizes(S, nominal.bends)
    return dataclasses.replace(funnel, beta=beta, rests=rests, errors=errors)


def hold_flown(funnel, model, states, command, wind, first):
    """Times of a hold, and states (B, n) at each, from one of the funnel's times on."""
    times = funnel.nominal.times
    which = np.flatnonzero(funnel.nominal.starts == first)
    paths = [states]
    for j in which[:-1]:
        step = (times[j + 1] - times[j]) / 8
        for _ in range(8):
            states = advance(
                lambda x, t: rates_of(model, x, command, wind), states, step
            )
        paths.append(states)
    return [*zip(which, paths, strict=True)]


def command_of(funnel, states, k):
    """The feedback's command (B,) at one of the funnel's times."""
    nominal = funnel.nominal
    return nominal.inputs[k] - (states - nominal.states[k]) @ nominal.gains[k]


@pytest.mark.nightly
def test_centers_of_held_commands_are_where_the_gliders_fly(clocked_set):
    """To first order: what is left falls with the square of the deviation."""
    nominal, center = clocked_set.nominal, clocked_set.gliders
    starts = nominal.samples[:12]
    delta = center.confidence.on_boundary(np.array([0.6, 0.8]))
    lefts = []
    for size in (0.0, 1.0, 0.5):
        glider = glider_at(nominal.model, NAMES, size * delta)
        states, off = nominal.states[:1], []
        for first in starts:
            command = command_of(clocked_set, states, first)
            off += [*(command - nominal.inputs[first])]
            off[-1] -= size * center.commands[first] @ delta
            path = hold_flown(clocked_set, glider, states, command, None, first)
            for k, states in path:
                moved = states[0] - nominal.states[k]
                off += [*(moved - size * center.shifts[k] @ delta)]
        lefts.append(np.array(off))
    whole, half = (np.abs(left - lefts[0]).max() for left in lefts[1:])
    assert half == pytest.approx(0.25 * whole, rel=0.1)
    assert whole < 0.05 * np.abs(center.shifts[starts] @ delta).max()
    at = nominal.times[20:30:3]
    found = center_at(center, at, np.tile(delta, (len(at), 1)))
    np.testing.assert_allclose(found, center.shifts[20:30:3] @ delta)


@pytest.mark.nightly
def test_held_flights_of_a_set_are_within_the_proven_error(clocked_set):
    """From the boundaries about their centers, in steady wind, with errors."""
    nominal, center, count = clocked_set.nominal, clocked_set.gliders, 100
    turn, ratio, seen = np.arange(count), 0.0, 0
    wind = WIND * np.stack([np.cos(turn), np.sin(turn)], axis=1)
    samples = nominal.samples[[2, 8, 14, 20]]
    for first, angle in zip(samples, (0.0, 2.0, 4.0, 5.0), strict=True):
        delta = center.confidence.on_boundary(np.array([np.cos(angle), np.sin(angle)]))
        glider = glider_at(nominal.model, NAMES, delta)
        e = sphere_points(count, 7) @ to_ball(clocked_set.S[first])[1].T
        states = nominal.states[first] + center.shifts[first] @ delta + e
        held = command_of(clocked_set, states, first) + ERROR * np.sign(np.sin(turn))
        inside = np.ones(count, dtype=bool)
        for k, x in hold_flown(clocked_set, glider, states, held, wind, first):
            e = x - nominal.states[k] - center.shifts[k] @ delta
            inside &= np.einsum("bi,ij,bj->b", e, clocked_set.S[k], e) <= 1.0 + 1e-9
            feedback = nominal.inputs[k] + center.commands[k] @ delta
            off = (held - feedback + e @ nominal.gains[k])[inside]
            rest = off - np.einsum("bi,ij,bj->b", e, nominal.bends[k], e)[inside]
            ratio = max(ratio, np.abs(rest).max() / clocked_set.rests[k])
            assert np.all(np.abs(rest) <= clocked_set.rests[k] + 1e-12)
            assert np.all(np.abs(off) <= clocked_set.errors[k] + 1e-12)
        seen += inside.sum()
    assert ratio > 0.2 and seen > 20


def test_held_commands_of_a_set_are_proven(clocked_set):
    assert held_faults(part(clocked_set, 2)) == []


@pytest.mark.nightly
def test_what_the_centers_lack_to_be_flights_counts(clocked_set):
    """Here their elevator does not follow their command."""
    piece = among(part(clocked_set, 4), allowed_by(100.0))
    assert held_faults(piece) == []
    commands = 3.0 * piece.gliders.commands
    gliders = dataclasses.replace(piece.gliders, commands=commands)
    [fault] = held_faults(dataclasses.replace(piece, gliders=gliders))
    assert "The held command may be" in fault


def test_held_commands_of_a_set_may_have_no_rate_left(clocked_set):
    """U δ counts when a command is computed."""
    piece = part(clocked_set, 6)
    last = piece.nominal.samples[-1]
    piece = among(piece, allowed_by(1500.0))
    assert held._keeps_rate(piece, 0)  # All gliders have the same launch.
    assert held._keeps_rate(of_one(piece), last)
    assert not held._keeps_rate(piece, last)


def test_the_reach_of_centers_to_the_stops_has_the_held_command(clocked_set):
    k = clocked_set.nominal.samples[8] + 1
    piece = clocked_set.between(k, k + 1)
    allowed, (start, stop) = piece.gliders.confidence, piece.nominal.times
    deltas = allowed.on_boundary(np.random.default_rng(3).normal(size=(300, 2)))
    rate, bound = _centers_reach(piece, exact(stop) - exact(start))
    assert rate == pytest.approx(allowed.reach(piece.gliders.commands[0]))
    found = [
        np.abs(
            center_at(piece.gliders, np.full(300, t), deltas)[:, ELEVATOR]
            + STOPPING_TIME * deltas @ piece.gliders.commands[0]
        ).max()
        for t in np.linspace(start, stop, 20)
    ]
    assert 0.98 * bound < max(found) <= bound
    np.testing.assert_array_equal(*piece.gliders.commands)


@pytest.mark.nightly
def test_a_set_is_flown_by_the_clock_about_its_centers(clocked):
    funnel = among(clocked, allowed_by(10.0))
    nominal, center = funnel.nominal, funnel.gliders
    launches = Launches.draw(funnel, 4, np.random.default_rng(0))
    _, ends = HeldFlights(funnel, launches).levels()
    pairs = zip(ends, launches.deviations, launches.states, strict=True)
    for found, delta, states in pairs:
        glider, path = glider_at(nominal.model, NAMES, delta), [(0, states[None])]
        for first in nominal.samples:
            given = path[-1][1], command_of(funnel, path[-1][1], first)
            path = hold_flown(funnel, glider, *given, None, first)
        e = path[-1][1][0] - nominal.states[-1] - center.shifts[-1] @ delta
        assert found == pytest.approx(e @ funnel.S[-1] @ e, rel=1e-3)


def test_held_commands_need_a_feedback_that_is_made_with_the_shape(clocked):
    settings = dataclasses.replace(clocked.settings, elevator_gain=0.0)
    policy = funnel_policy(clocked, held=True)
    with pytest.raises(InputError, match=r"'elevator_gain' is 0\.0; expected a"):
        make_funnel(clocked.nominal.model, policy, settings)
