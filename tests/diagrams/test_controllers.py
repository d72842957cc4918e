"""Who plans anew copes with what feedback along a plan does not."""

import numpy as np

from diagrams.program import load_truth
from diagrams.studies.controllers import CONTROLLERS, race
from tests.helpers.flights import NOMINAL, PROBLEM


def test_planning_anew_perches_a_wing_that_is_set_otherwise():
    """With the drawn model, which knows nothing of the incidence."""
    raced = race(load_truth("set_wing"), NOMINAL, PROBLEM, [PROBLEM.launch])
    assert tuple(raced.flights) == CONTROLLERS
    assert raced.flights["TVLQR"].perched == 0
    assert raced.flights["MPC"].perched == 1
    assert raced.flights["MPC"].misses[0] < raced.flights["TVLQR"].misses[0]
    assert 35 < len(raced.seconds) < 55
    assert raced.failures == 0
    assert np.median(raced.seconds) > 0.0


def test_all_perch_on_what_a_filter_makes_of_motion_capture():
    """From a launch 2 cm too high that the filter does not know of."""
    start = np.array(PROBLEM.launch)
    start[1] += 0.02
    seeing, filtering = (
        race(NOMINAL, NOMINAL, PROBLEM, [start], unsure=unsure)
        for unsure in (None, 1.0)
    )
    for name in CONTROLLERS:
        assert seeing.flights[name].perched == 1
        assert filtering.flights[name].perched == 1
        assert filtering.flights[name].misses[0] != seeing.flights[name].misses[0]
