"""The undeclared-effect test: the pipeline sees logs only, and must name the cause."""

import dataclasses

import numpy as np
import pytest

from glider.campaign.logs import split_flights
from glider.errors import InputError
from glider.physics.effects import KINDS
from glider.progress import Step
from glider.report.wording import say
from glider.sysid.constants import UNLIKELY
from glider.sysid.fit import floor
from glider.sysid.pipeline import close_the_loop
from glider.sysid.result import PERFECT
from tests.campaign.checks.breaking import change, scale
from tests.helpers.campaigns import campaign_path, first_flights
from tests.helpers.tasks import fly
from tests.helpers.unlike import shallow_and_deep


def kinds_of(result):
    return [effect.kind for effect in result.effects]


def errors_fall(result, share=0.25):
    """Whether held-out flights get better."""
    nominal, plate = result.errors["nominal"], result.errors["refitted"]
    corrected = result.errors["corrected"]
    pairs = [(nominal, corrected), (plate, corrected)]
    return all(b.position_rms_m < share * a.position_rms_m for a, b in pairs)


def assert_coefficients(result, kind, truths):
    """Each within three of its standard errors, which are small."""
    (effect,) = (e for e in result.effects if e.kind == kind)
    for name, truth in truths.items():
        found = effect.coefficients[name]
        assert abs(found.value - truth) < 3.0 * found.std, f"{kind}.{name}: {found}"
        assert found.std < 0.05 * max(abs(truth), 0.1)


ATTACHED_LIFT = {"slope": 3.0, "stall_angle": 0.26, "fade": 0.05}


@pytest.fixture(scope="module")
def few():
    """The sample campaign's first flights."""
    return close_the_loop(campaign_path("attached_lift"), flights=first_flights(8))


def test_attached_lift_is_named_with_its_coefficients(few):
    assert few.verdict == "effect_found"
    assert kinds_of(few) == ["attached_lift"]
    assert_coefficients(few, "attached_lift", ATTACHED_LIFT)
    (effect,) = few.effects
    assert effect.evidence > 100.0
    assert effect.inclusion == 1.0
    assert effect.share_of_residual > 0.9
    assert effect.shape == "library"
    assert few.spreads == {}


def test_the_covariance_is_of_the_standard_errors(few):
    (effect,) = few.effects
    known = few.covariance
    assert known.names == tuple(f"{effect.kind}.{n}" for n in effect.coefficients)
    std = np.sqrt(np.diag(known.matrix))
    np.testing.assert_allclose(std, [c.std for c in effect.coefficients.values()])


def test_errors_fall_on_held_out_flights(few):
    assert errors_fall(few)
    nominal, corrected = few.errors["nominal"], few.errors["corrected"]
    assert corrected.equation.normal < nominal.equation.normal
    assert not set(few.flights.fit) & set(few.flights.held_out)
    assert [flight.name for flight in few.held_out] == list(few.flights.held_out)


def test_what_is_left_is_no_more_than_noise(few):
    assert few.left.depends_on == ()
    assert few.left.position_m < 0.02
    assert few.air.std_m_s < 0.01
    lacks = few.residual_before.residual[:, 1]
    left = few.residual_after.residual[:, 1]
    assert np.std(left) < 0.2 * np.std(lacks)


def test_flights_unlike_the_others_are_predicted_without_them(few):
    assert set(few.unlike.flights) < {*few.flights.fit, *few.flights.held_out}
    assert set(few.unlike.errors) == set(few.errors)
    nominal, floor = few.unlike.errors["nominal"], few.unlike.errors[PERFECT]
    assert few.unlike.left.position_m < 0.1 * nominal.position_rms_m
    assert few.unlike.left.position_m < 2.0 * floor.position_rms_m
    assert not (few.unlike.left.exceeds_chance or few.warnings)


@pytest.mark.nightly
def test_a_model_that_is_good_on_random_flights_only_warns():
    """A stall that three of 15 flights reach, of which a fit without them knows nought.

    The warning is in the report and in the model's file.
    """
    result = close_the_loop(shallow_and_deep(12, 3))
    assert result.verdict == "effect_found" and result.left.may_be_chance
    assert result.left.position_m < 0.003
    assert len(result.unlike.flights) == 3
    assert result.unlike.left.position_m > 4.0 * result.left.position_m
    assert result.warnings == (result.unlike.warning,)
    assert result.unlike.warning in say("model_warnings", result)


def test_the_model_file_holds_the_effect(few):
    (effect,) = few.model.effects
    assert effect.kind is KINDS["attached_lift"]
    assert effect.to_dict()["slope"] == few.effects[0].coefficients["slope"].value
    assert few.model.free_functions == ()


@pytest.mark.nightly
@pytest.mark.parametrize(
    ("name", "kind", "truths"),
    [
        ("head_wind", "wind", {"x": -0.6, "z": 0.1}),
        ("slow_servo", "servo_lag", {"time_constant": 0.04}),
    ],
)
def test_practice_effects_are_named(name, kind, truths):
    result = close_the_loop(campaign_path(name), flights=first_flights(8))
    assert result.verdict == "effect_found"
    assert 0.3 < result.left.ratio_to_floor < 3.0
    assert result.left.chance > UNLIKELY
    assert kinds_of(result) == [kind]
    assert_coefficients(result, kind, truths)
    assert errors_fall(result)


@pytest.mark.nightly
def test_nothing_is_found_in_still_air():
    result = close_the_loop(campaign_path("still_air"), flights=first_flights(6))
    assert result.verdict == "no_effect"
    assert result.effects == ()
    assert result.left.depends_on == ()
    assert result.air.std_m_s < 0.01
    nominal, corrected = result.errors["nominal"], result.errors["corrected"]
    assert corrected.position_rms_m < 1.2 * nominal.position_rms_m


@pytest.mark.nightly
def test_what_the_library_lacks_is_unexplained_and_carried():
    result = close_the_loop(campaign_path("floor_vent"), flights=first_flights(12))
    assert result.verdict == "unexplained"
    assert kinds_of(result) == ["unexplained"]
    assert result.effects[0].depends_on[0] == "x"
    height = result.effects[0].coefficients["wind_z_peak"]
    place = result.effects[0].coefficients["wind_z_peak_at_x"]
    assert height.value == pytest.approx(1.0, abs=0.05)
    assert place.value == pytest.approx(-1.8, abs=0.03)
    assert 0.0 < height.std < 0.05
    assert result.model.free_functions
    assert errors_fall(result)


@pytest.mark.nightly
def test_wrong_signs_are_found():
    """More of them: tests/sysid/search/test_signs.py."""
    signs = {"pitch": -1.0, "elevator": -1.0, "command": 1.0}
    result = close_the_loop(fly(KINDS["angle_sign"](**signs), flights=5))
    assert kinds_of(result) == ["angle_sign"]
    found = result.effects[0].coefficients
    assert {name: found[name].value for name in signs} == signs
    nominal, corrected = result.errors["nominal"], result.errors["corrected"]
    assert max(corrected.position_rms_m, nominal.position_rms_m) < 2e-3
    assert result.verdict == "effect_found"


@pytest.mark.nightly
def test_effects_can_be_restricted_and_the_same_call_gives_the_same_result():
    campaign = fly(KINDS["wind"](x=-0.3), flights=8)
    few = ["wind", "profile_drag"]
    result, again = (close_the_loop(campaign, effects=few) for _ in range(2))
    assert any("only wind, profile_drag were tried" in w for w in result.warnings)
    assert kinds_of(result) == ["wind"]
    assert again.effects == result.effects
    assert again.errors == result.errors


@pytest.fixture(scope="module")
def dragged():
    """Flights with drag, and the index of one that is held out."""
    campaign = fly(KINDS["profile_drag"](cd0=0.05), flights=10)
    _, unseen = split_flights(campaign, 0.3, 0)
    return campaign, campaign.flights.index(unseen[0])


@pytest.mark.nightly
def test_a_held_out_flight_without_elevator_at_first_changes_no_error_to_nan(dragged):
    """Its elevator is frozen and its pose stands still where it begins."""
    campaign, one = dragged
    rows = int(0.35 * len(campaign.flights[one].time))

    def freeze(flight):
        elevator, pose = flight.elevator.copy(), flight.pose.copy()
        elevator[:rows] = elevator[0]
        pose[:6] = pose[0]
        return dataclasses.replace(flight, elevator=elevator, pose=pose)

    broken = change(campaign, freeze, only=one)
    result = close_the_loop(broken, effects=["profile_drag"])
    assert result.verdict == "effect_found"
    for model, errors in result.errors.items():
        groups = dataclasses.astuple(errors)[: 3 if model == PERFECT else 4]
        assert np.isfinite(np.concatenate(groups)).all(), model


@pytest.mark.slow
@pytest.mark.parametrize("count", [1, pytest.param(2, marks=pytest.mark.nightly)])
def test_a_flight_that_no_model_flies_is_in_no_error_and_is_named(monkeypatch, count):
    """One of six held-out flights may be such an exception; two are none."""
    campaign = fly(KINDS["profile_drag"](cd0=0.05), flights=20)
    _, unseen = split_flights(campaign, 0.3, 0)
    names = tuple(flight.name for flight in unseen[:count])
    own = floor.predict

    def diverge(model, record):
        flown = own(model, record)
        if record.name not in names:
            return flown
        return dataclasses.replace(flown, pose=flown.pose * np.inf)

    monkeypatch.setattr(floor, "predict", diverge)
    result = close_the_loop(campaign, effects=["profile_drag"])
    assert result.flights.diverged == names
    assert set(result.flights.held_out) == {flight.name for flight in unseen}
    assert result.flights.predicted == result.flights.held_out[count:]
    for errors in result.errors.values():
        assert errors.position_rms_m < 1.0
    assert f"without {count} of 6 held-out flights, on which every" in result.reason
    assert all(name in result.reason for name in names)
    assert (result.verdict == "not_trusted") == (count == 2)


@pytest.mark.nightly
def test_a_held_out_flight_that_stands_out_is_excluded(dragged):
    """It is no part of the errors, and no search is repeated for it."""
    campaign, one = dragged
    name = campaign.flights[one].name
    steps = []
    result = close_the_loop(
        change(campaign, scale(1, -1, 1), only=one),
        effects=["profile_drag"],
        progress=steps.append,
    )
    assert name not in result.flights.held_out + result.flights.fit
    assert name in [excluded.file for excluded in result.set_aside]
    assert not any("again" in step for step in steps)
    shares = [step.share for step in steps if isinstance(step, Step)]
    assert len(shares) > 10
    assert shares[0] == 0.0
    assert shares == sorted(shares)  # Of the work that is done: it only grows.
    assert shares[-1] < 1.0
    assert kinds_of(result) == ["profile_drag"]


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
    for campaign in (5, None):
        with pytest.raises(InputError, match=f"the campaign is {campaign}; expected"):
            close_the_loop(campaign, **arguments | {"held_out": 0.3, "effects": None})
