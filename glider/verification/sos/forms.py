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
from glider.verification.sos.exact import Exact
from glider.verification.sos.sphere import Sphere


def linear_part(coefficients: np.ndarray) -> np.ndarray:
    """Returns F₁ (..., n, n) of coefficients (..., n, M) of `Nominal.closed_loop`."""
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
        coefficients: (..., n, M) of `Nominal.closed_loop`.
    """
    L_T, L_inv_T = to_ball(S)
    n = S.shape[-1]
    forms = []
    for degree in (2, 3):
        part = coefficients[..., table_of(n).of_degree(degree)]
        tensor = _spread(part, n, degree)
        forms.append(_substitute(tensor, L_T, L_inv_T, n, degree))
    return forms[0], forms[1]


def spread_form(form: np.ndarray, n: int, degree: int) -> np.ndarray:
    """Returns the symmetric tensors (..., n, ..., n) of forms (..., C)."""
    return _spread(form, n, degree).reshape(*form.shape[:-1], *(n,) * degree)


def change_variables(coefficients: np.ndarray, basis: np.ndarray) -> np.ndarray:
    """Returns the coefficients (r, M) of p(basis w) as polynomials in w.

    Args:
        coefficients: (r, M) of polynomials p in n variables, by `table_of(n)`.
        basis: (n, n).
    """
    n = len(basis)
    table = table_of(n)
    changed = coefficients.copy()
    changed[:, table.of_degree(1)] = coefficients[:, table.of_degree(1)] @ basis
    for degree in (2, 3):
        here = table.of_degree(degree)
        tensor = _spread(coefficients[:, here], n, degree)
        changed[:, here] = _moved(tensor, basis, degree) @ _gather(n, degree)
    return changed


@functools.lru_cache(maxsize=16)
def tensor_places(n: int, degree: int) -> np.ndarray:
    """Returns which monomial each entry of a flat tensor adds to, (n^degree,)."""
    place = {tuple(e): k for k, e in enumerate(exponents_of(n, degree))}
    indices = np.indices((n,) * degree).reshape(degree, -1).T
    return np.array([place[tuple(np.bincount(i, minlength=n))] for i in indices])


def _substitute(tensor, L_T, L_inv_T, n, degree):
    """Returns the coefficients of 2 zᵀ Lᵀ F(L⁻ᵀ z), F a symmetric tensor."""
    moved = _moved(L_T @ tensor, L_inv_T, degree)
    return 2.0 * moved.reshape(*moved.shape[:-2], -1) @ _gather(n, degree + 1)


def _moved(tensor, matrix, degree):
    """Returns tensors (..., r, n^degree) with each axis of length n times a matrix."""
    *batch, rows, entries = tensor.shape
    n = matrix.shape[-1]
    out = tensor.reshape(*batch, rows, *(n,) * degree)
    for axis in range(degree):
        moved = np.moveaxis(out, len(batch) + 1 + axis, -1)
        shape = moved.shape
        flat = moved.reshape(*batch, -1, n) @ matrix
        out = np.moveaxis(flat.reshape(shape), -1, len(batch) + 1 + axis)
    return out.reshape(*batch, rows, entries)


def _spread(forms, n, degree):
    """Returns flat symmetric tensors (..., n^degree) of forms (..., C)."""
    places = tensor_places(n, degree)
    return forms[..., places] * (1.0 / np.bincount(places)[places])


@functools.lru_cache(maxsize=16)
def _gather(n, degree):
    """Returns the matrix (n^degree, C) that sums a tensor's entries by monomial."""
    places = tensor_places(n, degree)
    matrix = np.zeros((len(places), places.max() + 1))
    matrix[np.arange(len(places)), places] = 1.0
    return matrix


def form_tensor(forms: Exact, n: int, degree: int) -> Exact:
    """Returns tensors (r, n, ..., n) of forms (r, C), each coefficient in one place."""
    rows = [np.repeat(np.arange(n), e) for e in exponents_of(n, degree)]
    tensor = np.zeros((len(forms), *(n,) * degree), dtype=object)
    for column, row in enumerate(rows):
        tensor[(slice(None), *row)] = forms.numbers[:, column]
    return Exact(tensor, forms.exponent)


def contracted(tensor: Exact, matrix: Exact, axis: int = 1) -> Exact:
    """Returns a tensor with an axis times a matrix; that comes last then."""
    numbers = np.tensordot(tensor.numbers, matrix.numbers, axes=(axis, 0))
    return Exact(numbers, tensor.exponent + matrix.exponent)


def gathered(tensor: Exact, n: int, degree: int) -> Exact:
    """Returns the coefficients (C,) of a form, given a tensor of it."""
    places = tensor_places(n, degree)
    total = np.zeros(places.max() + 1, dtype=object)
    np.add.at(total, places, tensor.numbers.ravel())
    return Exact(total, tensor.exponent)


def quadratic_product(first: Exact, second: Exact) -> Exact:
    """Returns the coefficients (C₄,) of (zᵀ A z)(zᵀ B z), A and B (n, n)."""
    n = len(first)
    tensor = np.multiply.outer(first.numbers, second.numbers)
    return gathered(Exact(tensor, first.exponent + second.exponent), n, 4)


def odd_then_even(cubic: Exact, quartic: Exact) -> Exact:
    """Returns coefficients (C₃,) and (C₄,) as those of their sum, (C,)."""
    low = min(cubic.exponent, quartic.exponent)
    return Exact(np.concatenate([cubic.at(low), quartic.at(low)]), low)


def gram_polynomial(tables: Sphere, gram: Exact, metric: Exact) -> Exact:
    """Returns the coefficients (C,) of bᵀ Q b, with (zᵀ Q₁₁ z) times zᵀ G z.

    Args:
        gram: (s, s) Q, of which Q₁₁ is the block of z.
    """
    n = tables.n
    lifted = quadratic_product(gram[:n, :n], metric)
    cubic, quartic = mixed_forms(tables, gram)
    return odd_then_even(cubic, lifted + quartic)


def mixed_forms(tables: Sphere, gram: Exact) -> tuple[Exact, Exact]:
    """Returns the coefficients (C₃,) and (C₄,) of bᵀ Q b without zᵀ Q₁₁ z."""
    n, q = tables.n, gram.numbers
    quartic = np.zeros(len(tables.quartic), dtype=object)
    cubic = np.zeros(len(tables.cubic), dtype=object)
    np.add.at(quartic, _even_places(tables), q[n:, n:].ravel())
    np.add.at(cubic, _odd_places(tables), 2 * q[:n, n:].ravel())
    return Exact(cubic, gram.exponent), Exact(quartic, gram.exponent)


def sparse_gram(
    tables: Sphere, coefficients: Exact, block: Exact | None = None
) -> Exact:
    """Returns a symmetric matrix (s, s) whose polynomial has coefficients (C,).

    Each coefficient goes to the first place that has its monomial.

    Args:
        coefficients: (C,), odd then even.
        block: (n, n) of z, which represents nothing; zero if None.
    """
    n, size = tables.n, tables.size
    numbers = np.zeros((size, size), dtype=object)
    count = len(tables.cubic)
    odd = np.unique(_odd_places(tables), return_index=True)[1]
    even = np.unique(_even_places(tables), return_index=True)[1]
    # Half of each goes to either side of the diagonal: one binary place more.
    halves = coefficients.numbers
    rows, columns = np.unravel_index(odd, (n, size - n))
    numbers[rows, n + columns] += halves[:count]
    numbers[n + columns, rows] += halves[:count]
    rows, columns = np.unravel_index(even, (size - n, size - n))
    numbers[n + rows, n + columns] += halves[count:]
    numbers[n + columns, n + rows] += halves[count:]
    gram = Exact(numbers, coefficients.exponent - 1)
    if block is None:
        return gram
    corner = np.zeros((size, size), dtype=object)
    corner[:n, :n] = block.numbers
    return gram + Exact(corner, block.exponent)


@functools.lru_cache(maxsize=8)
def _even_places(tables):
    """Returns which monomial of degree 4 each product of two z_i z_j is."""
    place = {e: k for k, e in enumerate(tables.quartic)}
    pairs = tables.basis[tables.n :]
    return np.array([place[tuple(a + b)] for a in pairs for b in pairs])


@functools.lru_cache(maxsize=8)
def _odd_places(tables):
    """Returns which monomial of degree 3 each product of z_k and z_i z_j is."""
    place = {e: k for k, e in enumerate(tables.cubic)}
    ones, pairs = tables.basis[: tables.n], tables.basis[tables.n :]
    return np.array([place[tuple(a + b)] for a in ones for b in pairs])
