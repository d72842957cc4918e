"""Which launches can perch at all: a plan for each."""

import dataclasses

import numpy as np
import pytest

from examples import launch_map
from glider.errors import InputError
from glider.physics.model import GliderModel
from glider.planning import reach
from glider.planning.dircol import PlanningError, plan
from glider.planning.problem import PerchingProblem
from tests.helpers.examples import run_main


@pytest.fixture(scope="module")
def found():
    problem = PerchingProblem()
    launches = np.tile(problem.launch, (6, 1))
    launches[:, 4] = [4.5, 5.0, 5.5, 6.5, 7.0, 8.0]
    planned = reach.find_reach(GliderModel(), problem, launches)
    return launch_map.LaunchMap(launches=launches, planned=planned, seconds=1.0)


@pytest.fixture(scope="module")
def output(found, tmp_path_factory):
    folder, writes = tmp_path_factory.mktemp("map"), ("--json", "--figure")
    arguments = ("--launches=6", "--headless")
    return run_main(launch_map, found, folder, *arguments, writes=writes)


def test_slow_launches_have_no_plan(found):
    assert found.planned.tolist() == [False, False, False, True, True, True]


def test_the_answers_are_those_of_plan(found):
    slow, fast = (
        dataclasses.replace(PerchingProblem(), launch=found.launches[k].tolist())
        for k in (2, 3)
    )
    assert plan(GliderModel(), fast).attempts
    with pytest.raises(PlanningError):
        plan(GliderModel(), slow)


def test_what_is_reported(output, found):
    assert "3 of 6 launches have a plan" in output.words
    assert output.figures["planned"] == found.planned.tolist()
    assert output.ink > 0.02


def test_launches_are_drawn_within_the_box_and_shared_by_workers(monkeypatch):
    asked = []

    def find(model, problem, launches, progress=None):
        asked.append(launches)
        return np.ones(len(launches), dtype=bool)

    monkeypatch.setattr(launch_map.reach, "find_reach", find)
    launch_map.run(50, seed=1)
    drawn = asked[-1]
    assert drawn.shape == (50, 7)
    for column, (low, high) in ((1, (-0.8, 0.8)), (2, (-0.4, 0.4)), (4, (4.5, 9.5))):
        assert low < drawn[:, column].min() < drawn[:, column].max() < high
    assert np.all(drawn[:, 0] == -3.5)


def test_launches_that_are_no_states_are_refused():
    with pytest.raises(InputError, match=r"\[3\]"):
        reach.find_reach(GliderModel(), PerchingProblem(), np.zeros(3))
