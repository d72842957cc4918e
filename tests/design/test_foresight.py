"""What is foreseen of throws is what flying them brings."""

import dataclasses

import numpy as np
import pytest
from scipy.stats import norm

from glider.design.explanations import Explanation
from glider.design.foresight import Foresight, added, times
from glider.design.limits import limits_flown
from glider.design.throws import flown_throw, log_of, range_of
from glider.physics.effects import NO_FIELD
from glider.sysid.likelihood.linear_flight import linearize
from glider.sysid.likelihood.scales import whiten
from glider.sysid.replay.record import prepare


def foresight_of(late, explanations=None):
    campaign, task, noise, own = late
    travel, rate = campaign.elevator_limits, campaign.elevator_rate_limit
    limits = limits_flown(task.records, travel, rate)
    return Foresight(
        campaign=campaign,
        task=task,
        noise=noise,
        explanations=own if explanations is None else explanations,
        place=range_of(campaign, task.records, limits),
    )


def fixed(late):
    """The two explanations with nothing free, one lag wrong enough to show."""
    first = late[3][0]
    scales, layout = first.model.scales, late[1].layout
    slot = layout.index["servo_lag", "time_constant"]
    found = []
    for lag in (0.002, 0.0024):
        theta = first.model.theta.copy()
        theta[slot] = lag
        model = dataclasses.replace(
            first.model, kinds=("servo_lag",), theta=theta, free=(), scales=scales
        )
        found.append(
            Explanation(
                model=model,
                log_evidence=0.0,
                probability=0.5,
                precision=np.zeros((0, 0)),
            )
        )
    return tuple(found)


def test_foreseen_evidence_is_the_mean_of_noisy_flights(late):
    """Δ and its variance 2 Δ, over flights with the noise of the sensors."""
    campaign, task, noise, _ = late
    pair = fixed(late)
    foresight = foresight_of(late, pair)
    throw = flown_throw(task.records[0])
    [grams] = foresight.grams(foresight.logs([throw]))
    foreseen = foresight.distances(grams)[0, 1]
    assert foreseen > 2.0  # Else the test would show nothing.
    scales, rng = pair[0].model.scales, np.random.default_rng(0)
    clean = log_of(throw, foresight.place, task.layout, pair[0].model.theta, NO_FIELD)
    gained = []
    for _ in range(60):
        pose = clean.pose + rng.normal(size=clean.pose.shape) * (
            scales.position,
            scales.position,
            scales.pitch,
        )
        angle = clean.elevator + scales.elevator * rng.normal(size=len(clean.time))
        noisy = dataclasses.replace(clean, pose=pose, elevator=angle)
        [record] = prepare([noisy], campaign, noise, task.layout, maps=foresight.maps)
        costs = [
            whiten(linearize(record, e.model.theta, NO_FIELD), scales).cost
            for e in pair
        ]
        gained.append(costs[1] - costs[0])
    error = np.sqrt(2.0 * foreseen / len(gained))
    assert np.mean(gained) == pytest.approx(foreseen, abs=3.5 * error)
    assert np.var(gained) == pytest.approx(2.0 * foreseen, rel=0.6)


def test_free_numbers_take_away_what_they_can_explain(late):
    """A lag that may be refitted is no rival of the same lag."""
    _, task, _, explanations = late
    lag = next(e for e in explanations if e.model.kinds == ("servo_lag",))
    theta = lag.model.theta.copy()
    theta[task.layout.index["servo_lag", "time_constant"]] *= 1.1
    moved = dataclasses.replace(lag, model=dataclasses.replace(lag.model, theta=theta))
    loose = dataclasses.replace(moved, precision=1e-3 * lag.precision)
    throw = flown_throw(task.records[0])
    foreseen = []
    for rival in (moved, loose):
        foresight = foresight_of(late, (lag, rival))
        [grams] = foresight.grams(foresight.logs([throw]))
        foreseen.append(foresight.distances(grams)[0, 1])
        total = 0.5 * grams[0, 1][-1, -1]
        assert foreseen[-1] < total
    assert foreseen[1] < 0.05 * foreseen[0]


def test_chance_and_surprise_of_two(late):
    first = late[3][0]
    pair = tuple(dataclasses.replace(first, probability=0.5) for _ in range(2))
    foresight = foresight_of(late, pair)
    apart = np.array([[0.0, 1.0], [1.0, 0.0]])
    assert foresight.chance(0.0 * apart) == pytest.approx(0.5)
    for delta in (0.1, 1.0, 4.0):
        expected = norm.cdf(np.sqrt(0.5 * delta))
        assert foresight.chance(delta * apart) == pytest.approx(expected)
    surprises = [foresight.surprise(d * apart) for d in (0.0, 0.01, 1.0, 50.0)]
    assert surprises[0] == pytest.approx(np.log(2.0))
    assert np.all(np.diff(surprises) < 0.0)
    assert surprises[-1] == pytest.approx(0.0, abs=1e-12)


def test_more_flights_tell_more_and_leave_less_open(late):
    foresight = foresight_of(late)
    throws = [flown_throw(r) for r in late[1].records[:2]]
    grams = foresight.grams(foresight.logs(throws))
    both = added(grams)
    apart = [foresight.distances(g) for g in (grams[0], both, times(both, 10.0))]
    off = ~np.eye(len(late[3]), dtype=bool)
    assert np.all(apart[0][off] < apart[1][off])
    assert np.all(apart[1][off] < apart[2][off])
    before, after = foresight.covariance(), foresight.covariance(both)
    assert np.all(np.diag(after) < np.diag(before))
