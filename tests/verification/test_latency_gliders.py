"""What a prediction misses of the gliders of a set: it is the estimated one's."""

import dataclasses

import numpy as np
import pytest

from glider.physics.confidence import theta_at
from glider.verification.dynamics.nominal import open_loop_rates
from glider.verification.proof import latency as prediction
from glider.verification.proof.interval import keeps_servo, make_interval
from glider.verification.proof.latency import FINE, predictions_of, prove_latency
from glider.verification.proof.slopes import NearSets, Slopes
from glider.verification.sos.sphere import normalized
from tests.physics.test_confidence import ends_of
from tests.verification.points import of_one, slopes_at
from tests.verification.test_gliders import NAMES, allowed_by, among
from tests.verification.test_latency import LATENCY, flown_apart, held_of_one, states_in

SHARE = 0.2
"""Of the set's size in other tests, so that the servo keeps a margin."""


@pytest.fixture(scope="module")
def rest():
    """A funnel of one glider, said to be of a set; not a certificate."""
    return among(held_of_one(), allowed_by(SHARE))


def edge_of(rest, count, rng):
    """Returns deviations (count, m) on the edge of the set, with its axes' ends."""
    allowed = rest.allowed
    drawn = allowed.on_boundary(rng.normal(size=(count, allowed.dimension)))
    corners = ends_of(allowed)
    drawn[: len(corners)] = corners
    return drawn


def test_slopes_of_all_gliders_are_within_their_bounds(rest):
    part = predictions_of(rest, LATENCY)[10].window.between(0, 1)
    bounds = NearSets(Slopes(rest), part, np.zeros(7)).sizes((1.5, 2.5))
    rng, count = np.random.default_rng(2), 5000
    delta = edge_of(rest, count, rng)
    x = states_in(part, count, rng) + delta @ part.gliders.shifts[0].T
    still = np.full((1, count), part.nominal.inputs[0]), np.zeros((2, count))
    model = rest.nominal.model

    def rates(*own):
        theta = theta_at(model, NAMES, own[10:])
        return open_loop_rates(model, own[:7], own[7], theta, own[8:10])

    J = slopes_at(rates, np.vstack([x.T, *still, delta.T]))
    H = np.einsum("imb,mr->irb", J[:, 10:], rest.allowed.factor)
    seen = np.linalg.norm(H, axis=1).max(axis=1)
    assert np.all(seen <= bounds[:, 9] + 1e-8)
    assert np.all(bounds[seen > 1e-6, 9] < 3.0 * seen[seen > 1e-6])
    assert np.all(np.abs(J[:, :7]).max(axis=2) <= bounds[:, :7] + 1e-8)


@pytest.mark.nightly
def test_no_glider_is_farther_from_the_prediction(rest):
    """From about its own center, in winds and with errors that change at any time."""
    own = predictions_of(rest, LATENCY)[10]
    bounds = np.array(prediction._missed(own, Slopes(rest), FINE))
    alone = dataclasses.replace(own, window=of_one(own.window))
    nearer = np.array(prediction._missed(alone, Slopes(alone.window), FINE))
    assert bounds[0] > nearer[0]
    rng, part, count = np.random.default_rng(3), own.window.between(1, 2), 2000
    delta = edge_of(rest, count, rng)
    e = states_in(part, count, rng) - part.nominal.states[0]
    x = part.nominal.states[0] + delta @ part.gliders.shifts[0].T + e
    command = part.nominal.inputs[0] + delta @ part.gliders.commands[0]
    command -= e @ part.nominal.gains[0]
    command += np.einsum("bi,ij,bj->b", e, part.nominal.bends[0], e)
    left = own.window.nominal.times[-1] - part.nominal.times[0]
    model = rest.nominal.model
    theta = theta_at(model, NAMES, delta.T)
    winds = 0.02 * normalized(rng.normal(size=(8, count, 2)))
    errors = 0.05 * np.sign(rng.normal(size=(8, count)))
    given = model, x, command, left
    apart = flown_apart(*given, 0.0 * winds, 0.0 * errors, theta) @ own.gains
    share = left / LATENCY
    assert np.abs(apart).max() > 0.3 * share * (bounds - nearer)[0]
    winds[:], errors[:] = winds[0], errors[0]  # Steady ones move flights farthest.
    apart = flown_apart(*given, winds, errors, theta) @ own.gains
    assert 0.5 * share * bounds[0] < np.abs(apart).max() <= bounds @ [1.0, 0.05]


@pytest.mark.nightly
def test_bounds_are_of_all_numbers_and_centers(rest):
    """A bound a tenth above what is sampled fails where they deviate by more."""
    part, near = predictions_of(rest, LATENCY)[10].window.between(0, 1), np.zeros(7)
    assert np.all(np.isfinite(NearSets(Slopes(rest), part, near).sizes((1.1,))))
    gliders, far = part.gliders, part.gliders.shifts.copy()
    far[:, [2, 4, 5]] *= 200.0  # Pitch and speeds.
    names = "shifts", "slopes", "commands"
    less = {name: 0.01 * getattr(gliders, name) for name in names}
    wide = allowed_by(100.0 * SHARE)
    for changed in ({"shifts": far}, less | {"confidence": wide}):
        other = dataclasses.replace(
            part, gliders=dataclasses.replace(gliders, **changed)
        )
        assert keeps_servo(make_interval(other))
        found = NearSets(Slopes(other), other, near).sizes((1.1,))
        assert np.all(np.isinf(found))


@pytest.mark.nightly
def test_gliders_of_another_set_prove_nothing(rest):
    some = predictions_of(rest, LATENCY)[10:11]
    assert prove_latency(some, workers=1).error_left > -np.inf
    less = dataclasses.replace(rest.gliders, confidence=allowed_by(0.5 * SHARE))
    window = dataclasses.replace(rest, gliders=less)
    assert some[0].error_left(Slopes(window), FINE) == -np.inf
