"""The residual field: what it finds has honest standard errors."""

import dataclasses

import numpy as np
import pytest

from glider.physics.effects.field import FieldData
from glider.physics.model import GliderModel
from glider.sysid.fit.field_fit import (
    FieldFit,
    fit_field,
    place_basis,
)
from glider.sysid.fit.simulate import (
    CampaignPlan,
    simulate_campaign,
)
from glider.sysid.fit.whiteness import LackOfFit
from glider.sysid.replay.noise import measure_noise
from glider.sysid.replay.problem import Problem
from glider.sysid.replay.record import prepare
from glider.sysid.replay.theta import LIBRARY_LAYOUT
from glider.sysid.search.residual_field import (
    UnexplainedField,
    find_peaks,
    with_form_errors,
)

VENT = FieldData(
    kind="unexplained",
    variables=["x"],
    centers=[[-1.8]],
    widths=[0.6],
    weights={"wind_z": [1.0]},
)


def make_problem(field, seed, flights):
    """Flights through a field, and the nominal model."""
    model, rng = GliderModel(field=field), np.random.default_rng(seed)
    campaign = simulate_campaign(model, CampaignPlan(flights=flights), rng)
    noise = measure_noise(campaign)
    records = prepare(campaign.flights, campaign, noise)
    theta = LIBRARY_LAYOUT.default_theta(model.parameters)
    return Problem(records=records, noise=noise), theta


def peaks_of(seed):
    """Fits a field over x to a few flights over the vent."""
    problem, theta = make_problem(VENT, seed, flights=5)
    basis = place_basis(problem.records, theta, ("x",), 12)
    return find_peaks(fit_field(problem, theta, basis, "air", 3))


def test_standard_errors_of_a_peak_cover_over_campaigns():
    """Over campaigns height and place, in standard errors, have a spread near one."""
    scores = []
    for seed in range(6):
        found = peaks_of(seed)
        height, place = found["wind_z_peak"], found["wind_z_peak_at_x"]
        scores.append(
            [(height.value - 1.0) / height.std, (place.value + 1.8) / place.std]
        )
    spread = np.sqrt(np.mean(np.square(scores), axis=0))
    assert np.all((spread > 0.4) & (spread < 1.8))


def test_a_basis_too_coarse_is_owned_up_to():
    """A vent narrower than the Gaussians: its peak is off by more than the noise."""
    narrow = dataclasses.replace(VENT, widths=[0.35])
    problem, theta = make_problem(narrow, seed=0, flights=12)
    basis = place_basis(problem.records, theta, ("x",), 12)
    fitted = fit_field(problem, theta, basis, "air", 3)
    coarse = UnexplainedField(
        form="air",
        variables=("x",),
        data=fitted.data,
        held_out_cost=0.0,
        expected_cost=1.0,
        lack_of_fit=LackOfFit(excess=0.0, degrees=1.0, by_channel={}),
        coefficients=find_peaks(fitted),
        tried={},
        survey_noise=0.0,
    )
    honest = with_form_errors(problem, theta, coarse).coefficients["wind_z_peak"]
    noisy = coarse.coefficients["wind_z_peak"]
    assert honest.value == noisy.value
    assert abs(noisy.value - 1.0) > 4.0 * noisy.std
    assert abs(honest.value - 1.0) < 3.0 * honest.std


def test_a_peak_at_the_edge_of_what_was_flown_has_no_place():
    data = FieldData(
        variables=["V"],
        centers=[[4.0], [5.0], [6.0]],
        widths=[1.0],
        weights={"c_lift": [0.0, 0.0, 0.5]},
    )
    fitted = FieldFit(data=data, held_out_cost=0.0, covariance=1e-4 * np.eye(3))
    found = find_peaks(fitted)
    assert found["c_lift_peak_at_V"].value == 6.0
    assert np.isnan(found["c_lift_peak_at_V"].std)
    # The Gaussians have the values exp(0), exp(-1/2), exp(-2) there.
    expected = 1e-2 * np.sqrt(1.0 + np.exp(-1.0) + np.exp(-4.0))
    assert found["c_lift_peak"].std == pytest.approx(expected)
