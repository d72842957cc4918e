"""Derivatives are those of the model's own accelerations, in the signs of textbooks."""

import math

import numpy as np
import pytest

from glider.physics.covariance import Covariance
from glider.physics.effects import KINDS
from glider.physics.model import GliderModel
from glider.physics.state import NUM_STATES
from glider.sysid.derivatives import with_derivatives
from glider.sysid.result import ResidualTable
from tests.report.results import make_result

PLATE = GliderModel()
LIFTING = GliderModel(
    effects=(
        KINDS["attached_lift"](slope=3.0, stall_angle=0.26, fade=0.05),
        KINDS["pitch_damping"](coefficient=-0.02),
    )
)
SPEED, ALPHA, DELTA_E, CLIMB = 6.0, 0.05, 0.1, -0.2


@pytest.fixture
def flown():
    """Flights of which only the median state counts."""
    state = {"V": SPEED, "alpha": ALPHA, "elevator": -DELTA_E, "pitch": -CLIMB - ALPHA}
    state |= dict.fromkeys("txz", 0.0)
    none = np.zeros((3, 0))
    return ResidualTable(
        variables={name: np.full(3, value) for name, value in state.items()},
        residual=none,
        coefficients={},
        modelled={},
        flight=np.zeros(3, dtype=int),
        names=("a",),
        noise=none,
    )


def derivatives_of(model, covariance, flown, trim=None, chord=None):
    result = make_result(model=model, covariance=covariance, residual_after=flown)
    return with_derivatives(result, trim, chord).derivatives


def flown_coefficients(model, length, alpha=ALPHA, q=0.0, delta_e=DELTA_E):
    """C_L, C_D, C_m from the accelerations of a glider in still air."""
    p, v = model.parameters, SPEED * np.array([math.cos(CLIMB), math.sin(CLIMB)])
    state = [0.0, 0.0, -CLIMB - alpha, -delta_e, *v, -q]
    x = model.initial_state(state)
    rates = model.chain.derivatives(0.0, x, 0.0, 0.0, 0.0, model.numbers)
    force = p.mass * np.array([rates[4], rates[5] + p.gravity])
    unit = 0.5 * p.air_density * p.wing_area * SPEED**2
    along = v / SPEED
    up = np.array([-along[1], along[0]])
    moment = -p.pitch_inertia * rates[NUM_STATES - 1] / length
    return np.array([force @ up, -force @ along, moment]) / unit


@pytest.mark.parametrize("model", [PLATE, LIFTING], ids=("plate", "lifting"))
def test_they_are_slopes_of_the_accelerations(model, flown):
    found = derivatives_of(model, None, flown, chord=0.12)
    values = {name: e.value for name, e in found.values.items()}

    def slopes(step, **moved):
        ends = [
            flown_coefficients(model, 0.12, **{n: v + s for n, v in moved.items()})
            for s in (step, -step)
        ]
        return (ends[0] - ends[1]) / (2.0 * step)

    expected = [
        flown_coefficients(model, 0.12),
        slopes(1e-5, alpha=ALPHA),
        slopes(1e-4, q=0.0) * 2.0 * SPEED / 0.12,
        slopes(1e-5, delta_e=DELTA_E),
    ]
    np.testing.assert_allclose(
        np.reshape(list(values.values()), (3, 4)), np.transpose(expected), atol=1e-5
    )
    assert values["C_L_alpha"] > 0.0 > values["C_m_alpha"]
    assert values["C_m_q"] < 0.0 > values["C_m_delta_e"]
    assert (found.length, found.length_m, found.area_m2) == ("chord", 0.12, 0.0885)


def test_standard_errors_are_those_of_models_that_the_covariance_allows(flown):
    names = ("attached_lift.slope", "attached_lift.stall_angle", "wing_area")
    std = np.array([0.06, 0.004, 0.0009])
    correlations = np.array([[1.0, -0.9, 0.0], [-0.9, 1.0, 0.3], [0.0, 0.3, 1.0]])
    covariance = Covariance(names=names, matrix=correlations * np.outer(std, std))
    said = derivatives_of(LIFTING, covariance, flown).values
    rng, drawn = np.random.default_rng(0), []
    for slope, stall, area in rng.multivariate_normal(
        [3.0, 0.26, 0.0885], covariance.matrix, 1000
    ):
        p = LIFTING.parameters.__class__(wing_area=area)
        lift = KINDS["attached_lift"](slope=slope, stall_angle=stall, fade=0.05)
        model = GliderModel(parameters=p, effects=(lift, LIFTING.effects[1]))
        values = derivatives_of(model, None, flown).values
        scale = area / 0.0885  # Coefficients refer to the area that is reported.
        drawn.append([values[n].value * scale for n in said])
    spread = np.std(drawn, axis=0)
    assert spread[1] > 0.02
    np.testing.assert_allclose(
        [e.std for e in said.values()], spread, rtol=0.1, atol=1e-9
    )


def test_what_was_not_fitted_counts_as_exact(flown):
    known = Covariance(names=("wind.x", "attached_lift.slope"), matrix=np.eye(2))
    said = derivatives_of(LIFTING, known, flown).values
    assert said["C_L_alpha"].std > 0.0 == said["C_m_alpha"].std
    assert math.isnan(derivatives_of(LIFTING, None, flown).values["C_L"].std)


def test_a_trim_is_a_steady_glide(flown):
    found = derivatives_of(LIFTING, None, flown, 6.5)
    assert (found.condition, found.airspeed_m_s) == ("steady glide", 6.5)
    p, values = LIFTING.parameters, found.values
    assert values["C_m"].value == pytest.approx(0.0, abs=1e-9)
    pressure = 0.5 * p.air_density * p.wing_area * found.airspeed_m_s**2
    force = pressure * math.hypot(values["C_L"].value, values["C_D"].value)
    assert force == pytest.approx(p.mass * p.gravity)


def test_without_a_steady_glide_they_are_at_the_flights_and_say_so(flown):
    found = derivatives_of(PLATE, None, flown, 0.4)
    assert found.condition == (
        "median state of the flights, as the model has no steady glide at 0.4 m/s"
    )
    assert found.airspeed_m_s == SPEED
    assert found.alpha_rad == pytest.approx(ALPHA)
    assert found.delta_e_rad == pytest.approx(DELTA_E)
