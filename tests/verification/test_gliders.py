"""A funnel of the gliders that the data allow: made, saved, checked, falsified."""

import dataclasses

import numpy as np
import pytest

from glider.control.tvlqr import tracking_policy
from glider.errors import InputError
from glider.physics.confidence import ConfidenceSet, glider_at
from glider.physics.covariance import Covariance
from glider.physics.model import GliderModel
from glider.report.check_funnel import Checked, describe_check, describe_proof
from glider.verification.dynamics.moving_center import make_moving_center
from glider.verification.funnel.build import make_funnel
from glider.verification.funnel.funnel import load_funnel, save_funnel
from glider.verification.funnel.remainder import _remainder_of
from glider.verification.funnel.servo_limits import goal_about
from glider.verification.funnel.settings import FunnelSettings
from glider.verification.proof.check import check_funnel
from glider.verification.proof.flight_proof import FlightProof
from glider.verification.proof.interval_proof import IntervalProof, prove_interval
from glider.verification.proof.purpose import Purpose
from glider.verification.trials import ESCAPE_LEVEL, boundary_states, fly_from
from tests.verification.points import of_one, sphere_points

NAMES = ("mass", "wing_area")
STD = np.array([2e-4, 2e-4])  # About 0.2 %.


def allowed_by(share=1.0):
    matrix = share**2 * np.array([[1.0, 0.8], [0.8, 1.0]]) * np.outer(STD, STD)
    return ConfidenceSet(covariance=Covariance(names=NAMES, matrix=matrix))


def among(funnel, confidence):
    """The same sets, said to be of other gliders."""
    held = funnel.settings.period > 0.0
    gliders = make_moving_center(funnel.nominal, confidence, held)
    return dataclasses.replace(funnel, gliders=gliders)


@pytest.fixture(scope="module")
def policy(article_plan):
    """The feedback of the last tenth of the flight."""
    plan = article_plan
    arrays = {name: getattr(plan, name)[36:] for name in ("states", "slopes", "inputs")}
    plan = dataclasses.replace(plan, times=plan.times[36:] - plan.times[36], **arrays)
    return tracking_policy(GliderModel(), plan)


SETTINGS = FunnelSettings(step=0.011, hold=0.044, remainder=1.1, margin=0.1)


@pytest.fixture(scope="module")
def made(policy):
    return make_funnel(GliderModel(), policy, SETTINGS, confidence=allowed_by())


def levels_of_gliders(funnel, k, allowed, count=20):
    """Returns the largest V of flights of gliders on the edge of a set.

    Each flies from ten points of the boundary about its center, if it has one.
    """
    rng = np.random.default_rng(0)
    times = funnel.nominal.times[k:]
    found = []
    for deviation in allowed.on_boundary(rng.normal(size=(count, allowed.dimension))):
        glider = glider_at(GliderModel(), NAMES, deviation)
        starts = boundary_states(funnel, k, sphere_points(10, 7))
        starts += funnel.gliders.shifts[k] @ deviation if funnel.is_of_set else 0.0
        paths = fly_from(funnel, k, starts, glider)
        if funnel.is_of_set:
            paths = paths - funnel.gliders.shifts[k:] @ deviation
        found.append(funnel.level(times, paths).max(axis=1))
    return np.concatenate(found)


def test_the_center_moves_as_the_gliders_fly(funnel):
    """To first order: halving the deviation leaves a quarter of the difference."""
    center = make_moving_center(funnel.nominal, allowed_by())
    start = funnel.nominal.states[:1]
    direction, left = np.array([3e-4, -2e-4]), []
    for share in (1.0, 0.5):
        deviation = share * direction
        glider = glider_at(GliderModel(), NAMES, deviation)
        path = fly_from(funnel, 0, start, glider)[0]
        moved = center.shifts @ deviation
        left.append(np.abs(path - funnel.nominal.states - moved).max(axis=0))
        assert np.all(left[-1] < 0.2 * np.abs(moved).max(axis=0))
    np.testing.assert_allclose(left[0] / left[1], 4.0, rtol=0.1)
    assert not center.shifts[0].any()  # All gliders have the same launch.


def test_what_is_left_at_the_center_is_of_second_order(funnel):
    center, at = make_moving_center(funnel.nominal, allowed_by()), np.array([40, 120])
    errors = np.zeros((2, 1, 7))
    direction, left = np.array([3e-4, -2e-4]), []
    for share in (1.0, 0.5):
        deviations = np.tile(share * direction, (2, 1, 1))
        left.append(_remainder_of(funnel.nominal, at, errors, center, deviations))
    assert np.abs(left[0][..., :4]).max() < 1e-12  # Positions, pitch and elevator.
    np.testing.assert_allclose(left[0][..., 4:] / left[1][..., 4:], 4.0, rtol=0.05)


@pytest.mark.nightly
def test_a_set_costs_little(made, policy):
    alone = make_funnel(GliderModel(), policy, SETTINGS)
    volume = np.sqrt(np.linalg.det(alone.S[0]) / np.linalg.det(made.S[0]))
    # The set costs about 1 % of the volume; where R is large is found from samples,
    # which changes it by 3 %.
    assert 0.9 < volume < 1.05


@pytest.mark.nightly
def test_a_funnel_is_made_for_all_gliders_of_a_set(made):
    verdict = check_funnel(made, every=4)
    assert verdict.holds, verdict.faults
    checked = Checked(path=None, purpose=Purpose(), funnel=made, verdict=verdict)
    words = describe_check(checked)
    assert "95 % ellipsoid of mass ± 0.00049, wing_area ± 0.00049" in words
    assert "only --prove proves anything about them" in words
    for k in (0, len(made.nominal.times) // 2):
        levels = levels_of_gliders(made, k, allowed_by())
        np.testing.assert_allclose(levels, 1.0, atol=1e-6)  # All start at 1.


def test_what_is_proven_is_said_of_whom_it_is(made):
    proof = FlightProof(
        times=made.nominal.times,
        outcomes={k: IntervalProof() for k in range(len(made.nominal.times) - 1)},
    )
    words = describe_proof(made, proof)
    assert words.startswith("Proven: every flight of every glider of its 95 % set that")
    assert "stays in the funnel about its own center and ends in its last set" in words
    some = dataclasses.replace(proof, outcomes={0: IntervalProof()})
    words = describe_proof(made, some)
    assert "no flight of every glider" not in words
    assert "no flight of any glider of its 95 % set with a command error of" in words
    assert "leaves the funnel about its own center in 1 of its" in words
    alone = of_one(made)
    assert "every flight of this glider that starts" in describe_proof(alone, proof)


def test_it_is_saved_and_loaded_with_them(made, tmp_path):
    path = tmp_path / "funnel.npz"
    save_funnel(path, made)
    again = load_funnel(path).gliders
    np.testing.assert_array_equal(again.shifts, made.gliders.shifts)
    np.testing.assert_array_equal(
        again.confidence.factor, made.gliders.confidence.factor
    )
    half = made.between(3, 6)
    np.testing.assert_array_equal(half.gliders.shifts, made.gliders.shifts[3:7])
    spoilt = dataclasses.replace(made.gliders, confidence=allowed_by())
    spoilt.confidence.covariance.matrix[0, 0] = -1.0
    save_funnel(path, dataclasses.replace(made, gliders=spoilt))
    with pytest.raises(InputError, match="its gliders: covariance: the variance of"):
        load_funnel(path)


def test_one_that_is_said_to_be_of_more_gliders_is_refused(made, proven):
    verdict = check_funnel(among(made, allowed_by(3.0)), every=4)
    assert any("not within the goal" in fault for fault in verdict.faults)
    many = among(proven, allowed_by(20.0))
    found = prove_interval(many.between(180, 181), remainder=False)
    assert "servo would meet" in found.fault
    wide = dataclasses.replace(made.settings, goal=(4.0,) * 7)
    wide = dataclasses.replace(among(made, allowed_by(4.0)), settings=wide)
    faults = check_funnel(wide, every=4).faults
    assert any("The remainder is" in fault for fault in faults)


def test_gliders_that_end_beyond_the_goal_leave_nothing(funnel):
    center = make_moving_center(funnel.nominal, allowed_by(100.0))
    with pytest.raises(InputError, match="more flights, or a wider goal"):
        goal_about(np.array(funnel.settings.goal), center)
    with pytest.raises(InputError, match="'remainder' is 0"):
        make_funnel(GliderModel(), None, confidence=allowed_by())


def test_gliders_of_a_wide_set_leave(proven):
    levels = levels_of_gliders(proven, 50, allowed_by(40.0))
    assert np.mean(levels > ESCAPE_LEVEL) > 0.2
