"""A perch: planned, replayed, and flown from perturbed launches."""

import numpy as np
import pytest

from examples import perch
from tests.helpers.examples import run_main


@pytest.fixture(scope="module")
def flown():
    return perch.fly(launches=4)


@pytest.fixture(scope="module")
def output(flown, tmp_path_factory):
    return run_main(perch, flown, tmp_path_factory.mktemp("perch"), "--launches=4")


def test_the_plan_is_the_articles(flown):
    assert flown.plan.cost == pytest.approx(194.05, abs=0.1)
    assert flown.plan.duration == pytest.approx(0.8795, abs=1e-3)
    assert len(flown.plan.times) == 41
    assert flown.plan.max_defect < 1e-5


def test_feedback_brings_launches_to_the_wire_that_a_replay_misses(flown):
    assert flown.replayed.misses[0] < 0.001
    assert len(flown.blind) == len(flown.flights) == flown.flights.perched == 4
    assert np.median(flown.flights.misses) < 0.1 * np.median(flown.blind.misses)
    assert flown.flights.worst.miss == max(flown.flights.misses)


def test_both_fly_the_same_launches(flown):
    starts = [
        [flight.states[0] for flight in flights]
        for flights in (flown.blind, flown.flights)
    ]
    np.testing.assert_array_equal(*starts)
    again = perch.fly(launches=1, seed=1).flights[0]
    assert not np.allclose(again.states[0], starts[0][0])


def test_the_result_is_reported(output, flown):
    figures = output.figures
    assert figures["closed_loop"] == flown.flights.key_figures()
    assert figures["open_loop_from_launches"] == flown.blind.key_figures()
    assert figures["open_loop_miss_m"] == flown.replayed.misses[0]
    assert (figures["launches"], figures["seed"]) == (4, 0)
    assert (figures["knots"], figures["cost"]) == (41, flown.plan.cost)
    assert figures["duration"] == flown.plan.duration
    assert figures["max_defect"] == flown.plan.max_defect < figures["path_defect"]
    assert figures["plan_seconds"] > 0.0
    assert "194.05" in output.words
    assert "With feedback 4 of 4 launches perch" in output.words


def test_it_is_drawn_and_animated(output):
    assert output.size == (1425, 840)
    assert output.ink > 0.02
    for words in ("Perch", "worst launch", "plan"):
        assert f">{words}<" in output.page


def test_the_options_reach_the_story(flown, tmp_path):
    output = run_main(perch, flown, tmp_path, "--launches=7", "--seed=3")
    assert output.asked.call_args.args[:2] == (7, 3)
    assert output.figures["seed"] == 3
