"""The part of a funnel's check that is in exact arithmetic.

At each time that is checked:
1. S is positive definite, and the set keeps the servo within its limits;
2. V̇ <= -slack V on the whole boundary V = 1, for the third-order dynamics whose
   coefficients are the doubles that `Nominal.closed_loop` computes from the glider in
   the file, with any disturbance |R_k| <= β_k, and with the nominal's largest defect in
   the intervals about that time: minus V̇ - slack V has a positive definite Gram matrix.
At the end the set lies in the goal. `glider.verification.proof` states what rests on
more than exact arithmetic.
"""

from collections.abc import Callable, Sequence
from fractions import Fraction

import numpy as np

from glider.verification.dynamics.nominal import table_of
from glider.verification.funnel.funnel import Funnel
from glider.verification.funnel.servo_limits import servo_bounds
from glider.verification.sos.exact import (
    Exact,
    at_least,
    dyadic,
    exact,
    fractions,
    is_positive_definite,
    leaves_definite,
    rounded,
)
from glider.verification.sos.forms import (
    gram_polynomial,
    odd_then_even,
    quadratic_product,
    sparse_gram,
    substituted,
    to_ball,
)
from glider.verification.sos.sphere import represent, sphere

SLACK_SHARE = 0.1
"""Share of the margin of V̇/V that is proven; what is left of it is for rounding."""

GRAM_BITS = 26
"""Binary places that Gram matrices are rounded to: 1.5e-8, where their least
eigenvalues are 1e-3 and more."""

BALL_BITS = 30
"""Binary places of the coordinates of the ball. Any are right; few are fast."""

GOAL_ROUNDING = 1e-9
"""Relative amount by which S(T) may be below the goal's: where they are equal, as in
the shipped funnels, their difference is not definite."""


def proven_slack(funnel: Funnel) -> float:
    """Returns the slack of V̇ <= -slack V that is to be proven [1/s]."""
    return SLACK_SHARE * funnel.settings.margin


def exact_faults(
    funnel: Funnel,
    at: Sequence[int],
    defect: np.ndarray,
    progress: Callable[[float], None] | None = None,
) -> tuple[list[str], float]:
    """Checks a funnel in exact arithmetic.

    Args:
        at: indices of the times.
        defect: growth (T,) by the nominal's defect, `defect_growth`, finite [1/s].
        progress: called with the share that is done.

    Returns:
        what is wrong, a sentence each, and the largest change of an eigenvalue by what
        rounding left over.
    """
    nominal = funnel.nominal
    coefficients = nominal.closed_loop
    directions, bounds = servo_bounds(nominal, shrink=1.0, number=fractions)
    slack = proven_slack(funnel)
    found: dict[str, list[float]] = {}
    rounding = 0.0
    for number, k in enumerate(at):
        faults, change = [], 0.0
        if not np.all(np.isfinite(coefficients[k])):
            faults = ["The glider's dynamics have no Taylor polynomial"]
        elif not is_positive_definite(exact(funnel.S[k])):
            faults = ["The set is not an ellipsoid"]
        else:
            if not _keeps_bounds(funnel.S[k], directions[k], bounds[k]):
                faults = ["The servo would meet its limits"]
            holds, change = check_time(funnel, coefficients[k], k, slack + defect[k])
            faults += [] if holds else ["The Gram matrix does not prove that V falls"]
        rounding = max(rounding, change)
        for fault in faults:
            found.setdefault(fault, []).append(nominal.times[k])
        if progress:
            progress((number + 1) / len(at))
    sentences = [f"{fault} {_when(times)}." for fault, times in found.items()]
    if not _within_goal(funnel):
        sentences.append("The last set is not within the goal.")
    return sentences, rounding


def _when(times):
    """Returns words for some times [s]."""
    if len(times) == 1:
        return f"at {times[0]:.4f} s"
    return f"at {len(times)} times, from {times[0]:.4f} to {times[-1]:.4f} s"


def check_time(
    funnel: Funnel, coefficients: np.ndarray, k: int, slack: float
) -> tuple[bool, float]:
    """Returns whether V̇ <= -slack V is proven at one time, and what rounding took.

    Numbers too large or sets too flat for the floating point that proposes a Gram
    matrix prove nothing.

    Args:
        coefficients: (n, M) of `Nominal.closed_loop` at that time.
    """
    S, slope = funnel.S[k], funnel.slopes[k]
    beta, weights = funnel.beta[k], funnel.weights[k]
    if np.any(beta < 0.0) or np.any(weights < 0.0):
        return False, 0.0
    if np.any((beta > 0.0) & (weights == 0.0)):
        return False, 0.0
    tables = sphere(len(S))
    try:
        polynomial, metric = growth_polynomial(
            exact(S),
            exact(slope),
            coefficients,
            rounded(to_ball(S)[1], BALL_BITS),
            beta,
            weights,
            exact(slack),
        )
        # In floating point: a Gram matrix of nearly this polynomial. The one in the
        # file may or may not have the nominal's defect in it.
        doubles = polynomial.to_float()
        entries = funnel.grams[k].astype(float)
        entries = entries - 0.5 * slack * tables.entries(np.eye(tables.size))
        gram = tables.matrix(represent(tables, entries, doubles))
        gram = gram * np.multiply.outer(tables.scales, tables.scales)
        whole = rounded(gram, GRAM_BITS)
    except (np.linalg.LinAlgError, OverflowError, ValueError):
        return False, 0.0
    left_over = polynomial - gram_polynomial(tables, whole, metric)
    return leaves_definite(whole, sparse_gram(tables, left_over))


def growth_polynomial(
    S: Exact,
    slope: Exact,
    coefficients: np.ndarray,
    L_inv_T: Exact,
    beta: np.ndarray,
    weights: np.ndarray,
    slack: Exact,
) -> tuple[Exact, Exact]:
    """Returns minus V̇ - slack V on the boundary, and zᵀ G z = V.

    Both are in the coordinates e = L_inv_T z. That is an exact change of variables for
    any L_inv_T; it is near L⁻ᵀ, so that G is near the identity.

    Args:
        S: (n, n).
        slope: (n, n) Ṡ.
        coefficients: (n, M) of `Nominal.closed_loop`.
        L_inv_T: (n, n).
        beta: (n,) bounds of the remainder.
        weights: (n,) λ, positive where beta is.

    Returns:
        coefficients (C,), odd then even, and G (n, n).
    """
    table = table_of(len(coefficients))
    F1, F2, F3 = (exact(coefficients[:, table.of_degree(d)]) for d in (1, 2, 3))
    L_inv = L_inv_T.T
    L_T = L_inv @ S
    metric = L_T @ L_inv_T
    product = L_T @ F1 @ L_inv_T
    quadratic = L_inv @ slope @ L_inv_T + product + product.T
    for k, (b, w) in enumerate(zip(beta, weights, strict=True)):
        if w > 0.0:
            across = L_T[:, k : k + 1] @ L_T[:, k : k + 1].T
            quadratic = quadratic + across * exact(w)
            ball = at_least(Fraction(b) ** 2 / Fraction(w))
            quadratic = quadratic + metric * ball
    quadratic = quadratic + metric * slack
    cubic = substituted(L_T @ F2, L_inv_T, 2)
    quartic = substituted(L_T @ F3, L_inv_T, 3) + quadratic_product(quadratic, metric)
    return -odd_then_even(cubic, quartic), metric


def _keeps_bounds(S, directions, bounds):
    """Returns whether aᵀ S⁻¹ a < b² for each limit, b² S - a aᵀ positive definite."""
    for a, bound in zip(directions, bounds, strict=True):
        if not bound > 0:
            return False
        across = dyadic(np.multiply.outer(a, a))
        if not is_positive_definite(exact(S) * dyadic(bound**2) - across):
            return False
    return True


def _within_goal(funnel):
    """Returns whether S(T) is at least the goal's, but for GOAL_ROUNDING."""
    axes = funnel.settings.goal_axes(funnel.num_states)
    goal = exact(np.diag(1.0 / axes**2) * (1.0 - GOAL_ROUNDING))
    return is_positive_definite(exact(funnel.S[-1]) - goal)
