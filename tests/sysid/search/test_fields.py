"""Fields without a name: where to look, and peaks with honest standard errors."""

import dataclasses

import numpy as np
import pytest

from glider.physics.effects.field import FieldData
from glider.physics.model import GliderModel
from glider.simulation.campaigns import CampaignPlan
from glider.sysid.likelihood.model_fit import fit_model
from glider.sysid.outcome import find_peaks
from glider.sysid.search import tracing
from glider.sysid.search.fields import Survey, fit_field, fit_fields, survey
from glider.sysid.search.fits import Search
from tests.helpers.tasks import begin, fly, task_of

VENT = FieldData(
    kind="unexplained",
    variables=["x"],
    centers=[[-1.8]],
    widths=[0.6],
    weights={"wind_z": [1.0]},
)


def plate_over(field, seed, flights):
    """Flights through a field, and the plate fitted to them."""
    model, rng = GliderModel(field=field), np.random.default_rng(seed)
    task, noise = task_of(CampaignPlan(flights=flights).simulate(model, rng))
    return task, fit_model(task, begin(task, noise))


@pytest.fixture(scope="module")
def vent():
    task, plate = plate_over(VENT, 0, 5)
    return task, plate, survey(task, plate)


def test_a_vent_is_seen_over_x_and_as_moving_air(vent):
    *_, found = vent
    assert found.leading[0] == ("air", "x")
    assert found.gains["air", "x"] > 0.0
    # A throw is at x at about the same time.
    assert found.nearly_as_good(("air", "x")) in (("x",), ("x", "t"))
    assert max(gain for (form, _), gain in found.gains.items() if form != "air") < 0.0


def test_where_nothing_is_nothing_is_seen():
    task, noise = task_of(fly(flights=6))
    found = survey(task, fit_model(task, begin(task, noise)))
    assert max(found.gains.values()) < 0.0


def test_variables_that_nearly_tie_are_told():
    gains = {("air", "x"): 90.0, ("air", "t"): 70.0, ("forces", "x"): 61.0}
    gains |= {("forces", "V"): 59.0}
    found = Survey(gains=gains)
    assert found.leading[0] == ("air", "x")
    assert found.nearly_as_good(("air", "x")) == ("x", "t")
    assert found.nearly_as_good(("forces", "V"))[0] == "V"


def test_a_survey_without_a_finite_field_finds_none(vent, monkeypatch):
    task, plate, _ = vent
    for gains in ({}, {("air", "x"): -np.inf, ("air", "z"): np.nan}):
        found = Survey(gains=gains)
        assert found.leading == []
        assert found.most == -np.inf
        monkeypatch.setattr(tracing, "survey", lambda *_, found=found: found)
        assert tracing.unmodelled_field(Search(task, print), plate) is None


def peaks_of(task, plate, found):
    field = fit_field(task, plate, found, found.leading[0])
    assert field.basis.form == "air" and field.basis.variable == "x"
    return find_peaks(field.model.extra, field.covariance)


def test_the_field_is_the_vent(vent):
    task, plate, found = vent
    found = Survey(gains={("air", "x"): found.gains["air", "x"]})
    peaks = peaks_of(task, plate, found)
    height, place = peaks["wind_z_peak"], peaks["wind_z_peak_at_x"]
    assert height.value == pytest.approx(1.0, abs=0.05)
    assert place.value == pytest.approx(-1.8, abs=0.05)
    assert 0.0 < height.std < 0.05 and 0.0 < place.std < 0.05
    # It blows upward alone: a horizontal wind would only fit noise.
    assert set(peaks) == {"wind_z_peak", "wind_z_peak_at_x"}


@pytest.mark.nightly
def test_standard_errors_of_a_peak_cover_over_campaigns():
    """Over campaigns height and place, in standard errors, have a spread near one."""
    scores = []
    for seed in range(6):
        task, plate = plate_over(VENT, seed, 5)
        found = peaks_of(task, plate, Survey(gains={("air", "x"): 1.0}))
        height, place = found["wind_z_peak"], found["wind_z_peak_at_x"]
        scores.append(
            [(height.value - 1.0) / height.std, (place.value + 1.8) / place.std]
        )
    spread = np.sqrt(np.mean(np.square(scores), axis=0))
    assert np.all((spread > 0.3) & (spread < 2.0))


@pytest.mark.slow
def test_a_narrow_vent_gets_narrow_gaussians():
    """One that the survey's Gaussians are too coarse for."""
    narrow = dataclasses.replace(VENT, widths=[0.2])
    task, plate = plate_over(narrow, 0, 8)
    field = fit_field(task, plate, Survey(gains={("air", "x"): 1.0}), ("air", "x"))
    peaks = find_peaks(field.model.extra, field.covariance)
    assert len(field.basis.centers) > 12
    assert peaks["wind_z_peak"].value == pytest.approx(1.0, abs=0.1)


def test_a_peak_at_the_edge_of_what_was_flown_has_no_place():
    data = FieldData(
        variables=["V"],
        centers=[[4.0], [5.0], [6.0]],
        widths=[1.0],
        weights={"c_lift": [0.0, 0.0, 0.5]},
    )
    found = find_peaks(data, 1e-4 * np.eye(3))
    assert found["c_lift_peak_at_V"].value == 6.0
    assert np.isnan(found["c_lift_peak_at_V"].std)
    # The Gaussians have the values exp(0), exp(-1/2), exp(-2) there.
    expected = 1e-2 * np.sqrt(1.0 + np.exp(-1.0) + np.exp(-4.0))
    assert found["c_lift_peak"].std == pytest.approx(expected)


def test_a_field_that_cannot_be_told_from_the_best_is_fitted_too():
    gains = {("forces", "x"): 100.0, ("forces", "t"): 99.0, ("air", "z"): 50.0}
    assert Survey(gains=gains).leading == [("forces", "x"), ("forces", "t")]


def test_about_a_model_that_blows_up_no_field_is_fitted(vent):
    task, model, _ = vent
    lost = dataclasses.replace(model, theta=np.full_like(model.theta, np.nan))
    found = survey(task, lost)
    assert set(found.gains.values()) <= {-np.inf}
    assert found.leading == []
    assert fit_fields(task, lost, found) == []
