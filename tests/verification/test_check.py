"""A check tells a certificate from what only looks like one."""

import dataclasses

import numpy as np
import pytest

from glider.physics.effects.geometry import WIND
from glider.physics.model import GliderModel
from glider.physics.parameters import GliderParameters
from glider.verification.dynamics.nominal import evaluate
from glider.verification.funnel.growth import _remainder_form
from glider.verification.funnel.servo_limits import servo_bounds
from glider.verification.proof.check import _largest_between, check_funnel
from glider.verification.proof.exact_check import _check_time, exact_faults
from glider.verification.proof.interval import at_time
from glider.verification.proof.interval_growth import BALL_BITS, _growth_forms
from glider.verification.proof.purpose import _model_faults
from glider.verification.sos.exact import exact, rounded
from glider.verification.sos.forms import (
    higher_forms,
    linear_part,
    product_form,
    quadratic_form,
    to_ball,
)
from glider.verification.sos.sphere import sphere
from tests.verification.points import sphere_points, sphere_values

EVERY = 50
"""Number of times from one that tests check exactly to the next."""

NO_DEFECT = np.zeros(201)


def test_the_forms_are_the_growth_of_v_on_the_boundary(funnel, coefficients):
    k, z = 120, sphere_points(20, 7)
    S, slope = funnel.S[k], funnel.slopes[k]
    L_inv_T = to_ball(S)[1]
    errors = z @ L_inv_T.T
    rates = evaluate(coefficients[k], errors)
    growth = np.einsum("bi,ij,bj->b", errors, slope, errors)
    growth += 2.0 * np.einsum("bi,ij,bj->b", errors, S, rates)
    quadratic = L_inv_T.T @ quadratic_form(S, slope, coefficients[k]) @ L_inv_T
    tables = sphere(7)
    polynomial = tables.coefficients(quadratic, *higher_forms(S, coefficients[k]))
    values = sphere_values(tables, polynomial, z)
    assert values == pytest.approx(growth, abs=1e-9)
    assert np.all(growth < 0.0)
    assert np.linalg.eigvals(linear_part(coefficients[k])).real.max() < 50.0


def test_the_exact_polynomial_is_the_growth_with_the_disturbance(funnel, coefficients):
    k, slack = 150, 0.25
    S, slope = funnel.S[k], funnel.slopes[k]
    rng = np.random.default_rng(0)
    beta, weights = rng.uniform(0.1, 1.0, (2, *funnel.beta.shape))
    factor = rng.normal(size=(7, 2)) / funnel.half_widths()[:, None]
    focus = np.broadcast_to(factor @ factor.T, funnel.S.shape)
    L_inv_T = to_ball(S)[1]
    changed = dataclasses.replace(funnel, beta=beta, weights=weights, focus=focus)
    here = at_time(changed, k)
    forms = _growth_forms(here, rounded(L_inv_T, BALL_BITS), exact(slack))
    *found, metric = (form.parts[0].to_float() for form in forms)
    assert metric == pytest.approx(np.eye(7), abs=1e-5)
    quadratic = L_inv_T.T @ quadratic_form(S, slope, coefficients[k]) @ L_inv_T
    disturbance = _remainder_form(S[None], beta[[k]], weights[[k]])[0]
    quadratic += disturbance + slack * np.eye(7)
    cubic, quartic = higher_forms(S, coefficients[k])
    quartic += product_form(disturbance, L_inv_T.T @ focus[k] @ L_inv_T)
    expected = sphere(7).coefficients(quadratic, cubic, quartic)
    polynomial = sphere(7).coefficients(*found)
    assert polynomial == pytest.approx(-expected, rel=1e-5, abs=1e-3)


def test_the_shipped_certificate_holds(funnel):
    verdict = check_funnel(funnel, every=EVERY)
    assert verdict.holds, verdict.faults
    assert verdict.times >= 4
    assert verdict.between < 0.0


def test_the_servos_limits_are_the_same_without_rounding(funnel):
    directions, bounds = servo_bounds(
        funnel.nominal, funnel.settings, funnel.gliders, shrink=1.0
    )
    for k in (0, 77, 200):
        limits = at_time(funnel, k).limits
        a, b = (
            [part.parts[0].to_float() for part in of]
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
    "a wider set": (lambda f: {"S": 0.9 * f.S}, "does not prove that V falls"),
    "a narrower set": (
        lambda f: {"slopes": 1.2 * f.slopes},
        "does not prove that V falls",
    ),
    "random Gram matrices": (
        lambda f: {"grams": f.grams[:, ::-1].copy()},
        "does not prove that V falls",
    ),
    "a larger disturbance": (
        lambda f: {"beta": f.beta + 0.5, "weights": f.weights + 0.5},
        "does not prove that V falls",
    ),
    "weights that divide by zero": (
        lambda f: {"beta": f.beta + 0.5},
        "does not prove that V falls",
    ),
    "not an ellipsoid": (lambda f: {"S": -f.S}, "not an ellipsoid"),
    "a larger goal set": (lambda f: {"S": f.S / 1.01}, "goal"),
    "a servo of less travel": (lambda f: {"nominal": weaker(f)}, "servo"),
    "another glider": (
        lambda f: {"nominal": lighter(f)},
        "does not prove that V falls",
    ),
}


@pytest.mark.parametrize("name", CORRUPTIONS)
def test_a_corrupted_funnel_fails_the_check(name, funnel):
    change, words = CORRUPTIONS[name]
    changed = dataclasses.replace(funnel, **change(funnel))
    faults = exact_faults(changed, [100], NO_DEFECT)
    assert words in " ".join(faults)


def test_a_check_is_of_the_nominal_and_between_the_times_too(funnel):
    changed = dataclasses.replace(funnel, nominal=lighter(funnel))
    assert "not a flight" in " ".join(check_funnel(changed, every=1000).faults)
    wider = dataclasses.replace(funnel, S=0.8 * funnel.S)
    rng = np.random.default_rng(0)
    assert _largest_between(wider, NO_DEFECT, rng, 20) > 0.0
    assert _largest_between(funnel, NO_DEFECT, rng, 20) < 0.0
    assert _largest_between(funnel, NO_DEFECT + 2.0, rng, 20) > 0.0
    unknown = NO_DEFECT.copy()
    unknown[100] = np.nan  # Not the first that is looked at.
    assert np.isnan(_largest_between(funnel, unknown, rng, 20))


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


def test_the_nominals_defect_is_counted_exactly(funnel):
    assert exact_faults(funnel, [100], NO_DEFECT) == []
    assert exact_faults(funnel, [100], NO_DEFECT + 0.001) == []
    [fault] = exact_faults(funnel, [100], NO_DEFECT + 1.0)
    assert "does not prove that V falls" in fault
    two = exact_faults(funnel, [50, 100], NO_DEFECT + np.inf)
    times = funnel.nominal.times[[50, 100]]
    words = f"at 2 times, from {times[0]:.4f} to {times[1]:.4f} s."
    assert two == [f"The Gram matrix does not prove that V falls {words}"]


def test_one_wrong_number_in_one_gram_matrix_fails_its_time(funnel):
    assert _check_time(funnel, 7, 0.003) == []
    grams = funnel.grams.copy()
    grams[7, 0] -= 200.0
    wrong = dataclasses.replace(funnel, grams=grams)
    assert _check_time(wrong, 7, 0.003) != []
