"""V̇/V on the boundary of an ellipsoid, as forms in the coordinates of the ball.

With V = eᵀ S e, S = L Lᵀ and z = Lᵀ e,
    V̇ = eᵀ Ṡ e + 2 eᵀ S ė = zᵀ M z + c₃(z) + c₄(z),
    M = L⁻¹ (Ṡ + F₁ᵀ S + S F₁) L⁻ᵀ,  c₃ = 2 zᵀ Lᵀ F₂(L⁻ᵀ z),  c₄ = 2 zᵀ Lᵀ F₃(L⁻ᵀ z).
"""

import functools

import numpy as np

from glider.verification.dynamics.error_dynamics import table_of
from glider.verification.dynamics.jets import exponents_of


def linear_part(coefficients: np.ndarray) -> np.ndarray:
    """Returns F₁ (..., n, n) of the coefficients of `expand`."""
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
    """Returns the coefficients of c₃ (..., C₃) and c₄ (..., C₄).

    Args:
        S: (..., n, n).
        coefficients: (..., n, M) of `expand`, order 3.
    """
    upper, back = to_ball(S)
    n = S.shape[-1]
    forms = []
    for degree in (2, 3):
        part = coefficients[..., table_of(n).of_degree(degree)]
        where, share = _spread(n, degree)
        tensor = part[..., where] * share
        forms.append(_substitute(tensor, upper, back, n, degree))
    return forms[0], forms[1]


def spread_form(form: np.ndarray, n: int, degree: int) -> np.ndarray:
    """Returns the symmetric tensors (..., n, ..., n) of forms (..., C)."""
    where, share = _spread(n, degree)
    return (form[..., where] * share).reshape(*form.shape[:-1], *(n,) * degree)


def change_variables(coefficients: np.ndarray, T: np.ndarray) -> np.ndarray:
    """Returns the coefficients (r, M) of p(T w) as polynomials in w, order 3.

    Args:
        coefficients: (r, M) of polynomials p in n variables, by `table_of(n)`.
        T: (n, n).
    """
    n = len(T)
    table = table_of(n)
    changed = coefficients.copy()
    changed[:, table.of_degree(1)] = coefficients[:, table.of_degree(1)] @ T
    for degree in (2, 3):
        here = table.of_degree(degree)
        where, share = _spread(n, degree)
        tensor = coefficients[:, here][:, where] * share
        changed[:, here] = _moved(tensor, T, degree) @ _gather(n, degree)
    return changed


def _substitute(tensor, upper, back, n, degree):
    """Returns the coefficients of 2 zᵀ upper F(back z), F a symmetric tensor."""
    moved = _moved(upper @ tensor, back, degree)
    return 2.0 * moved.reshape(*moved.shape[:-2], -1) @ _gather(n, degree + 1)


def _moved(tensor, back, degree):
    """Returns tensors (..., r, n^degree) with each axis of length n times back."""
    *batch, rows, entries = tensor.shape
    n = back.shape[-1]
    out = tensor.reshape(*batch, rows, *(n,) * degree)
    for axis in range(degree):
        moved = np.moveaxis(out, len(batch) + 1 + axis, -1)
        shape = moved.shape
        flat = moved.reshape(*batch, -1, n) @ back
        out = np.moveaxis(flat.reshape(shape), -1, len(batch) + 1 + axis)
    return out.reshape(*batch, rows, entries)


@functools.lru_cache(maxsize=16)
def _spread(n, degree):
    """Returns, for each entry of a tensor (flat), its monomial and its share of it."""
    indices = np.indices((n,) * degree).reshape(degree, -1)
    place = {tuple(e): k for k, e in enumerate(exponents_of(n, degree))}
    where = np.array([place[tuple(np.bincount(c, minlength=n))] for c in indices.T])
    return where, 1.0 / np.bincount(where)[where]


@functools.lru_cache(maxsize=16)
def _gather(n, degree):
    """Returns the matrix (n^degree, C) that sums a tensor's entries by monomial."""
    where, _ = _spread(n, degree)
    matrix = np.zeros((len(where), where.max() + 1))
    matrix[np.arange(len(where)), where] = 1.0
    return matrix
