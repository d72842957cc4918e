"""A chosen shape costs what the shapes that it was chosen from are worth."""

import dataclasses

import numpy as np
import pytest

from glider.experiments.explanations import _choice_of_shapes
from glider.physics.effects import KINDS
from glider.sysid.likelihood.model_fit import (
    fit_model,
    grams_of,
    linear_flights,
    prior_of,
)
from tests.helpers.tasks import begin, fly, task_of

KIND = "dynamic_stall"


@pytest.fixture(scope="module", params=[0.02, 1.0], ids=["hardly", "well"])
def fitted(request):
    """A task of flights with an effect that they show, and its model."""
    effect = KINDS[KIND](strength=request.param, time_constant=0.08)
    task, noise = task_of(fly(effect, flights=4))
    task = dataclasses.replace(task, kinds=(KIND, "mass"))
    nothing = fit_model(task, begin(task, noise))
    start = begin(task, noise, (KIND,))
    start = dataclasses.replace(start, scales=nothing.scales)
    return request.param, task, fit_model(task, start, free_scales=())


def worth(task, model, late):
    """Returns the log evidence at a shape, fitted again."""
    size, shape = task.space.slots_of(KIND)
    theta = model.theta.copy()
    theta[shape] = late
    own = dataclasses.replace(model, theta=theta, free=(size,))
    own = fit_model(task, own, free_scales=())
    gram = grams_of(linear_flights(task, own), own.scales).sum(axis=0)
    prior = prior_of(task, own).precision
    return -own.cost + 0.5 * np.log(prior[0] / (gram[0, 0] + prior[0]))


def test_the_cost_is_that_of_fits_at_each_shape(fitted):
    size, task, model = fitted
    _, shape = KINDS[KIND].coefficients
    slot = task.space.slots_of(KIND)[1]
    own = worth(task, model, model.theta[slot])
    told = np.array([worth(task, model, late) - own for late in shape.grid])
    told[np.argmin(np.abs(np.array(shape.grid) - model.theta[slot]))] = 0.0
    expected = np.log(np.mean(np.exp(np.minimum(told, 0.0))))
    cost = _choice_of_shapes(task, model)
    assert cost == pytest.approx(expected, abs=0.1)
    most = -np.log(len(shape.grid))
    if size == 1.0:
        assert cost == pytest.approx(most, abs=0.15)
    else:
        assert most + 0.3 < cost < 0.0


def test_what_has_no_shape_costs_nothing(fitted):
    _, task, model = fitted
    mass = dataclasses.replace(model, kinds=("mass",), free=task.free(("mass",)))
    assert _choice_of_shapes(task, mass) == 0.0
