"""The oracle's limits are the standard errors of fits, and fall with √N."""

import numpy as np
import pytest
from scipy.stats import norm

from glider.design.power import limits_of
from glider.studies.known_truth import begin, task_of
from glider.sysid.likelihood.directions import slopes
from glider.sysid.likelihood.model_fit import fit_model, grams_of, linear_flights
from tests.helpers.tasks import fly


@pytest.fixture(scope="module")
def still():
    task, noise = task_of(fly(flights=6))
    return task, noise, fit_model(task, begin(task, noise))


@pytest.fixture(scope="module")
def limits(still):
    task, _, model = still
    return {(x.kind, x.name): x for x in limits_of(task, model)}


def test_every_effect_has_a_limit(still, limits):
    assert {kind for kind, _ in limits} == set(still[0].kinds)
    assert all(np.isfinite(x.std) and x.std > 0.0 for x in limits.values())


def test_four_times_the_flights_show_half_the_size(limits):
    limit = limits["mass", "change"]
    assert limit.smallest(40) == pytest.approx(0.5 * limit.smallest(10))
    # A test at 1 %, two-sided, has 95 % power there.
    power = norm.sf(norm.ppf(0.995) - limit.smallest(9) / (limit.std / 3.0))
    assert power == pytest.approx(0.95)


@pytest.mark.parametrize(
    "key", [("mass", "change"), ("servo_lag", "time_constant"), ("camber", None)]
)
def test_a_limit_is_the_standard_error_of_a_fit(still, limits, key):
    """Of all six flights, with the same scales."""
    task, noise, model = still
    limit = next(x for k, x in limits.items() if k[0] == key[0])
    fitted = fit_model(task, begin(task, noise, (limit.kind,)), free_scales=())
    columns = slopes(task.layout, fitted.theta, fitted.free)
    grams = grams_of(linear_flights(task, fitted, columns), model.scales)
    error = np.sum(grams, axis=0)[0, 0] ** -0.5
    assert limit.std / np.sqrt(6.0) == pytest.approx(error, rel=0.05)
