"""A confidence set holds what it says, and gliders that deviate are the ones meant."""

import dataclasses

import numpy as np
import pytest

from glider.errors import InputError
from glider.physics.confidence import (
    ConfidenceSet,
    describe_set,
    glider_at,
    make_confidence,
    physical,
    theta_at,
)
from glider.physics.covariance import Covariance
from glider.physics.effects import KINDS, WIND
from glider.physics.model import GliderModel
from glider.verification.dynamics.nominal import open_loop_rates
from glider.verification.funnel.file import GlidersNote
from glider.verification.funnel.funnel import _noted_confidence

MODEL = GliderModel(effects=(WIND(x=-0.6, z=0.1), KINDS["profile_drag"](cd0=0.05)))
NAMES = ("wind.z", "mass", "profile_drag.cd0")

# The units differ by far, and two of the errors nearly are the same.
STD = np.array([1e-3, 1e-6, 2.0])
CORRELATION = np.array([[1.0, 0.95, 0.2], [0.95, 1.0, 0.1], [0.2, 0.1, 1.0]])
KNOWN = Covariance(names=NAMES, matrix=CORRELATION * np.outer(STD, STD))


def ends_of(allowed):
    """Returns the ends δ of a set's axes."""
    axes = np.eye(allowed.dimension)
    return allowed.on_boundary(np.concatenate([axes, -axes]))


@pytest.mark.parametrize("level", [0.5, 0.95])
def test_it_holds_the_true_numbers_as_often_as_it_says(level):
    allowed = ConfidenceSet(covariance=KNOWN, level=level)
    rng = np.random.default_rng(0)
    errors = rng.multivariate_normal(np.zeros(3), KNOWN.matrix, size=20_000)
    share = np.mean(allowed.holds(errors))
    assert share == pytest.approx(level, abs=0.01)  # Three of its standard errors.


def test_what_is_drawn_is_in_it_and_reaches_as_far_as_it_does():
    allowed = ConfidenceSet(covariance=KNOWN)
    rng = np.random.default_rng(0)
    edge = allowed.on_boundary(rng.normal(size=(40_000, 3)))
    assert np.all(allowed.holds(edge)) and np.all(allowed.holds(0.5 * edge))
    assert not np.any(allowed.holds(1.001 * edge))
    a = np.array([0.3, -1.0, 0.5]) / STD
    assert 0.98 * allowed.reach(a) < np.max(edge @ a) <= allowed.reach(a)


def test_it_covers_what_it_holds_and_no_more():
    rng = np.random.default_rng(1)
    edge = rng.normal(size=(2000, 3))
    for _ in range(40):
        factor = np.eye(3) + 0.3 * rng.normal(size=(3, 3))
        matrix = rng.uniform(0.5, 1.0) * factor @ factor.T * np.outer(STD, STD)
        sets = [
            ConfidenceSet(covariance=c)
            for c in (KNOWN, dataclasses.replace(KNOWN, matrix=matrix))
        ]
        for one, other in (sets, sets[::-1]):
            inside = np.all(one.holds(other.on_boundary(edge[:, : other.dimension])))
            inside &= np.all(one.holds(ends_of(other)))
            if one.covers(other):
                assert inside
        assert sets[0].covers(sets[0])
        narrower = dataclasses.replace(KNOWN, matrix=0.999 * KNOWN.matrix)
        assert not ConfidenceSet(covariance=narrower).covers(sets[0])


def test_a_number_that_a_set_lacks_does_not_deviate_in_it():
    fewer = ConfidenceSet(covariance=KNOWN.among(["wind", "mass"]))
    wider = 10.0 * KNOWN.matrix
    most = ConfidenceSet(covariance=dataclasses.replace(KNOWN, matrix=wider))
    assert most.covers(fewer) and not fewer.covers(most)
    known = wider.copy()
    known[2] = known[:, 2] = 0.0
    exactly = ConfidenceSet(covariance=dataclasses.replace(KNOWN, matrix=known))
    assert exactly.covers(fewer)
    assert "cd0" not in describe_set(exactly)


def test_no_set_is_said_to_hold_everything():
    words = describe_set(ConfidenceSet(covariance=KNOWN, level=1.0 - 1e-12))
    assert words.startswith("over 99.999 % ellipsoid of wind.z ± ")


def test_what_is_known_exactly_does_not_deviate():
    matrix = np.diag([1e-6, 0.0, 0.0])
    covariance = Covariance(names=NAMES, matrix=matrix)
    allowed = ConfidenceSet(covariance=covariance)
    assert allowed.dimension == 1
    assert allowed.reach(np.eye(3)) == pytest.approx([1.96e-3, 0.0, 0.0], rel=1e-3)
    one = Covariance(names=("mass",), matrix=np.zeros((1, 1)))
    none = ConfidenceSet(covariance=one)
    drawn = none.on_boundary(np.zeros((2, 0)))
    assert drawn.shape == (2, 1) and not drawn.any()


def test_only_what_changes_a_flight_is_in_it():
    names = (*NAMES, "pitch_offset.angle")
    covariance = Covariance(names=names, matrix=np.eye(4))
    assert make_confidence(MODEL, covariance).names == NAMES


def test_it_comes_back_from_its_notes():
    note = GlidersNote(names=NAMES, matrix=KNOWN.matrix, level=0.9)
    again = _noted_confidence(MODEL, note)
    assert (again.names, again.level) == (NAMES, 0.9)
    allowed = ConfidenceSet(covariance=KNOWN, level=0.9)
    np.testing.assert_array_equal(again.factor, allowed.factor)
    assert describe_set(again).startswith("90 % ellipsoid of wind.z ± 0.0025, mass ±")
    for change in ({"level": 2.0}, {"shape": "box"}, {"names": ("wind.z",)}):
        with pytest.raises(InputError):
            _noted_confidence(MODEL, dataclasses.replace(note, **change))
    offset = GliderModel(effects=(KINDS["pitch_offset"](angle=0.1),))
    names = ("mass", "pitch_offset.angle")
    note = dataclasses.replace(note, names=names, matrix=np.eye(2))
    with pytest.raises(InputError, match="of which a flight depends on mass only"):
        _noted_confidence(offset, note)


@pytest.mark.parametrize("level", [0.0, 1.0, -1.0, float("nan"), True, "0.95"])
def test_a_level_is_a_probability(level):
    with pytest.raises(InputError, match="between 0 and 1"):
        ConfidenceSet(covariance=KNOWN, level=level)


def test_a_glider_that_deviates_is_the_one_that_is_meant():
    deviation = np.array([0.02, 0.003, -0.01])
    glider = glider_at(MODEL, NAMES, deviation)
    assert glider.parameters.mass == 0.083
    assert glider.effects[0].values == pytest.approx((-0.6, 0.12))
    assert glider.effects[1].values == pytest.approx((0.04,))
    x = [-1.0, 0.3, -0.2, 0.1, 6.0, -1.0, 0.5]
    theta = theta_at(MODEL, NAMES, deviation)
    own = open_loop_rates(glider, x, 2.0)
    np.testing.assert_allclose(open_loop_rates(MODEL, x, 2.0, theta), own, rtol=1e-13)
    assert np.abs(np.subtract(own, open_loop_rates(MODEL, x, 2.0))).max() > 0.1


def test_what_is_not_physical_is_drawn_back():
    deviations = np.array([[0.01, -0.2, 0.02], [0.01, 0.02, -0.1], [0.01, 0.02, 0.03]])
    nearer = physical(MODEL, NAMES, deviations)
    share = (MODEL.parameters.mass - MODEL.space.lower[0]) / 0.2
    np.testing.assert_allclose(nearer[0], share * deviations[0], rtol=1e-6)
    np.testing.assert_allclose(nearer[1], 0.5 * deviations[1], rtol=1e-6)
    np.testing.assert_array_equal(nearer[2], deviations[2])
    for deviation in nearer:
        glider_at(MODEL, NAMES, deviation)
    with pytest.raises(InputError, match="mass"):
        glider_at(MODEL, NAMES, deviations[0])


def test_of_few_flights_it_is_as_much_larger():
    """Hotelling's T²: a covariance that is estimated is uncertain."""
    rng, freedom, held = np.random.default_rng(0), 8, []
    for _ in range(2000):
        drawn = rng.multivariate_normal(np.zeros(3), KNOWN.matrix, size=freedom)
        guess = Covariance(
            names=NAMES, matrix=drawn.T @ drawn / freedom, degrees_of_freedom=freedom
        )
        error = rng.multivariate_normal(np.zeros(3), KNOWN.matrix)
        held.append(ConfidenceSet(covariance=guess).holds(error))
    assert np.mean(held) == pytest.approx(0.95, abs=0.015)
    note = GlidersNote(
        names=NAMES, matrix=KNOWN.matrix, level=0.95, degrees_of_freedom=9.0
    )
    wide = _noted_confidence(MODEL, note).reach(np.eye(3))
    assert np.all(wide > 1.1 * ConfidenceSet(covariance=KNOWN).reach(np.eye(3)))


@pytest.mark.parametrize("freedom", [2.0, np.inf, np.nan])
def test_degrees_of_freedom_suffice_for_the_numbers(freedom):
    with pytest.raises(InputError, match=r"degrees_of_freedom.*at least 3"):
        dataclasses.replace(KNOWN, degrees_of_freedom=freedom)
