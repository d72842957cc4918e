"""Taylor models enclose what they stand for, also where a function has no series."""

import numpy as np
import pytest

from glider.compiled import taylor
from glider.compiled.taylor import FUNCTIONS, INPUT, PRODUCT
from glider.physics.effects import SERVO_LAG, WIND
from glider.physics.model import GliderModel
from glider.verification.dynamics.nominal import (
    for_one_glider,
    nonlinear_parts,
    rate_dependences,
)
from glider.verification.dynamics.numbers import monomials
from glider.verification.dynamics.taylor_models import Recording

FORMULAS = {
    "sum": lambda x, y: 1.0 - x + 2.0 * y - (3.0 - y) + np.float64(0.5) * x,
    "product": lambda x, y: x * y * (2.0 - x) * (x + y) * y,
    "quotient": lambda x, y: (1.0 + y) / (x * x + 2.0) + 1.0 / (x + 3.0) - x / 2.0,
    "sqrt": lambda x, y: np.sqrt(x * x + y * y + 1e-8),
    "bent root": lambda x, y: np.sqrt(7.0 - x * x + 0.5 * y - 0.3 * y * y),
    "sin": lambda x, y: np.sin(x) - np.cos(y),
    "sin, cos": lambda x, y: np.sin(2.0 * x + y) * np.cos(x - 3.0 * y),
    "growth": lambda x, y: np.exp(x),
    "exp": lambda x, y: np.exp(-0.5 * (x + y) * (x + y)),
    "tanh": lambda x, y: np.tanh(x / 0.3 + y) + np.tanh(4.0 + x),
    "arctan": lambda x, y: np.arctan(2.0 * x - y),
}


TABLE = monomials(2, 3)

POINT = np.full((2, 1), 0.5), np.full((2, 1), 0.1)


def model(formula, center, half, lost=0.0):
    """Coefficients (M, B) and remainders (B,) of a formula on boxes (2, B).

    Its inputs may be off by what is lost.
    """
    recording = Recording(TABLE)
    result = formula(recording.add(INPUT, 0), recording.add(INPUT, 1))
    coefficients = np.zeros((2, len(TABLE.degrees), center.shape[1]))
    for i in range(2):
        coefficients[i, 0], coefficients[i, 1 + i] = center[i], half[i]
    program = recording.program([result], np.any(coefficients != 0.0, axis=2))
    found, left = program.run(coefficients, np.full(center.shape, lost))
    return found[0], left[0]


def boxes(size, count=300):
    rng = np.random.default_rng(0)
    center = rng.uniform(-1.0, 1.0, (2, count))
    return center, size * rng.uniform(0.2, 1.0, (2, count))


@pytest.mark.parametrize("name", FORMULAS)
@pytest.mark.parametrize("size", [0.001, 0.1, 1.0])
def test_every_value_on_a_box_is_within_the_remainder_of_the_polynomial(name, size):
    center, half = boxes(size)
    coefficients, remainder = model(FORMULAS[name], center, half)
    assert np.all(np.isfinite(remainder))
    v = np.random.default_rng(1).uniform(-1.0, 1.0, (2, 200))
    v[:, :4] = [[1.0, 1.0, -1.0, -1.0], [1.0, -1.0, 1.0, -1.0]]
    points = center[:, :, None] + half[:, :, None] * v[:, None]
    truth = FORMULAS[name](*points)
    polynomial = coefficients.T @ TABLE.values(v.T).T
    off = np.abs(truth - polynomial)
    # What NumPy itself rounds, here and in the polynomial.
    assert np.all(off <= remainder[:, None] + 1e-14 * (1.0 + np.abs(truth)))


@pytest.mark.parametrize(
    "name", ["sqrt", "sin, cos", "exp", "tanh", "quotient", "arctan"]
)
def test_the_remainder_falls_with_the_fourth_power_of_the_box(name):
    center, half = boxes(0.02)
    large = model(FORMULAS[name], center, half)[1]
    small = model(FORMULAS[name], center, 0.5 * half)[1]
    assert np.median(np.log2(large / small)) == pytest.approx(4.0, abs=0.3)


def test_a_root_near_zero_is_known_to_an_eighth_of_its_largest():
    center, half = np.zeros((2, 1)), np.ones((2, 1))
    _, remainder = model(lambda x, y: np.sqrt(x * x + y * y), center, half)
    assert remainder[0] <= 2.0 * np.sqrt(2.0) / 8.0 * 1.5


def test_a_root_is_enclosed_where_squares_count_in_one_direction():
    table, count, rng = monomials(4, 3), 300, np.random.default_rng(3)
    square = (table.degrees == 2) & (table.exponents.max(axis=1) == 2)
    coefficients = 0.2 * rng.normal(size=(1, len(table.degrees), count))
    coefficients[0, square] = rng.uniform(-0.3, 1.5, (4, count))
    least = np.where(square[:, None], np.minimum(coefficients[0], 0.0), coefficients[0])
    coefficients[0, 0] = 0.5 + np.abs(least[1:]).sum(axis=0)
    coefficients[0, 1:, ::3] = 0.0
    coefficients[0, square, ::3] = 1.0  # Nothing is below the center.
    recording = Recording(table)
    root = recording.program(
        [np.sqrt(recording.add(INPUT, 0))], np.full((1, len(table.degrees)), True)
    )
    found, bounds = root.run(coefficients, np.zeros((1, count)))
    v = rng.uniform(-1.0, 1.0, (3000, 4))
    v[::2] = np.sign(v[::2])
    values = table.values(v)
    off = np.abs(np.sqrt(values @ coefficients[0]) - values @ found[0])
    assert np.all(off <= bounds[0] + 1e-14)
    assert np.median(off.max(axis=0) / bounds[0]) > 0.3


@pytest.mark.parametrize("order", [1, 2, 3])
def test_values_reach_no_farther_below_and_above_the_center(order):
    """Squares tell how far, of which a linear model has none."""
    table, rng = monomials(4, order), np.random.default_rng(5)
    coefficients = rng.normal(size=(len(table.degrees), taylor.WIDTH))
    coefficients[:, ::2] = np.abs(coefficients[:, ::2])
    sizes = np.array(
        [np.abs(coefficients[table.degrees == i]).sum(0) for i in range(order + 1)]
    )
    lost, present = np.full(taylor.WIDTH, 0.1), np.full(len(table.degrees), True)
    model = coefficients, sizes, lost, present
    below, above = taylor._reach.py_func(model, table.degrees)
    v = np.sign(rng.normal(size=(5000, 4))) * rng.uniform(size=(5000, 4)) ** 0.3
    change = table.values(v) @ coefficients - coefficients[0]
    assert np.all(change.max(axis=0) + lost <= above)
    assert np.all(change.min(axis=0) - lost >= -below)
    squares = np.any(table.exponents[table.degrees == 2] == 2, axis=1)
    expected = np.maximum(coefficients[table.degrees == 2][squares], 0.0).sum(axis=0)
    assert above - below == pytest.approx(expected, abs=1e-9)


@pytest.mark.parametrize("count", [3, 4, 6])
def test_the_tail_of_a_root_holds_in_both_directions(count):
    terms = np.empty(count)
    taylor._write_series.py_func(FUNCTIONS[np.sqrt], 2.0, terms)
    for below, above in ((0.1, 3.0), (1.9, 2.0), (0.0, 0.5), (2.0, 2.0)):
        tail = taylor._tail.py_func(FUNCTIONS[np.sqrt], 2.0, below, above, terms)
        steps = np.linspace(-below, above, 1000)
        off = np.polynomial.polynomial.polyval(steps, terms) - np.sqrt(2.0 + steps)
        assert np.abs(off).max() <= tail <= np.abs(off).max() * 1.001 + 1e-12
        if count % 2 == 0:
            assert np.all(off >= -1e-15)
    assert taylor._tail.py_func(FUNCTIONS[np.sqrt], 2.0, 2.1, 3.0, terms) == np.inf


def test_what_a_quotient_by_zero_goes_into_is_never_bounded():
    for unknown in (
        lambda x, y: 1.0 / x,
        lambda x, y: np.sqrt(1.0 / x) * y,
        lambda x, y: np.sin(x / y) * 0.0 + x,
        lambda x, y: np.sin(x / y) * 0.0 * y + x,
    ):
        _, remainder = model(unknown, np.zeros((2, 1)), np.ones((2, 1)))
        assert not np.isfinite(remainder[0])


def test_many_boxes_at_once_are_bounded_as_one_by_one():
    def formula(x, y):
        """With numbers met twice, factors, zeros, and models needed late and early."""
        root, early = np.sqrt(x * x + y * y + 1.0), 3.0 * x
        zero = 0.0 * np.sin(x) * y
        turned = (root - 2.0 * y) * (0.5 * x) * (-4.0 * np.cos(y)) + zero
        return -(turned - early) / (root + 0.0) + 1.5 * (y - 0.25 * x * x * y)

    center, half = boxes(0.3, count=150)  # Of 64, 64 and 22.
    together, bounds = model(formula, center, half)
    for k in (0, 63, 64, 127, 128, 149):
        alone, bound = model(formula, center[:, k : k + 1], half[:, k : k + 1])
        assert together[:, k] == pytest.approx(alone[:, 0], rel=1e-12, abs=1e-15)
        assert bounds[k] == pytest.approx(bound[0], rel=1e-9)
    v = np.random.default_rng(1).uniform(-1.0, 1.0, (2, 200))
    truth = formula(*(center[:, :, None] + half[:, :, None] * v[:, None]))
    off = np.abs(truth - together.T @ TABLE.values(v.T).T)
    assert np.all(off <= bounds[:, None] + 1e-14)
    assert np.median(off.max(axis=1) / bounds) > 0.05


@pytest.mark.parametrize("name", [*FORMULAS, "reversed"])
def test_what_the_inputs_leave_out_is_in_the_remainder(name):
    formula = FORMULAS.get(name, lambda x, y: (y + 2.0) * (x + 3.0) * np.cos(y) * x)
    center, half = boxes(0.01)
    lost = 0.05
    found, bounds = model(formula, center, half, lost)
    rng = np.random.default_rng(2)
    v = rng.uniform(-1.0, 1.0, (2, 50))
    for off in (
        [lost, lost],
        [lost, -lost],
        [-lost, lost],
        [-lost, -lost],
        [lost, 0.0],
    ):
        points = center[:, :, None] + half[:, :, None] * v[:, None]
        truth = formula(*(points + np.array(off)[:, None, None]))
        polynomial = found.T @ TABLE.values(v.T).T
        assert np.all(np.abs(truth - polynomial) <= bounds[:, None] + 1e-14)


def test_a_result_that_others_depend_on_stays():
    recording = Recording(TABLE)
    x, y = recording.add(INPUT, 0), recording.add(INPUT, 1)
    product = x * y
    late = np.sin(product + 1.0) * np.cos(x) - np.sqrt(y + 3.0)
    coefficients = np.zeros((2, len(TABLE.degrees), 1))
    coefficients[:, 0], coefficients[0, 1], coefficients[1, 2] = 0.5, 0.1, 0.1
    program = recording.program([product, late, x], np.full((2, 10), True))
    found, _ = program.run(coefficients, np.zeros((2, 1)))
    assert found[0] == pytest.approx(model(lambda x, y: x * y, *POINT)[0])
    np.testing.assert_array_equal(found[2], coefficients[0])


def test_a_coefficient_that_may_not_be_zero_is_kept_and_others_are_not_computed():
    recording = Recording(TABLE)
    x, y = recording.add(INPUT, 0), recording.add(INPUT, 1)
    present = np.zeros((2, len(TABLE.degrees)), dtype=bool)
    present[0, :2], present[1, [0, 2]] = True, True  # Constants and slopes.
    program = recording.program([x * y, x * y - y * x, np.sin(2.0 * x)], present)
    places = [TABLE.place(e) for e in ([0, 0], [1, 0], [0, 1], [1, 1])]
    product = program.present[program.code[:, 0] == PRODUCT][0]
    assert np.flatnonzero(product).tolist() == sorted(places)
    of_sine = program.present[program.code[:, 0] == FUNCTIONS[np.sin]][0]
    assert not of_sine[TABLE.exponents[:, 1] > 0].any()
    assert of_sine[TABLE.exponents[:, 1] == 0].all()


@pytest.mark.parametrize(
    "formula",
    [
        lambda x, y: np.tanh(0.0 * (((x + 3.0) * (y + 1.0)) * (y + 1.0))) + y,
        lambda x, y: np.cos(x * ((y + 2.0) * (y + 3.0))),
        lambda x, y: np.exp(0.0 * (np.sin(y) * (y + 2.0))) * y,
    ],
)
def test_a_function_of_what_is_known_to_be_zero(formula):
    """Its slot held something else before."""
    recording = Recording(TABLE)
    coefficients = np.zeros((2, len(TABLE.degrees), 1))
    coefficients[1, 0], coefficients[1, 2] = 0.5, 0.1  # The first is zero.
    result = formula(recording.add(INPUT, 0), recording.add(INPUT, 1))
    program = recording.program([result], np.any(coefficients != 0.0, axis=2))
    [found], [bound] = program.run(coefficients, np.zeros((2, 1)))
    v = np.random.default_rng(3).uniform(-1.0, 1.0, (50, 2))
    truth = formula(0.0, 0.5 + 0.1 * v[:, 1])
    assert np.all(np.abs(truth - TABLE.values(v) @ found[:, 0]) <= bound[0] + 1e-15)


def test_small_factors_do_not_vanish():
    found, left = model(
        lambda x, y: ((1e-90 * x) * (1e-90 * y)) * 1e180 - x * y, *boxes(0.1, count=5)
    )
    assert np.all(np.abs(found).max(axis=0) <= left)
    assert np.all(left < 0.1)


def test_results_show_what_is_nonlinear_and_what_is_linear():
    recording = Recording(monomials(3, 2))
    x, y, z = recording.inputs(3)
    present = np.eye(3, 10, 1, dtype=bool)
    present[:, 0] = True
    results = [2.0 * x - y / 3.0 + np.sin(z) * 4.0 + 1.0, x * y, 1.0 / x, 2.0]
    shown = recording.program(results, present).shown
    exponents = recording.table.exponents
    found = [{tuple(e) for e in exponents[row]} for row in shown]
    linear = {(0, 0, 0), (1, 0, 0)}
    assert found[0] == linear | {(0, 1, 0), (0, 0, 1), (0, 0, 2)}
    assert found[1] == linear | {(0, 1, 0), (1, 1, 0)}
    assert found[2] == linear | {(2, 0, 0)}
    assert found[3] == {(0, 0, 0)}


def test_a_glider_depends_on_the_numbers_that_deviate_and_on_the_wind():
    depends, nonlinear = rate_dependences(GliderModel(), ("mass",), in_wind=True)
    np.testing.assert_array_equal(depends[:4], np.eye(4, 11, 4, dtype=bool))
    # Of the mass also where only an added mass, which is zero, has it.
    assert depends[4:7, 8:].all()
    assert nonlinear[4:6, 8:].all() and not nonlinear[:4].any()


def test_a_gliders_accelerations_are_nonlinear_in_all_but_its_position():
    assert nonlinear_parts(GliderModel()) == ([2, 3, 4, 5, 6, 7], [4, 5, 6])
    slow = GliderModel(effects=(SERVO_LAG(time_constant=0.03), WIND(x=1.0)))
    # The elevator turns at the servo's rate, state 7, not as commanded.
    assert nonlinear_parts(slow) == ([2, 3, 4, 5, 6, 7], [4, 5, 6])


def test_what_another_thread_remembers_is_of_its_own_glider():
    gliders, other = [GliderModel(), GliderModel()], []

    @for_one_glider
    def found(model, key):
        if model is gliders[0] and not other:  # Another thread comes in between.
            other.append(found(gliders[1], key))
        return int(model is gliders[1])

    assert [found(gliders[0], 5), other[0]] == [0, 1]
    assert [found(own, 5) for own in reversed(gliders)] == [1, 0]


def test_what_is_remembered_is_of_one_glider_and_of_the_same_numbers():
    calls = []

    @for_one_glider
    def found(model, *others):
        calls.append((model, others))
        return len(calls)

    one, equal = GliderModel(), GliderModel()
    assert [found(one, 1), found(one, 1), found(one, 2), found(one, 1)] == [1, 1, 2, 1]
    # Another object may have other numbers, at the same place in memory later.
    assert [found(equal, 1), found(one, 1), found(one, 2)] == [3, 4, 5]
    assert calls[2][0] is equal
