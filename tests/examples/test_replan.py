"""Tracking a plan, or planning again: three controllers over the same launches."""

import numpy as np
import pytest

from examples import replan
from glider.physics.model import GliderModel
from tests.helpers.flights import NOMINAL, PROBLEM


def test_planning_again_perches_a_wing_that_is_set_otherwise():
    """With the nominal model, which lacks the incidence."""
    truth = GliderModel.load("set_wing")
    _, flights, plans = replan.race(truth, NOMINAL, PROBLEM, [PROBLEM.launch])
    assert tuple(flights) == replan.CONTROLLERS
    assert flights["TVLQR"].perched == 0
    assert flights["MPC"].perched == 1
    assert flights["MPC"].misses[0] < flights["TVLQR"].misses[0]
    assert 35 < len(plans) < 55
    assert not any(again.failed for again in plans)
    assert min(again.seconds for again in plans) > 0.0


def test_all_perch_on_a_filters_estimate_from_motion_capture():
    """From a launch 2 cm too high that the filter is not given."""
    start = np.array(PROBLEM.launch)
    start[1] += 0.02
    (_, seeing, _), (_, filtering, _) = (
        replan.race(NOMINAL, NOMINAL, PROBLEM, [start], unsure=unsure)
        for unsure in (None, 1.0)
    )
    for name in replan.CONTROLLERS:
        assert seeing[name].perched == 1
        assert filtering[name].perched == 1
        assert filtering[name].misses[0] != seeing[name].misses[0]


@pytest.mark.nightly  # It compiles for a minute.
def test_the_options_reach_the_flights(tmp_path, capsys):
    page, picture = tmp_path / "page.html", tmp_path / "figure.png"
    model = tmp_path / "model.yaml"
    GliderModel.load("set_wing").save(model)
    asked = [f"--model={model}", "--launches=2", "--width=2", "--estimated"]
    replan.main([*asked, "--headless", f"--html={page}", f"--figure={picture}"])
    words = capsys.readouterr().out
    for name in replan.CONTROLLERS:
        assert f"{name}: 2 of 2 launches perch" in words
        assert f">worst by {name}<" in page.read_text(encoding="utf-8")
    assert picture.stat().st_size > 10_000
