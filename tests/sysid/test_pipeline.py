"""The undeclared-effect test: the pipeline sees logs only, and must name the cause."""

import numpy as np
import pytest

from glider.errors import InputError
from glider.physics.effects import KINDS
from glider.physics.model import GliderModel
from glider.sysid.fit.simulate import (
    CampaignPlan,
    simulate_campaign,
)
from glider.sysid.pipeline import close_the_loop
from tests.helpers.campaigns import campaign_path

FLOOR = 1.5
"""Held-out rollout error, over that of a fit that knows the truth, at most."""


def kinds_of(result):
    return [effect.kind for effect in result.effects]


def value(result, coefficient):
    return result.effects[0].coefficients[coefficient].value


@pytest.fixture(scope="module")
def attached():
    return close_the_loop(campaign_path("attached_lift"))


def test_attached_lift_is_named_with_its_coefficients(attached):
    assert attached.verdict == "effect_found"
    assert kinds_of(attached) == ["attached_lift"]
    assert value(attached, "slope") == pytest.approx(3.0, rel=0.15)
    assert value(attached, "stall_angle") == pytest.approx(0.26, rel=0.15)


def test_errors_fall_on_held_out_flights(attached):
    nominal, corrected = attached.errors["as_drawn"], attached.errors["corrected"]
    assert corrected.position_rms_m < 0.25 * nominal.position_rms_m
    assert corrected.normal < nominal.normal
    assert not set(attached.fit_flights) & set(attached.held_out_flights)


def test_the_model_file_holds_the_effect(attached):
    (effect,) = attached.model.effects
    assert effect.kind is KINDS["attached_lift"]
    assert effect.to_dict()["slope"] == value(attached, "slope")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "coefficients"),
    [
        ("head_wind", {"x": (-0.6, 0.05), "z": (0.1, 0.05)}),
        ("slow_servo", {"time_constant": (0.04, 0.006)}),
    ],
)
def test_practice_effects_are_named(name, coefficients):
    result = close_the_loop(campaign_path(name))
    kind = {"head_wind": "wind", "slow_servo": "servo_lag"}[name]
    assert kinds_of(result) == [kind]
    for coefficient, (truth, tolerance) in coefficients.items():
        assert value(result, coefficient) == pytest.approx(truth, abs=tolerance)
    nominal, corrected = result.errors["as_drawn"], result.errors["corrected"]
    assert corrected.position_rms_m < 0.25 * nominal.position_rms_m


def test_nothing_is_found_in_still_air():
    result = close_the_loop(campaign_path("still_air"))
    assert result.verdict == "no_effect"
    assert result.effects == ()
    assert abs(result.left_z) < 4.0


def test_what_the_library_lacks_is_unexplained_and_carried():
    result = close_the_loop(campaign_path("floor_vent"))
    assert result.verdict == "unexplained"
    assert kinds_of(result) == ["unexplained"]
    assert result.effects[0].depends_on == ("x",)
    assert value(result, "wind_z_peak") == pytest.approx(1.0, rel=0.15)
    assert value(result, "wind_z_peak_at_x") == pytest.approx(-1.8, abs=0.1)
    height = result.effects[0].coefficients["wind_z_peak"]
    place = result.effects[0].coefficients["wind_z_peak_at_x"]
    assert 0.0 < height.std < 0.05
    assert 0.0 < place.std < 0.05
    nominal, corrected = result.errors["as_drawn"], result.errors["corrected"]
    assert corrected.position_rms_m < 0.25 * nominal.position_rms_m


def planted(*effects, seed=0, **plan):
    """A campaign of our own whose truth holds undeclared effects."""
    model = GliderModel(effects=effects)
    plan = CampaignPlan(**{"flights": 16, **plan})
    return simulate_campaign(model, plan, np.random.default_rng(seed))


@pytest.mark.slow
@pytest.mark.parametrize(
    "kinds",
    [
        ("command_delay",),
        ("tail_wake",),
        ("pose_latency",),
        ("marker_offset",),
        ("camber",),
        ("pitch_rate_lift",),
        ("induced_drag",),
        ("axial_drag",),
        ("elevator_blowback",),
        ("stalled_downwash",),
        ("wind_shear",),
        ("added_mass",),
        ("inertia",),  # Which added_mass holds too.
        ("wind", "profile_drag"),  # More kinds and pairs: bench_tracing.
    ],
    ids="+".join,
)
def test_planted_effects_are_traced(kinds):
    effects = []
    for name in kinds:
        values = {
            c.name: c.default if c.is_shape and c.default else c.scale
            for c in KINDS[name].coefficients
        }
        effects.append(KINDS[name](**values))
    result = close_the_loop(planted(*effects))
    assert sorted(kinds_of(result)) == sorted(kinds)
    for effect in effects:
        found = next(e for e in result.effects if e.kind == effect.kind.kind)
        for coefficient, truth in effect.to_dict().items():
            assert found.coefficients[coefficient].value == pytest.approx(
                truth, rel=0.15
            )


@pytest.mark.slow
@pytest.mark.parametrize(
    "signs",
    [
        {"pitch": -1.0},
        {"elevator": -1.0, "command": -1.0},
        {"pitch": -1.0, "elevator": -1.0, "command": -1.0},
        {"command": -1.0},
    ],
    ids=str,
)
def test_wrong_signs_are_found(signs):
    result = close_the_loop(planted(KINDS["angle_sign"](**signs)))
    assert kinds_of(result) == ["angle_sign"]
    found = result.effects[0].coefficients
    for name in ("pitch", "elevator", "command"):
        assert found[name].value == signs.get(name, 1.0)
    nominal, corrected = result.errors["as_drawn"], result.errors["corrected"]
    assert corrected.position_rms_m < 0.25 * nominal.position_rms_m


def test_effects_can_be_restricted_and_the_same_call_gives_the_same_result():
    campaign, few = planted(KINDS["wind"](x=-0.3)), ["wind", "profile_drag"]
    result, again = (close_the_loop(campaign, effects=few) for _ in range(2))
    assert set(result.candidates) == set(few)
    assert kinds_of(result) == ["wind"]
    assert again.effects == result.effects
    assert again.errors == result.errors


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"effects": ["tailwind"]}, "tailwind"),
        ({"held_out": 1.5}, "held-out"),
        ({"flights": ["flight_999.csv"]}, "flight_999"),
    ],
)
def test_bad_arguments_are_one_clear_sentence(arguments, words):
    with pytest.raises(InputError, match=words) as error:
        close_the_loop(campaign_path("attached_lift"), **arguments)
    assert "\n" not in str(error.value)
