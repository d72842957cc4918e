"""The parts of a result: curves, free functions, flight-to-flight variation."""

import dataclasses
import types

import numpy as np
import pytest
import scipy.linalg

from glider.campaign.turning import Signs
from glider.physics.effects import ELEVATOR_TRIM, PITCH_OFFSET, WIND
from glider.sysid.likelihood.fitted_functions import flown_values
from glider.sysid.likelihood.model_fit import fit_model
from glider.sysid.likelihood.uncertainty import Uncertainty
from glider.sysid.naming import (
    LIFT,
    OVER_RATE,
    absorbed,
    names_of,
    names_of_lift,
    slight,
    small,
    standing_alone,
)
from glider.sysid.outcome import (
    curves_of,
    effects_of,
    model_of,
    numbers_of_lift,
    rivals_of,
    spreads_of,
    vehicle_of,
)
from glider.sysid.report import LIBRARY_SHAPE, OTHER_SHAPE
from glider.sysid.result import ResidualTable
from tests.helpers.lifelike import turbulence_campaign
from tests.helpers.tasks import begin, fly, task_of


@pytest.fixture(scope="module")
def plain():
    """A task, and its nominal model."""
    task, noise = task_of(fly(flights=3))
    return task, begin(task, noise)


def test_what_is_carried_is_in_the_model_and_nothing_else_is(plain):
    task, model = plain
    bent = with_function(task, model, "moment over alpha").model
    whole = model_of(task, bent, Signs())
    (own,) = bent.functions
    assert whole.free_functions == (own.data,)
    assert model_of(task, model, Signs()).free_functions == ()
    (effect,) = model_of(task, model, Signs(pitch=-1)).effects
    assert effect.to_dict()["pitch"] == -1.0


# ------------------------------------------------------------------------ curves


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


# ------------------------------------------------------------------------ functions


def with_function(task, model, name):
    """Returns a trace of a model with a free function."""
    function = task.functions[name]
    values = np.linspace(2.0, 1.0, function.count)  # So that peaks are near the start.
    own = dataclasses.replace(function, coordinates=values)
    model = dataclasses.replace(model, kinds=(name,), functions=(own,))
    return types.SimpleNamespace(
        model=model,
        families={},
        found_by={},
        evidence={name: 50.0},
        weighed={name: types.SimpleNamespace(inclusion=1.0, rivals=())},
        rivals=(),
    )


def test_a_free_functions_errors_are_its_own(plain):
    task, model = plain
    traced = with_function(task, model, "air along x over x")
    function, first = task.functions["air along x over x"], 3
    std = np.append(np.full(first, 9.0), np.full(function.count, 0.1))
    places = {function.name: range(first, len(std))}
    known = Uncertainty(
        free=model.free,
        named=(),
        places=places,
        likelihood=np.diag(std**2),
        changes=np.zeros((2, len(std))),
    )
    (effect,) = effects_of(task, traced, known, {}, Signs())
    assert effect.kind == "unexplained" and effect.family == "air"
    peak = effect.coefficients["wind_x_peak"]
    # A Gaussian beside its neighbours, each 0.5 m/s times 0.1.
    assert 0.05 < peak.std < 0.15


def entry_of(task, model, name, family=None):
    """Returns the only reported effect of a model with one free function."""
    traced = with_function(task, model, name)
    traced.families = {name: family} if family else {}
    function = task.functions[name]
    known = Uncertainty(
        free=model.free,
        named=(),
        places={name: range(function.count)},
        likelihood=1e-4 * np.eye(function.count),
        changes=np.zeros((2, function.count)),
    )
    (effect,) = effects_of(task, traced, known, {}, Signs())
    return effect


def test_a_free_function_of_no_family_is_no_effect_of_the_library(plain):
    effect = entry_of(*plain, "air along x over x")
    assert effect.kind == "unexplained" and effect.shape == LIBRARY_SHAPE
    assert effect.words.startswith("no effect of the library: air along x that changes")
    assert effect.depends_on == ("x",)


def test_a_free_function_of_a_family_has_not_its_formulas_shape(plain):
    effect = entry_of(*plain, "wing's force over z", "ground_effect")
    assert effect.kind == "ground_effect" and effect.shape == OTHER_SHAPE
    assert effect.words.startswith("a wing's force that changes with z")
    assert effect.family == "wing_force" and effect.depends_on == ("z",)


def test_effects_of_sets_that_are_nearly_as_likely_are_rivals():
    """Of what they have instead of it: formulas, but those of the model itself."""
    task, _ = task_of(fly(flights=2, duration=0.6))

    def fitted(*kinds):
        return types.SimpleNamespace(kinds=kinds)

    traced = types.SimpleNamespace(
        model=fitted("camber", "mass", "lift over reduced_rate"),
        weighed={"camber": types.SimpleNamespace(rivals=("wing_incidence",))},
        rivals=(
            (fitted("pitch_offset", "mass", "lift over reduced_rate"), 1.0),
            (fitted("pitch_rate_lift", "mass"), 1.5),
            (fitted("camber", "mass", "dynamic_stall", "lift over alpha"), 2.0),
            (fitted("wind", "mass", "thrust", "lift over reduced_rate"), 3.0),
            (fitted("downwash", "inertia", "lift over reduced_rate"), 4.0),
        ),
    )
    reported = {"camber", "mass", "pitch_rate_lift"}
    rivals = rivals_of(task, traced, reported, "camber")
    assert {*rivals} == {"pitch_offset", "wing_incidence", "wind", "thrust"}
    of_rate = "lift over reduced_rate"
    assert rivals_of(task, traced, reported, of_rate, "pitch_rate_lift") == (
        "dynamic_stall",
    )
    assert rivals_of(task, traced, reported, of_rate, "dynamic_stall") == ()


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


COMMON = WIND(x=-0.4), ELEVATOR_TRIM(angle=0.1), PITCH_OFFSET(angle=0.05)


@pytest.mark.parametrize("effect", COMMON, ids=lambda effect: effect.kind.kind)
def test_what_all_flights_have_is_no_variation(effect):
    """Though a model that lacks it needs the same constant in each flight."""
    task, noise = task_of(fly(effect, flights=8))
    assert spreads_of(task, fit_model(task, begin(task, noise))) == {}


def test_a_variation_is_about_its_mean():
    trims = 0.1 + 0.02 * np.array([-1.3, 0.4, 1.2, -0.8, 0.1, 1.0, -1.1, 0.5])
    flights = []
    for k, trim in enumerate(trims.tolist()):
        campaign = fly(ELEVATOR_TRIM(angle=trim), flights=1, seed=k)
        name = f"flight_{k:03d}.csv"
        flights.append(dataclasses.replace(campaign.flights[0], name=name))
    task, noise = task_of(dataclasses.replace(campaign, flights=tuple(flights)))
    found = spreads_of(task, fit_model(task, begin(task, noise)))
    assert set(found) == {"elevator_trim"}
    spread = found["elevator_trim"]
    assert spread.std == pytest.approx(np.std(trims), rel=0.1)
    np.testing.assert_allclose([*spread.values.values()], trims, atol=3e-3)


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


def test_formulas_that_only_help_others_to_their_shape_are_not_named():
    task, _ = task_of(fly(flights=2, duration=0.3))
    space = task.space

    def unnamed(times, evidence, free=()):
        theta = task.vehicle.theta.copy()
        for name, value in times.items():
            theta[space.index[f"lagged_separation.{name}"]] = value
        model = types.SimpleNamespace(
            kinds=(*evidence,), free_kinds=free, functions=(), theta=theta
        )
        traced = types.SimpleNamespace(model=model, evidence=evidence)
        known = types.SimpleNamespace(std=lambda slot: 0.01)
        return absorbed(task, traced, known)

    both = {"attached_lift": 60.0, "lagged_separation": 40.0}
    long, short = {"relaxation": 0.08}, {"relaxation": 0.03, "delay": 0.01}
    assert unnamed(long, both) == {}
    assert unnamed({"relaxation": 0.012, "delay": 0.05}, both) == {}
    assert unnamed(short, both) == {"lagged_separation": {"attached_lift"}}
    assert unnamed(short, {"lagged_separation": 40.0}) == {}
    of_rate = {"lagged_separation": 40.0, "pitch_rate_lift": 30.0}
    assert unnamed(short, of_rate) == {}  # It has the only lift over alpha.
    function = "lift over alpha and reduced_rate"
    beside = {"lagged_separation": 40.0, function: 10.0}
    assert unnamed(short, beside, (function,)) == {"lagged_separation": {function}}
    assert unnamed(long, beside, (function,)) == {}
    first = {"attached_lift": 30.0, "lagged_separation": 60.0, "lift over alpha": 50.0}
    assert unnamed(short, first, ("lift over alpha",)).keys() == {"lagged_separation"}
    three = {"dynamic_stall": 90.0, "pitch_rate_lift": 30.0}
    shaped = {"pitch_rate_lift": {"dynamic_stall", function}}
    assert unnamed({}, three | {function: 50.0}, (function,)) == shaped
    assert unnamed({}, three | {function: 20.0}, (function,)) == {}
    stream = "stream at the tail over alpha"  # Its family has no area.
    area, pressure = {"elevator_area": 22.0}, "tail's force over elevator"
    assert unnamed({}, area | {stream: 400.0}, (stream,)) == {"elevator_area": {stream}}
    assert unnamed({}, area | {stream: 20.0}, (stream,)) == {}
    assert unnamed({}, {"downwash": 42.0, stream: 400.0}, (stream,)) == {}
    turned = {"downwash": 22.0, stream: 400.0}  # It is the function's rest.
    assert unnamed({}, turned, (stream,)) == {"downwash": {stream}}
    assert unnamed({}, area | {pressure: 400.0}, (pressure,)) == {}  # It has no family.
    load, wake = "tail's angle over tail_load", "tail's force over alpha"
    both = {"tail_wake": 46.0, "elevator_blowback": 178.0, load: 219.0, wake: 550.0}
    weak = {"tail_wake": {wake}}  # Each has a function of its family.
    assert unnamed({}, both, (load, wake)) == weak
    weak = {"profile_drag": 2000.0, "camber": 12.0}
    assert unnamed({}, weak) == {}
    assert unnamed({}, weak | {"drag over V": 50.0}, ("drag over V",)) == {
        "camber": set()
    }
    moment = "moment over alpha"  # Without a mean, which the constant moment is.
    mean, whole = {"pitch_moment": 35.0}, {"pitch_moment": 35.0, moment: 45.0}
    assert unnamed({}, whole, (moment,)) == {"pitch_moment": {moment}}
    assert unnamed({}, mean | {moment: 25.0}, (moment,)) == {}
    turned = {"center_of_pressure": 35.0, moment: 45.0}
    assert unnamed({}, turned, (moment,)) == {}
    both = {"pitch_moment": 40.0} | turned  # The other formula is its first.
    assert unnamed({}, both, (moment,)).keys() == {"pitch_moment"}


def sized(task, model, name, size):
    """Returns a free function that is so large, over its prior's RMS."""
    own, flown = task.functions[name], flown_values(task.records, model.theta)
    own = dataclasses.replace(own, coordinates=np.ones(own.count))
    values = own.gaussians(flown[:, own.columns]) @ own.weights
    [value] = own.effect.coefficients
    factor = size * value.scale / np.sqrt(np.mean(values**2))
    return dataclasses.replace(own, coordinates=factor * own.coordinates)


def test_a_small_free_function_is_no_effect_where_a_larger_one_acts(plain):
    """Its size is along the flights, over what is expected, of which 4 % count."""
    task, model = plain

    def found(**sizes):
        names = {f"{link} over alpha": size for link, size in sizes.items()}
        functions = tuple(sized(task, model, *own) for own in names.items())
        other = dataclasses.replace(model, kinds=tuple(names), functions=functions)
        return small(task, other)

    assert found() == found(lift=0.02) == set()
    assert found(lift=0.035, moment=0.5) == {"lift over alpha"}
    assert found(lift=0.045, moment=0.5) == set()
    assert found(lift=0.02, moment=0.03) == {"lift over alpha"}


def test_a_formula_is_named_where_the_function_that_bends_it_is_small(plain):
    """One of them has to be, or a moment is gone."""
    task, model = plain
    moment, drag = "moment over alpha", "drag over V"
    evidence = {"pitch_moment": 60.0, moment: 80.0, drag: 300.0}

    def named(size):
        functions = (sized(task, model, moment, size), sized(task, model, drag, 0.5))
        kinds, traced = (*evidence,), with_function(task, model, drag)
        traced.model = dataclasses.replace(
            model, kinds=kinds, free=task.free(kinds), functions=functions
        )
        traced.evidence, traced.families = evidence, {moment: "center_of_pressure"}
        own = types.SimpleNamespace(inclusion=1.0, rivals=())
        traced.weighed = dict.fromkeys(evidence, own)
        count = len(traced.model.free) + sum(own.count for own in functions)
        known = Uncertainty(
            free=traced.model.free,
            named=task.space.slots_of("pitch_moment"),
            places=traced.model.places(),
            likelihood=np.eye(count),
            changes=np.zeros((2, count)),
        )
        return {own.kind for own in effects_of(task, traced, known, {}, Signs())}

    assert named(0.5) == {"center_of_pressure", "unexplained"}
    assert named(0.02) == {"pitch_moment", "unexplained"}


def test_a_free_function_is_no_effect_of_its_own_where_it_helps_a_named_one():
    function = "lift over alpha and reduced_rate"
    lag, lift = "lagged_separation", "attached_lift"
    both = {lift: 60.0, lag: 40.0, function: 50.0}
    assert function in standing_alone({lift: 60.0, function: 50.0}, (function,), {})
    assert not standing_alone(both, (function,), {})
    assert not standing_alone(both, (function,), {lag: {lift}})
    assert standing_alone(both, (function,), {lag: {function}}) == {function}
    assert not standing_alone(both, (function,), {lag: {function}, function: set()})
    load, wake = "tail's angle over tail_load", "tail's force over alpha"
    one = {"tail_wake": 46.0, load: 4.0}
    assert not standing_alone(one, (load,), {})
    assert standing_alone(one | {load: 5.0}, (load,), {}) == {load}
    both = one | {wake: 550.0}  # Which counts as the effect's own evidence.
    assert not standing_alone(both | {load: 59.0}, (load, wake), {})
    assert standing_alone(both | {load: 60.0}, (load, wake), {}) == {load}
    assert standing_alone({"tail_wake": 300.0, load: 20.0}, (load,), {}) == set()
    unnamed = {"tail_wake": {"elevator_area"}}
    assert standing_alone({"tail_wake": 300.0, load: 20.0}, (load,), unnamed) == {load}
    moment = "moment over V"  # Added mass is no moment by the airspeed.
    beside = {"added_mass": 20.0, moment: 500.0}
    assert standing_alone(beside, (moment,), {}) == {moment}
    speed = "tail's force over V"  # It has no family.
    own = {wake: 550.0, speed: 54.0}
    assert standing_alone(own, (wake, speed), {}) == {wake}
    assert standing_alone(own | {speed: 56.0}, (wake, speed), {}) == {wake, speed}


def likeliest(shown, values):
    """Coordinates by values (n,) with errors of a hundredth, and their covariance.

    Of the likeliest strength, as a fit has it.
    """
    error, strength = 0.01 * np.std(values), 1.0
    for _ in range(8):
        known = shown.T @ shown / error**2 + np.eye(shown.shape[1]) / strength**2
        covariance = np.linalg.inv(known)
        weights = covariance @ shown.T @ values / error**2
        strength = np.sqrt(np.mean(weights**2 + np.diag(covariance)))
    return weights, covariance


@pytest.mark.parametrize(
    ("link", "law", "slope", "names", "likelier"),
    [
        ("lift", lambda a, q: np.sin(a), 0.0, "attached_lift", ""),
        ("lift", lambda a, q: -0.3 * q, 0.0, "pitch_rate_lift", "dynamic_stall"),
        ("lift", lambda a, q: 0.3 * q * (a > 0.3), 0.0, "dynamic_stall", ""),
        (
            *("lift", lambda a, q: 0.3 * q * (a > 0.3), 0.3),
            *("pitch_rate_lift", "dynamic_stall"),
        ),
        (
            *("lift", lambda a, q: np.sin(a) - 0.5 * q, 0.0),
            *("attached_lift pitch_rate_lift", "attached_lift"),
        ),
        ("moment", lambda a, q: 0.01 * np.sin(3.0 * a), 0.0, "center_of_pressure", ""),
        ("moment", lambda a, q: 0.01 * q * (a < 0.4), 0.0, "pitch_damping", ""),
        (
            *("moment", lambda a, q: 0.01 * np.sin(3.0 * a), 0.004),
            *("center_of_pressure pitch_damping", "center_of_pressure"),
        ),
    ],
    ids=[
        "lift",
        "by rate",
        "where flow separates",
        "not there",
        "both",
        "moment",
        "damping",
        "damping's formula",
    ],
)
def test_functions_of_alpha_and_the_rate_are_named_by_their_parts(
    link, law, slope, names, likelier
):
    task, _ = task_of(fly(flights=8, duration=0.6))
    name = f"{link} over alpha and reduced_rate"
    function, formula = task.functions[name], OVER_RATE[link]
    nearest = {"lift": "dynamic_stall", "moment": "pitch_damping"}[link]
    at = flown_values(task.records, task.vehicle.theta)[:, function.columns]
    shown = function.gaussians(at) @ function.mix
    weights, covariance = likeliest(shown, law(*at.T))
    errors = scipy.linalg.block_diag(1e-8, covariance)
    own = dataclasses.replace(function, coordinates=weights)
    theta, [slot] = task.vehicle.theta.copy(), task.space.slots_of(formula)
    theta[slot] = slope
    model = types.SimpleNamespace(kinds=(name,), theta=theta, by_name={name: own})
    known = types.SimpleNamespace(
        free=[slot] if slope else [],
        places={name: range(1, 1 + function.count)},
        std_along=lambda places, rows: np.sqrt(
            np.einsum("...i,ij,...j->...", rows, errors[np.ix_(places, places)], rows)
        ),
    )
    assert names_of(task, model, known, name, nearest) == {*names.split()}
    unknown = types.SimpleNamespace(
        free=known.free,
        places=known.places,
        std_along=lambda places, rows: np.full(np.shape(rows)[:-1], 10.0),
    )
    assert names_of(task, model, unknown, name, nearest) == {likelier or names}


@pytest.mark.parametrize(
    ("force", "names"),
    [
        (lambda a: 2.5 * np.sin(a) * np.exp(-((a / 0.4) ** 2)), {"attached_lift"}),
        (lambda a: 0.1 + 0.0 * a, {"camber"}),
        (lambda a: 0.3 + 2.5 * np.sin(a) / (1 + a**4), {"attached_lift", "camber"}),
    ],
    ids=["lift", "camber", "both"],
)
@pytest.mark.parametrize("beside", [0.0, 0.05], ids=["alone", "beside a camber"])
def test_a_normal_force_where_the_plate_has_none_is_camber(force, names, beside):
    """Together with a formula, which the free function may undo."""
    task, _ = task_of(fly(flights=2, duration=0.6))
    function, theta = task.functions[LIFT], task.vehicle.theta.copy()
    (slot,) = task.space.slots_of("camber")
    theta[slot] = beside
    alpha = np.linspace(*function.flown[:, 0], 200)
    alone = force(alpha) - 2.0 * (np.sin(alpha - beside) - np.sin(alpha))
    shown = function.gaussians(alpha[:, None]) @ function.mix
    weights = np.linalg.lstsq(shown, alone, rcond=1e-6)[0]
    own = dataclasses.replace(function, coordinates=weights)
    kinds = (LIFT, "camber") if beside else (LIFT,)
    model = types.SimpleNamespace(kinds=kinds, theta=theta, by_name={LIFT: own})
    places = {LIFT: range(1, 1 + function.count)}

    def known(std):
        errors = {"places": places, "free": (slot,), "std_along": lambda *_: std}
        return types.SimpleNamespace(**errors)

    assert names_of_lift(task, model, known(0.002)) == names
    assert names_of_lift(task, model, known(0.1)) == {"attached_lift"}
    at_zero = np.interp([-0.02, 0.0, 0.02], alpha, alone)
    expected = {
        "attached_lift": ("slope", (at_zero[2] - at_zero[0]) / 0.04, 0.3),
        "camber": ("zero_lift_angle", -0.5 * at_zero[1], 0.005),
    }
    for family, (name, value, error) in expected.items():
        found = numbers_of_lift(own, known(0.01), family)[name]
        assert found.value == pytest.approx(value, abs=error)
        assert found.std == 0.01


def test_what_stands_for_errors_of_free_functions_is_slight():
    of_drag, of_lift = "drag over V", "lift over alpha"
    found = {of_drag: 3000.0, "camber": 12.0, of_lift: 5.0}
    assert slight((), found) == set()
    assert slight((of_drag, of_lift), found) == {"camber", of_lift}
    # A slight formula is the name of what bends it.
    found = {of_drag: 3000.0, "camber": 12.0, of_lift: 50.0}
    assert slight((of_drag, of_lift), found) == set()


def test_units_per_kilogram_are_those_of_the_vehicle_alone():
    """An effect's coefficient has the wing's area, which is per kilogram, in it."""
    task, _ = task_of(dataclasses.replace(fly(flights=3), vehicle={}))
    model = types.SimpleNamespace(theta=task.vehicle.theta)
    known = types.SimpleNamespace(std=lambda slot: 0.1)
    units = {name: own.unit for name, own in vehicle_of(task, model, known).items()}
    assert units["wing_area"] == "m²/kg"
    assert units["pitch_damping.coefficient"] == "m²"
