"""Checks a funnel's certificate, exactly and without a solver.

At each of its times, with whole numbers only:
1. S is positive definite, and the set keeps the servo within its limits;
2. V̇ <= -slack V on the whole boundary V = 1, for the third-order dynamics whose
   coefficients are the doubles that `expand` computes from the glider in the file, with
   any disturbance |R_k| <= β_k: minus V̇ - slack V has a positive definite Gram matrix.
At the end the set lies in the goal. Beside that, with floating point: the nominal is a
flight, and V̇ is negative between the times too. That the true remainder is within β_k
is for `glider.verification.proof.remainder_proof`.
"""

import dataclasses
import functools
from collections.abc import Callable, Sequence

import numpy as np
from threadpoolctl import threadpool_limits

from glider.verification.dynamics.error_dynamics import (
    expand,
    table_of,
)
from glider.verification.dynamics.jets import exponents_of
from glider.verification.funnel.between import (
    SHARES,
    Between,
    drift,
)
from glider.verification.funnel.funnel import Funnel
from glider.verification.funnel.limits import servo_bounds
from glider.verification.sos.exact import (
    GRAM_BITS,
    Exact,
    exact,
    is_positive_definite,
    leaves_definite,
    rounded,
)
from glider.verification.sos.forms import to_ball
from glider.verification.sos.grams import represent
from glider.verification.sos.sphere import (
    Sphere,
    sphere,
)

SLACK = 0.1
"""Share of the margin of V̇/V that the exact check proves."""

BALL_BITS = 30
"""Binary places of the coordinates of the ball. Any are right; few are fast."""

DRIFT = 1e-4
"""How far the nominal may be from a flight over one step [m, rad, m/s, rad/s]."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Verdict:
    """What the check of a funnel found."""

    times: int
    """How many times were checked exactly."""

    faults: tuple[str, ...]
    """What is wrong, a sentence each; empty where the certificate holds."""

    slack: float
    """V̇ <= -slack V is proven at these times [1/s]."""

    rounding: float
    """Largest change of an eigenvalue by what rounding and solver left over."""

    between: float
    """Largest V̇/V found between the times, in floating point [1/s]; infinite where
    something else is wrong already."""

    drift: float
    """Largest error of the nominal over a step."""

    @property
    def holds(self) -> bool:
        """Whether nothing is wrong."""
        return not self.faults


@threadpool_limits.wrap(limits=1, user_api="blas")  # Small matrices.
def check_funnel(
    funnel: Funnel,
    every: int = 1,
    progress: Callable[[float], None] | None = None,
) -> Verdict:
    """Checks a funnel.

    Args:
        funnel: the funnel.
        every: check every so many times only, the first and last included.
        progress: called with the share that is done.
    """
    last = len(funnel.nominal.times) - 1
    at = sorted({*range(0, last + 1, every), last})
    faults, rounding = exact_faults(funnel, at, progress)
    drifted, between = drift(funnel.nominal), np.inf
    if not drifted < DRIFT:
        faults.append(
            f"The nominal is no flight: it drifts by {drifted:.2g} in a step."
        )
    if not faults:
        between = largest_between(funnel, every)
        if not between < 0.0:
            faults.append(f"Between the times V̇/V reaches {between:.2g} 1/s.")
    return Verdict(
        times=len(at),
        faults=tuple(faults),
        slack=SLACK * funnel.settings.margin,
        rounding=rounding,
        between=between,
        drift=drifted,
    )


def exact_faults(
    funnel: Funnel,
    at: Sequence[int],
    progress: Callable[[float], None] | None = None,
) -> tuple[list[str], float]:
    """Checks in whole numbers.

    Args:
        funnel: the funnel.
        at: indices of the times.
        progress: called with the share that is done.

    Returns:
        what is wrong, a sentence each, and the `rounding` of a Verdict.
    """
    nominal = funnel.nominal
    coefficients = expand(nominal)
    directions, bounds = servo_bounds(nominal, shrink=1.0)
    slack = SLACK * funnel.settings.margin
    faults, rounding = [], 0.0
    for number, k in enumerate(at):
        when = f"at {nominal.times[k]:.4f} s"
        if not is_positive_definite(exact(funnel.S[k])):
            faults.append(f"The set is no ellipsoid {when}.")
            continue
        if not _keeps(funnel.S[k], directions[k], bounds[k]):
            faults.append(f"The servo would meet its limits {when}.")
        holds, change = check_time(funnel, coefficients[k], k, slack)
        rounding = max(rounding, change)
        if not holds:
            faults.append(f"The Gram matrix proves nothing {when}.")
        if progress:
            progress((number + 1) / len(at))
    if not _within_goal(funnel):
        faults.append("The last set is not within the goal.")
    return faults, rounding


def check_time(
    funnel: Funnel, coefficients: np.ndarray, k: int, slack: float
) -> tuple[bool, float]:
    """Returns whether V̇ <= -slack V is proven at one time, and what rounding took.

    Args:
        funnel: the funnel.
        coefficients: (n, M) of `expand` at that time.
        k: the time's index.
        slack: [1/s].
    """
    S, slope = funnel.S[k], funnel.slopes[k]
    beta, weights = funnel.beta[k], funnel.weights[k]
    n = len(S)
    if np.any(beta < 0.0) or np.any(weights < 0.0):
        return False, 0.0
    if np.any((beta > 0.0) & (weights == 0.0)):
        return False, 0.0
    tables = sphere(n)
    back = to_ball(S)[1]
    polynomial, metric = growth_polynomial(
        exact(S),
        exact(slope),
        coefficients,
        rounded(back, BALL_BITS),
        beta,
        weights,
        exact(slack),
    )
    # In floating point: a Gram matrix for exactly this polynomial, as near as can be.
    doubles = polynomial.to_float()
    entries = funnel.grams[k].astype(float)
    entries = entries - 0.5 * slack * tables.entries(np.eye(tables.size))
    gram = tables.matrix(represent(tables, entries, doubles))
    gram = gram * np.multiply.outer(tables.scales, tables.scales)
    whole = rounded(gram, GRAM_BITS)
    rest = polynomial - _gram_polynomial(tables, whole, metric)
    return leaves_definite(whole, _as_gram(tables, rest))


def _keeps(S, directions, bounds):
    """Whether aᵀ S⁻¹ a < b² for each limit: b² S - a aᵀ is positive definite."""
    for a, bound in zip(directions, bounds, strict=True):
        if not bound > 0.0:
            return False
        square = exact(bound).times(exact(bound))
        across = np.multiply.outer(exact(a).numbers, exact(a).numbers)
        product = Exact(across, 2 * exact(a).exponent)
        if not is_positive_definite(exact(S).times(square) - product):
            return False
    return True


def _within_goal(funnel):
    """Whether S(T) is at least the goal's, to one part in 10⁹."""
    axes = funnel.settings.goal_axes(funnel.num_states)
    goal = exact(np.diag(1.0 / axes**2) * (1.0 - 1e-9))
    return is_positive_definite(exact(funnel.S[-1]) - goal)


def growth_polynomial(S, slope, coefficients, back, beta, weights, slack):
    """Returns minus V̇ - slack V as coefficients, odd then even, and zᵀ G z = V."""
    n = len(coefficients)
    table = table_of(n)
    F1, F2, F3 = (exact(coefficients[:, table.of_degree(d)]) for d in (1, 2, 3))
    forth = back.transposed()
    pull = forth @ S  # Tᵀ S
    metric = pull @ back
    product = pull @ F1 @ back
    quadratic = forth @ slope @ back + product + product.transposed()
    for b, w, column in zip(beta, weights, pull.numbers.T, strict=True):
        if w > 0.0:
            across = Exact(np.multiply.outer(column, column), 2 * pull.exponent)
            quadratic = quadratic + across.times(exact(w))
            quadratic = quadratic + metric.times(_at_least(b * b / w))
    quadratic = quadratic + metric.times(slack)
    cubic = _substitute(pull @ F2, back, n, 2)
    quartic = _substitute(pull @ F3, back, n, 3) + _product(quadratic, metric)
    low = min(cubic.exponent, quartic.exponent)
    polynomial = np.concatenate([cubic.at(low), quartic.at(low)])
    return Exact(-polynomial, low), metric


def _at_least(value):
    """Returns a double above a quotient that rounding may have lowered."""
    return exact(np.nextafter(np.nextafter(value, np.inf), np.inf))


@functools.lru_cache(maxsize=16)
def _places(n, degree):
    """Returns where each entry of a flat tensor goes among the monomials."""
    place = {tuple(e): k for k, e in enumerate(exponents_of(n, degree))}
    indices = np.indices((n,) * degree).reshape(degree, -1).T
    return np.array([place[tuple(np.bincount(i, minlength=n))] for i in indices])


def _gather(tensor, n, degree):
    """Returns the coefficients of a form, given a tensor of it."""
    places = _places(n, degree)
    total = np.zeros(places.max() + 1, dtype=object)
    np.add.at(total, places, tensor.ravel())
    return total


def _substitute(forms, back, n, degree):
    """Returns the coefficients of 2 Σ z_i form_i(back z), forms (n, monomials)."""
    rows = [np.repeat(np.arange(n), e) for e in exponents_of(n, degree)]
    tensor = np.zeros((n,) * (degree + 1), dtype=object)
    for column, row in enumerate(rows):
        tensor[(slice(None), *row)] = forms.numbers[:, column]
    for _ in range(degree):
        tensor = np.tensordot(tensor, back.numbers, axes=(1, 0))
    exponent = forms.exponent + degree * back.exponent
    return Exact(2 * _gather(tensor, n, degree + 1), exponent)


def _product(first, second):
    """Returns the coefficients of (zᵀ A z)(zᵀ B z)."""
    n = len(first.numbers)
    tensor = np.multiply.outer(first.numbers, second.numbers)
    return Exact(_gather(tensor, n, 4), first.exponent + second.exponent)


def _gram_polynomial(tables: Sphere, gram: Exact, metric: Exact) -> Exact:
    """Returns bᵀ Q b with (zᵀ Q₁₁ z) times zᵀ G z, without the basis's scales."""
    n, q = tables.n, gram.numbers
    corner = Exact(q[:n, :n], gram.exponent)
    even = _product(corner, metric)
    higher = np.zeros(len(tables.quartic), dtype=object)
    cubic = np.zeros(len(tables.cubic), dtype=object)
    np.add.at(higher, _even_places(tables), q[n:, n:].ravel())
    np.add.at(cubic, _odd_places(tables), 2 * q[:n, n:].ravel())
    even = even + Exact(higher, gram.exponent)
    low = min(even.exponent, gram.exponent)
    odd = Exact(cubic, gram.exponent).at(low)
    return Exact(np.concatenate([odd, even.at(low)]), low)


@functools.lru_cache(maxsize=8)
def _even_places(tables):
    place = {e: k for k, e in enumerate(tables.quartic)}
    pairs = tables.basis[tables.n :]
    return np.array([place[tuple(a + b)] for a in pairs for b in pairs])


@functools.lru_cache(maxsize=8)
def _odd_places(tables):
    place = {e: k for k, e in enumerate(tables.cubic)}
    ones, pairs = tables.basis[: tables.n], tables.basis[tables.n :]
    return np.array([place[tuple(a + b)] for a in ones for b in pairs])


def _as_gram(tables: Sphere, rest: Exact) -> Exact:
    """Returns a symmetric matrix whose form is a polynomial, odd then even.

    Each coefficient goes to the first place that has its monomial.
    """
    n, size = tables.n, tables.size
    numbers = np.zeros((size, size), dtype=object)
    count = len(tables.cubic)
    odd = np.unique(_odd_places(tables), return_index=True)[1]
    even = np.unique(_even_places(tables), return_index=True)[1]
    twice = 2 * rest.numbers  # So that a half is whole.
    rows, columns = np.unravel_index(odd, (n, size - n))
    numbers[rows, n + columns] += twice[:count] // 2
    numbers[n + columns, rows] += twice[:count] // 2
    rows, columns = np.unravel_index(even, (size - n, size - n))
    numbers[n + rows, n + columns] += twice[count:] // 2
    numbers[n + columns, n + rows] += twice[count:] // 2
    return Exact(numbers, rest.exponent - 1)


def largest_between(funnel: Funnel, every: int = 1) -> float:
    """Returns the largest V̇/V found between the times, by ascent [1/s].

    Args:
        funnel: the funnel.
        every: look into every so many intervals only.
    """
    starts = np.random.default_rng(0).normal(size=(8, funnel.num_states))
    starts /= np.linalg.norm(starts, axis=1, keepdims=True)
    return max(
        float(
            Between(funnel.nominal, share, every)
            .growth(funnel.S, funnel.slopes, funnel.beta, funnel.weights, starts)
            .max()
        )
        for share in SHARES
    )
