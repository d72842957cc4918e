"""Sums of squares on the sphere, their solvers, and the exact check of a matrix."""

import os
from fractions import Fraction

import joblib
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from glider.verification.dynamics.numbers import exponents_of
from glider.verification.funnel.growth import _largest_values
from glider.verification.sos.exact import (
    Exact,
    at_least,
    exact,
    is_positive_definite,
    leaves_definite,
    rounded,
)
from glider.verification.sos.programs import (
    SolverError,
    _pool,
    _solve_apart,
    largest_margin,
    least_growth,
)
from glider.verification.sos.sphere import (
    least_eigenvalue,
    nearby_gram,
    represent,
    sphere,
)
from tests.verification.points import sphere_points, sphere_values

N = 3
TABLES = sphere(N)

BASIS = np.concatenate([exponents_of(N, 1), exponents_of(N, 2)])


def random_forms(seed, size=1.0):
    rng = np.random.default_rng(seed)
    quadratic = rng.normal(size=(N, N))
    cubic = size * rng.normal(size=len(exponents_of(N, 3)))
    quartic = size * rng.normal(size=len(exponents_of(N, 4)))
    return quadratic + quadratic.T, cubic, quartic


def basis_at(z):
    return np.array(
        [
            TABLES.scales * np.prod(point**BASIS, axis=1) * np.ones(TABLES.size)
            for point in z
        ]
    )


def test_a_gram_matrix_gives_its_polynomials_values():
    rng = np.random.default_rng(0)
    gram = rng.normal(size=(TABLES.size, TABLES.size))
    gram = gram + gram.T
    z = sphere_points(20, N)
    coefficients = TABLES.map @ TABLES.entries(gram)
    b = basis_at(z)
    assert np.sum(b * b, axis=1) == pytest.approx(2.0)  # |z|² + |z ⊗ z|²
    values = sphere_values(TABLES, coefficients, z)
    assert values == pytest.approx(np.einsum("bi,ij,bj->b", b, gram, b), abs=1e-12)


def test_the_margin_of_a_quadratic_form_is_its_least_eigenvalue():
    quadratic, cubic, quartic = random_forms(1, size=0.0)
    polynomial = TABLES.coefficients(quadratic, cubic, quartic)
    success, margin, _ = largest_margin(polynomial, N)
    assert success
    assert margin == pytest.approx(np.linalg.eigvalsh(quadratic)[0], abs=1e-3)


@pytest.mark.parametrize("seed", [2, 3])
def test_the_margin_is_the_least_value_that_ascent_finds(seed):
    forms = random_forms(seed)
    polynomial = TABLES.coefficients(*forms)
    _, margin, entries = largest_margin(polynomial, N)
    starts = sphere_points(30, N, seed)[None]
    least, at = _largest_values(*(-form[None] for form in forms), starts)
    assert margin == pytest.approx(-least[0], abs=1e-3)
    assert sphere_values(TABLES, polynomial, at) == pytest.approx(-least)
    expected = polynomial - margin * TABLES.constant
    assert TABLES.map @ entries == pytest.approx(expected, abs=1e-3)
    assert least_eigenvalue(TABLES, entries) > -1e-3


def test_the_least_growth_is_enough_and_no_more():
    _, cubic, quartic = random_forms(4)
    success, growth = least_growth(cubic, quartic, np.diag([1.0, 2.0, 0.5]))
    assert success
    assert np.array_equal(growth, growth.T)
    polynomial = TABLES.coefficients(growth, -cubic, -quartic)
    assert largest_margin(polynomial, N)[1] == pytest.approx(0.0, abs=1e-3)


def test_a_near_polynomial_gets_its_gram_matrix_without_a_solver():
    forms = random_forms(5)
    polynomial = TABLES.coefficients(*forms)
    _, margin, entries = largest_margin(polynomial, N)
    lifted = polynomial + (0.1 - margin) * TABLES.constant
    change = 0.02 * np.random.default_rng(6).normal(size=len(polynomial))
    found = nearby_gram(TABLES, entries, lifted + change, 0.01)
    assert found is not None
    assert TABLES.map @ found == pytest.approx(lifted + change, abs=1e-12)
    assert least_eigenvalue(TABLES, found) >= 0.01
    below = polynomial - (margin + 0.1) * TABLES.constant
    assert nearby_gram(TABLES, entries, below, 0.01, rounds=20) is None


def test_a_gram_matrix_may_have_a_block_that_is_known():
    rng = np.random.default_rng(7)
    gram = rng.normal(size=(TABLES.size, TABLES.size))
    gram, block = gram + gram.T, np.diag(rng.uniform(size=N))
    cubic_and_quartic = rng.normal(size=len(TABLES.map))
    found = represent(TABLES, TABLES.entries(gram), cubic_and_quartic, block)
    matrix = TABLES.matrix(found)
    assert np.array_equal(matrix[:N, :N], block)
    matrix[:N, :N] = 0.0  # What is left represents the forms without it.
    assert TABLES.map @ TABLES.entries(matrix) == pytest.approx(cubic_and_quartic)


def test_a_change_of_variables_moves_the_basis_of_gram_matrices():
    rng = np.random.default_rng(8)
    turn, z = rng.normal(size=(N, N)), rng.normal(size=N)

    def basis(z):
        return TABLES.scales * np.prod(z**BASIS, axis=1)

    assert TABLES.substitution(turn) @ basis(z) == pytest.approx(basis(turn @ z))


def test_the_solver_may_die_and_the_program_goes_on():
    with pytest.raises(SolverError, match="process died"):
        _solve_apart(os.abort)
    assert [_solve_apart(abs, value) for value in (-3, 4)] == [3, 4]
    assert _pool()._timeout is None  # Else a death after an idle time hangs us.


@given(st.lists(st.floats(-1e6, 1e6, width=32), min_size=1, max_size=6))
def test_doubles_become_whole_numbers_without_rounding(values):
    array = np.array(values)
    assert np.array_equal(exact(array).to_float(), array)
    total = exact(array) + exact(0.1 * np.ones(len(array)))
    assert total.to_float() == pytest.approx(array + 0.1)


def test_what_is_no_number_has_no_exact_value():
    for bad in (np.nan, np.inf, -np.inf):
        for make in (exact, lambda values: rounded(values, 30)):
            with pytest.raises(ValueError, match="finite"):
                make(np.array([1.0, bad]))
    with pytest.raises(ValueError, match="finite"):
        rounded(np.array([1e305]), 30)  # It overflows.


@given(st.floats(0.0, 1e200), st.floats(1e-200, 1e200))
def test_a_quotient_is_rounded_up_and_hardly(a, b):
    value = Fraction(a) ** 2 / Fraction(b)
    found = at_least(value)
    above = Fraction(found.numbers.item()) * Fraction(2) ** found.exponent
    assert value <= above <= value * (1 + Fraction(1, 2**58))


@pytest.mark.parametrize("shift", [1e-9, -1e-9])
def test_definiteness_is_told_where_floating_point_cannot(shift):
    """The least eigenvalue is `shift`, under one of 1e8."""
    rotation = np.linalg.qr(np.random.default_rng(0).normal(size=(6, 6)))[0]
    whole = rounded(rotation, 40)
    eigenvalues = exact(np.diag([1e8, 1.0, 1.0, 1.0, 1.0, shift]))
    matrix = whole @ eigenvalues @ whole.T
    assert is_positive_definite(matrix) == (shift > 0.0)


def test_a_singular_matrix_is_not_definite():
    assert not is_positive_definite(exact(np.ones((2, 2))))


def test_an_asymmetric_matrix_is_not_definite():
    assert not is_positive_definite(exact(np.array([[2.0, 1.0], [0.5, 2.0]])))


def test_a_small_change_is_forgiven_and_a_large_one_is_not():
    gram = rounded(np.diag([1.0, 0.01]), 30)
    small = Exact([[[0, 1], [1, 0]]], -10)
    assert leaves_definite(gram, small)
    assert not leaves_definite(gram, Exact(small.numbers, -6))


def test_the_closest_representation_changes_nothing_that_fits():
    entries = np.random.default_rng(1).normal(size=len(TABLES.rows))
    assert represent(TABLES, entries, TABLES.map @ entries) == pytest.approx(entries)


def test_processes_of_the_solvers_leave_those_of_joblib_alone():
    """As where a funnel is made and then proven."""
    assert _solve_apart(len, [2, 3]) == 2
    again = joblib.Parallel(n_jobs=2)(joblib.delayed(len)([1] * k) for k in (3, 4))
    assert again == [3, 4]
    assert _solve_apart(len, [1]) == 1
