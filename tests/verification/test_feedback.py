"""A feedback that is made with a funnel's shape brings V down, as fast as it may."""

import dataclasses

import numpy as np
import pytest

from glider.control.tvlqr import tracking_policy
from glider.errors import InputError
from glider.physics.model import GliderModel
from glider.physics.state import ELEVATOR
from glider.verification.dynamics.nominal import make_nominal
from glider.verification.funnel.servo_limits import SHARE, steepest_gains
from glider.verification.funnel.settings import FunnelSettings
from glider.verification.funnel.shape_flow import FunnelTask, ShapeFlow
from glider.verification.sos.forms import linear_part
from tests.verification.points import sphere_points

RATE = 9.0


@pytest.fixture(scope="module")
def nominal(article_plan):
    """The article's flight, without its first half."""
    plan, model = article_plan, GliderModel()
    arrays = {name: getattr(plan, name)[20:] for name in ("states", "slopes", "inputs")}
    plan = dataclasses.replace(plan, times=plan.times[20:] - plan.times[20], **arrays)
    return make_nominal(model, tracking_policy(model, plan), 0.011)


def test_the_commands_slopes_are_those_of_the_closed_loop(nominal):
    """F₁ = A - B K: with gains of 1 on one state less, its column differs by B."""
    more = nominal.gains.copy()
    more[:, 2] += 1.0
    changed = linear_part(dataclasses.replace(nominal, gains=more).closed_loop)
    difference = linear_part(nominal.closed_loop) - changed
    slopes = nominal.push_slopes[:, :, 0, 0]
    np.testing.assert_allclose(difference[:, :, 2], slopes, atol=1e-9)
    np.testing.assert_allclose(slopes[:, ELEVATOR], 1.0)


def test_no_command_of_this_size_brings_v_down_faster(funnel, nominal):
    """V̇ = ... - 2 eᵀ S B K e: the most, where e is worst, is what the rate allows."""
    S, slopes = funnel.S[60], nominal.push_slopes[:, :, 0, 0][10]
    gains = steepest_gains(S, slopes, RATE, 1e9)
    boundary = sphere_points(5000, 7) @ np.linalg.inv(np.linalg.cholesky(S))
    largest = np.sqrt(gains @ np.linalg.solve(S, gains))
    assert largest == pytest.approx(SHARE * RATE)
    assert largest < RATE
    commands = boundary @ gains
    assert np.abs(commands).max() <= largest
    fall = commands * (boundary @ S @ slopes)
    assert np.all(fall >= 0.0)
    bound = SHARE * RATE * np.sqrt(slopes @ S @ slopes)
    assert fall.max() <= bound
    worst = slopes / np.sqrt(slopes @ S @ slopes)
    assert (gains @ worst) * (worst @ S @ slopes) == pytest.approx(bound)
    slow = steepest_gains(S, slopes, RATE, 2.0)
    assert slow[ELEVATOR] == pytest.approx(2.0)
    np.testing.assert_allclose(slow / slow[ELEVATOR], gains / gains[ELEVATOR])


@pytest.mark.nightly
def test_a_launch_may_err_by_more_with_it(nominal):
    settings = FunnelSettings(step=0.011, hold=0.088, elevator_gain=40.0)
    task = FunnelTask(nominal, settings, sphere_points(1, 7))
    with_it, without = ShapeFlow(task, steer=True), ShapeFlow(task)
    given = nominal.gains.copy()
    heights = [flow.run()[0, 1, 1] ** -0.5 for flow in (with_it, without)]
    assert heights[0] > 1.1 * heights[1]
    np.testing.assert_array_equal(nominal.gains, given)
    assert without.nominal is nominal
    assert with_it.nominal.gains[:, ELEVATOR].max() <= 40.0 + 1e-9


def test_a_gain_below_zero_is_refused():
    with pytest.raises(InputError, match="'elevator_gain' is -1"):
        FunnelSettings(elevator_gain=-1.0)
