"""What a prediction of the state misses, by flights and by numbers of other kinds."""

import dataclasses
import json
from fractions import Fraction

import numpy as np
import pytest

from glider.__main__ import main
from glider.errors import InputError
from glider.paths import models_path
from glider.physics.compose import compose
from glider.physics.effects import ATTACHED_LIFT, NO_GAUSSIANS, SERVO_LAG
from glider.physics.parameters import Theta
from glider.physics.servo import STOPPING_TIME
from glider.physics.state import ELEVATOR
from glider.verification.dynamics.nominal import open_loop_rates
from glider.verification.dynamics.numbers import Slope, monomials
from glider.verification.dynamics.taylor_models import Recording
from glider.verification.funnel.funnel import load_funnel
from glider.verification.proof import check, flight_proof
from glider.verification.proof import latency as prediction
from glider.verification.proof.interval import make_interval
from glider.verification.proof.interval_proof import IntervalProof
from glider.verification.proof.latency import (
    FINE,
    ProvenLatency,
    predictions_of,
    prove_latency,
)
from glider.verification.proof.slopes import NearSets, Slopes
from glider.verification.sos.forms import to_ball
from glider.verification.sos.sphere import normalized
from tests.helpers.physics import PARAMETERS
from tests.helpers.second_flight import advance, rates_of
from tests.verification.points import of_one, slopes_at


def nightly(hold):
    return pytest.param(hold, marks=pytest.mark.nightly)


LATENCY = 0.01
HELD = models_path("funnels", "held_head_wind_95_hook.npz")


def held_of_one():
    """A shipped funnel of a set of gliders, as one of the estimated glider alone."""
    return of_one(load_funnel(HELD))


@pytest.fixture(scope="module")
def held():
    return held_of_one()


@pytest.fixture(scope="module")
def slopes(held):
    return Slopes(held)


KINDS = {"plate": ((), ()), "lag": ((ATTACHED_LIFT, SERVO_LAG), (3.0, 0.3, 0.05, 0.04))}


@pytest.mark.parametrize("name", KINDS)
def test_slopes_of_the_dynamics_are_those_of_complex_steps(name):
    kinds, c = KINDS[name]
    chain, rng = compose(kinds), np.random.default_rng(1)
    n = 7 + len(kinds) // 2
    points = rng.normal(size=(n + 3, 50))
    points[4] += 6.0
    theta, unit = Theta(PARAMETERS, np.array(c), NO_GAUSSIANS), np.eye(n + 3).tolist()
    own = [Slope(x, tuple(row)) for x, row in zip(points, unit, strict=True)]

    def rates(*x):
        return chain.derivatives(0.0, list(x[:n]), *x[n:], theta)

    for rate, true in zip(rates(*own), slopes_at(rates, points), strict=True):
        for found, expected in zip(rate.slopes, true, strict=True):
            np.testing.assert_allclose(found + 0.0 * expected, expected, 1e-9, 1e-9)


def test_slopes_of_a_speed_are_bounded_at_rest():
    """The root of a sum of squares has a slope of one at most; a quotient has none."""
    recording = Recording(monomials(2, 2))
    own = [recording.add(7, k) for k in range(2)]
    x, y = (
        Slope(v, tuple(row)) for v, row in zip(own, np.eye(2).tolist(), strict=True)
    )
    speed = np.sqrt(x * x + y * y + 1e-8)
    other = np.sqrt((x * x + 1e-8) + 0.5 * (y * y))  # No sum of squares is seen here.
    bounds = {}
    for name, number in (("speed", speed), ("other", other)):
        program = recording.program(list(number.slopes), np.ones((2, 6), dtype=bool))
        inputs = np.zeros((2, 6, 2))
        inputs[0, 1], inputs[1, 2] = 1.0, 1.0  # From -1 to 1,
        inputs[:, 0, 1] = 4.0  # and from 3 to 5.
        found, lost = program.run(inputs, np.zeros((2, 2)))
        bounds[name] = np.abs(found).sum(axis=1) + lost
    assert bounds["speed"][:, 0] == pytest.approx(1.0)
    assert not np.any(bounds["other"][:, 0] < 10.0)
    assert np.all(bounds["speed"][:, 1] < 1.2) and np.all(bounds["speed"][:, 1] > 0.7)


def states_in(part, count, rng):
    """Returns states on the boundary of a funnel's set at the first of its times."""
    directions = normalized(rng.normal(size=(count, part.num_states)))
    return part.nominal.states[0] + directions @ to_ball(part.S[0])[1].T


@pytest.mark.parametrize("hold", [nightly(1), 20, nightly(40)])
def test_slopes_in_the_sets_are_within_their_bounds(held, slopes, hold):
    """Also where the tail is at rest in some states, at the end of the flight."""
    part = predictions_of(held, LATENCY)[hold].window
    part = part.between(len(part.nominal.times) - 2, len(part.nominal.times) - 1)
    near = NearSets(slopes, part, np.zeros(7))
    bounds = near.sizes((1.5, 2.5))
    assert np.all(np.isfinite(bounds))
    x = states_in(part, 5000, np.random.default_rng(2)).T
    given = np.vstack([x, np.full(5000, part.nominal.inputs[0]), np.zeros((2, 5000))])
    J = slopes_at(
        lambda *x: open_loop_rates(held.nominal.model, x[:7], x[7], wind=x[8:]), given
    )
    seen = np.column_stack(
        [
            np.abs(J[:, :7]).max(axis=2),
            np.linalg.norm(J[:, 8:], axis=1).max(axis=1),
            np.abs(J[:, 7]).max(axis=1),
        ]
    )
    assert np.all(seen <= bounds + 1e-8)
    far = seen > 1e-6
    assert np.all(bounds[far] < 3.5 * seen[far])  # Not much more than what is there.
    # Near the sets there are more states, and larger slopes.
    wider = NearSets(slopes, part, np.full(7, 0.05)).sizes((1.5, 2.5))
    assert np.all(wider >= bounds - 1e-8) and np.any(wider[far] > 1.02 * bounds[far])


def flown_apart(model, states, command, latency, wind, error, theta=None):
    """Returns how far flights end from what is predicted, (B, n); by other numbers."""
    count = 8
    ends = []
    for air, more, own in ((0.0 * wind, 0.0 * error, None), (wind, error, theta)):
        now = states
        for k in range(count):
            now = advance(
                lambda x, t, k=k, a=air, u=more, own=own: rates_of(
                    model, x, command + u[k], a[k], own
                ),
                now,
                latency / count,
            )
        ends.append(now)
    return ends[1] - ends[0]


@pytest.mark.parametrize("hold", [nightly(2), 10, nightly(19)])
def test_no_flight_is_farther_from_its_prediction(held, slopes, hold):
    """In winds and with errors that change at any time."""
    own = predictions_of(held, LATENCY)[hold]
    bounds = np.array(prediction._missed(own, slopes, FINE))
    rng, window, count = np.random.default_rng(3), own.window, 2000
    part = window.between(1, 2)
    x = states_in(part, count, rng)
    left = window.nominal.times[-1] - part.nominal.times[0]
    assert 0.0 < left <= LATENCY
    e = x - part.nominal.states[0]
    command = part.nominal.inputs[0] - e @ part.nominal.gains[0]
    command += np.einsum("bi,ij,bj->b", e, part.nominal.bends[0], e)
    model, still = held.nominal.model, np.zeros((8, count))
    winds = 0.02 * normalized(rng.normal(size=(8, count, 2)))
    winds[:, ::2] = winds[0, ::2]  # Half of them are steady.
    errors = 0.05 * np.sign(rng.normal(size=(8, count)))
    errors[:, ::2] = errors[0, ::2]
    blown = flown_apart(model, x, command, left, winds, still) @ own.gains
    pushed = flown_apart(model, x, command, left, 0.0 * winds, errors) @ own.gains
    share = left / LATENCY
    assert 0.3 * share * bounds[0] < np.abs(blown).max() <= bounds[0]
    assert 0.3 * share * bounds[1] < np.abs(pushed).max() / 0.05 <= bounds[1]
    both = flown_apart(model, x, command, left, winds, errors) @ own.gains
    assert np.abs(both).max() <= bounds[0] + 0.05 * bounds[1]


@pytest.mark.nightly
def test_what_is_left_is_that_of_the_worst_prediction(held, slopes):
    some = predictions_of(held, LATENCY)[10:20:9]
    found = prove_latency(some, 0.005, workers=1)
    assert found.holds and found.latency == LATENCY
    alone = [own.error_left(slopes, FINE) for own in some]
    assert 0.0 <= min(alone) - found.error_left < 1e-4  # It is rounded down.
    # Where commands may be off by less, the wind takes all of it.
    window = some[0].window
    settings = dataclasses.replace(window.settings, command_error=0.02)
    window = dataclasses.replace(window, settings=settings)
    strict = dataclasses.replace(some[0], window=window)
    assert not prove_latency([strict], workers=1).holds
    assert not ProvenLatency(latency=0.01, error_left=0.01, least=0.02).holds


def test_nothing_is_proven_where_the_sets_are_not_covered(held, slopes, monkeypatch):
    own = predictions_of(held, LATENCY)[2]
    # The servo's margin does not last for the error that a prediction may have.
    near_limit = dataclasses.replace(
        own.window,
        settings=dataclasses.replace(own.window.settings, command_error=200.0),
    )
    far = dataclasses.replace(own, window=near_limit)
    assert far.error_left(slopes, (2.5,)) == -np.inf
    monkeypatch.setattr(prediction, "_TURNS", 1)  # None that has seen what is near.
    assert own.error_left(slopes, (2.5,)) == -np.inf


class Recorded:
    """Bounds of slopes on one interval, given as a number of its times."""

    pushes = np.array([0.02, 0.05])

    def __init__(self, slopes, part, near):
        self.first, self.last = part.nominal.times

    def sizes(self, rooms):
        return np.zeros((7, 9))

    def pulls(self, first, last, duration, apart, rooms):
        return np.full(2, self.worth(self.first, self.last))


@pytest.mark.parametrize("hold", [0, 3, 20])
@pytest.mark.parametrize("is_late", [True, False])
def test_every_interval_of_a_latency_counts(held, hold, is_late, monkeypatch):
    """Of all lines of λ."""
    monkeypatch.setattr(prediction, "NearSets", Recorded)
    Recorded.worth = lambda self, first, last: last if is_late else 1.0 - first
    given = predictions_of(held, LATENCY)[hold]
    times = given.window.nominal.times
    found = prediction._missed(given, None, FINE)
    duration, expected = LATENCY / prediction._PARTS, 0.0
    for k in range(prediction._PARTS):
        begin, end = times[-1] - (k + 1) * duration, times[-1] - k * duration
        met = np.flatnonzero((times[1:] > begin + 1e-9) & (times[:-1] < end - 1e-9))
        worst = times[1:][met[-1]] if is_late else 1.0 - times[:-1][met[0]]
        expected += duration * worst
    room = duration * np.diff(times).max() * prediction._PARTS  # Where intervals meet.
    for bound, push in zip(found, (0.02, 1.0), strict=True):
        assert expected * push <= bound <= (expected + room) * push * (1.0 + 1e-9)


@pytest.mark.parametrize("size", [0.1, 5.0, 20.0])
def test_what_is_apart_is_that_of_all_terms_of_its_series(size):
    """Of one state that grows at a rate: (exp(rate t) - 1) / rate."""
    found = prediction._apart(np.array([[size / LATENCY, 3.0]]), LATENCY)
    expected = 3.0 * np.expm1(size) / (size / LATENCY)
    assert expected <= found[0, 0] <= expected * (1.0 + 1e-3)


def room_to_stops(piece):
    """How far the sets of two times keep away from the nearer stop [rad]."""
    interval, lefts = make_interval(piece), []
    for a, b in interval.limits:
        for share in (0, 1):
            given = (v.at(Fraction(share)).to_float() for v in (a, b, interval.S))
            along, bound, S = given
            lefts.append(bound - np.sqrt(along @ np.linalg.solve(S, along)))
    return float(np.min(lefts))


@pytest.mark.parametrize("what", ["elevator", "command"])
def test_a_prediction_keeps_away_from_the_stops_too(held, slopes, what):
    """By how far its elevator may be off, and its command."""
    part, near = held.between(20, 21), np.zeros(7)
    settings = dataclasses.replace(part.settings, command_error=0.0)
    part = dataclasses.replace(part, settings=settings)
    room = room_to_stops(part)
    for share, kept in ((0.98, True), (1.02, False)):
        if what == "elevator":
            near[ELEVATOR] = share * room
        else:
            error = share * room / STOPPING_TIME
            settings = dataclasses.replace(part.settings, command_error=error)
            part = dataclasses.replace(part, settings=settings)
        lacks = NearSets(slopes, part, near)._lacks
        assert np.all(np.isfinite(lacks)) == kept


def test_a_latency_that_cannot_be_proven_is_refused(capsys, held):
    path = str(HELD)
    asked = ["check-funnel", path, "--every", "1000", "--prove"]
    assert main([*asked, "--hold", "0.02", "--latency", "0.02"]) == 2
    said = capsys.readouterr().err
    assert "0 or more, and less than the funnel's period, 0.02 s" in said
    assert main(["check-funnel", path, "--prove", "--latency", "-0.01"]) == 2
    said = capsys.readouterr().err
    assert "--latency: -0.01 is not a number of at least 0" in said
    drawn = str(models_path("funnels", "drawn.npz"))
    assert main(["check-funnel", drawn, "--prove", "--latency", "0.01"]) == 2
    assert "the funnel is for a feedback that acts at all times" in (
        capsys.readouterr().err
    )
    with pytest.raises(InputError, match="more than one command's"):
        predictions_of(held.between(0, 4), LATENCY)


@pytest.mark.parametrize(("left", "code"), [(0.006, 0), (0.004, 1)])
def test_a_latency_is_proven_of_what_is_proven_as_a_whole(
    left, code, capsys, monkeypatch, checked_once
):
    source = str(models_path("funnels", "held_head_wind_hook.npz"))
    asked = ["check-funnel", source, "--hook", "--prove", "--latency", "0.01"]
    asked += ["--command-error", "0.005", "--every", "1000"]

    def prove(predictions, least, progress):
        assert len(predictions) == 44 and predictions[0].latency == 0.01
        return ProvenLatency(latency=0.01, error_left=left, least=least)

    def prove_intervals(funnel, every, **options):
        whole = IntervalProof(boxes=1, ratio=0.5)
        outcomes = dict.fromkeys(funnel.nominal.flows.tolist()[::every], whole)
        return flight_proof.FlightProof(times=funnel.nominal.times, outcomes=outcomes)

    monkeypatch.setattr(prediction, "prove_latency", prove)
    monkeypatch.setattr(flight_proof, "prove_flights", prove_intervals)
    monkeypatch.setattr(check, "held_faults", lambda funnel, progress: [])
    assert main(asked) == 1  # Of some intervals: nothing is said of the latency.
    assert "latency" not in capsys.readouterr().out
    monkeypatch.setattr(check.Verdict, "is_whole", True)
    monkeypatch.setattr(flight_proof.FlightProof, "is_whole", True)
    assert main(asked) == code
    said = " ".join(capsys.readouterr().out.split())
    words = (
        "Proven: commands may be computed 10 ms before they act",
        "The first command is computed from the state in which it acts.",
    )
    assert [w in said for w in words] == 2 * [code == 0]
    assert ("leaves 0.004 rad/s of the funnel's command error" in said) == (code == 1)
    assert main([*asked, "--json"]) == code
    assert json.loads(capsys.readouterr().out)["latency"]["holds"] == (code == 0)


@pytest.mark.nightly
def test_lines_of_a_covector_end_where_the_nominal_takes_it(held, slopes, monkeypatch):
    """With λ of constant slopes instead, more of Jᵀ λ - dλ/dσ is left."""
    own = predictions_of(held, LATENCY)[10]
    good = np.array(prediction._missed(own, slopes, FINE))
    monkeypatch.setattr(
        prediction.scipy.linalg, "expm", lambda matrix: np.eye(len(matrix))
    )
    bad = np.array(prediction._missed(own, slopes, FINE))
    assert np.all(good < bad)
