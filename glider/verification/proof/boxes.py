"""Polynomials on boxes of a ball: their Taylor models there, and how large they are.

A box is w = center + half v with |v_i| <= 1, the ball is |w| <= 1. A coordinate that
the ball leaves free, as time, has center and half-width zero in it.
"""

import functools
import math

import numpy as np

from glider.compiled.boxes import shift, top_in_balls
from glider.compiled.taylor import ROUNDING, TERMS, WIDER
from glider.verification.dynamics.numbers import Monomials

_SLOPE_BLAME = 0.2
"""Blame of a box's linear terms, which the ball bounds too, beside 1 for those
of higher degree."""


def run_on_boxes(program, table, polynomials, lacks, center, half):
    """Returns results (R, M, B) of a program on boxes (m, B), and remainders (R, B).

    Its inputs are polynomials (I, M) in w, but for what these lack, (I,) at most.
    """
    points = center, half, np.abs(center) + half
    centers, halves, both = (table.values(of.T).T.copy() for of in points)
    products = table.left, table.right, *_binomials(table)
    found = shift(polynomials, centers, halves, *products)
    terms = np.count_nonzero(polynomials, axis=1, keepdims=True)
    rounding = ROUNDING * np.maximum(1.0, terms / TERMS)
    left = rounding * WIDER * (np.abs(polynomials) @ both)
    return program.run(found, (left + lacks[:, None]) * WIDER)


def shifted_from(table, polynomials):
    """Returns which coefficients (I, M) there are where polynomials are shifted."""
    present = np.zeros(polynomials.shape, dtype=bool)
    rows, products = np.nonzero(polynomials[:, _binomials(table)[0]])
    present[rows, table.left[products]] = True
    return present


@functools.lru_cache(maxsize=16)
def _binomials(table: Monomials) -> tuple[np.ndarray, np.ndarray]:
    """Returns for each product in the table where it goes and how often it occurs.

    w^(i+j) has Π_k binomial(i_k + j_k, i_k) terms v^i (center)^j.
    """
    counts = np.diff(table.starts, append=len(table.left))
    where = np.repeat(np.arange(len(table.starts)), counts)
    pairs = zip(table.exponents[where], table.exponents[table.left], strict=True)
    times = [math.prod(map(math.comb, whole, part)) for whole, part in pairs]
    return where, np.array(times, dtype=float)


def excess_in_balls(table, polynomials, remainders, limits, rates, center, half, balls):
    """Returns bounds (R, B) of |p(v) + remainder| - limit on those parts, and blame.

    That is how much each v_i makes a bound large, (R, m, B): a guide for splitting. The
    highest degree of rates (R, M, B) in it indicates what is beyond. The balls are
    those coordinates of each.
    """
    exponents = table.exponents
    m = table.num_variables
    signed = polynomials - limits, -polynomials - limits
    tops = [tops_in_balls(table, of, remainders, center, half, balls) for of in signed]
    sizes = np.abs(np.where(polynomials[:, :1] >= 0.0, *signed))
    own = exponents[1 + m :].T @ sizes[:, 1 + m :]
    # What is beyond the degree varies as the highest degree does.
    top = table.of_degree(table.degree)
    highest = exponents[top].T @ np.abs(rates[:, top])
    share = highest / np.maximum(highest.sum(axis=1, keepdims=True), 1e-300)
    own += _SLOPE_BLAME * sizes[:, 1 : m + 1] + share * remainders[:, None]
    return np.max(tops, axis=0), own


def tops_in_balls(table, polynomials, remainders, center, half, balls):
    """Returns bounds (R, B) of p(v) + remainder on the same parts of boxes."""
    m = table.num_variables
    which = np.full(m, -1)
    for k, ball in enumerate(balls):
        which[ball] = k
    # What is mixed in v or cubic is at most its size times a mean of squares v_i².
    shares = table.exponents / np.maximum(table.degrees, 2)[:, None]
    shares[: 1 + m] = 0.0
    is_square = (table.exponents.max(axis=1) == 2) & (table.degrees == 2)
    sizes = np.abs(polynomials)
    bent = np.where(is_square[:, None], polynomials, sizes)
    parts = polynomials[:, : 1 + m], shares.T @ bent, sizes.sum(axis=1), remainders
    # Numba keeps compiled code when a constant of another module changes: an argument.
    given = center, half, which, ROUNDING
    return np.array([top_in_balls(*own, *given) for own in zip(*parts, strict=True)])
