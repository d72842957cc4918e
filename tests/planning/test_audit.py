"""The audit tells the worst of a whole path, wherever on it that is."""

import numpy as np
import pytest

from glider.physics.model import GliderModel
from glider.planning import dircol
from glider.planning.audit import path_defect, segment_drift
from glider.planning.point_dynamics import Dynamics
from tests.helpers.flights import PROBLEM, QUICK


@pytest.fixture(params=[1, 20, 39], ids=["early", "middle", "late"])
def shifted(request, article_plan):
    """The states of the article's plan with one knot 1 cm farther."""
    states = article_plan.states.copy()
    states[request.param, 0] += 0.01
    return states


def test_a_shifted_knot_shows_in_the_drift(article_plan, shifted):
    drift = segment_drift(
        Dynamics(GliderModel()), article_plan.times, shifted, article_plan.inputs
    )
    assert drift[0] == pytest.approx(0.01, rel=0.01)
    assert drift[1:].max() < 0.001


def test_a_shifted_knot_shows_in_the_defect_of_the_path(article_plan, shifted):
    """A cubic that makes up 1 cm in h is at most 1.5 / h times 1 cm too fast."""
    defect = path_defect(
        Dynamics(GliderModel()),
        article_plan.times,
        shifted,
        article_plan.slopes,
        article_plan.inputs,
    )
    expected = 1.5 * 0.01 / article_plan.times[1]
    assert defect[0] == pytest.approx(expected, rel=0.05)
    assert np.all(np.isfinite(defect))


def test_a_quick_servo_s_plan_is_flown_in_steps_that_it_can_follow():
    """A flight from knot to knot keeps to the plan, but for the servo's own state."""
    planned = dircol.plan(QUICK, PROBLEM)
    path = planned.times, planned.states, planned.inputs
    assert np.max(segment_drift(Dynamics(QUICK), *path)[:7]) < 0.005
