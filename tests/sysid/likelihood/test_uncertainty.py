"""Standard errors that hold though no glider is exactly a formula."""

import dataclasses

import numpy as np
import pytest

from glider.physics.effects import KINDS
from glider.physics.model import GliderModel
from glider.simulation.campaigns import CampaignPlan
from glider.sysid.likelihood.model_fit import (
    fit_model,
    grams_of,
    linear_flights,
    prior_of,
)
from glider.sysid.likelihood.uncertainty import (
    ALLOWED,
    STRENGTHS_ASKED,
    uncertainty_of,
    with_allowed_curves,
)
from tests.helpers.tasks import begin, fit_kinds, fly, task_of

CD0 = 0.05
DRAG = KINDS["profile_drag"](cd0=CD0)


@pytest.fixture(scope="module")
def exact():
    """Flights of a drag that is exactly the library's, and their fit."""
    return fit_kinds(fly(DRAG, flights=6), "profile_drag")


def drag_error(task, model, known):
    (slot,) = task.layout.slots_of("profile_drag")
    return (model.theta[slot] - CD0) / known.std(slot)


def log_evidence(task, model, strength):
    """Returns the evidence of a strength, by the determinant of all there is."""
    model = model.with_curves(task.curves, strength)
    grams, prior = (
        grams_of(linear_flights(task, model), model.scales),
        prior_of(task, model),
    )
    total = prior.added_to(grams.sum(axis=0))
    system, error = total[:-1, :-1], total[:-1, -1]
    gained = error @ np.linalg.solve(system, error) - total[-1, -1]
    gained += np.log(prior.precision).sum() - np.linalg.slogdet(system)[1]
    return 0.5 * gained


def test_the_curves_are_as_strong_as_the_evidence_lets_them_be(exact):
    task, model = exact
    allowed = with_allowed_curves(task, model)
    evidence = np.array([log_evidence(task, allowed, s) for s in STRENGTHS_ASKED])
    (place,) = np.flatnonzero(np.isclose(STRENGTHS_ASKED, allowed.strength))
    assert evidence[place] >= evidence.max() - ALLOWED
    assert np.all(evidence[place + 1 :] < evidence.max() - ALLOWED)


def test_curves_that_act_already_allow_the_same(exact):
    task, model = exact
    bare = with_allowed_curves(task, model)
    (own,) = model.with_curves(task.curves, 1.0).blocks
    some = dataclasses.replace(own, coordinates=np.full(task.curves.count, 1e-3))
    bent = with_allowed_curves(task, dataclasses.replace(model, blocks=(some,)))
    assert bent.strength == pytest.approx(bare.strength, rel=0.3)


def test_errors_of_the_forces_allow_for_any_form_as_they_are(exact):
    task, model = exact
    judged = dataclasses.replace(model, has_force_errors=True)
    assert with_allowed_curves(task, judged) is judged


def test_where_formulas_are_exact_errors_grow_little(exact):
    task, model = exact
    (slot,) = task.layout.slots_of("profile_drag")
    sampling = uncertainty_of(task, model).std(slot)
    told = uncertainty_of(task, with_allowed_curves(task, model)).std(slot)
    assert sampling < told < 0.002
    assert model.theta[slot] == pytest.approx(CD0, abs=2.0 * told)


@pytest.mark.nightly
def test_standard_errors_hold_what_a_form_hides():
    """Gliders whose coefficients differ from the formulas by smooth curves."""
    rng = np.random.default_rng(3)
    task, _ = task_of(fly(DRAG, flights=5))
    sampling, told = [], []
    for _ in range(12):
        weights = 0.2 * rng.standard_normal(task.curves.count)
        glider = GliderModel(effects=(DRAG,), field=task.curves.data(weights))
        # The same launches: at the same angles of attack.
        campaign = CampaignPlan(flights=5).simulate(glider, np.random.default_rng(0))
        own, noise = task_of(campaign)
        model = fit_model(own, begin(own, noise, ["profile_drag"]))
        sampling.append(drag_error(own, model, uncertainty_of(own, model)))
        known = uncertainty_of(own, with_allowed_curves(own, model))
        told.append(drag_error(own, model, known))
    assert np.mean(np.abs(told) < 1.96) > 0.9 > 0.7 > np.mean(np.abs(sampling) < 1.96)
