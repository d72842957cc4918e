"""The region of attraction of the reversed Van der Pol oscillator.

    ẋ₁ = -x₂,  ẋ₂ = x₁ + (x₁² - 1) x₂

The origin attracts all that lies within the limit cycle. {V <= 1} is within it if
    -V̇ - L (1 - V) is a sum of squares, L is one, and V is one,
all without a constant term and with positive definite Gram matrices: where V <= 1,
V̇ is then negative away from the origin. The products of unknowns L V and L ρ are
what alternation is for: first L for a given V, then V or the level ρ for that L.
"""

import dataclasses
import functools
import math
from collections.abc import Callable, Sequence
from fractions import Fraction

import numpy as np
from scipy.integrate import solve_ivp
from scipy.linalg import solve_continuous_lyapunov

from glider.verification.sos.exact import Exact, is_positive_definite
from glider.verification.sos.solving import SolverError, solve_apart
from planar import Squares, gradient, padded, product, solve, values

SIZE = 2.0
"""Scale of y = x / SIZE, in which all polynomials are; y is about 1 on the limit cycle:
the margins of small and of large monomials then weigh alike."""

FIELD = (np.zeros((4, 4)), np.zeros((4, 4)))
"""ẏ₁ and ẏ₂ as polynomials."""
FIELD[0][0, 1] = -1.0
FIELD[1][1, 0], FIELD[1][0, 1], FIELD[1][2, 1] = 1.0, -1.0, SIZE**2

MARGIN = 1e-5
"""Margin of the Gram matrices' eigenvalues while V is looked for."""

BITS = 40
"""Number of binary places that a Gram matrix is rounded to before it is checked."""

_ANGLES = np.linspace(0.0, 2.0 * np.pi, 721)[:-1]
_RAYS = np.array([np.cos(_ANGLES), np.sin(_ANGLES)])


@dataclasses.dataclass(frozen=True, kw_only=True)
class Region:
    """{V <= 1} and what proves that it is attracted."""

    polynomial: np.ndarray
    """Lyapunov function V."""

    positive: np.ndarray
    """Entries of Gram matrices of V."""

    multiplier: np.ndarray
    """Entries of Gram matrices of L."""

    decrease: np.ndarray
    """Entries of Gram matrices of -V̇ - L (1 - V)."""

    half: int
    """Highest degree of a monomial in the squares of L."""


def lyapunov_function() -> np.ndarray:
    """Returns xᵀ P x with Aᵀ P + P A = -I, A the linear part; a polynomial of y."""
    A = np.array([[0.0, -1.0], [1.0, -1.0]])
    P = SIZE**2 * solve_continuous_lyapunov(A.T, -np.eye(2))
    V = np.zeros((3, 3))
    V[2, 0], V[1, 1], V[0, 2] = P[0, 0], 2.0 * P[0, 1], P[1, 1]
    return V


def lie_derivative(V: np.ndarray) -> np.ndarray:
    """Returns V̇, of floats or of fractions."""
    by_first, by_second = gradient(V)
    field = [f if V.dtype == float else _fractions(f) for f in FIELD]
    return product(by_first, field[0]) + product(by_second, field[1])


def area(V: np.ndarray) -> float:
    """Returns the area of the part of {V <= 1} that rays from the origin see."""
    return SIZE**2 * np.pi * float(np.mean(radii(V) ** 2))


def radii(V: np.ndarray) -> np.ndarray:
    """Returns for how large |y| along each of 720 rays V stays below 1; at most 2."""
    r = np.linspace(0.0, 2.0, 2001)
    along = np.zeros((2 * len(V) - 1, len(_ANGLES)))  # Coefficients of powers of r.
    for i, j in np.argwhere(V != 0.0):
        along[i + j] += V[i, j] * _RAYS[0] ** i * _RAYS[1] ** j
    heights = along.T @ r ** np.arange(len(along))[:, None]
    heights[:, -1] = np.inf
    last = np.argmax(heights >= 1.0, axis=1)
    rows = np.arange(len(heights))
    low, high = heights[rows, last - 1], heights[rows, last]
    return r[last - 1] + (r[1] - r[0]) * (1.0 - low) / (high - low)


def boundary(V: np.ndarray) -> np.ndarray:
    """Returns where V is 1, (2, 720) as values of x."""
    return SIZE * _RAYS * radii(V)


@functools.cache
def limit_cycle() -> np.ndarray:
    """Returns the limit cycle (2, K) as values of x, by simulation backward in time."""

    def backward(_, x):
        return np.array([x[1], -x[0] - (x[0] ** 2 - 1.0) * x[1]])

    def crosses(_, x):
        return x[1]

    crosses.direction = 1.0  # type: ignore[attr-defined]
    flown = solve_ivp(
        backward,
        (0.0, 60.0),
        [2.0, 0.0],
        rtol=1e-10,
        atol=1e-12,
        dense_output=True,
        events=crosses,
    )
    first, last = flown.t_events[0][-2:]
    return flown.sol(np.linspace(first, last, 4001)[:-1])


def true_area() -> float:
    """Returns the area within the limit cycle."""
    x, y = limit_cycle()  # By the shoelace formula.
    return 0.5 * abs(float(np.sum(x * np.roll(y, -1) - y * np.roll(x, -1))))


def share(region: Region) -> float:
    """Returns how much a region has of the area within the limit cycle, 0 to 1."""
    return area(region.polynomial) / true_area()


def find_multiplier(V: np.ndarray, half: int) -> tuple[float, np.ndarray, np.ndarray]:
    """Looks for L such that {V <= 1} is proved with the largest margin.

    Args:
        V: whose {V <= 1} it is.
        half: highest degree of a monomial in the squares of L.

    Returns:
        the least eigenvalue of the Gram matrices of L and of -V̇ - L (1 - V), at best
        (where it is not positive, nothing is proved), and the entries of these two.
    """
    L, decrease = Squares(half), decreasing(V, half)
    columns = [product(term, below(V)) for term in L.terms()] + decrease.terms()
    rows = _rows(columns, decrease)
    identity = np.concatenate([L.identity(), decrease.identity()])
    rows = np.column_stack([rows, rows @ identity])
    target = _rows([-lie_derivative(V)], decrease)[:, 0]
    v = _solved(L.sizes + decrease.sizes, rows, target, _last(rows))
    entries = v[:-1] + v[-1] * identity
    return float(v[-1]), entries[: len(L.pairs)], entries[len(L.pairs) :]


def find_positive(V: np.ndarray) -> np.ndarray:
    """Returns the entries of Gram matrices of V, as positive as can be."""
    squares = Squares((len(V) - 1) // 2)
    rows = _rows(squares.terms(), squares)
    rows = np.column_stack([rows, rows @ squares.identity()])
    v = _solved(squares.sizes, rows, _rows([V], squares)[:, 0], _last(rows))
    return v[:-1] + v[-1] * squares.identity()


def find_level(V: np.ndarray, multiplier: np.ndarray, half: int) -> float:
    """Returns the largest level ρ such that {V <= ρ} is proved by L as it is."""
    decrease, L = decreasing(V, half), Squares(half).polynomial(multiplier)
    rows = _rows([*decrease.terms(), L], decrease)
    target = _rows([-lie_derivative(V), product(L, V)], decrease).sum(axis=1)
    return float(_solved(decrease.sizes, rows, target, _last(rows))[-1])


def find_shape(V: np.ndarray, multiplier: np.ndarray, half: int) -> np.ndarray:
    """Returns the W whose {W <= 1}, proved by L as it is, is largest.

    That is, to first order about V: along a ray the boundary moves by (1 - W) / ∂V/∂r,
    and the area by the integral of r times that over the angle.
    """
    squares, decrease = Squares((len(V) - 1) // 2), decreasing(V, half)
    L, terms = Squares(half).polynomial(multiplier), squares.terms()
    rows = _rows([product(L, term) for term in terms], decrease)
    rows -= _rows([lie_derivative(term) for term in terms], decrease)
    rows = np.column_stack([rows, -_rows(decrease.terms(), decrease)])
    margin = MARGIN * np.concatenate([squares.identity(), decrease.identity()])
    target = _rows([L], decrease)[:, 0] - rows @ margin
    r = radii(V)
    outward = sum(_RAYS[i] * values(g, _RAYS * r) for i, g in enumerate(gradient(V)))
    weights, gain = r / outward, np.zeros(len(margin))
    gain[: len(terms)] = [-np.mean(weights * values(t, _RAYS * r)) for t in terms]
    v = _solved(squares.sizes + decrease.sizes, rows, target, gain) + margin
    return squares.polynomial(v[: len(terms)])


def largest_level(V: np.ndarray, half: int = 2, rounds: int = 30) -> float:
    """Alternates between the multiplier and the level, V kept, as the article does.

    Args:
        V: the Lyapunov function.
        half: as in `find_multiplier`.
        rounds: at most so many; fewer once the level grows by less than 1e-6.
    """
    level = 1.0
    for _ in range(rounds):
        _, L, _ = find_multiplier(V / level, half)
        before, level = level, level * find_level(V / level, L, half)
        if level < before + 1e-6:
            break
    return level


def start_of_degree(degree: int, V: np.ndarray) -> np.ndarray:
    """Returns V, a little larger, with room for monomials up to an even degree."""
    return padded(1.01 * V, degree + 1)


def grow(
    V: np.ndarray,
    half: int,
    rounds: int,
    progress: Callable[[int, float], None] | None = None,
) -> np.ndarray:
    """Alternates between the multiplier and V; returns the last V.

    Args:
        V: to start from, its {V <= 1} attracted; its array gives the degree.
        half: as in `find_multiplier`.
        rounds: their number.
        progress: told the round and the area.
    """
    for k in range(rounds):
        _, L, _ = find_multiplier(V, half)
        V = find_shape(V, L, half)
        if progress:
            progress(k + 1, area(V))
    return V


def certify(V: np.ndarray, half: int) -> Region:
    """Returns a region {V <= 1 - 2⁻ᵏ}, for the largest k up to 14 that is proved.

    Its polynomial is V / (1 - 2⁻ᵏ). The proof is checked in exact arithmetic.

    Raises:
        SolverError: none was found.
    """
    for k in range(14, 3, -1):
        W = V / (1.0 - 2.0**-k)
        _, multiplier, decrease = find_multiplier(W, half)
        region = Region(
            polynomial=W,
            positive=find_positive(W),
            multiplier=multiplier,
            decrease=decrease,
            half=half,
        )
        if is_proved(region):
            return region
    raise SolverError("No multiplier proves the region.")


def is_proved(region: Region) -> bool:
    """Returns whether the Gram matrices are positive definite for sure.

    Gram matrices are rounded to BITS binary places, and V is taken as the doubles are.
    What a Gram matrix then lacks to its polynomial is computed exactly and shared out
    among the entries that have the monomial.
    """
    V = _fractions(region.polynomial)
    squares, decrease = Squares((len(V) - 1) // 2), decreasing(V, region.half)
    multiplier = _rounded(region.multiplier)
    L = Squares(region.half).polynomial(multiplier)
    rest = padded(-lie_derivative(V), 2 * decrease.half + 1)
    rest = rest - padded(product(L, below(V)), len(rest))
    return (
        _is_gram(squares, _rounded(region.positive), V)
        and _is_gram(Squares(region.half), multiplier, L)
        and _is_gram(decrease, _rounded(region.decrease), rest)
    )


def _is_gram(squares: Squares, entries: np.ndarray, polynomial: np.ndarray) -> bool:
    """Returns whether a polynomial has positive definite Gram matrices near these."""
    lacking = polynomial - squares.polynomial(entries)
    shares = squares.polynomial(np.array([Fraction(1)] * len(entries)))
    if np.any((lacking != 0) & (shares == 0)):  # A monomial that no square has.
        return False
    places = [(a[0] + b[0], a[1] + b[1]) for a, b, _ in squares.pairs]
    nearest = [
        e + lacking[at] / shares[at] for e, at in zip(entries, places, strict=True)
    ]
    common = math.lcm(*(entry.denominator for entry in nearest))
    whole = np.array([int(entry * common) for entry in nearest], dtype=object)
    return all(is_positive_definite(Exact(m, 0)) for m in squares.matrices(whole))


def decreasing(V: np.ndarray, half: int) -> Squares:
    """Returns the squares that -V̇ - L (1 - V) may be a sum of."""
    return Squares((len(V) - 1) // 2 + max(half, 1))


def below(V: np.ndarray) -> np.ndarray:
    """Returns 1 - V."""
    rest = -V
    rest[0, 0] = rest[0, 0] + 1
    return rest


def _fractions(numbers: np.ndarray) -> np.ndarray:
    return np.vectorize(Fraction, otypes=[object])(numbers)


def _rounded(numbers: np.ndarray) -> np.ndarray:
    return _fractions(np.ldexp(np.rint(np.ldexp(numbers, BITS)), -BITS))


def _rows(polynomials: Sequence[np.ndarray], squares: Squares) -> np.ndarray:
    """Returns coefficients, one column a polynomial."""
    size = 2 * squares.half + 1
    return np.array([padded(p, size).ravel() for p in polynomials]).T


def _last(rows: np.ndarray) -> np.ndarray:
    """Returns the gain of a program that maximizes its last unknown."""
    return np.eye(rows.shape[1])[-1]


def _solved(
    sizes: list[int], rows: np.ndarray, target: np.ndarray, gain: np.ndarray
) -> np.ndarray:
    [(success, v)] = solve_apart(solve, [(sizes, rows, target, gain)], workers=1)
    if not success:
        raise SolverError("A step of the alternation has no solution.")
    return v
