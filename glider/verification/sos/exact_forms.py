"""Exact forms and Gram matrices; forms and sphere have them in doubles.

Coefficients are in the order of `Sphere`; its basis is without the scales √2 here.
"""

import functools

import numpy as np

from glider.verification.dynamics.jets import exponents_of
from glider.verification.sos.exact import Exact
from glider.verification.sos.forms import tensor_places
from glider.verification.sos.sphere import Sphere


def substituted(forms: Exact, matrix: Exact, degree: int) -> Exact:
    """Returns the coefficients of 2 Σ z_i form_i(matrix z), a form of degree + 1.

    Args:
        forms: (n, C) coefficients of n forms.
        matrix: (n, n).
        degree: of the forms.
    """
    n = len(forms)
    tensor = form_tensor(forms, n, degree)
    for _ in range(degree):
        tensor = contracted(tensor, matrix)
    return gathered(tensor, n, degree + 1) * 2


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
        tables: those of the dimension.
        gram: (s, s) Q, of which Q₁₁ is the block of z.
        metric: (n, n) G, nearly the identity.
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
        tables: those of the dimension.
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
