"""A check tells a certificate from what only looks like one."""

import dataclasses
from fractions import Fraction

import numpy as np
import pytest

from glider.physics.effects.geometry import WIND
from glider.physics.model import GliderModel
from glider.physics.parameters import GliderParameters
from glider.verification.dynamics.nominal import evaluate
from glider.verification.funnel.servo_limits import servo_bounds
from glider.verification.proof import interval_proof
from glider.verification.proof.check import _within_goal, check_funnel
from glider.verification.proof.interval import make_interval
from glider.verification.proof.interval_proof import prove_interval
from glider.verification.proof.purpose import _model_faults
from glider.verification.sos.forms import linear_part, to_ball
from glider.verification.sos.sphere import sphere
from tests.verification.points import forms_of, sphere_points, sphere_values

EVERY = 50
"""Number of intervals from one that tests check to the next."""


def test_the_forms_are_the_growth_of_v_on_the_boundary(funnel, coefficients):
    k, z = 120, sphere_points(20, 7)
    S, slope = funnel.S[k], funnel.slopes[k]
    L_inv_T = to_ball(S)[1]
    errors = z @ L_inv_T.T
    rates = evaluate(coefficients[k], errors)
    growth = np.einsum("bi,ij,bj->b", errors, slope, errors)
    growth += 2.0 * np.einsum("bi,ij,bj->b", errors, S, rates)
    tables = sphere(7)
    forms = forms_of(funnel.between(k, k + 1))
    polynomial = tables.coefficients(*(form[0] for form in forms))
    values = sphere_values(tables, polynomial, z)
    assert values == pytest.approx(growth, abs=1e-9)
    assert np.all(growth < 0.0)
    assert np.linalg.eigvals(linear_part(coefficients[k])).real.max() < 50.0


def test_the_shipped_certificate_holds(funnel):
    verdict = check_funnel(funnel, every=EVERY)
    assert verdict.holds, verdict.faults
    assert (verdict.intervals, verdict.of_intervals) == (5, 200)


def test_the_servos_limits_are_the_same_without_rounding(funnel):
    directions, bounds = servo_bounds(
        funnel.nominal, funnel.settings, funnel.gliders, shrink=1.0
    )
    for k in (0, 77, 199):
        limits = make_interval(funnel.between(k, k + 1)).limits
        a, b = (
            [part.at(Fraction(0)).to_float() for part in of]
            for of in zip(*limits, strict=True)
        )
        rate, travel = directions[k]
        assert np.array(a) == pytest.approx(np.array([-rate, rate, travel, -travel]))
        assert np.min(np.reshape(b, (2, 2)), axis=1) == pytest.approx(bounds[k])


def lighter(funnel):
    parameters = GliderParameters(mass=0.07)
    return dataclasses.replace(funnel.nominal, model=GliderModel(parameters=parameters))


def weaker(funnel):
    parameters = GliderParameters(elevator_limits=[-0.3, 0.8])
    return dataclasses.replace(funnel.nominal, model=GliderModel(parameters=parameters))


CORRUPTIONS = {
    "a wider set": (lambda f: {"S": 0.9 * f.S}, "servo"),
    "a narrower set": (lambda f: {"slopes": 1.2 * f.slopes}, "not proven to fall"),
    "random Gram matrices": (
        lambda f: {"grams": f.grams[:, ::-1].copy()},
        "not proven to fall",
    ),
    "a larger disturbance": (
        lambda f: {"beta": f.beta + 0.5, "weights": f.weights + 0.5},
        "not proven to fall",
    ),
    "weights that divide by zero": (
        lambda f: {"beta": f.beta + 0.5},
        "a weight is zero",
    ),
    "negative bounds": (
        lambda f: {"beta": f.beta - 0.5, "weights": f.weights + 0.5},
        "a weight is zero",
    ),
    "not an ellipsoid": (lambda f: {"S": -f.S}, "not an ellipsoid"),
    "a servo of less travel": (lambda f: {"nominal": weaker(f)}, "servo"),
    "another glider": (lambda f: {"nominal": lighter(f)}, "not proven to fall"),
}


@pytest.mark.parametrize("name", CORRUPTIONS)
def test_a_corrupted_funnel_fails_the_check(name, funnel):
    change, words = CORRUPTIONS[name]
    changed = dataclasses.replace(funnel, **change(funnel))
    assert words in prove_interval(changed.between(100, 101), remainder=False).fault


def test_a_larger_goal_set_fails_the_check(funnel):
    wider = dataclasses.replace(funnel, S=funnel.S / 1.01)
    assert not _within_goal(wider)
    assert _within_goal(funnel)


def test_a_check_is_of_the_nominal(funnel):
    changed = dataclasses.replace(funnel, nominal=lighter(funnel))
    assert "not a flight" in " ".join(check_funnel(changed, every=1000).faults)


def test_a_funnel_of_another_glider_names_what_differs(funnel):
    wind, model = WIND(x=-0.6, z=0.1), funnel.nominal.model
    slight = dataclasses.replace(model.parameters, mass=0.08000000001)
    for other, words in (
        (model, []),
        (
            dataclasses.replace(model, effects=(wind,)),
            ["'effects'", "is []", "kind: 'wind'", "x: -0.6"],
        ),
        (
            dataclasses.replace(model, parameters=slight),
            ["parameters.mass", "0.08000000001"],
        ),
    ):
        message = " ".join(_model_faults(funnel, other))
        assert all(word in message for word in words) and bool(message) == bool(words)


@pytest.mark.parametrize(
    ("size", "words"),
    [(0.0, ""), (1e-3, "V was not proven to fall"), (np.inf, "defect is not bounded")],
)
def test_the_nominals_defect_is_counted(funnel, size, words, monkeypatch):
    bounds = np.full((1, 7), size)
    monkeypatch.setattr(interval_proof, "defect_bounds", lambda nominal: bounds)
    found = prove_interval(funnel.between(100, 101), remainder=False)
    assert found.fault.startswith(words) if size < np.inf else words in found.fault
    assert found.proven == (size == 0.0)


def test_the_first_interval_that_fails_is_named(funnel):
    S = funnel.S.copy()
    S[101:150] *= -1.0
    changed = dataclasses.replace(funnel, S=S)
    faults = check_funnel(changed, every=50, workers=1).faults
    times = funnel.nominal.times
    words = f"from {times[100]:.4f} to {times[101]:.4f} s."
    assert f"A set is not an ellipsoid {words}" in faults


def test_many_intervals_are_checked_as_one_is(funnel):
    """In several processes."""
    verdict = check_funnel(funnel, every=25)
    assert verdict.holds
    assert verdict.intervals == 9
