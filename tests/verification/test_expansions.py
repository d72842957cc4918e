"""Taylor polynomials of every operation, and of the glider's dynamics."""

import numpy as np
import pydrake.symbolic as sym
import pytest
from pydrake.autodiffutils import ExtractGradient, InitializeAutoDiff

from glider.physics.compose import compose
from glider.physics.effects import ATTACHED_LIFT, NO_GAUSSIANS, SERVO_LAG
from glider.physics.model import GliderModel
from glider.physics.parameters import Theta
from glider.verification.dynamics.nominal import expand, open_loop_rates
from glider.verification.dynamics.numbers import monomials
from glider.verification.dynamics.taylor_models import Recording
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


def polynomials(formula, points, degree):
    """Taylor coefficients (R, M, B) of a formula of numbers at points (n, B)."""
    recording = Recording(monomials(len(points), degree))
    results = formula(*recording.inputs(len(points)))
    inputs = np.zeros((len(points), len(recording.table.degrees), points.shape[1]))
    inputs[:, 0] = points
    for i, own in enumerate(inputs):
        own[1 + i] = 1.0
    program = recording.program(results, np.ones(inputs.shape[:2], dtype=bool))
    found, left = program.run(inputs, np.full(points.shape, np.nan))
    assert not np.any(np.isfinite(left))  # Nothing is bounded that was not asked for.
    return found


@pytest.mark.parametrize("name", FORMULAS)
def test_an_operation_gives_the_coefficients_of_drakes_taylor_expansion(name):
    [[values]] = polynomials(
        lambda x, y: [FORMULAS[name](x, y, np)], POINT[:, None], 3
    ).transpose(0, 2, 1)
    x, y = sym.Variable("x"), sym.Variable("y")
    steps = FORMULAS[name](POINT[0] + x, POINT[1] + y, sym)
    expansion = sym.Polynomial(
        sym.TaylorExpand(steps, {x: 0.0, y: 0.0}, 3), sym.Variables([x, y])
    )
    found = expansion.monomial_to_coefficient_map()
    for exponents, value in zip(monomials(2, 3).exponents, values, strict=True):
        monomial = sym.Monomial({x: int(exponents[0]), y: int(exponents[1])})
        expected = float(found.get(monomial, sym.Expression(0.0)).Evaluate({}))
        assert value == pytest.approx(expected, rel=1e-9, abs=1e-9), exponents


def test_arctan_and_tanh_agree_with_their_inverses():
    def formula(x):
        exponential = np.exp(2.0 * x)
        tangent = (exponential - 1.0) / (exponential + 1.0)
        return [np.arctan(np.sin(x) / np.cos(x)), x, np.tanh(x), tangent]

    found = polynomials(formula, np.array([[0.3]]), 5)
    assert found[0] == pytest.approx(found[1], abs=1e-12)
    assert found[2] == pytest.approx(found[3], abs=1e-12)


def expand_dynamics(kinds, x, c, order):
    theta = Theta(PARAMETERS, c, NO_GAUSSIANS)

    def rates(*own):
        return compose(kinds).derivatives(0.0, own, 1.5, 0.2, 0.1, theta)

    return polynomials(rates, x[:, None], order)[..., 0]


def test_rates_expand_like_floats_between_their_points():
    model = GliderModel(effects=(ATTACHED_LIFT(),))
    points = np.vstack([random_states(80).T, np.linspace(-3.0, 3.0, 80)])
    open_loop = expand(model, points, 3)
    gains = np.random.default_rng(0).normal(size=(80, 7))
    closed_loop = expand(model, points, 3, gains=gains)
    e = 1e-3 * np.random.default_rng(1).normal(size=(80, 7))
    command = points[7] - np.sum(gains * e, axis=1)
    moved = np.array(open_loop_rates(model, list(points[:7] + e.T), command)).T
    both = np.column_stack([e, command - points[7]])
    values = monomials(8, 3).values(both)
    assert np.einsum("tim,tm->ti", open_loop, values) == pytest.approx(moved, abs=1e-6)
    values = monomials(7, 3).values(e)
    found = np.einsum("tim,tm->ti", closed_loop, values)
    assert found == pytest.approx(moved, abs=1e-6)


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
