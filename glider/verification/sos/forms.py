"""V̇/V on the boundary of an ellipsoid, as forms in the coordinates of the ball.

With V = eᵀ S e, S = L Lᵀ and z = Lᵀ e,
    V̇ = eᵀ Ṡ e + 2 eᵀ S ė = zᵀ M z + c₃(z) + c₄(z),
    M = L⁻¹ (Ṡ + F₁ᵀ S + S F₁) L⁻ᵀ,  c₃ = 2 zᵀ Lᵀ F₂(L⁻ᵀ z),  c₄ = 2 zᵀ Lᵀ F₃(L⁻ᵀ z).
First in doubles, then exactly. Coefficients are in the order of `Sphere`; the basis of
exact Gram matrices is without its scales √2.
"""

import functools

import numpy as np

from glider.verification.dynamics.jets import exponents_of
from glider.verification.dynamics.nominal import table_of
from glider.verification.sos.exact import Exact, leaves_definite
from glider.verification.sos.sphere import Sphere


def linear_part(coefficients: np.ndarray) -> np.ndarray:
    """Returns F₁ (..., n, n) of coefficients (..., n, M) of a `Nominal`'s rates."""
    n = coefficients.shape[-2]
    return coefficients[..., 1 : n + 1]


def quadratic_form(
    S: np.ndarray, slope: np.ndarray, coefficients: np.ndarray
) -> np.ndarray:
    """Returns Ṡ + F₁ᵀ S + S F₁, (..., n, n)."""
    product = S @ linear_part(coefficients)
    return slope + product + np.swapaxes(product, -1, -2)


def to_ball(S: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Returns Lᵀ and L⁻ᵀ, (..., n, n): z = Lᵀ e and e = L⁻ᵀ z."""
    L = np.linalg.cholesky(S)
    return np.swapaxes(L, -1, -2), np.swapaxes(np.linalg.inv(L), -1, -2)


def higher_forms(
    S: np.ndarray, coefficients: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Returns the coefficients of c₃ (..., C₃) and c₄ (..., C₄)."""
    L_T, L_inv_T = to_ball(S)
    *batch, n, _ = S.shape
    forms = []
    for degree in (2, 3):
        part = coefficients[..., table_of(n).of_degree(degree)]
        moved = move_axes(spread_form(part, n, degree), L_inv_T, degree)
        pulled = 2.0 * L_T @ moved.reshape(*batch, n, -1)
        forms.append(pulled.reshape(*batch, -1) @ _gather(n, degree + 1))
    return forms[0], forms[1]


def product_form(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Returns the coefficients (..., C) of (zᵀ A z)(zᵀ B z) or of pᵀ z (zᵀ B z).

    B is (..., n, n), the first factor A (..., n, n) or p (..., n).
    """
    *batch, n, _ = second.shape
    both = first.reshape(*batch, -1, 1) * second.reshape(*batch, 1, -1)
    return both.reshape(*batch, -1) @ _gather(n, first.ndim - len(batch) + 2)


def spread_form(form: np.ndarray, n: int, degree: int) -> np.ndarray:
    """Returns the symmetric tensors (..., n, ..., n) of forms (..., C)."""
    places = _tensor_places(n, degree)
    tensors = form[..., places] * (1.0 / np.bincount(places)[places])
    return tensors.reshape(*form.shape[:-1], *(n,) * degree)


def change_variables(coefficients: np.ndarray, basis: np.ndarray) -> np.ndarray:
    """Returns coefficients (r, M) of p(basis w), given those of p by `table_of(n)`."""
    n = len(basis)
    changed = coefficients.copy()
    for degree in (1, 2, 3):
        here = table_of(n).of_degree(degree)
        moved = move_axes(spread_form(coefficients[:, here], n, degree), basis, degree)
        changed[:, here] = moved.reshape(len(moved), -1) @ _gather(n, degree)
    return changed


@functools.lru_cache(maxsize=16)
def _tensor_places(n: int, degree: int) -> np.ndarray:
    """Returns which monomial each entry of a flat tensor adds to, (n^degree,)."""
    places = np.zeros(1, dtype=int)
    for reached in range(degree):
        places = _places_of_products(n, reached, 1)[places].ravel()
    return places


def move_axes(tensors: np.ndarray, matrix: np.ndarray, degree: int) -> np.ndarray:
    """Returns tensors (..., n, ..., n) with each of the last axes times a matrix."""
    *batch, n, _ = matrix.shape
    for axis in range(-degree, 0):
        moved = np.moveaxis(tensors, axis, -1)
        turned = moved.reshape(*batch, -1, n) @ matrix
        tensors = np.moveaxis(turned.reshape(moved.shape), -1, axis)
    return tensors


@functools.lru_cache(maxsize=16)
def _gather(n, degree):
    """Returns the matrix (n^degree, C) that sums a tensor's entries by monomial."""
    places = _tensor_places(n, degree)
    matrix = np.zeros((len(places), places.max() + 1))
    matrix[np.arange(len(places)), places] = 1.0
    return matrix


def substituted(forms: Exact, degree: int, matrix: Exact) -> Exact:
    """Returns the coefficients (r, C) of forms (r, C₀) in m variables as those of z.

    The variables are a matrix (m, n) times z.
    """
    (m, n), (parts, r, _) = matrix.numbers.shape[1:], forms.numbers.shape
    tensor = np.zeros((parts, r, m**degree), dtype=object)
    first = np.unique(_tensor_places(m, degree), return_index=True)[1]
    tensor[..., first] = forms.numbers  # Each coefficient is in one place.
    changed = Exact(tensor.reshape(parts, r, *(m,) * degree, 1), forms.exponent)
    for reached in range(degree):
        changed = gathered(contracted(changed, matrix), n, reached)
    return changed


def contracted(tensor: Exact, matrix: Exact, axis: int = 1) -> Exact:
    """Returns a tensor with an axis times a matrix; what that has left comes last."""
    return tensor.product(matrix, functools.partial(np.tensordot, axes=(axis, 0)))


def gathered(products: Exact, n: int, first: int = 1, second: int = 1) -> Exact:
    """Returns the coefficients (..., C) of sums of products of monomials in z.

    Each (..., C₁, C₂) is of one of the first degree and one of the second: of zᵀ A z,
    given A.
    """
    places = _places_of_products(n, first, second)
    numbers = np.moveaxis(products.numbers, (-2, -1), (0, 1))
    total = np.zeros((places.max() + 1, *numbers.shape[2:]), dtype=object)
    np.add.at(total, places, numbers)
    return Exact(np.moveaxis(total, 0, -1), products.exponent)


@functools.lru_cache(maxsize=16)
def _places_of_products(n, first, second):
    """Returns which monomial each product (C₁, C₂) is."""
    places = {tuple(e): k for k, e in enumerate(exponents_of(n, first + second))}
    products = exponents_of(n, first)[:, None] + exponents_of(n, second)
    return np.array([[places[tuple(e)] for e in row] for row in products])


def exact_product(first: Exact, second: Exact) -> Exact:
    """Returns what `product_form` does, exactly."""
    n = len(second)
    degree = first.numbers.ndim - 1
    A = first if degree == 1 else gathered(first, n)
    B = gathered(second, n)
    return gathered(A.product(B, np.multiply.outer), n, degree, 2)


def has_definite_gram(
    tables: Sphere, gram: Exact, corner: Exact, others: Exact
) -> bool:
    """Determines whether a polynomial has a positive definite Gram matrix near one.

    It is zᵀ A z, A the corner (n, n), plus one with the other coefficients (C,). What
    these differ by from those of the Gram matrix (s, s) is added to it, each in the
    first place that has its monomial.
    """
    places = tables.places
    mixed = tables.places >= 0
    known = np.zeros(len(tables.map), dtype=object)
    np.add.at(known, places[mixed], gram.numbers[0, mixed])
    left_over = others - Exact([known], gram.exponent)
    _, first = np.unique(places, return_index=True)
    rows, columns = np.unravel_index(first[1:], places.shape)  # The first is -1.
    numbers, own = np.zeros((2, 1, *places.shape), dtype=object)
    # Half of each goes to either side of the diagonal: one binary place more.
    numbers[:, rows, columns] += left_over.numbers
    numbers[:, columns, rows] += left_over.numbers
    block = corner - gram[: tables.n, : tables.n]
    own[:, : tables.n, : tables.n] = block.numbers
    change = Exact(numbers, left_over.exponent - 1) + Exact(own, block.exponent)
    return leaves_definite(gram, change)
