"""Lesson 7: how much of a region of attraction can sums of squares prove?

The sums-of-squares script of the article's section "A note on funnels". The reversed
Van der Pol oscillator goes to the origin from within its limit cycle. With V from the
Lyapunov equation, Drake's RegionOfAttraction finds the largest level (the article
alternates between the multiplier and the level instead): the ellipse {V <= 2.3045},
less than half of the region. Where V may change too and is of degree 4 or 6,
alternation between a multiplier and V proves nearly all of it. Every proof is checked
in exact arithmetic; the solver is not trusted.

    ẋ₁ = -x₂,  ẋ₂ = x₁ + (x₁² - 1) x₂

A polynomial p = mᵀ G m, m its monomials, is a sum of squares if the Gram matrix G is
positive semidefinite, and then p >= 0 everywhere; to find such a G is a semidefinite
program. L is the multiplier of the S-procedure: L >= 0 and -V̇ >= L (1 - V) make V̇
negative where V <= 1. {V <= 1} is attracted if V, L and -V̇ - L (1 - V) are sums of
squares, all without a constant term and with positive definite Gram matrices: where V
<= 1, V̇ is then negative away from the origin. L V is a product of unknowns, hence the
alternation: first L for a given V, then V for that L.

    python examples/article/van_der_pol.py --figure van_der_pol.png
"""

import dataclasses
import functools
import itertools
from collections.abc import Sequence
from fractions import Fraction
from pathlib import Path

import numpy as np
from pydrake.solvers import ClarabelSolver, MathematicalProgram
from pydrake.symbolic import Monomial, Polynomial, Variable
from pydrake.systems.analysis import RegionOfAttraction, RegionOfAttractionOptions
from pydrake.systems.primitives import SymbolicVectorSystem
from scipy.integrate import solve_ivp

from course import compare, legend_beside, picture, read_options, start
from glider.report.plots.style import BLUE, GREEN, RED

ARTICLE = {
    "Largest level of the Lyapunov function": "2.3045 (its script, run again)",
    "Share of the region that V of degree 2 proves": "-",
    "V of degree 4": "-",
    "V of degree 6": "-",
}

SIZE = 2.0
"""Scale of y = x / SIZE, in which all polynomials are; y is about 1 on the limit cycle:
the margins of small and of large monomials then have similar weights."""

Y = np.array([Variable("y1"), Variable("y2")])
FIELD = [Polynomial(f, Y) for f in (-Y[1], Y[0] + (SIZE**2 * Y[0] ** 2 - 1.0) * Y[1])]
"""ẏ as polynomials."""

MARGIN = 1e-5
"""Margin of the Gram matrices' eigenvalues while V is searched for."""

BITS = 40
"""Number of binary places that a Gram matrix is rounded to before it is checked."""

ANGLES = np.linspace(0.0, 2.0 * np.pi, 721)[:-1]
RAYS = np.array([np.cos(ANGLES), np.sin(ANGLES)])

ROUNDS = 16
"""Rounds of the alternation."""


class SolverError(RuntimeError):
    """The solver found no solution, or nothing that the exact check accepts."""


# ------------------------------------------------------------------ sums of squares


def monomials_of(half: int) -> tuple[list[Monomial], ...]:
    """Returns the monomials of degree 1 to `half`, odd and even ones apart.

    All polynomials here are even, so that a square need not mix the two.
    """
    every = [
        Monomial({Y[0]: degree - j, Y[1]: j})
        for degree in range(1, half + 1)
        for j in range(degree + 1)
    ]
    odd = [m for m in every if m.total_degree() % 2 == 1]
    even = [m for m in every if m.total_degree() % 2 == 0]
    return (odd, even) if even else (odd,)


@dataclasses.dataclass(frozen=True)
class Squares:
    """A sum of squares Σ_b m_bᵀ G_b m_b over the blocks of `monomials_of`."""

    polynomial: Polynomial
    """The sum, with decision variables."""

    grams: list[np.ndarray]
    """G_b, less the margin."""

    margin: Variable | float
    """Least eigenvalue of the Gram matrices."""

    def solved(self, result) -> list[np.ndarray]:
        """Returns the Gram matrices that a solver found."""
        given = isinstance(self.margin, float)
        margin = self.margin if given else result.GetSolution(self.margin)
        return [result.GetSolution(G) + margin * np.eye(len(G)) for G in self.grams]


def add_squares(
    prog: MathematicalProgram, half: int, margin: Variable | float
) -> Squares:
    """Adds a sum of squares whose Gram matrices exceed a margin times the identity."""
    total, grams = Polynomial(), []
    for basis in monomials_of(half):
        squares, gram = prog.NewSosPolynomial(np.array(basis))
        identity = sum(m.ToExpression() ** 2 for m in basis)
        total += squares + Polynomial(margin * identity, Y)
        grams.append(gram)
    return Squares(total, grams, margin)


def solve(prog: MathematicalProgram):
    """Solves a program, or raises SolverError."""
    result = ClarabelSolver().Solve(prog)
    if not result.is_success():
        raise SolverError("A step of the alternation has no solution.")
    return result


def lie_derivative(V: Polynomial) -> Polynomial:
    """Returns V̇."""
    return sum((V.Differentiate(y) * f for y, f in zip(Y, FIELD, strict=True)), 0.0)


def find_multiplier(V: Polynomial, half: int):
    """Finds L that proves {V <= 1} with the largest margin.

    Args:
        V: whose {V <= 1} it is.
        half: highest degree of a monomial in the squares of L.

    Returns:
        the margin (where it is not positive, nothing is proved), L, and the Gram
        matrices of L and of -V̇ - L (1 - V).
    """
    prog = MathematicalProgram()
    prog.AddIndeterminates(Y)
    [margin] = prog.NewContinuousVariables(1, "margin")
    L = add_squares(prog, half, margin)
    decrease = add_squares(prog, V.TotalDegree() // 2 + half, margin)
    prog.AddEqualityConstraintBetweenPolynomials(
        -lie_derivative(V) - L.polynomial * (1.0 - V), decrease.polynomial
    )
    prog.AddLinearCost(-margin)
    result = solve(prog)
    return (
        result.GetSolution(margin),
        result.GetSolution(L.polynomial),
        L.solved(result),
        decrease.solved(result),
    )


def find_shape(V: Polynomial, L: Polynomial, degree: int) -> Polynomial:
    """Finds the W whose {W <= 1}, proved by L as it is, is largest.

    That is, to first order about V: along a ray the boundary moves by (1 - W) / ∂V/∂r,
    and the area by the integral of r times that over the angle.
    """
    half = L.TotalDegree() // 2
    prog = MathematicalProgram()
    prog.AddIndeterminates(Y)
    W = add_squares(prog, degree // 2, MARGIN)
    decrease = add_squares(prog, degree // 2 + half, MARGIN)
    prog.AddEqualityConstraintBetweenPolynomials(
        -lie_derivative(W.polynomial) - L * (1.0 - W.polynomial), decrease.polynomial
    )
    r = radii(V)
    outward = sum(
        direction * V.Differentiate(y).EvaluateIndeterminates(Y, RAYS * r)
        for y, direction in zip(Y, RAYS, strict=True)
    )
    rows, variables, _ = W.polynomial.EvaluateWithAffineCoefficients(Y, RAYS * r)
    prog.AddLinearCost((r / outward) @ rows / len(r), 0.0, variables)
    return solve(prog).GetSolution(W.polynomial)


def find_positive(V: Polynomial) -> list[np.ndarray]:
    """Returns Gram matrices of V with the largest margin."""
    prog = MathematicalProgram()
    prog.AddIndeterminates(Y)
    [margin] = prog.NewContinuousVariables(1, "margin")
    squares = add_squares(prog, V.TotalDegree() // 2, margin)
    prog.AddEqualityConstraintBetweenPolynomials(V, squares.polynomial)
    prog.AddLinearCost(-margin)
    return squares.solved(solve(prog))


def lyapunov_function() -> tuple[Polynomial, float]:
    """Returns V = xᵀ P x with Aᵀ P + P A = -I, A the linear part, and its level."""
    V = SIZE**2 * (1.5 * Y[0] ** 2 - Y[0] * Y[1] + Y[1] ** 2)
    system = SymbolicVectorSystem(state=Y, dynamics=[f.ToExpression() for f in FIELD])
    options = RegionOfAttractionOptions()
    options.lyapunov_candidate, options.state_variables = V, Y
    context = system.CreateDefaultContext()
    scaled = Polynomial(RegionOfAttraction(system, context, options), Y)
    first = Monomial({Y[0]: 2})
    level = 1.5 * SIZE**2 / scaled.monomial_to_coefficient_map()[first].Evaluate()
    return Polynomial(V, Y), level


def grow(V: Polynomial, degree: int, rounds: int) -> Polynomial:
    """Alternates between the multiplier and V of a degree; returns the last V."""
    for _ in range(rounds):
        _, L, *_ = find_multiplier(V, degree // 2)
        V = find_shape(V, L, degree)
    return V


# ------------------------------------------------------------------ the exact check


@dataclasses.dataclass(frozen=True, kw_only=True)
class Region:
    """{V <= 1} and what proves that it is attracted."""

    V: Polynomial
    """Lyapunov function."""

    positive: list[np.ndarray]
    """Gram matrices of V."""

    multiplier: list[np.ndarray]
    """Gram matrices of L."""

    decrease: list[np.ndarray]
    """Gram matrices of -V̇ - L (1 - V)."""

    half: int
    """Highest degree of a monomial in the squares of L."""


Exact = dict[tuple[int, int], Fraction]
"""Exponents of a monomial to its coefficient."""


def exact(polynomial: Polynomial) -> Exact:
    """Returns a polynomial with its doubles as they are."""
    return {
        (m.degree(Y[0]), m.degree(Y[1])): Fraction(c.Evaluate())
        for m, c in polynomial.monomial_to_coefficient_map().items()
    }


def plus(a: Exact, b: Exact, factor: int = 1) -> Exact:
    """Returns a + factor b."""
    return {e: a.get(e, Fraction(0)) + factor * b.get(e, Fraction(0)) for e in {*a, *b}}


def times(a: Exact, b: Exact) -> Exact:
    """Returns a b."""
    total: Exact = {}
    for ((i, j), c), ((k, m), d) in itertools.product(a.items(), b.items()):
        total[i + k, j + m] = total.get((i + k, j + m), Fraction(0)) + c * d
    return total


def certify(V: Polynomial, half: int) -> Region:
    """Returns a region {V <= 1 - 2⁻ᵏ}, for the largest k up to 14 that is proved.

    Raises:
        SolverError: none was found.
    """
    for k in range(14, 3, -1):
        W = V * (1.0 / (1.0 - 2.0**-k))
        _, _, multiplier, decrease = find_multiplier(W, half)
        region = Region(
            V=W,
            positive=find_positive(W),
            multiplier=multiplier,
            decrease=decrease,
            half=half,
        )
        if is_proved(region):
            return region
    raise SolverError("No multiplier proves the region.")


def is_proved(region: Region) -> bool:
    """Checks in rational arithmetic that the Gram matrices prove a region.

    Gram matrices are rounded to BITS binary places, and V is taken as the doubles are.
    What a Gram matrix then lacks to its polynomial is computed exactly and shared out
    among the entries that have the monomial.
    """
    V = exact(region.V)
    V_dot: Exact = {}
    for axis, field in enumerate(FIELD):
        slope = {
            (i - (axis == 0), j - (axis == 1)): (i, j)[axis] * c
            for (i, j), c in V.items()
            if (i, j)[axis]
        }
        V_dot = plus(V_dot, times(slope, exact(field)))
    half = region.V.TotalDegree() // 2
    L = gram_polynomial(region.half, rounded(region.multiplier))
    below = plus({(0, 0): Fraction(1)}, V, -1)
    rest = plus({e: -c for e, c in V_dot.items()}, times(L, below), -1)
    return (
        is_gram(half, rounded(region.positive), V)
        and is_gram(region.half, rounded(region.multiplier), L)
        and is_gram(half + region.half, rounded(region.decrease), rest)
    )


def rounded(grams: list[np.ndarray]) -> list[np.ndarray]:
    """Returns Gram matrices as fractions of BITS binary places."""
    fraction = np.vectorize(lambda g: Fraction(round(g * 2**BITS), 2**BITS), "O")
    return [fraction(G) for G in grams]


def places_of(half: int):
    """Yields block, row, column and exponents of each entry of Gram matrices."""
    for b, basis in enumerate(monomials_of(half)):
        powers = [(m.degree(Y[0]), m.degree(Y[1])) for m in basis]
        for (r, first), (c, second) in itertools.product(enumerate(powers), repeat=2):
            yield b, r, c, (first[0] + second[0], first[1] + second[1])


def gram_polynomial(half: int, grams: list[np.ndarray]) -> Exact:
    """Returns Σ_b m_bᵀ G_b m_b."""
    total: Exact = {}
    for b, r, c, exponents in places_of(half):
        total[exponents] = total.get(exponents, Fraction(0)) + grams[b][r, c]
    return total


def is_gram(half: int, grams: list[np.ndarray], polynomial: Exact) -> bool:
    """Checks that a polynomial has positive definite Gram matrices near these."""
    lacking = plus(polynomial, gram_polynomial(half, grams), -1)
    ones = [np.full(G.shape, Fraction(1)) for G in grams]
    shares = gram_polynomial(half, ones)
    if any(lack and exponents not in shares for exponents, lack in lacking.items()):
        return False  # A monomial that no square has.
    for b, r, c, exponents in places_of(half):
        grams[b][r, c] += lacking[exponents] / shares[exponents]
    return all(is_positive_definite(G) for G in grams)


def is_positive_definite(matrix: np.ndarray) -> bool:
    """Checks a symmetric matrix of fractions by the pivots of its elimination."""
    rest = matrix.copy()
    while len(rest):
        if rest[0, 0] <= 0:
            return False
        rest = rest[1:, 1:] - np.outer(rest[1:, 0], rest[0, 1:] / rest[0, 0])
    return True


# --------------------------------------------------------------------------- areas


def radii(V: Polynomial) -> np.ndarray:
    """Returns for how large |y| along each of 720 rays V stays below 1; at most 2."""
    r = np.linspace(0.0, 2.0, 2001)
    powers = np.zeros((V.TotalDegree() + 1, len(ANGLES)))  # Coefficients of V in r.
    for (i, j), c in exact(V).items():
        powers[i + j] += float(c) * RAYS[0] ** i * RAYS[1] ** j
    heights = powers.T @ r ** np.arange(len(powers))[:, None]
    heights[:, -1] = np.inf
    last = np.argmax(heights >= 1.0, axis=1)
    rows = np.arange(len(heights))
    low, high = heights[rows, last - 1], heights[rows, last]
    return r[last - 1] + (r[1] - r[0]) * (1.0 - low) / (high - low)


def boundary(V: Polynomial) -> np.ndarray:
    """Returns where V is 1, (2, 720) as values of x."""
    return SIZE * RAYS * radii(V)


def area(V: Polynomial) -> float:
    """Returns the area of the part of {V <= 1} that rays from the origin see."""
    return SIZE**2 * np.pi * float(np.mean(radii(V) ** 2))


@functools.cache
def limit_cycle() -> np.ndarray:
    """Returns the limit cycle (2, K) as values of x, by simulation backward in time."""

    def backward(_, x):
        return np.array([x[1], -x[0] - (x[0] ** 2 - 1.0) * x[1]])

    def crosses(_, x):
        return x[1]

    crosses.direction = 1.0  # type: ignore[attr-defined]
    options = {"rtol": 1e-10, "atol": 1e-12, "dense_output": True, "events": crosses}
    flown = solve_ivp(backward, (0.0, 60.0), [2.0, 0.0], **options)
    first, last = flown.t_events[0][-2:]
    return flown.sol(np.linspace(first, last, 4001)[:-1])


def true_area() -> float:
    """Returns the area within the limit cycle, by the shoelace formula."""
    x, y = limit_cycle()
    return 0.5 * abs(float(np.sum(x * np.roll(y, -1) - y * np.roll(x, -1))))


# ------------------------------------------------------------------------- lecture


def prove(ellipse: Polynomial, rounds: int = ROUNDS) -> dict[int, Region]:
    """Returns proved regions by the degree of V: 2 as given, 4 and 6 by alternation."""
    proved = {2: certify(ellipse, 1)}
    for degree in (4, 6):
        grown = grow(ellipse * 1.01, degree, rounds)
        proved[degree] = certify(grown, degree // 2)
    return proved


def share_of(region: Region) -> float:
    """Returns a region's share of the area within the limit cycle, 0 to 1."""
    return area(region.V) / true_area()


def main(arguments: Sequence[str] | None = None) -> dict[str, str]:
    """Finds the level, then V of degree 4 and 6, and checks the proofs."""
    path = read_options(__doc__, arguments)
    V, level = lyapunov_function()
    proved = prove(V * (1.0 / level))
    if path:
        draw(path, proved)
    shares = (f"{share_of(region):.1%}" for region in proved.values())
    return compare(ARTICLE, f"{level:.4f}", *shares)


def draw(path: Path, proved: dict[int, Region]) -> None:
    """Draws the limit cycle and the boundaries of the proved regions."""
    with picture(path, 7.0, 4.6) as figure:
        ax = figure.subplots()
        ax.fill(*limit_cycle(), color="#EDEDED", lw=0)
        curves = {"limit cycle, simulated": limit_cycle()}
        for degree, region in proved.items():
            label = f"degree {degree}: {share_of(region):.1%}"
            curves[label] = boundary(region.V)
        for (label, curve), color in zip(
            curves.items(), ("k", RED, GREEN, BLUE), strict=True
        ):
            closed = np.column_stack([curve, curve[:, 0]])
            ax.plot(*closed, color=color, label=label)
        ax.set(xlabel="x₁", ylabel="x₂")
        ax.set_aspect("equal", adjustable="datalim")
        legend_beside(ax)


if __name__ == "__main__":
    start(main)
