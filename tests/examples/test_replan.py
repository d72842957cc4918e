"""Tracking a plan, or planning again: three controllers over the same launches."""

import numpy as np
import pytest

from examples import replan
from glider.physics.model import GliderModel
from tests.helpers.examples import run_main
from tests.helpers.flights import NOMINAL, PROBLEM


@pytest.fixture(scope="module")
def raced():
    return replan.race(GliderModel.load("set_wing"), NOMINAL, PROBLEM, [PROBLEM.launch])


def test_planning_again_perches_a_wing_that_is_set_otherwise(raced):
    """With the nominal model, which lacks the incidence."""
    assert tuple(raced.flights) == replan.CONTROLLERS
    assert raced.flights["TVLQR"].perched == 0
    assert raced.flights["MPC"].perched == 1
    assert raced.flights["MPC"].misses[0] < raced.flights["TVLQR"].misses[0]
    assert 35 < len(raced.seconds) < 55
    assert raced.failures == 0
    assert np.median(raced.seconds) > 0.0


def test_all_perch_on_a_filters_estimate_from_motion_capture():
    """From a launch 2 cm too high that the filter is not given."""
    start = np.array(PROBLEM.launch)
    start[1] += 0.02
    seeing, filtering = (
        replan.race(NOMINAL, NOMINAL, PROBLEM, [start], unsure=unsure)
        for unsure in (None, 1.0)
    )
    for name in replan.CONTROLLERS:
        assert seeing.flights[name].perched == 1
        assert filtering.flights[name].perched == 1
        assert filtering.flights[name].misses[0] != seeing.flights[name].misses[0]


def test_the_result_is_reported(raced, tmp_path):
    options = ("--truth=set_wing", "--launches=1", "--seed=2", "--estimated")
    output = run_main(replan, raced, tmp_path, *options)
    assert output.figures == raced.key_figures() | {
        "truth": "set_wing",
        "seed": 2,
        "width": 1.0,
        "corrected": False,
        "estimated": True,
    }
    assert "MPC: 1 of 1 launches perch" in output.words
    truth, *asked = output.asked.call_args.args
    assert (truth, asked) == (GliderModel.load("set_wing"), [1, 2])
    assert output.asked.call_args.kwargs["estimated"] is True
    assert output.size == (1425, 1050)
    assert output.ink > 0.02
    for name in replan.CONTROLLERS:
        assert f">worst by {name}<" in output.page


def test_launches_get_wider(monkeypatch):
    asked = []
    monkeypatch.setattr(replan, "race", lambda *args, **kwargs: asked.append(args))
    for width in (1.0, 3.0):
        replan.run(NOMINAL, 40, width=width)
    near, far = (np.std(starts[:, 1]) for *_, starts in asked)
    assert 2.0 < far / near < 4.5
