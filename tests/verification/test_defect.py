"""The defect of a nominal flight is enclosed between its times too."""

import dataclasses

import numpy as np
import pytest

from glider.physics.effects import KINDS
from glider.physics.model import GliderModel
from glider.verification.dynamics.defect import defect_bounds, defect_growth


def sampled(nominal, points=21):
    """Returns the largest |ẋ₀ - f| (T - 1, n) seen at points of each interval."""
    path, found = nominal.path, []
    for share in np.linspace(0.0, 1.0, points)[1:-1]:
        here = nominal.between(share)
        found.append(np.abs(path(here.times, 1) - here.slopes))
    return np.max(found, axis=0)


EFFECTS = {
    "none": (),
    "wind": (KINDS["wind"](x=-0.6), KINDS["profile_drag"](cd0=0.05)),
    "wake": (KINDS["tail_wake"](loss=0.5), KINDS["added_mass"](mass=0.01)),
    "attached": (KINDS["attached_lift"](),),
}


@pytest.mark.parametrize("name", EFFECTS)
def test_no_defect_is_larger_than_its_bound(funnel, name):
    """The flight is none of these gliders, except for the first."""
    model = GliderModel(effects=EFFECTS[name])
    nominal = dataclasses.replace(funnel.nominal, model=model)
    bounds, seen = defect_bounds(nominal), sampled(nominal)
    assert bounds.shape == seen.shape
    assert np.all(seen <= bounds)
    assert np.median(bounds / seen) < 4.0


def test_it_grows_with_a_drift_and_is_infinite_where_nothing_is_known(funnel):
    nominal = funnel.nominal
    good = defect_growth(funnel.S, defect_bounds(nominal))
    assert good.shape == nominal.times.shape
    assert 1e-4 < good.max() < 1e-3
    states = nominal.states.copy()
    states[100:, 1] += 1e-6
    moved = dataclasses.replace(nominal, states=states)
    found = defect_growth(funnel.S, defect_bounds(moved))
    assert np.flatnonzero(found > 1.01 * good).tolist() == [99, 100]
    states[100:, 4] = 1e200
    lost = dataclasses.replace(nominal, states=states)
    assert np.isinf(defect_growth(funnel.S, defect_bounds(lost))[100])


def test_its_growth_is_the_largest_of_any_such_disturbance(funnel):
    rng, k = np.random.default_rng(0), 60
    bounds = rng.uniform(0.0, 1.0, (len(funnel.S) - 1, 7))
    largest = defect_growth(funnel.S, bounds)[k]
    around = np.maximum(bounds[k - 1], bounds[k])
    d = rng.choice([-1.0, 1.0], size=(2000, 7)) * around
    growth = 2.0 * np.sqrt(np.einsum("bi,ij,bj->b", d, funnel.S[k], d))
    assert growth.max() <= largest
    assert growth.max() > 0.5 * largest
