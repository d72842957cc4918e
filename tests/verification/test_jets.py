"""Jets are Taylor polynomials: of every operation, and of the glider's dynamics."""

import numpy as np
import pydrake.symbolic as sym
import pytest
from pydrake.autodiffutils import ExtractGradient, InitializeAutoDiff

from glider.physics.compose import compose
from glider.physics.effects import ATTACHED_LIFT, NO_GAUSSIANS, SERVO_LAG
from glider.physics.parameters import Theta
from glider.verification.dynamics.jets import coefficients_of, monomials, variables
from tests.helpers.physics import PARAMETERS, random_states

POINT = np.array([0.7, -0.4])

FORMULAS = {
    "product": lambda x, y, m: x * y * (2.0 - x) + 3.0 * y - x,
    "quotient": lambda x, y, m: (1.0 + y) / (x * x + 2.0) + 1.0 / x - x / 2.0,
    "sqrt": lambda x, y, m: m.sqrt(x * x + y * y),
    "sin, cos": lambda x, y, m: m.sin(2.0 * x + y) * m.cos(x - y),
    "exp": lambda x, y, m: m.exp(-0.5 * (x + y) * (x + y)),
    "tanh": lambda x, y, m: m.tanh(x / 0.3 + y),
}


@pytest.mark.parametrize("name", FORMULAS)
def test_an_operation_gives_the_coefficients_of_drakes_taylor_expansion(name):
    jet = FORMULAS[name](*variables(POINT, 3), np)
    x, y = sym.Variable("x"), sym.Variable("y")
    steps = FORMULAS[name](POINT[0] + x, POINT[1] + y, sym)
    expansion = sym.Polynomial(
        sym.TaylorExpand(steps, {x: 0.0, y: 0.0}, 3), sym.Variables([x, y])
    )
    found = expansion.monomial_to_coefficient_map()
    for exponents, value in zip(
        jet.table.exponents, jet.coefficients[:, ...], strict=True
    ):
        monomial = sym.Monomial({x: int(exponents[0]), y: int(exponents[1])})
        expected = float(found.get(monomial, sym.Expression(0.0)).Evaluate({}))
        assert value == pytest.approx(expected, rel=1e-9, abs=1e-9), exponents


def test_arctan_and_tanh_agree_with_their_inverses():
    [x] = variables(np.array([0.3]), 5)
    both = np.arctan(np.sin(x) / np.cos(x))
    assert both.coefficients == pytest.approx(x.coefficients, abs=1e-12)
    exponential = np.exp(2.0 * x)
    tangent = (exponential - 1.0) / (exponential + 1.0)
    assert np.tanh(x).coefficients == pytest.approx(tangent.coefficients, abs=1e-12)


def test_many_points_at_once_are_the_same_as_one_by_one():
    points = np.random.default_rng(0).normal(size=(2, 4)) + 2.0
    together = FORMULAS["sqrt"](*variables(points, 3), np).coefficients
    for k in range(4):
        alone = FORMULAS["sqrt"](*variables(points[:, k], 3), np).coefficients
        assert together[:, k] == pytest.approx(alone, rel=1e-13)


def expand_dynamics(kinds, x, c, order):
    jets = variables(x, order)
    theta = Theta(PARAMETERS, c, NO_GAUSSIANS)
    rates = compose(kinds).derivatives(0.0, jets, 1.5, 0.2, 0.1, theta)
    return np.array([coefficients_of(rate, jets[0]) for rate in rates])


def test_the_linear_part_of_the_dynamics_is_drakes_autodiff():
    kinds, c = (ATTACHED_LIFT, SERVO_LAG), np.array([3.0, 0.3, 0.05, 0.04])
    x = np.append(random_states(1)[0], 0.5)
    found = expand_dynamics(kinds, x, c, 3)
    duals = InitializeAutoDiff(x).ravel()
    theta = Theta(PARAMETERS, c, NO_GAUSSIANS)
    rates = compose(kinds).derivatives(0.0, duals, 1.5, 0.2, 0.1, theta)
    expected = ExtractGradient(np.array(rates))
    assert found[:, 1:9] == pytest.approx(expected, rel=1e-9, abs=1e-9)


@pytest.mark.parametrize("order", [2, 3])
def test_the_error_falls_with_the_order_of_the_expansion(order):
    x, rng = random_states(1, seed=2)[0], np.random.default_rng(1)
    theta = Theta(PARAMETERS, np.zeros(0), NO_GAUSSIANS)
    coefficients = expand_dynamics((), x, theta.c, order)
    direction = rng.normal(size=7) * [0.1, 0.1, 0.1, 0.1, 0.5, 0.5, 0.5]
    errors = []
    for size in (0.2, 0.1):
        step = size * direction
        powers = np.prod(step ** monomials(7, order).exponents, axis=1)
        true = compose().derivatives(0.0, x + step, 1.5, 0.2, 0.1, theta)
        errors.append(np.linalg.norm(true - coefficients @ powers))
    assert np.log2(errors[0] / errors[1]) == pytest.approx(order + 1, abs=0.5)
