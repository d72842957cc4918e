"""Held commands: what a predictor makes of their latency, and what it flies."""

import numpy as np
import pytest

from glider.control.predictor import Hold, flown_under, held_command, policy_command
from glider.control.tvlqr import tracking_policy
from glider.errors import InputError
from glider.physics.model import GliderModel
from glider.simulation.fly import fly
from tests.helpers.second_flight import advance, rates_of


@pytest.fixture(scope="module")
def policy(article_plan):
    return tracking_policy(GliderModel(), article_plan)


def near(policy, count=5, time=0.3):
    """States near the plan at a time."""
    rng = np.random.default_rng(0)
    k = np.argmin(np.abs(policy.plan.times - time))
    sizes = 0.02 * np.array([1.0, 1.0, 1.0, 1.0, 3.0, 3.0, 5.0])
    states = policy.plan.states[k] + sizes * rng.normal(size=(count, 7))
    return np.full(count, policy.plan.times[k]), states


def test_a_prediction_is_what_the_glider_then_does(policy):
    """Under two commands on their way, then the feedback, by steps a tenth as long."""
    model = GliderModel()
    times, states = near(policy)
    hold = Hold(period=0.02, latency=0.03)
    assert (hold.waiting, hold.rest) == (1, pytest.approx(0.01))
    waiting = [np.full(5, 3.0), np.full(5, -2.0)]
    found = held_command(model, policy, times, states, waiting, hold)

    x, step = states.copy(), 1e-4
    for k in range(400):  # To the middle of its hold, 0.04 s later.
        fixed = 3.0 if k < 100 else -2.0
        t = times + k * step

        def slope(x, since, k=k, fixed=fixed, t=t):
            own = policy_command(policy, t + since, x)
            return rates_of(model, x, np.full(5, fixed) if k < 300 else own)

        x = advance(slope, x, step)
    expected = policy_command(policy, times + 0.04, x)
    assert found == pytest.approx(expected, abs=2e-3)
    assert np.abs(found - policy_command(policy, times, states)).min() > 0.1


def test_held_predictions_fly_as_the_feedback_that_acts_at_once(policy, article_plan):
    """Of second order in the period; the state as it is, of first."""
    model, start = GliderModel(), near(policy, 4, 0.0)[1]
    ideal = fly(model, policy, start, keep_paths=True, after=0.0)
    end, errors = ideal.paths[:, -1], {}
    for predicts in (False, True):
        for period in (0.02, 0.01):
            hold = Hold(period=period)
            x, t = start.copy(), np.zeros(4)
            while t[0] < policy.duration - 1e-9:
                span = min(period, policy.duration - t[0])
                u = policy_command(policy, t, x)
                if predicts:
                    u = held_command(model, policy, t, x, [np.zeros(4)], hold)
                x = flown_under(model, x, span, u)
                t = t + span
            errors[predicts, period] = np.abs(x - end).max()
    assert errors[True, 0.02] < 0.3 * errors[False, 0.02]
    assert errors[True, 0.01] < 0.3 * errors[True, 0.02]
    assert errors[False, 0.01] > 0.4 * errors[False, 0.02]


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"period": 0.0}, "the period of commands is 0.0; expected 0.001 to 1 s"),
        ({"period": np.nan}, "the period of commands is nan"),
        ({"latency": -0.01}, "the latency is -0.01; expected 0 to 1 s"),
        ({"latency": np.inf}, "the latency is inf"),
    ],
)
def test_times_out_of_range_are_refused(changes, words):
    with pytest.raises(InputError, match=words):
        Hold(**changes)


@pytest.mark.parametrize("share", [0.0, 0.3, 1.0, 2.0, 2.7])
def test_a_latency_is_whole_periods_and_a_rest(share):
    hold = Hold(period=0.02, latency=share * 0.02)
    assert hold.waiting == int(share)
    assert hold.waiting * hold.period + hold.rest == pytest.approx(hold.latency)
    assert 0.0 <= hold.rest < hold.period
