"""A campaign rehearsed: drawn to first order, and flown again."""

import numpy as np
import pytest

from glider.campaign.motion_capture import MotionCapture
from glider.errors import InputError
from glider.experiments.explanations import Findings, explain
from glider.experiments.proposal import read_task
from glider.experiments.rehearsal import (
    Rehearser,
    Strengths,
    _first_above,
    _root_of,
    rehearse,
)
from glider.physics.effects import WIND
from glider.physics.model import GliderModel
from glider.simulation.campaigns import CampaignPlan
from glider.sysid.likelihood.scales import FLOOR
from glider.sysid.result import UNEXPLAINED

WINDY = GliderModel(effects=(WIND(x=-0.5),))
FINDINGS = Findings(models=(WINDY,))
CAPTURE = MotionCapture()


@pytest.fixture(scope="module")
def campaign():
    plan = CampaignPlan(flights=8, duration=0.6)
    return plan.simulate(WINDY, np.random.default_rng(0))


@pytest.fixture(scope="module")
def rehearser(campaign):
    reading = read_task(campaign, FINDINGS)
    model = explain(reading.task, reading.noise, FINDINGS)[0].model
    return Rehearser(reading, model, 0)


def test_a_large_effect_is_named_and_a_small_one_is_not(rehearser):
    large = rehearser.rehearsed("mass", 1.0)
    assert large.power == 1.0
    assert large.instead == {}
    assert 0.0 < large.visible < 0.2 * large.size
    small = rehearser.rehearsed("mass", 0.1 * large.visible / large.coefficient.scale)
    assert small.power < 0.2
    assert small.visible == pytest.approx(large.visible, rel=0.2)
    assert np.all(np.diff(large.curve[:, 0]) > 0.0)


def test_an_effect_that_may_as_well_be_none_has_no_name(rehearser):
    large = rehearser.rehearsed("mass", 1.0)
    change = rehearser.change_of(rehearser.column_of("mass"), 0.6 * large.visible)
    answers = rehearser.outcomes(change)
    assert answers[frozenset({UNEXPLAINED})] > 0


def test_what_the_model_has_already_is_fitted(rehearser):
    """No likelihood is lost of a change of its own coefficients, but by their prior."""
    strengths = rehearser.strengths
    [first, *_] = rehearser.candidates.variants["wind"][0]
    step = np.zeros(rehearser.noise.shape[1])
    step[first] = 0.05
    alone = Strengths(strengths.flights, strengths.scales, (), np.zeros(0))
    assert strengths.lost_without(step) < 0.1
    assert alone.lost_without(step) > 10.0


def test_few_campaigns_without_another_effect_name_one(rehearser):
    answers = rehearser.outcomes(np.zeros(rehearser.noise.shape[1]))
    assert answers[frozenset()] >= 0.95 * sum(answers.values())


def test_more_noise_hides_more(rehearser, campaign):
    """Of ten times the noise, an effect is visible at nearly ten times the size."""
    loud = MotionCapture(
        position=10.0 * CAPTURE.position,
        pitch=10.0 * CAPTURE.pitch,
        elevator=10.0 * CAPTURE.elevator,
    )
    plan = CampaignPlan(flights=8, duration=0.6, capture=loud)
    noisy = plan.simulate(WINDY, np.random.default_rng(0))
    reading = read_task(noisy, FINDINGS)
    model = explain(reading.task, reading.noise, FINDINGS)[0].model
    other = Rehearser(reading, model, 0).rehearsed("attached_lift", 1.0)
    ratio = other.visible / rehearser.rehearsed("attached_lift", 1.0).visible
    assert 4.0 < ratio < 16.0


def test_a_campaign_is_flown_again_as_it_was(rehearser, campaign):
    """Without noise and by the same model; a row is 58 mm of a flight's path.

    A launch is fitted to the beginning of a flight, which does not know it exactly.
    """
    quiet = rehearser.model.scales.without(*vars(FLOOR)).without_floors
    flown = rehearser.flown_again(rehearser.model.theta, quiet, 0)
    for again, logged in zip(flown.flights, campaign.flights, strict=True):
        assert np.array_equal(again.time, logged.time)
        assert np.array_equal(again.command, logged.command)
        off = again.pose - logged.pose
        assert np.abs(off[:, :2]).max() < 0.01
        assert np.abs(off[:, 2]).max() < 0.03
        assert np.std(again.elevator - logged.elevator) < 1.5 * CAPTURE.elevator


def test_a_planted_effect_is_traced_in_flight(rehearser):
    planted = rehearser.rehearsed("mass", 1.0)
    found = rehearser.traced(planted, 1)
    assert found.verdict == "effect_found"
    assert {own.kind for own in found.effects} == {"wind", "mass"}
    mass = next(own for own in found.effects if own.kind == "mass")
    assert mass.coefficients["change"].value == pytest.approx(0.1, abs=0.02)


def test_an_effect_of_the_model_or_an_unknown_one_is_refused(campaign):
    for name in ("wind", "nonsense"):
        with pytest.raises(InputError, match=f"'{name}' cannot be planted") as refused:
            rehearse(campaign, FINDINGS, effects=[name], flies=False)
        assert "its model has wind" in str(refused.value)


def test_a_singular_matrix_has_a_root():
    columns = np.random.default_rng(0).normal(size=(4, 3)) @ np.diag([1.0, 1e6, 0.0])
    gram = columns.T @ columns
    root = _root_of(gram)
    assert root @ root.T == pytest.approx(gram, rel=1e-9, abs=1e-9)


def test_a_size_is_visible_from_the_last_crossing():
    curve = np.array([(1.0, 0.0), (2.0, 0.9), (4.0, 1.0)])
    assert _first_above(curve, 0.95) == pytest.approx(2.0 * 2.0**0.5)
    assert _first_above(curve[:2], 0.95) == np.inf
    assert _first_above(curve[2:], 0.95) == 4.0
