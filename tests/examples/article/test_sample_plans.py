"""Sampled plans: what searches find, and what planning again is worth in flight."""

import numpy as np
import pytest

import sample_plans
from glider.physics.model import GliderModel
from tests.helpers.examples import run_main


@pytest.fixture(scope="module")
def found():
    return sample_plans.fly(GliderModel.load("set_wing"), searches=3, launches=3)


@pytest.fixture(scope="module")
def output(found, tmp_path_factory):
    folder = tmp_path_factory.mktemp("sampled")
    return run_main(sample_plans, found, folder, "--searches=3", "--launches=3")


def test_planning_anew_perches_where_a_replayed_plan_misses(found):
    flown = found.flown
    assert len(flown.replanned) == 3
    assert flown.replanned.perched >= 2
    assert flown.replayed.perched == flown.tracked.perched == 0
    assert np.median(flown.replanned.misses) < 0.05
    assert min(*flown.replayed.misses, *flown.tracked.misses) > 0.05
    assert flown.real_time_factor > 0.0


@pytest.mark.parametrize(
    ("method", "least", "largest"), [("CEM", 8.0, 15.0), ("MPPI", 11.0, 15.5)]
)
def test_searches_come_near_the_plan(found, method, least, largest):
    costs = found.searches.histories()[method]
    assert costs.shape == (3, 101)
    assert least < np.median(costs[:, -1]) < largest
    assert len(np.unique(costs[:, -1])) == 3  # Each has a seed of its own.


def test_one_core_flies_thousands_of_samples_a_second(found):
    assert found.searches.flights_per_second > 1000.0


def test_the_result_is_reported(output, found):
    receding, flown = output.figures["receding"], found.flown
    assert receding.pop("truth") == "set_wing"
    assert receding.pop("real_time_factor") == flown.real_time_factor
    assert receding == {
        **flown.replanned.key_figures(),
        "open_loop_miss_m": flown.replayed.misses,
        "open_loop_perched": 0,
        "tracking_miss_m": flown.tracked.misses,
        "tracking_perched": 0,
    }
    for method, runs in found.searches.histories().items():
        costs = output.figures[method.lower()]
        assert costs["cost"] == np.median(runs, axis=0).tolist()
        assert np.all(np.array(costs["lowest"]) <= costs["cost"])
        assert np.all(np.array(costs["highest"]) >= costs["cost"])
    speed = found.searches.flights_per_second
    assert output.figures["rollouts_per_second"] == speed
    assert output.figures["seed"] == 0
    assert f"replanning: {flown.replanned.describe()}" in output.words
    assert output.asked.call_args.args[1:4] == (3, 3, 0)


def test_it_is_drawn_and_animated(output):
    assert output.size == (1425, 1500)
    assert output.ink > 0.05
    assert ">MPPI: set_wing<" in output.page
    for words in ("replanned", "replayed", "plan of the nominal model"):
        assert f">{words}<" in output.page
