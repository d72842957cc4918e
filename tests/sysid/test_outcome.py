"""The parts of a result: verdicts, curves, what differs from flight to flight."""

import dataclasses
import types

import numpy as np
import pytest

from glider.sysid.fit.folds import LEAST_T, WORSE
from glider.sysid.likelihood.curves import TERMS
from glider.sysid.likelihood.model_fit import fit_model
from glider.sysid.likelihood.uncertainty import Uncertainty
from glider.sysid.outcome import (
    CURVE_Z,
    FLOWN,
    Carried,
    carried_of,
    curves_of,
    judge,
    model_of,
    spreads_of,
)
from glider.sysid.replay.signs import Signs
from glider.sysid.result import VERDICTS, Errors, FoundEffect, Left, ResidualTable
from tests.helpers.lifelike import turbulence_campaign
from tests.helpers.tasks import begin, fly, task_of

# ---------------------------------------------------------------------- verdicts

RIGHT = Signs()
NO_CURVES = Carried(terms=(), data=None)


def entry(kind, shape_fits=True):
    return FoundEffect(
        kind=kind,
        words="",
        coefficients={},
        evidence=1.0,
        share=1.0,
        indistinguishable_from=(),
        depends_on=(),
        shape_fits=shape_fits,
    )


def errors_with(free, along):
    numbers = dict.fromkeys([f.name for f in dataclasses.fields(Errors)], 1.0)
    numbers |= {"position_rms_m": free, "measured_pitch_position_rms_m": along}
    return Errors(**numbers)


def verdict(
    kinds=(),
    *,
    field=False,
    terms=(),
    signs=RIGHT,
    t=9.0,
    ratios=(0.1, 0.1),
    split=(0.1, 0.1),
    shape_fits=True,
    unnamed=None,
    left_over=None,
    doubt=None,
):
    """Judges a trace that found kinds, and a field or curves without a name."""
    if unnamed is None:
        unnamed = field or bool(terms)
    effects = [entry(kind, shape_fits) for kind in kinds]
    if not signs.are_right:
        effects.append(entry("angle_sign"))
    if unnamed:
        effects.append(entry("unexplained"))
    traced = types.SimpleNamespace(
        model=types.SimpleNamespace(kinds=tuple(kinds)),
        field=object() if field else None,
        forces=None if left_over is None else object(),
    )
    left = Left(ratio_to_noise=3.0, position_m=0.05, depends_on=left_over or ())
    held_out = types.SimpleNamespace(t=t, ratios=ratios) if signs.are_right else None
    errors = {"refitted": errors_with(1.0, 1.0), "corrected": errors_with(*split)}
    carried = Carried(terms=terms, data=None)
    return judge(traced, signs, carried, held_out, errors, tuple(effects), left, doubt)


def test_thrown_gliders_that_leave_much_are_never_without_effect():
    word, reason = verdict(left_over=("alpha", "V"))
    assert word == "unexplained"
    assert "alpha, V" in reason
    assert verdict(left_over=())[0] == "no_effect"


def test_nothing_found_is_no_effect():
    """However the flights came out."""
    assert verdict()[0] == "no_effect"
    assert verdict(t=-5.0, ratios=(2.0, 2.0))[0] == "no_effect"


def test_effects_that_hold_are_found():
    word, reason = verdict(("wind",))
    assert word == "effect_found"
    assert "curve" not in reason


def test_a_shape_that_is_not_the_librarys_is_told():
    word, reason = verdict(
        ("wind",), terms=("c_drag",), shape_fits=False, unnamed=False
    )
    assert word == "effect_found"
    assert "curve" in reason


@pytest.mark.parametrize("kinds", [("wind",), ()], ids=["named", "unnamed"])
def test_a_gain_by_chance_is_not_trusted(kinds):
    word, reason = verdict(kinds, field=not kinds, t=LEAST_T - 0.1)
    assert word == "not_trusted"
    assert f"t = {LEAST_T - 0.1:.1f}" in reason
    assert verdict(kinds, field=not kinds, t=LEAST_T + 0.1)[0] != "not_trusted"


@pytest.mark.parametrize("place", range(4))
def test_what_makes_unseen_flights_worse_is_not_trusted(place):
    """Free or along the measured pitch, in folds or on the flights held out."""
    worse = WORSE[place % 2] + 0.01
    for worst, expected in ((worse, "not_trusted"), (1.0, "effect_found")):
        ratios = [0.5, 0.5, 0.5, 0.5]
        ratios[place] = worst
        word, reason = verdict(("wind",), ratios=ratios[:2], split=ratios[2:])
        assert word == expected
        words = f"{FLOWN[place % 2]} {worse:.3g} times"
        assert (words in reason) == (word == "not_trusted")


def test_what_leaves_too_much_to_chance_is_not_trusted():
    word, reason = verdict(("wind",), doubt="the model needs gusts of 0.6 m/s")
    assert word == "not_trusted"
    assert "gusts of 0.6 m/s" in reason
    assert verdict((), doubt="the model needs gusts of 0.6 m/s")[0] == "no_effect"


@pytest.mark.parametrize("lack", [{"field": True}, {"terms": ("c_lift",)}], ids=str)
def test_what_has_no_name_is_unexplained(lack):
    assert verdict((), **lack)[0] == "unexplained"
    assert verdict(("wind",), **lack)[0] == "partly_explained"


def test_wrong_signs_need_no_folds():
    wrong = Signs(pitch=-1, evidence=1e4, share=0.9)
    assert verdict((), signs=wrong)[0] == "effect_found"
    assert verdict(("wind",), signs=wrong, t=-9.0)[0] == "effect_found"
    assert verdict((), signs=wrong, field=True)[0] == "partly_explained"
    worse = verdict(("wind",), signs=wrong, split=(WORSE[0] + 0.01, 0.5))
    assert worse[0] == "not_trusted"


def test_what_only_differs_from_flight_to_flight_names_no_lack():
    """A trim that is zero in the mean stands beside the unexplained, no more."""
    traced = types.SimpleNamespace(
        model=types.SimpleNamespace(kinds=()), field=object(), forces=None
    )
    left = Left(ratio_to_noise=3.0, position_m=0.05, depends_on=())
    found = (entry("unexplained"), entry("elevator_trim"))
    held_out = types.SimpleNamespace(t=9.0, ratios=(0.9, 0.9))
    errors = {"refitted": errors_with(1.0, 1.0), "corrected": errors_with(0.9, 0.9)}
    word, _ = judge(traced, RIGHT, NO_CURVES, held_out, errors, found, left, None)
    assert word == "unexplained"


def test_all_verdicts_have_been_seen():
    seen = {
        verdict()[0],
        verdict(("wind",))[0],
        verdict(("wind",), field=True)[0],
        verdict(field=True)[0],
        verdict(("wind",), t=0.0)[0],
    }
    assert seen == set(VERDICTS)


# ------------------------------------------------------------------------ curves


@pytest.fixture(scope="module")
def plain():
    """A task, and its nominal model with curves of nothing."""
    task, noise = task_of(fly(flights=3))
    model = begin(task, noise)
    return task, dataclasses.replace(model, coordinates=np.zeros(task.curves.count))


def known_within(model, std):
    """Returns an uncertainty in which all curves' coordinates have one error."""
    count = len(model.free) + len(model.coordinates)
    return Uncertainty(
        free=model.free,
        covariance=std**2 * np.eye(count),
        flights=np.zeros((1, count + 1, count + 1)),
    )


def curve_of(task, term):
    """Returns coordinates of a curve in one term only, as large as typical."""
    curves, place = task.curves, TERMS.index(term)
    values = np.stack([curves.values(u, curves.angles) for u in np.eye(curves.count)])
    others = np.delete(values, place, axis=2).reshape(curves.count, -1)
    _, _, rows = np.linalg.svd(others.T)
    found = rows[-1]
    assert np.abs(found @ values[:, :, place]).max() > 1e-4
    return found


def test_no_curves_none_carried(plain):
    task, model = plain
    bare = dataclasses.replace(model, coordinates=np.zeros(0))
    assert carried_of(task, bare, known_within(bare, 0.1)) == NO_CURVES
    assert carried_of(task, model, known_within(model, 0.1)).terms == ()


@pytest.mark.parametrize("term", ["c_moment", "elevator_factor"])
def test_a_curve_that_is_sure_is_carried_and_told_by_its_term(plain, term):
    task, model = plain
    coordinates = curve_of(task, term)
    bent = dataclasses.replace(model, coordinates=coordinates)
    size = np.linalg.norm(coordinates)
    sure = carried_of(task, bent, known_within(bent, size / (20.0 * CURVE_Z)))
    assert sure.terms == (term,)
    assert sure.data == task.curves.data(coordinates)
    assert carried_of(task, bent, known_within(bent, 10.0 * size)).terms == ()


def test_what_is_carried_is_in_the_model_and_nothing_else_is(plain):
    task, model = plain
    bent = dataclasses.replace(model, coordinates=curve_of(task, "c_moment"))
    carried = Carried(terms=("c_moment",), data=task.curves.data(bent.coordinates))
    campaign = fly(flights=1, duration=0.2)
    whole = model_of(task, bent, carried, Signs(), campaign)
    assert whole.field == carried.data
    assert model_of(task, bent, NO_CURVES, Signs(), campaign).field is None
    signs = Signs(pitch=-1)
    (effect,) = model_of(task, bent, NO_CURVES, signs, campaign).effects
    assert effect.to_dict()["pitch"] == -1.0


def table(lift, drag, flights=6, rows=200):
    rng = np.random.default_rng(0)
    alpha = rng.uniform(0.0, 1.0, flights * rows)
    return ResidualTable(
        variables={"alpha": alpha},
        residual=np.zeros((len(alpha), 3)),
        coefficients={
            "c_lift": lift(alpha),
            "c_drag": drag(alpha) + rng.normal(0.0, 0.1, len(alpha)),
            "c_moment": 0.0 * alpha,
        },
        modelled={name: 0.0 * alpha for name in ("c_lift", "c_drag", "c_moment")},
        flight=np.repeat(np.arange(flights), rows),
        names=tuple(f"{i}.csv" for i in range(flights)),
        noise=np.zeros((len(alpha), 3)),
        unit=np.ones((len(alpha), 2)),
    )


def test_curves_show_what_is_lacking_along_and_across_the_wing():
    """A drag along the body: c_axial at all angles of attack, and no c_normal."""
    before = table(lambda a: -0.2 * np.sin(a), lambda a: 0.2 * np.cos(a))
    after = dataclasses.replace(before, modelled=before.coefficients)
    found = {curve.term: curve for curve in curves_of(before, after)}
    assert set(found) == {"c_normal", "c_axial", "c_moment"}
    axial, normal = found["c_axial"], found["c_normal"]
    assert np.all(np.diff(axial.alpha) > 0.0)
    assert np.all(np.abs(axial.lack - 0.2) < 5.0 * axial.std)
    assert np.all(np.abs(normal.lack) < 5.0 * normal.std)
    np.testing.assert_allclose(axial.named, axial.lack, atol=0.01)
    expected = 0.1 * np.cos(axial.alpha) / np.sqrt(6 * 200 / len(axial.alpha))
    assert np.median(axial.std / expected) == pytest.approx(1.0, rel=0.4)


# ----------------------------------------------------------------------- spreads


def test_trims_that_differ_from_flight_to_flight_are_told_one_by_one():
    campaign, truth = turbulence_campaign(4, flights=12)
    task, noise = task_of(campaign)
    found = spreads_of(task, fit_model(task, begin(task, noise)))
    assert set(found) == {"elevator_trim"}
    spread, own = found["elevator_trim"], truth.per_flight["elevator_trim"]
    assert spread.unit == "rad"
    assert spread.std == pytest.approx(np.std(own), rel=0.3)
    assert list(spread.values) == [record.name for record in task.records]
    values = np.array(list(spread.values.values()))
    assert np.corrcoef(values, own)[0, 1] > 0.9
    assert np.std(values - own) < 0.5 * np.std(own)


def test_where_flights_are_alike_nothing_is_told():
    task, noise = task_of(fly(flights=8))
    assert spreads_of(task, fit_model(task, begin(task, noise))) == {}


def test_what_effects_explain_is_in_the_units_of_the_plate():
    """A model that sees half the airspeed leaves nothing: all that lacks is named."""
    before = table(lambda a: -0.2 * np.sin(a), lambda a: 0.2 * np.cos(a))
    slower = dataclasses.replace(
        before,
        coefficients={n: 4.0 * c for n, c in before.coefficients.items()},
        modelled={n: 4.0 * c - 0.4 for n, c in before.coefficients.items()},
        unit=before.unit / 4.0,
    )
    (moment,) = [c for c in curves_of(before, slower) if c.term == "c_moment"]
    np.testing.assert_allclose(moment.lack - moment.named, 0.4 / 4.0)
