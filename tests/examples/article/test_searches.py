"""Searches keep what they found, and of the first what they drew."""

import numpy as np
import pytest

from glider.paths import models_path
from glider.physics.model import GliderModel
from glider.physics.parameters import load_parameters
from glider.planning.problem import PerchingProblem
from glider.planning.sampling import SequenceCost
from sampling_planners import cem, mppi
from searches import search_plans, spread

SHOWN = (1, 5)


@pytest.fixture(scope="module")
def cost():
    heavy = load_parameters(models_path("vehicles", "heavy.yaml"))
    article = PerchingProblem.load(models_path("problems", "sampling.yaml"))
    return SequenceCost(GliderModel(parameters=heavy), article)


@pytest.fixture(scope="module")
def launch(cost):
    return np.array(
        PerchingProblem.load(models_path("problems", "sampling.yaml")).launch
    )


@pytest.fixture(scope="module")
def found(cost, launch):
    return search_plans(cost, launch, 2, 7, SHOWN)


def test_each_search_has_a_seed_of_its_own(cost, launch, found):
    for name, search in (("CEM", cem), ("MPPI", mppi)):
        rngs = np.random.default_rng(7).spawn(2)
        for plan, rng in zip(found.plans[name], rngs, strict=True):
            alone = search(cost, launch, rng)
            np.testing.assert_array_equal(plan.inputs, alone.inputs)
            assert plan.costs == alone.costs
        first, second = found.plans[name]
        assert np.any(first.inputs != second.inputs)


def test_of_the_first_search_the_chosen_iterations_are_kept(cost, launch, found):
    for name, search in (("CEM", cem), ("MPPI", mppi)):
        drawn = {}
        rng, _ = np.random.default_rng(7).spawn(2)
        search(cost, launch, rng, watch=drawn.__setitem__)
        assert tuple(found.drawn[name]) == SHOWN
        for k in SHOWN:
            np.testing.assert_array_equal(found.drawn[name][k], drawn[k])


def test_the_histories_are_the_costs_of_all(found):
    for name, costs in found.histories().items():
        assert costs.shape == (2, 101)
        np.testing.assert_array_equal(costs[1], found.plans[name][1].costs)
        output = spread(costs)
        np.testing.assert_array_equal(output["cost"], np.mean(costs, axis=0))
        np.testing.assert_array_equal(output["lowest"], np.min(costs, axis=0))
        np.testing.assert_array_equal(output["highest"], np.max(costs, axis=0))
