"""Errors on the flights most unlike the others, where random ones are like the rest."""

import dataclasses

import numpy as np
import pytest

from glider.physics.effects.free_functions import FLOW_UNITS
from glider.simulation.campaigns import CampaignPlan
from glider.sysid.fit.floor import PerfectModel
from glider.sysid.fit.prediction import flown_by, mean_squares, predict
from glider.sysid.fit.unlike import find_unlike, predict_unlike
from glider.sysid.likelihood.model_fit import fit_model
from glider.sysid.replay.log_space import vector_of
from glider.sysid.replay.replayed import make_table
from glider.sysid.result import ResidualTable
from tests.helpers.known_truth import begin, task_of
from tests.helpers.unlike import STALLING, shallow_and_deep


def table_of(features, rows=30):
    """A table of flights (F,), each along a ramp from zero to its feature in V."""
    count = len(features)
    ramps = np.outer(features, np.linspace(0.0, 1.0, rows)).ravel()
    nothing = np.zeros((count * rows, 3))
    return ResidualTable(
        variables={**dict.fromkeys(FLOW_UNITS, np.zeros(count * rows)), "V": ramps},
        residual=nothing,
        coefficients={},
        modelled={},
        flight=np.repeat(np.arange(count), rows),
        names=tuple(f"flight_{i:03d}.csv" for i in range(count)),
        noise=nothing,
    )


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_those_beyond_the_widest_gap_are_unlike_the_others(sign):
    """Five of twenty are 2 m/s faster, or slower."""
    features = 6.0 + 0.1 * np.random.default_rng(0).random(20)
    features[[1, 4, 5, 11, 17]] += sign * 2.0
    is_unlike, difference = find_unlike(table_of(features))
    assert np.flatnonzero(is_unlike).tolist() == [1, 4, 5, 11, 17]
    assert (difference.what, difference.unit) == ("largest V", "m/s")
    assert difference.value == pytest.approx(np.median(features[is_unlike]))
    assert difference.others == pytest.approx(np.median(features[~is_unlike]))


@pytest.mark.parametrize(
    ("count", "least", "most"), [(3, 1, 1), (8, 1, 3), (40, 4, 16)]
)
def test_about_a_fifth_of_the_flights_is_left_out(count, least, most):
    """Half as many or twice at most, wherever the gaps are."""
    for seed in range(10):
        features = np.random.default_rng(seed).normal(6.0, 1.0, count)
        is_unlike, _ = find_unlike(table_of(features))
        assert least <= np.count_nonzero(is_unlike) <= most
        own, others = features[is_unlike], features[~is_unlike]
        assert own.min() > others.max() or own.max() < others.min()


def test_never_most_flights_are_left_out():
    """Where ten of twenty are apart, no group of eight is."""
    features = np.random.default_rng(0).normal(6.0, 0.1, 20)
    features[:10] += 2.0
    is_unlike, _ = find_unlike(table_of(features))
    assert 2 <= np.count_nonzero(is_unlike) <= 8


def test_flights_that_are_all_alike_are_no_error():
    is_unlike, _ = find_unlike(table_of(np.full(10, 6.0)))
    assert 1 <= np.count_nonzero(is_unlike) <= 4


def fit_truth(campaign):
    """A campaign's task, and the right model fitted to all of its flights."""
    task, noise = task_of(campaign)
    start = begin(task, noise, ["attached_lift"])
    start = dataclasses.replace(start, theta=vector_of(STALLING))
    return task, fit_model(task, start)


def unlike_of(task, model):
    count = len(task.records)
    table = make_table(task.records, model.theta, [0.0] * count, model.gaussians)
    truth = model.scales.without_floors
    rng = np.random.default_rng(0)
    perfect = PerfectModel(truth=truth, pitch_ratio=1e-4, rng=rng)
    models = {"corrected": model}
    flying = {"corrected": flown_by(task, model, model.scales)}
    return predict_unlike(task, models, flying, None, table, perfect)


def test_what_only_few_flights_show_is_not_known_without_them():
    """A stall, of which flights below it show nothing: each of them is predicted well.

    Flights held out at random are, and so are the deep ones if the model has seen them.
    """
    task, model = fit_truth(shallow_and_deep(12, 3))
    flown = flown_by(task, model, model.scales)
    squares = mean_squares(task.records, [predict(flown, r) for r in task.records])
    assert np.all(squares[:, 0] < 0.006**2)
    unlike = unlike_of(task, model)
    assert unlike.flights == tuple(f"flight_{i:03d}.csv" for i in range(12, 15))
    assert unlike.difference.what == "largest alpha"
    assert unlike.left.position_m > 0.01
    assert unlike.left.ratio_to_floor > 4.0 and unlike.left.exceeds_chance
    assert "within the flown range only" in unlike.warning


def test_what_all_flights_show_is_known_without_the_most_unlike():
    """All are deep: the stall is known from any of them."""
    campaign = CampaignPlan(flights=10).simulate(STALLING, np.random.default_rng(3))
    unlike = unlike_of(*fit_truth(campaign))
    assert unlike.left.position_m < 0.005
    assert not unlike.left.exceeds_chance
