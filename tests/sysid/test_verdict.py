"""The verdict: what is claimed, and what is not."""

import math
import types

import numpy as np
import pytest

from glider.campaign.turning import Signs
from glider.sysid.constants import MOST_LEFT, UNLIKELY, WORSE
from glider.sysid.result import (
    LIBRARY_SHAPE,
    OTHER_SHAPE,
    VERDICTS,
    EquationErrors,
    Errors,
    FlightNames,
    FoundEffect,
    PathErrors,
    Residual,
    RolloutErrors,
    Spread,
)
from glider.sysid.verdict import _changes_baseline_alone, judge, too_few_fly

RIGHT = Signs()


def entry(kind, shape_fits=True, evidence=1.0):
    return FoundEffect(
        kind=kind,
        words="",
        coefficients={},
        evidence=evidence,
        share_of_residual=1.0,
        indistinguishable_from=(),
        depends_on=(),
        shape=LIBRARY_SHAPE if shape_fits else OTHER_SHAPE,
    )


def errors_with(free, along):
    return Errors(
        equation=EquationErrors(tangential=1.0, normal=1.0, pitch=1.0),
        rollout=RolloutErrors(
            position_rms_m=free, position_end_m=1.0, pitch_rms_rad=1.0
        ),
        rollout_measured_pitch=PathErrors(position_rms_m=along),
    )


LEAST_T, FLIGHTS = 2.1, 20


def gain_of(t):
    """A gain in folds of this t."""
    return types.SimpleNamespace(
        t=t, least_t=LEAST_T, are_significant=t >= LEAST_T, values=np.zeros(FLIGHTS)
    )


def gains_of(t=9.0, over_nominal=None):
    """Gains over the refitted baseline, and over the nominal model if it is known."""
    gains = {"refitted": gain_of(t)}
    if over_nominal is not None:
        gains["nominal"] = gain_of(over_nominal)
    return gains


def verdict(
    kinds=(),
    *,
    is_free=False,
    terms=(),
    signs=RIGHT,
    t=9.0,
    split=0.1,
    shape_fits=True,
    unnamed=None,
    left_over=None,
    doubt=None,
    t_over_nominal=None,
    drawn=1.0,
    chance=0.5,
    times_floor=1.5,
    times_along=math.nan,
    left_m=0.05,
    spreads=None,
    bank=None,
):
    """Judges a trace that found kinds, and a free function without a name."""
    if unnamed is None:
        unnamed = is_free or bool(terms)
    effects = [entry(kind, shape_fits) for kind in kinds]
    if not signs.are_right:
        effects.append(entry("angle_sign"))
    if unnamed:
        effects.append(entry("unexplained"))
    functions = ("air over x",) if is_free else ()
    traced = types.SimpleNamespace(
        model=types.SimpleNamespace(kinds=(*kinds, *functions), functions=functions),
        forces=None if left_over is None else object(),
        bank=bank,
    )
    left = Residual(
        position_m=left_m,
        ratio_to_floor=times_floor,
        ratio_along_pitch=times_along,
        chance=chance,
        depends_on=left_over or (),
    )
    gains = gains_of(t, t_over_nominal) if signs.are_right else {}
    errors = {
        "nominal": errors_with(drawn, 1.0),
        "refitted": errors_with(1.0, 1.0),
        "corrected": errors_with(split, 1.0),
    }
    return judge(traced, gains, errors, effects, left, spreads or {}, doubt)


def test_thrown_gliders_that_leave_much_are_never_without_effect():
    word, reason = verdict(left_over=("alpha", "V"))
    assert word == "unexplained"
    assert "alpha, V" in reason
    assert verdict(left_over=())[0] == "no_effect"


def test_a_roll_that_is_not_logged_is_asked_for():
    """Whatever acts beside it; the reason has a doubt as well."""
    for found, word in (
        (verdict(bank=0.1), "unexplained"),
        (verdict(bank=0.1, is_free=True), "unexplained"),
        (verdict(["camber"], bank=0.1), "partly_explained"),
        (verdict(["camber"], bank=0.1, t=-5.0), "not_trusted"),
        (verdict(bank=0.1, doubt="its clock is wrong"), "unexplained"),
    ):
        assert found[0] == word
        assert "about 0.10 rad at the end: log roll and yaw." in found[1]
    assert "its clock is wrong" in found[1]
    assert "its clock" in verdict(["camber"], bank=0.1, doubt="its clock")[1]


def test_nothing_found_is_no_effect():
    """However the flights came out."""
    assert verdict()[0] == "no_effect"
    assert verdict(t=-5.0)[0] == "no_effect"


def test_no_effect_says_what_varies_from_flight_to_flight():
    _, reason = verdict()
    assert reason == "The flights show nothing beyond noise and moving air."
    _, reason = verdict(
        spreads={"elevator_trim": Spread(std=0.04, unit="rad", values={})}
    )
    assert reason.endswith(
        "moving air and a flight-to-flight variation of elevator_trim (0.04 rad)."
    )


def test_a_model_that_diverges_shows_nothing():
    """As with a number of the vehicle in another unit."""
    word, reason = verdict(left_m=math.nan)
    assert word == "not_trusted"
    assert "diverges" in reason


@pytest.mark.parametrize(("count", "words"), [(0, None), (1, None), (2, "on 2 of 9")])
def test_few_flights_on_which_every_model_diverges_are_exceptions(count, words):
    """One of five at most."""
    names = tuple(f"flight_{i}.csv" for i in range(9))
    doubt = too_few_fly(FlightNames(fit=(), held_out=names, diverged=names[:count]))
    assert doubt is None if words is None else words in doubt


def test_effects_that_hold_are_found():
    word, reason = verdict(("wind",))
    assert word == "effect_found"
    assert "free function" not in reason


def test_what_a_perfect_model_would_not_leave_is_not_all_explained():
    assert verdict(("wind",), chance=1.01 * UNLIKELY)[0] == "effect_found"
    word, reason = verdict(("wind",), chance=0.99 * UNLIKELY)
    assert word == "partly_explained"
    assert "50 mm (RMS), 1.5 times as much as a perfect model" in reason
    less = verdict(("wind",), chance=0.5 * UNLIKELY, times_floor=0.99)
    assert less[0] == "effect_found"
    word, reason = verdict(("wind",), times_floor=1.01 * MOST_LEFT)
    assert word == "partly_explained"
    assert "2.02 times as much as a perfect model" in reason
    assert verdict(("wind",), times_floor=math.nan)[0] == "effect_found"
    # No chance excuses more than twice.
    assert verdict(("wind",), times_floor=1.99)[0] == "effect_found"
    assert verdict(("wind",), times_floor=2.01)[0] == "partly_explained"
    _, reason = verdict(("wind",), chance=0.0, left_over=("alpha", "V"))
    assert reason.endswith("depending on alpha, V.")


def test_what_is_left_where_nothing_was_found_is_unexplained():
    """Noise and moving air of a right model do not leave it."""
    word, reason = verdict(chance=0.99 * UNLIKELY, times_floor=35.4)
    assert word == "unexplained"
    assert reason.startswith("No effect of the library explains what the flat plate")
    assert "50 mm (RMS), 35.4 times as much as a perfect model" in reason
    assert verdict(chance=0.0, times_floor=0.99)[0] == "no_effect"
    assert verdict(chance=1.01 * UNLIKELY)[0] == "no_effect"
    doubt = {"doubt": "the model needs gusts of 0.6 m/s"}
    word, reason = verdict(times_floor=4.0, chance=0.0, **doubt)
    assert word == "unexplained"


def test_a_shape_that_is_not_the_librarys_is_told():
    word, reason = verdict(
        ("wind",), terms=("c_drag",), shape_fits=False, unnamed=False
    )
    assert word == "effect_found"
    assert "free function" in reason


@pytest.mark.parametrize("kinds", [("wind",), ()], ids=["named", "unnamed"])
def test_a_gain_by_chance_is_not_trusted(kinds):
    word, reason = verdict(kinds, is_free=not kinds, t=LEAST_T - 0.1)
    assert word == "not_trusted"
    assert f"t = {LEAST_T - 0.1:.1f}" in reason
    assert verdict(kinds, is_free=not kinds, t=LEAST_T + 0.1)[0] != "not_trusted"


def test_a_model_that_diverges_is_no_infinite_number():
    word, reason = verdict(("wind",), split=float("inf"))
    assert word == "not_trusted"
    assert "the corrected model diverges" in reason and "inf" not in reason


def test_what_makes_unseen_flights_worse_is_not_trusted():
    worse = WORSE + 0.01
    for worst, expected in ((worse, "not_trusted"), (1.0, "effect_found")):
        word, reason = verdict(("wind",), split=worst)
        assert word == expected
        words = f"flown freely {worse:.4g} times"
        assert (words in reason) == (word == "not_trusted")


@pytest.mark.parametrize("kinds", [("wind",), ()], ids=["named", "unnamed"])
def test_what_is_worse_than_the_nominal_model_is_not_trusted(kinds):
    """A refitted baseline may be worse still."""
    given = {"kinds": kinds, "is_free": not kinds}
    word, reason = verdict(**given, split=0.9, drawn=0.9 / (WORSE + 0.01))
    assert word == "not_trusted" and "times the error of the nominal model" in reason
    assert verdict(**given, split=0.9, drawn=0.9)[0] != "not_trusted"
    # Of what the plate has, too.
    word, reason = verdict(("mass",), t_over_nominal=9.0, split=1.0, drawn=0.9)
    assert word == "not_trusted" and "1.111 times the error of the nominal" in reason


def test_a_gain_by_chance_is_told_with_its_flights():
    word, reason = verdict(("wind",), t=LEAST_T - 0.1)
    assert word == "not_trusted"
    assert f"On {FLIGHTS} flights, held out" in reason
    assert f"t = 2.0, expected {LEAST_T}" in reason


def test_what_leaves_too_much_to_chance_is_not_trusted():
    word, reason = verdict(("wind",), doubt="the model needs gusts of 0.6 m/s")
    assert word == "not_trusted"
    assert "gusts of 0.6 m/s" in reason
    assert verdict((), doubt="the model needs gusts of 0.6 m/s")[0] == "not_trusted"


@pytest.mark.parametrize("lack", [{"is_free": True}, {"terms": ("c_lift",)}], ids=str)
def test_what_has_no_name_is_unexplained(lack):
    assert verdict((), **lack)[0] == "unexplained"
    assert verdict(("wind",), **lack)[0] == "partly_explained"


def test_wrong_signs_need_no_folds():
    wrong = Signs(pitch=-1, evidence=1e4, share=0.9)
    assert verdict((), signs=wrong)[0] == "effect_found"
    assert verdict(("wind",), signs=wrong, t=-9.0)[0] == "effect_found"
    assert verdict((), signs=wrong, is_free=True)[0] == "partly_explained"
    worse = verdict(("wind",), signs=wrong, split=WORSE + 0.01)
    assert worse[0] == "not_trusted"


def test_the_reason_says_where_more_than_a_perfect_models_error_is_left():
    left = {"times_floor": 0.7, "chance": 1e-9}
    word, reason = verdict(("wind",), times_along=1.8, **left)
    assert word == "partly_explained" and "(1.8 times along the measured" in reason
    word, reason = verdict(("wind",), times_along=1.8, times_floor=2.5)
    assert word == "partly_explained" and "along the measured" not in reason
    assert verdict(("wind",), times_along=0.9, **left)[0] == "effect_found"


def test_what_only_differs_from_flight_to_flight_names_no_lack():
    """A trim that is zero in the mean stands beside the unexplained, no more."""
    traced = types.SimpleNamespace(
        model=types.SimpleNamespace(kinds=("air over x",)), forces=None, bank=None
    )
    left = Residual(position_m=0.05, ratio_to_floor=3.0, depends_on=())
    found = entry("unexplained"), entry("elevator_trim", evidence=math.nan)
    errors = {"refitted": errors_with(1.0, 1.0), "corrected": errors_with(0.9, 0.9)}
    word, _ = judge(traced, gains_of(), errors, found, left, {}, None)
    assert word == "unexplained"


def test_what_is_of_the_plate_is_held_against_the_nominal_glider():
    """Refitted, the plate has it too: there is nothing to gain over that."""
    alike = {"t": 0.1, "split": 1.02, "drawn": 2.0}
    assert verdict(("mass",), **alike)[0] == "not_trusted"
    assert verdict(("mass",), t_over_nominal=9.0, **alike)[0] == "effect_found"
    by_chance = verdict(("mass",), t_over_nominal=LEAST_T - 0.1, **alike)
    assert by_chance[0] == "not_trusted"
    assert "over the nominal model" in by_chance[1]
    worse = alike | {"drawn": 1.0}
    assert verdict(("mass",), t_over_nominal=9.0, **worse)[0] == "not_trusted"


@pytest.mark.parametrize(
    ("kinds", "functions", "expected"),
    [
        (("mass", "center_of_pressure"), (), True),
        (("mass", "profile_drag"), (), False),
        (("mass",), (object(),), False),
        ((), (), False),
    ],
    ids=["own", "more", "function", "nothing"],
)
def test_only_the_plates_own_numbers_are_of_the_plate(kinds, functions, expected):
    model = types.SimpleNamespace(kinds=kinds, functions=functions)
    assert _changes_baseline_alone(model) is expected


def test_all_verdicts_have_been_seen():
    seen = {
        verdict()[0],
        verdict(("wind",))[0],
        verdict(("wind",), is_free=True)[0],
        verdict(is_free=True)[0],
        verdict(("wind",), t=0.0)[0],
    }
    assert seen == set(VERDICTS)
