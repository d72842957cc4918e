"""The oracle's limits: rivals count, and unknown strengths of noise."""

import dataclasses

import numpy as np
import pytest
from scipy.optimize import minimize_scalar

from benchmarks.power import MOST_SIGMAS, limits_of
from glider.campaign.logs import ServoLog
from glider.sysid.likelihood.directions import slopes
from glider.sysid.likelihood.model_fit import fit_model, grams_of, linear_flights
from glider.sysid.likelihood.scale_fit import fit_scales
from tests.helpers.known_truth import begin, task_of
from tests.helpers.tasks import fly

pytestmark = pytest.mark.nightly  # Of a benchmark.

ASKED = ("servo_lag", "command_delay", "mass", "camber", "pitch_offset", "tail_wake")


@pytest.fixture(scope="module")
def still():
    """Of clocks that are known exactly: the oracle knows them."""
    servo = ServoLog(clock_std=0.0, command_std=0.0)
    task, noise = task_of(dataclasses.replace(fly(flights=6), servo=servo))
    return task, noise, fit_model(task, begin(task, noise))


@pytest.fixture(scope="module")
def limits(still):
    task, _, model = still
    return {x.kind: x for x in limits_of(task, model, ASKED)}


def test_the_wanted_effects_have_a_limit_of_what_they_show(limits):
    assert set(limits) == set(ASKED)
    for limit in limits.values():
        assert 0.0 < limit.std < np.inf
        # A test at 1 % in all of 52 columns, two-sided, has 95 % power from there on.
        assert 4.9 * limit.std < limit.shown <= limit.named
    assert limits["tail_wake"].shapes == {"angle": 0.4, "width": 0.25}


@pytest.mark.parametrize("kind", ["mass", "servo_lag", "camber"])
def test_the_standard_error_is_that_of_a_fit(still, limits, kind):
    """With the same scales."""
    task, noise, model = still
    fitted = fit_model(task, begin(task, noise, (kind,)), free_scales=())
    columns = slopes(task.space, fitted.free)
    grams = grams_of(linear_flights(task, fitted, columns), model.scales)
    [own] = (
        k for k, slot in enumerate(fitted.free) if slot in task.space.slots_of(kind)[:1]
    )
    error = np.sum(grams, axis=0)[own, own] ** -0.5  # Clocks are free too.
    assert limits[kind].std == pytest.approx(error, rel=0.05)


def test_what_is_one_to_the_flights_has_no_name(limits):
    """A small lag is a delay; an effect alone of its kind is named where it shows."""
    assert limits["servo_lag"].rival == "command_delay"
    assert limits["command_delay"].named == np.inf
    assert limits["camber"].named < 1.5 * limits["camber"].shown


def test_what_may_differ_from_flight_to_flight_takes_up_the_mean(still, limits):
    """Of few flights: a pitch zero of their own is nearly as likely as one for all."""
    task, _, model = still
    pitch, mass = limits["pitch_offset"], limits["mass"]
    assert pitch.shown / pitch.std > 1.3 * mass.shown / mass.std
    fewer = task.on(task.records[:3])
    own = limits_of(fewer, model, ["pitch_offset"])[0]
    assert own.shown / own.std > 1.2 * pitch.shown / pitch.std
    # Where it is known that nothing differs, three flights tell as well as six.
    assert own.std == pytest.approx(np.sqrt(2.0) * pitch.std, rel=0.2)


def test_rivals_that_are_no_candidates_do_not_matter(still):
    """An oracle that knows more names more."""
    task, _, model = still
    few = dataclasses.replace(task, kinds=("servo_lag", "mass"))
    lag = limits_of(few, model, ["servo_lag"])[0]
    assert lag.rival == "mass"
    assert lag.named == pytest.approx(lag.shown, rel=0.05)
    assert lag.named < MOST_SIGMAS * lag.std


def test_a_named_effect_is_lost_where_its_rival_is_fitted(still):
    """Two that are nearly one need 3.29 standard errors of what is left: 5.4 nats."""
    task, _, model = still
    few = dataclasses.replace(task, kinds=("profile_drag", "axial_drag"))
    drag = next(x for x in limits_of(few, model) if x.kind == "profile_drag")
    assert drag.rival == "axial_drag"
    assert drag.named > 3.0 * drag.shown
    slots = [task.space.slots_of(kind)[0] for kind in few.kinds]
    flights = linear_flights(task, model, slopes(task.space, slots))

    def lost(sizes):
        moved = [f.combined(np.asarray(sizes)) for f in flights]
        return fit_scales(moved, model.scales, iterations=20)[1]

    def lost_beside(rival):
        signs = -1.0, 1.0
        return sum(lost([s * drag.named, -s * rival]) for s in signs) / 2.0

    bounds = 0.5 * drag.named, 1.5 * drag.named
    best = minimize_scalar(lost_beside, bounds=bounds, method="bounded")
    assert best.fun - lost([0.0, 0.0]) == pytest.approx(5.4, rel=0.2)


def test_what_is_unknown_of_the_glider_is_fitted_beside(still):
    """And what it is one with has no limit: no campaign tells."""
    task, _, model = still
    offset = task.space.index["wing_offset"]
    vehicle = dataclasses.replace(task.vehicle, nuisance={offset: 0.03})
    own = {(x.kind, x.name): x for x in limits_of(task, model)}
    blind = dataclasses.replace(task, vehicle=vehicle)
    found = {(x.kind, x.name): x for x in limits_of(blind, model)}
    assert set(own) - set(found) == {("center_of_pressure", "shift")}
    travel = "center_of_pressure", "travel"
    assert found[travel].std > 1.5 * own[travel].std


def test_nothing_to_find_has_no_limits(still):
    task, _, model = still
    assert limits_of(dataclasses.replace(task, kinds=()), model) == []
