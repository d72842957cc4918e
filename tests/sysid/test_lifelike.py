"""Campaigns like real ones: several effects, moving air, flights that differ."""

import functools

import numpy as np
import pytest

from glider.sysid.pipeline import close_the_loop
from tests.helpers.campaigns import campaign_path, first_flights

pytestmark = pytest.mark.nightly


@functools.cache
def closed(name):
    few = first_flights(FEW[name]) if name in FEW else None
    return close_the_loop(campaign_path(name), flights=few)


FEW = {"new_trims": 14, "moving_air": 10}
"""How many flights suffice."""


NAMED = {
    "gusty_drag": {"profile_drag": {"cd0": 0.07}},
    "new_trims": {
        "attached_lift": {"slope": 2.5, "stall_angle": 0.25, "fade": 0.05},
        "pitch_damping": {"coefficient": 0.015},
    },
    "other_stall": {
        "attached_lift": {"slope": 2.5},  # Its stall has another form.
        "camber": {},  # What it adds to such a stall is a free function.
        "profile_drag": {"cd0": 0.05},
        "induced_drag": {"k": 0.04},
    },
    "four_at_once": {
        "servo_lag": {"time_constant": 0.03},
        "profile_drag": {"cd0": 0.05},
        "induced_drag": {"k": 0.04},
        "center_of_pressure": {"shift": 0.005},
        "wind": {"x": -0.3, "z": 0.0},
    },
}
"""What is wrong, as those who flew them say."""

DIFFERS = {
    "new_trims": ("elevator_trim", "angle", 0.02),
    "other_stall": ("wind", "x", 0.15),
}
"""The flight-to-flight variation, its coefficient and standard deviation."""


@pytest.mark.parametrize("name", NAMED)
def test_all_that_is_wrong_is_named_and_nothing_else(name):
    result = closed(name)
    assert result.verdict == "effect_found"
    expected = set(NAMED[name]) | set(DIFFERS.get(name, ())[:1])
    assert {effect.kind for effect in result.effects} == expected
    for effect in result.effects:
        if effect.kind in NAMED[name]:
            assert effect.inclusion > 0.7  # A free function and a formula take turns.
            assert effect.evidence > 10.0


@pytest.mark.parametrize("name", NAMED)
def test_coefficients_are_within_their_standard_errors(name):
    found = {effect.kind: effect.coefficients for effect in closed(name).effects}
    for kind, truths in NAMED[name].items():
        for coefficient, truth in truths.items():
            estimate = found[kind][coefficient]
            error = abs(estimate.value - truth)
            # Flights are linear about their measurement: good to a hundredth.
            allowed = 3.0 * estimate.std + 0.01 * abs(truth)
            assert error < allowed, f"{kind}.{coefficient}: {estimate}"
            assert estimate.std < 0.2 * max(abs(truth), 0.05)


@pytest.mark.parametrize("name", NAMED)
def test_unseen_flights_get_better(name):
    result = closed(name)
    before = result.errors["nominal"]
    after = result.errors["corrected"]
    assert after.position_rms_m < 0.5 * before.position_rms_m
    along = before.rollout_measured_pitch.position_rms_m
    assert after.rollout_measured_pitch.position_rms_m < 0.5 * along


@pytest.mark.parametrize("name", DIFFERS)
def test_what_differs_from_flight_to_flight_is_told(name):
    kind, coefficient, truth = DIFFERS[name]
    result = closed(name)
    spread = result.spreads[kind]
    assert spread.std == pytest.approx(truth, rel=0.3)
    assert set(spread.values) == set(result.flights.fit)
    assert np.std(list(spread.values.values())) == pytest.approx(truth, rel=0.35)
    (effect,) = (e for e in result.effects if e.kind == kind)
    assert [*effect.coefficients] == [coefficient]
    assert set(result.spreads) == {kind}


def test_moving_air_is_no_effect():
    result = closed("moving_air")
    assert result.verdict == "no_effect"
    assert result.effects == ()
    assert result.model.effects == ()
    assert result.spreads == {}


@pytest.mark.parametrize(
    ("name", "truth"), [("moving_air", 0.18), ("gusty_drag", 0.15)]
)
def test_the_air_moves_as_it_did(name, truth):
    air = closed(name).air
    assert air.std_m_s == pytest.approx(truth, rel=0.2)
    assert 0.12 < air.correlation_s < 0.5
