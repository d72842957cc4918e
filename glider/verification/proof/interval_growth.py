"""V falls on the boundary throughout an interval: the exact proof.

As docs/certificate.md has it: with e = B z for some basis and V = zᵀ G z, on V = 1
    -h (V̇ + slack V) >= zᵀ A z + c₃(z) + c₄(z) = b(z)ᵀ Q b(z) + zᵀ N z (1 - V),
b = (z, z⊗z), if Q has A - N as its block of z and represents c₃ and
c₄ + (zᵀ N z)(zᵀ G z) by the others. All are polynomials in time. N is quadratic and
comes from Gram matrices at both ends and in the middle. Where a part of Q is not
definite, both halves of the interval are tried.
"""

import math
from collections.abc import Sequence
from fractions import Fraction

import numpy as np

from glider.verification.funnel.boundary import growth_forms
from glider.verification.funnel.funnel import Funnel
from glider.verification.proof.interval import Interval
from glider.verification.sos.exact import Exact, in_time, joined, rounded
from glider.verification.sos.forms import product_form, to_ball
from glider.verification.sos.sphere import has_definite_gram, nearby_gram, sphere

_GRAM_BITS = 36
"""Binary places that Gram matrices are rounded to: 1.5e-11, where their least
eigenvalues are 1e-6, for they are of h V̇."""

BALL_BITS = 30
"""Binary places of the basis. Any number is valid; fewer are faster."""

_LEAST = 2e-5
"""Least eigenvalue that suffices for Gram matrices of -V̇/V [1/s]."""

_AIM = 3e-3
"""Least eigenvalue that the search for them aims at [1/s]; few have it."""

_ROUNDS = 150
"""Steps of the search; then the interval is halved, which makes it easier."""

HALVINGS = 4
"""Largest number of times that an interval is halved."""


def prove_growth(
    interval: Interval,
    slack: Exact,
    grams: Sequence[np.ndarray],
    halvings: int = HALVINGS,
) -> bool:
    """Tries to prove that V̇ <= -slack V on the boundary throughout an interval.

    Gram matrices (s, s) of -V̇/V - slack at both ends, in b(e), are guesses.
    """
    middle, is_proven = _prove_whole(interval, slack, grams)
    if is_proven or middle is None or not halvings:
        return is_proven
    first, last = interval.halves()
    early = prove_growth(first, slack, (grams[0], middle), halvings - 1)
    return early and prove_growth(last, slack, (middle, grams[1]), halvings - 1)


def gram_guesses(funnel: Funnel, slack: float) -> list[np.ndarray]:
    """Returns the Gram matrices (s, s) of -V̇/V - slack at all times, in b(e)."""
    tables = sphere(funnel.num_states)
    # On the boundary bᵀ b = 2.
    less = 0.5 * slack * np.eye(tables.size)
    grams = tables.matrix(funnel.grams) - less
    L_T, _ = to_ball(funnel.S)
    found = []
    for root, gram in zip(L_T, grams, strict=True):
        turn = tables.substitution(root)
        found.append(turn.T @ gram @ turn)
    return found


def _prove_whole(interval, slack, grams):
    """Returns a Gram matrix in the middle, in b(e), and whether V falls throughout.

    The matrix is None where none is found.
    """
    half = Fraction(1, 2)
    # It turns the set in the middle into a ball.
    basis = rounded(to_ball(interval.S.at(half).to_float())[1], BALL_BITS)
    forms = growth_forms(interval, basis, slack)
    tables = sphere(len(basis))
    h = float(interval.step.to_float())
    B = basis.to_float()
    turn = tables.substitution(B)
    first, last = (h * turn.T @ gram @ turn for gram in grams)
    # In the middle G is all but the identity.
    here = [form.at(half).to_float() for form in forms[:3]]
    coefficients = tables.coefficients(*here)
    found = _search(tables, 0.5 * (first + last), coefficients, h)
    if found is None:
        return None, False
    middle = tables.matrix(found)
    guesses = np.array([first, middle, last])
    shares = Fraction(0), half, Fraction(1)
    A = np.array([forms.A.at(share).to_float() for share in shares])
    corners = guesses[:, : tables.n, : tables.n]
    N = _through(A - corners)
    degree = max(form.degree for form in forms)
    controls = _through(guesses).raised(degree).bernstein()
    falls = _has_definite_grams(forms, N, controls, h)
    back = tables.substitution(np.linalg.inv(B))
    gram = back.T @ middle @ back / h
    return gram, falls


def _search(tables, guess, coefficients, h, block=None):
    """Returns the entries of a Gram matrix of h V̇ near a guess; None for none."""
    entries = tables.entries(guess)
    least = _LEAST * h
    aim = _AIM * h
    return nearby_gram(tables, entries, coefficients, least, aim, _ROUNDS, block)


def _through(matrices):
    """Returns the quadratic polynomial through doubles at τ = 0, 1/2 and 1, rounded."""
    first, middle, last = matrices
    parts = []
    for part in (first, 4.0 * middle - first - last, last):
        symmetric = 0.5 * (part + part.T)
        parts.append(rounded(symmetric, _GRAM_BITS))
    return in_time(*parts)


def _has_definite_grams(forms, N, guesses, h):
    """Determines whether all parts of a Q with this N are positive definite."""
    tables = sphere(len(N))
    even = forms.quartic + product_form(N, forms.G)
    degree = len(guesses) - 1
    corners = (forms.A - N).raised(degree).parts
    cubics = forms.cubic.raised(degree).parts
    quartics = even.raised(degree).parts
    scales = np.multiply.outer(tables.scales, tables.scales)
    for j, guess in enumerate(guesses):
        share = math.comb(degree, j)  # Of Bernstein's coefficient in a part.
        corner = corners[j]
        others = joined(cubics[j], quartics[j], axis=1)
        block = corner.to_float() / share
        coefficients = others.to_float() / share
        found = _search(tables, guess, coefficients, h, block)
        if found is None:
            return False
        whole = share * tables.matrix(found) * scales
        gram = rounded(whole, _GRAM_BITS)
        if not has_definite_gram(tables, gram, corner, others):
            return False
    return True
