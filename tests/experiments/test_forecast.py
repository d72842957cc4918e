"""What is predicted of throws is what flying them brings."""

import dataclasses

import numpy as np
import pytest
from scipy.stats import multivariate_normal, norm

from glider.experiments.explanations import Explanation
from glider.experiments.forecast import Forecast, added
from glider.experiments.throw_limits import ThrowLimits
from glider.experiments.throws import log_of, range_of
from glider.physics.effects import NO_GAUSSIANS
from glider.sysid.likelihood.filtering import whiten
from glider.sysid.likelihood.linear_flight import linearize
from glider.sysid.replay.record import prepare
from tests.helpers.late import flown_throw


def forecast_of(late, explanations=None):
    campaign, task, noise, own = late
    wide = ThrowLimits(x=(-9.0, 9.0), z=(-9.0, 9.0), pitch=(-3.0, 3.0), speed=50.0)
    return Forecast(
        campaign=campaign,
        task=task,
        noise=noise,
        explanations=own if explanations is None else explanations,
        place=range_of(campaign, task.records, wide),
    )


def grams_of(forecast, throws):
    return [predicted.grams for predicted in forecast.predict(throws)]


def fixed(late):
    """The two explanations with nothing free, one lag wrong enough to show."""
    first = late[3][0]
    # Elevators may begin anywhere: the noisy flights all begin at zero.
    scales = dataclasses.replace(first.model.scales, rest=0.1)
    space = late[1].space
    slot = space.index["servo_lag.time_constant"]
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


def test_predicted_evidence_is_the_mean_of_noisy_flights(late):
    """Δ and its variance 2 Δ, over flights with the noise of the sensors."""
    campaign, task, noise, _ = late
    pair = fixed(late)
    forecast = forecast_of(late, pair)
    throw = flown_throw(task.records[0])
    [grams] = grams_of(forecast, [throw])
    predicted = forecast.distances(forecast.futures(grams))[0, 1]
    assert predicted > 2.0  # Else the test would show nothing.
    scales, rng = pair[0].model.scales, np.random.default_rng(0)
    clean = log_of(throw, forecast.place, task.space, pair[0].model.theta, NO_GAUSSIANS)
    gained = []
    for _ in range(60):
        pose = clean.pose + rng.normal(size=clean.pose.shape) * (
            scales.position,
            scales.position,
            scales.pitch,
        )
        angle = clean.elevator + scales.elevator * rng.normal(size=len(clean.time))
        noisy = dataclasses.replace(clean, pose=pose, elevator=angle)
        [record] = prepare([noisy], campaign, noise, task.space)
        costs = [
            whiten(linearize(record, e.model.theta, NO_GAUSSIANS), scales).cost
            for e in pair
        ]
        gained.append(costs[1] - costs[0])
    error = np.sqrt(2.0 * predicted / len(gained))
    assert np.mean(gained) == pytest.approx(predicted, abs=3.5 * error)
    assert np.var(gained) == pytest.approx(2.0 * predicted, rel=0.6)
    drawn = forecast.futures(grams)[0]
    drawn = drawn[:, 0] - drawn[:, 1]
    assert np.mean(gained) == pytest.approx(np.mean(drawn), abs=3.5 * error)
    assert np.std(gained) == pytest.approx(np.std(drawn), rel=0.4)


def test_free_numbers_take_away_what_they_can_explain(late):
    """A lag that may be refitted is no rival of the same lag."""
    _, task, _, explanations = late
    lag = next(e for e in explanations if e.model.kinds == ("servo_lag",))
    theta = lag.model.theta.copy()
    theta[task.space.index["servo_lag.time_constant"]] *= 1.1
    moved = dataclasses.replace(lag, model=dataclasses.replace(lag.model, theta=theta))
    loose = dataclasses.replace(moved, precision=1e-3 * lag.precision)
    throw = flown_throw(task.records[0])
    predicted = []
    for rival in (moved, loose):
        forecast = forecast_of(late, (lag, rival))
        [grams] = grams_of(forecast, [throw])
        # The room that a loose rival had beforehand is no part of what is told.
        odds = forecast.odds(grams[0], np.zeros((1, len(grams[0]))))[0]
        room = 0.5 * np.log(
            1.0
            + grams[0][[0, 2], [0, 2]] / [lag.precision[0, 0], rival.precision[0, 0]]
        )
        predicted.append((odds + room) @ [1.0, -1.0])
    assert predicted[1] < 0.05 * predicted[0]


def alike(late, probabilities, precision=0.0):
    """Explanations that differ in nothing but how probable they are."""
    first = late[3][0]
    return tuple(
        dataclasses.replace(
            first, probability=p, precision=first.precision * (1.0 + precision * k)
        )
        for k, p in enumerate(probabilities)
    )


def test_throws_that_show_nothing_leave_the_posterior_of_today(late):
    forecast = forecast_of(late, alike(late, (0.6, 0.3)))
    nothing = tuple(np.zeros((4, 4)) for _ in range(2))
    futures = forecast.futures(nothing)
    assert np.exp(futures) == pytest.approx(
        np.broadcast_to([2 / 3, 1 / 3], (2, 128, 2))
    )
    assert forecast.chance(futures) == pytest.approx(0.6)


def test_a_chance_leaves_room_for_what_is_not_among_the_rivals(late):
    """However much throws tell."""
    forecast = forecast_of(late, fixed(late))
    told = np.array([[0.0, 0.0], [0.0, 900.0]])  # Δ of 450 nats.
    futures = forecast.futures((told, told[::-1, ::-1]))
    assert forecast.chance(futures) == pytest.approx(1.0)
    some = tuple(
        dataclasses.replace(e, probability=0.45) for e in forecast.explanations
    )
    forecast = dataclasses.replace(forecast, explanations=some)
    futures = forecast.futures((told, told[::-1, ::-1]))
    assert forecast.chance(futures) == pytest.approx(0.9)


@pytest.mark.parametrize("delta", [0.1, 1.0, 4.0])
def test_the_chance_of_two_is_that_of_their_bayes_factor(late, delta):
    """Φ(√(Δ/2)), where log K ~ N(Δ, 2 Δ) and nothing is free."""
    forecast = forecast_of(late, fixed(late))
    told = 2.0 * delta * np.diag([0.0, 1.0])
    futures = forecast.futures((told, told[::-1, ::-1]))
    expected = norm.cdf(np.sqrt(0.5 * delta))
    assert forecast.chance(futures) == pytest.approx(expected, abs=0.03)
    assert forecast.distances(futures)[0, 1] == pytest.approx(delta, rel=1e-9)


def test_more_flights_show_more_and_leave_less_open(late):
    forecast = forecast_of(late)
    throws = [flown_throw(r) for r in late[1].records[:2]]
    grams = grams_of(forecast, throws)
    both = added(grams)
    told = [forecast.futures(g) for g in (grams[0], both, added([both] * 10))]
    opens = [forecast.open(f) for f in told]
    assert opens[0] > opens[1] > opens[2] > 0.0
    before, after = forecast.covariance(), forecast.covariance(both)
    assert np.all(np.diag(after) < np.diag(before))


def made_up(late, rng, apart=1.0):
    """Two explanations with two free numbers each, and a throw's columns (30, 6)."""
    columns = rng.normal(size=(30, 6))
    columns[:, [2, 5]] *= apart / np.sqrt(30.0)
    columns[:, 2] = 0.0  # The first is true.
    explanations = []
    for k, p in enumerate((0.6, 0.4)):
        root = rng.normal(size=(2, 2))
        model = dataclasses.replace(
            late[3][0].model,
            free=tuple(late[1].space.slots_of("wind")),
            theta=late[1].vehicle.theta,
        )
        explanations.append(
            Explanation(
                model=model,
                log_evidence=0.0,
                probability=p,
                precision=(0.3 + k) * (root @ root.T + np.eye(2)),
            )
        )
    return tuple(explanations), columns


def test_odds_are_those_of_normal_distributions(late):
    """N(y; model k, 1 + X_k A_k⁻¹ X_k'), with no formula of the squares."""
    rng = np.random.default_rng(3)
    explanations, columns = made_up(late, rng)
    forecast = forecast_of(late, explanations)
    shift = rng.normal(size=30)  # X_i δ + ν, of one future.
    odds = forecast.odds(columns.T @ columns, (shift @ columns)[None])[0]
    whole = []
    for e, first in zip(explanations, (0, 3), strict=True):
        x = columns[:, first : first + 2]
        covariance = np.eye(30) + x @ np.linalg.inv(e.precision) @ x.T
        seen = columns[:, first + 2] + shift
        density = multivariate_normal(np.zeros(30), covariance).logpdf(seen)
        whole.append(np.log(e.probability) + density)
    assert odds[0] - odds[1] == pytest.approx(whole[0] - whole[1], rel=1e-9)


def test_futures_are_drawn_as_the_flights_leave_the_numbers(late):
    """Mean and spread of the log-odds by drawing δ and ν row by row."""
    rng = np.random.default_rng(4)
    explanations, columns = made_up(late, rng, apart=2.0)
    forecast = forecast_of(late, explanations)
    gram = columns.T @ columns
    drawn = forecast.futures((gram, gram))[0]
    drawn = drawn[:, 0] - drawn[:, 1]
    root = np.linalg.cholesky(np.linalg.inv(explanations[0].precision))
    numbers = np.clip(rng.normal(size=(4000, 2)) @ root.T, *_bounds(late))
    shifts = numbers @ columns[:, :2].T + rng.normal(size=(4000, 30))
    odds = forecast.odds(gram, shifts @ columns)
    odds = odds[:, 0] - odds[:, 1]
    assert np.mean(drawn) == pytest.approx(np.mean(odds), abs=0.3 * np.std(odds))
    assert np.std(drawn) == pytest.approx(np.std(odds), rel=0.25)


def _bounds(late):
    task = late[1]
    slots = list(task.space.slots_of("wind"))
    own = task.vehicle.theta[slots]
    return task.space.lower[slots] - own, task.space.upper[slots] - own
