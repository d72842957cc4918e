"""A figure of merit over the gliders that a result allows."""

import types

import numpy as np
import pytest
from scipy.special import ndtr

from glider import propagate
from glider.errors import InputError
from glider.physics.covariance import Covariance
from glider.physics.effects import KINDS, SERVO_LAG, WIND
from glider.physics.model import GliderModel
from glider.sysid.result import Alternative

WINDY = GliderModel(effects=(WIND(x=-0.5, z=0.1),))
DRAGGED = GliderModel(effects=(KINDS["profile_drag"](cd0=0.02),))
STD, CORRELATION = np.array([0.02, 0.01]), 0.8


def result_of(*shares, freedom=None):
    """A result of a wind, and a drag as its rival."""
    mixed = np.array([[1.0, CORRELATION], [CORRELATION, 1.0]])
    wind = Covariance(
        names=("wind.x", "wind.z"),
        matrix=mixed * np.outer(STD, STD),
        degrees_of_freedom=freedom,
    )
    models = [(WINDY, wind), (DRAGGED, None)]
    return types.SimpleNamespace(
        model=WINDY,
        alternatives=tuple(
            Alternative(probability=share, model=model, covariance=covariance)
            for share, (model, covariance) in zip(shares, models, strict=False)
        ),
    )


def wind_sum(model):
    return sum(sum(e.to_dict().values()) for e in model.effects if e.kind is WIND)


def test_a_sum_has_the_error_of_a_sum():
    found = propagate(result_of(1.0), wind_sum, draws=4000)
    assert found.estimate == pytest.approx(-0.4)
    assert found.mean == pytest.approx(-0.4, abs=0.002)
    variance = STD @ STD + 2.0 * CORRELATION * STD.prod()
    assert found.std == pytest.approx(np.sqrt(variance), rel=0.05)
    low, median, high = found.quantiles()
    assert median == pytest.approx(-0.4, abs=0.002)
    assert high - low == pytest.approx(2.0 * 1.96 * np.sqrt(variance), rel=0.07)


@pytest.mark.parametrize("lag", [0.0, 0.002])
def test_a_number_near_its_bound_leaves_the_others_as_uncertain_as_they_are(lag):
    """A lag that cannot be negative, of its own error, and a wind."""
    model = GliderModel(effects=(WIND(x=-0.5), SERVO_LAG(time_constant=lag)))
    names = ("wind.x", "servo_lag.time_constant", "mass")
    covariance = Covariance(names=names, matrix=np.diag([0.1, 0.01, 0.1]) ** 2)
    alternative = Alternative(probability=1.0, model=model, covariance=covariance)
    result = types.SimpleNamespace(model=model, alternatives=(alternative,))
    wind = propagate(result, lambda m: m.effects[0].values[0], draws=4000)
    assert wind.mean == pytest.approx(-0.5, abs=0.01)
    assert wind.std == pytest.approx(0.1, rel=0.05)
    lags = propagate(result, lambda m: m.effects[1].values[0], draws=4000).values
    below = ndtr(-lag / 0.01)  # Probability of a negative one.
    assert lags.min() == 0.0 and np.mean(lags == 0.0) == pytest.approx(below, abs=0.03)
    mass = propagate(result, lambda m: m.parameters.mass, draws=100)
    assert mass.values.min() == model.space.lower[model.space.index["mass"]] > 0.0


def test_few_flights_make_wider_tails():
    wide = propagate(result_of(1.0, freedom=4.0), wind_sum, draws=4000)
    assert wide.std > 1.2 * propagate(result_of(1.0), wind_sum, draws=4000).std


def test_rivals_count_by_their_probability():
    found = propagate(result_of(0.7, 0.3), lambda m: float(len(m.kinds)), draws=50)
    assert found.std == 0.0
    found = propagate(result_of(0.7, 0.3), wind_sum, draws=2000)
    assert np.mean(found.places) == pytest.approx(0.3, abs=0.04)
    assert np.mean(found.values == 0.0) == np.mean(found.places)


def test_the_seed_decides_the_draws():
    same = [propagate(result_of(0.7, 0.3), wind_sum, draws=5).values for _ in range(2)]
    np.testing.assert_array_equal(*same)
    other = propagate(result_of(0.7, 0.3), wind_sum, draws=5, seed=1).values
    assert not np.array_equal(same[0], other)
    with pytest.raises(InputError, match="at least 2"):
        propagate(result_of(1.0), wind_sum, draws=1)
