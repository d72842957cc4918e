"""The parts of a result: free functions, flight-to-flight variation."""

import dataclasses
import types

import numpy as np
import pytest
import scipy.linalg

from glider.campaign.turning import Signs
from glider.physics.effects import (
    ELEVATOR_TRIM,
    PITCH_OFFSET,
    PROFILE_DRAG,
    SERVO_LAG,
    WIND,
)
from glider.sysid.fit.folds import HeldOut
from glider.sysid.likelihood.model_fit import fit_model
from glider.sysid.likelihood.uncertainty import Uncertainty
from glider.sysid.outcome import (
    _rivals_of,
    covariance_of,
    effects_of,
    model_of,
    spreads_of,
    vehicle_of,
)
from glider.sysid.result import LIBRARY_SHAPE, OTHER_SHAPE, UNEXPLAINED
from tests.helpers.lifelike import turbulence_campaign
from tests.helpers.tasks import begin, fly, task_of

NO_FOLDS = HeldOut(gains={}, chosen=[set()])


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


@pytest.mark.parametrize("kind", [SERVO_LAG, PROFILE_DRAG])
@pytest.mark.parametrize("errors", [1.0, 3.0])
def test_an_effect_whose_size_may_be_zero_has_no_name(plain, kind, errors):
    """A lag is a size, though it is found like a shape."""
    task, model = plain
    free = task.free((kind.kind,))
    [slot] = task.space.slots_of(kind.kind)
    theta = model.theta.copy()
    theta[slot] = errors * 0.01
    stds = np.where(np.array(free) == slot, 0.01, 1e-9)
    model = dataclasses.replace(model, kinds=(kind.kind,), theta=theta, free=free)
    known = Uncertainty(
        free=free,
        named=(slot,),
        places={},
        likelihood=np.diag(stds**2),
        changes=np.zeros((2, len(free))),
    )
    traced = types.SimpleNamespace(
        model=model,
        names={kind.kind: kind.kind},
        evidence={kind.kind: 50.0},
        rivals=(),
        alike={},
    )
    (effect,) = effects_of(task, traced, NO_FOLDS, known, {}, Signs())
    assert effect.kind == (kind.kind if errors > 2.0 else UNEXPLAINED)
    assert kind.words in effect.words


# ------------------------------------------------------------------------ functions


def with_function(task, model, name):
    """Returns a trace of a model with a free function."""
    function = task.functions[name]
    values = np.linspace(2.0, 1.0, function.count)  # So that peaks are near the start.
    own = dataclasses.replace(function, coordinates=values)
    model = dataclasses.replace(model, kinds=(name,), functions=(own,))
    return types.SimpleNamespace(
        model=model,
        names={name: UNEXPLAINED},
        evidence={name: 50.0},
        rivals=(),
        alike={},
    )


def peak_of(task, model, covariance):
    """Returns the effect of a function of the air with coordinates of a covariance.

    Three other coefficients come first, with errors of 9.
    """
    name = "air along x over x"
    traced = with_function(task, model, name)
    whole = scipy.linalg.block_diag(81.0 * np.eye(3), covariance)
    known = Uncertainty(
        free=traced.model.free,
        named=(),
        places={name: range(3, len(whole))},
        likelihood=whole,
        changes=np.zeros((2, len(whole))),
    )
    (effect,) = effects_of(task, traced, NO_FOLDS, known, {}, Signs())
    return effect


def test_a_free_functions_errors_are_its_own(plain):
    task, model = plain
    count = task.functions["air along x over x"].count
    effect = peak_of(task, model, 0.01 * np.eye(count))
    assert effect.kind == "unexplained"
    peak = effect.coefficients["wind_x_peak"]
    # A Gaussian beside its neighbours, each 0.5 m/s times 0.1.
    assert 0.05 < peak.std < 0.15


def test_a_peak_is_on_the_flights_where_it_is_surely_large(plain):
    task, model = plain
    function = task.functions["air along x over x"]
    flown = [record.pose[:, 0] for record in task.records]
    equal = 0.01 * np.eye(function.count)
    peak = peak_of(task, model, equal).coefficients
    place = peak["wind_x_peak_at_x"].value
    assert min(map(np.min, flown)) - 0.01 < place < max(map(np.max, flown)) + 0.01
    # The value there is not known: the peak is elsewhere.
    [row] = function.gaussians(np.array([[place]])) @ function.mix
    unsure = equal + 100.0 * np.outer(row, row) / (row @ row)
    other = peak_of(task, model, unsure).coefficients
    # A model that diverges on a flight has no covariance.
    unknown = peak_of(task, model, np.full_like(equal, np.nan)).coefficients
    assert unknown["wind_x_peak"].value == peak["wind_x_peak"].value
    assert np.isnan(unknown["wind_x_peak"].std)
    assert abs(other["wind_x_peak_at_x"].value - place) > 0.1
    assert other["wind_x_peak"].std < 0.5 * abs(other["wind_x_peak"].value)


@pytest.mark.parametrize("diverges", [False, True])
def test_a_model_that_diverges_on_a_flight_has_no_covariance(plain, diverges):
    task, _ = plain
    slots = task.space.slots_of("profile_drag")
    variance = np.nan if diverges else 0.01
    known = Uncertainty(
        free=slots,
        named=slots,
        places={},
        likelihood=variance * np.eye(len(slots)),
        changes=np.zeros((3, len(slots))),
    )
    assert (covariance_of(task, known) is None) == diverges


def entry_of(task, model, name, family=None):
    """Returns the only reported effect of a model with one free function."""
    traced = with_function(task, model, name)
    traced.names = {name: family or UNEXPLAINED}
    function = task.functions[name]
    known = Uncertainty(
        free=model.free,
        named=(),
        places={name: range(function.count)},
        likelihood=1e-4 * np.eye(function.count),
        changes=np.zeros((2, function.count)),
    )
    (effect,) = effects_of(task, traced, NO_FOLDS, known, {}, Signs())
    return effect


def test_a_free_function_of_no_family_is_no_effect_of_the_library(plain):
    effect = entry_of(*plain, "air along x over x")
    assert effect.kind == "unexplained" and effect.shape == LIBRARY_SHAPE
    assert effect.words.startswith("no effect of the library: air along x that changes")
    assert effect.link == "air" and effect.depends_on == ("x",)


def test_a_free_function_of_a_family_has_not_its_formulas_shape(plain):
    effect = entry_of(*plain, "wing's force over z", "ground_effect")
    assert effect.kind == "ground_effect" and effect.shape == OTHER_SHAPE
    assert effect.words.startswith("a wing's force that changes with z")
    assert effect.link == "wing_force" and effect.depends_on == ("z",)


def test_a_formula_and_what_bends_it_are_one_effect(plain):
    """Its coefficients are the formula's, its evidence is that of both."""
    task, model = plain
    name = "drag over V"
    traced = with_function(task, model, name)
    [slot, *_] = task.space.slots_of("profile_drag")
    theta = model.theta.copy()
    theta[slot] = 0.05
    traced.model = dataclasses.replace(
        traced.model, kinds=("profile_drag", name), theta=theta
    )
    traced.evidence["profile_drag"] = 30.0
    traced.names = {"profile_drag": "profile_drag", name: "profile_drag"}
    known = types.SimpleNamespace(std=lambda slot: 0.01)
    chosen = [{"profile_drag"}, {"profile_drag"}, {"profile_drag"}, set()]
    tests = HeldOut(gains={}, chosen=chosen)
    [effect] = effects_of(task, traced, tests, known, {}, Signs())
    assert effect.kind == "profile_drag" and effect.shape == OTHER_SHAPE
    assert effect.coefficients["cd0"].value == 0.05
    assert effect.evidence == 80.0 and effect.inclusion == 0.75


def test_effects_of_sets_that_are_nearly_as_likely_are_rivals():
    """Of what they have instead of it: formulas, but those of the model itself."""
    task, _ = task_of(fly(flights=2, duration=0.6))

    def fitted(*kinds):
        return types.SimpleNamespace(kinds=kinds)

    traced = types.SimpleNamespace(
        model=fitted("camber", "mass", "lift over reduced_rate"),
        rivals=(
            (fitted("pitch_offset", "mass", "lift over reduced_rate"), 1.0),
            (fitted("pitch_rate_lift", "mass"), 1.5),
            (fitted("camber", "mass", "dynamic_stall", "lift over alpha"), 2.0),
            (fitted("wind", "mass", "thrust", "lift over reduced_rate"), 3.0),
            (fitted("downwash", "inertia", "lift over reduced_rate"), 4.0),
        ),
        alike={"camber": {"wing_incidence"}},
    )
    of_rate = "lift over reduced_rate"
    names = {"camber": "camber", "mass": "mass", of_rate: "pitch_rate_lift"}
    rivals = _rivals_of(task, traced, names, "camber")
    assert {*rivals} == {"pitch_offset", "wing_incidence", "wind", "thrust"}
    assert _rivals_of(task, traced, names, of_rate) == ("dynamic_stall",)
    names[of_rate] = "dynamic_stall"
    assert _rivals_of(task, traced, names, of_rate) == ()


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


def test_units_per_kilogram_are_those_of_the_vehicle_alone():
    """An effect's coefficient has the wing's area, which is per kilogram, in it."""
    task, _ = task_of(dataclasses.replace(fly(flights=3), vehicle={}))
    model = types.SimpleNamespace(theta=task.vehicle.theta)
    known = types.SimpleNamespace(std=lambda slot: 0.1)
    units = {name: own.unit for name, own in vehicle_of(task, model, known).items()}
    assert units["wing_area"] == "m²/kg"
    assert units["pitch_damping.coefficient"] == "m²"
