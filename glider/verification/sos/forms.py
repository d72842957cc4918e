"""Forms in the coordinates of the ball, and their tensors, in doubles and exactly.

With S = L Lᵀ the boundary of eᵀ S e <= 1 is |z| = 1, z = Lᵀ e. Coefficients are in the
order of `exponents_of`.
"""

import functools

import numpy as np

from glider.verification.dynamics.nominal import table_of
from glider.verification.dynamics.numbers import exponents_of
from glider.verification.sos.exact import Exact, Sampled


def linear_part(coefficients: np.ndarray) -> np.ndarray:
    """Returns F₁ (..., n, n) of coefficients (..., n, M) of a `Nominal`'s rates."""
    n = coefficients.shape[-2]
    return coefficients[..., 1 : n + 1]


def to_ball(S: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Returns Lᵀ and L⁻ᵀ, (..., n, n): z = Lᵀ e and e = L⁻ᵀ z."""
    L = np.linalg.cholesky(S)
    return np.swapaxes(L, -1, -2), np.swapaxes(np.linalg.inv(L), -1, -2)


def spread_form(form: np.ndarray, n: int, degree: int) -> np.ndarray:
    """Returns the symmetric tensors (..., n, ..., n) of forms (..., C)."""
    places = _tensor_places(n, degree)
    tensors = form[..., places] * (1.0 / np.bincount(places)[places])
    return tensors.reshape(*form.shape[:-1], *(n,) * degree)


def change_variables(coefficients: np.ndarray, basis: np.ndarray) -> np.ndarray:
    """Returns coefficients (r, M) of p(basis w), given those of p by `table_of(n)`."""
    n = len(basis)
    changed = coefficients.copy()
    turn = Sampled(basis[None])
    for degree in (1, 2, 3):
        here = table_of(n).of_degree(degree)
        part = Sampled(coefficients[None, :, here])
        changed[:, here] = substituted(part, degree, turn).numbers[0]
    return changed


@functools.lru_cache(maxsize=16)
def _tensor_places(n: int, degree: int) -> np.ndarray:
    """Returns which monomial each entry of a flat tensor adds to, (n^degree,)."""
    places = np.zeros(1, dtype=int)
    for reached in range(degree):
        places = places_of_products(n, reached, 1)[places].ravel()
    return places


def substituted(forms: Exact, degree: int, matrix: Exact) -> Exact:
    """Returns the coefficients (r, C) of forms (r, C₀) in m variables as those of z.

    The variables are a matrix (m, n) times z.
    """
    (m, n), (parts, r, _) = matrix.numbers.shape[1:], forms.numbers.shape
    tensor = np.zeros((parts, r, m**degree), dtype=forms.numbers.dtype)
    first = np.unique(_tensor_places(m, degree), return_index=True)[1]
    tensor[..., first] = forms.numbers  # Each coefficient is in one place.
    shape = parts, r, *(m,) * degree, 1
    changed = type(forms)(tensor.reshape(shape), forms.exponent)
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
    places = places_of_products(n, first, second)
    numbers = np.moveaxis(products.numbers, (-2, -1), (0, 1))
    total = np.zeros((places.max() + 1, *numbers.shape[2:]), dtype=numbers.dtype)
    np.add.at(total, places, numbers)
    return type(products)(np.moveaxis(total, 0, -1), products.exponent)


@functools.lru_cache(maxsize=16)
def places_of_products(n, first, second):
    """Returns which monomial each product (C₁, C₂) is."""
    places = {tuple(e): k for k, e in enumerate(exponents_of(n, first + second))}
    products = exponents_of(n, first)[:, None] + exponents_of(n, second)
    return np.array([[places[tuple(e)] for e in row] for row in products])


def product_form(first: Exact, second: Exact) -> Exact:
    """Returns the coefficients (C,) of (zᵀ A z)(zᵀ B z) or of pᵀ z (zᵀ B z).

    B is (n, n), the first factor A (n, n) or p (n,).
    """
    n = len(second)
    degree = first.numbers.ndim - 1
    A = first if degree == 1 else gathered(first, n)
    B = gathered(second, n)
    return gathered(A.product(B, np.multiply.outer), n, degree, 2)
