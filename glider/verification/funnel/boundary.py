"""V̇ on the boundary of a funnel's sets, as forms: in doubles or exactly.

With V = eᵀ S e and the Taylor polynomials P₁ to P₃ of the rates,
    V̇ = eᵀ Ṡ e + 2 eᵀ S (P + R + G q),
where R is within its bound and the pushes q are within theirs. What is written here
once holds for values in doubles, by which a funnel is made, and for exact polynomials
in time, by which it is proven.
"""

import dataclasses
import functools
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import numpy as np
from scipy.interpolate import PPoly

from glider.verification.dynamics.nominal import (
    Nominal,
    hermite_path,
    nonlinear_parts,
    table_of,
)
from glider.verification.funnel.settings import FunnelSettings
from glider.verification.sos.exact import Exact, Sampled
from glider.verification.sos.forms import (
    contracted,
    gathered,
    product_form,
    substituted,
    to_ball,
)


@dataclasses.dataclass(frozen=True, kw_only=True)
class BoundarySets:
    """The sets {x₀ + e: eᵀ S e <= 1} along a flight, and what acts on them.

    The names of the arrays are keys in a funnel's file.
    """

    nominal: Nominal  #: Flight x₀, and the feedback that keeps the glider inside.
    settings: FunnelSettings  #: Settings that it was made with.
    S: np.ndarray  #: Matrices S (T, n, n), between the times cubic Hermite polynomials.
    slopes: np.ndarray  #: Slopes Ṡ (T, n, n) [1/s].
    beta: np.ndarray  #: Bounds β (T, n) of the Taylor remainder [m/s², rad/s²].
    weights: np.ndarray  #: Weights λ (T, n) of `glider.verification.funnel.remainder`.
    focus: np.ndarray  #: F (T, n, n) of |R_k| <= β_k (1 + eᵀ F e), where R is large.
    push_weights: np.ndarray  #: λ (T, 2) of the command's error and of the wind.
    errors: np.ndarray  #: Largest error of the command u₀ - K e (T,) [rad/s].
    rests: np.ndarray  #: Of it, what is not eᵀ M e (T,) [rad/s].

    @functools.cached_property
    def curve(self) -> PPoly:
        """S as a function of time."""
        return hermite_path(self.nominal.times, self.S, self.slopes)

    @property
    def pushes(self) -> np.ndarray:
        """Bounds (T, 2) of the command's error [rad/s] and of the wind [m/s]."""
        return pushes_of(self.errors, self.settings)

    @property
    def unknown_pushes(self) -> np.ndarray:
        """The same without the command's error that is known, eᵀ M e."""
        return pushes_of(self.rests, self.settings)


BOUNDS = ("beta", "weights", "focus", "push_weights", "errors", "rests")
"""Names of the arrays that are straight lines between the times."""


def pushes_of(errors: np.ndarray, settings: FunnelSettings) -> np.ndarray:
    """Returns bounds (K, 2) of the command's error, (K,), and of the wind."""
    return np.stack([errors, settings.wind + 0.0 * errors], axis=1)


PUSHES = [0, 1, 1]
"""Which bound each push has: the command's error, and the wind along x and z."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Rates:
    """Taylor polynomials of the rates, at some times or as polynomials in time."""

    rows: list[int]  #: Indices (r,) of the rates that are not linear.
    which: list[int]  #: Indices (m,) of the variables (e, δu) that these depend on.
    outputs: Exact  #: C (n + 1, n): (e, δu) = C e.
    linear: Exact  #: Jacobian of the rates (n, n + 1), P₁.
    quadratic: Exact  #: Coefficients (r, C₂) of P₂, in the variables that count.
    cubic: Exact  #: Coefficients (r, C₃) of P₃.
    push_slopes: Exact  #: G (n, 3, 1 + n) of pushes, in (1, e).
    bends: Exact  #: M (n, n) of the command's known error eᵀ M e.

    def higher(self, basis: Exact, *pulls: Exact) -> Iterator[Exact]:
        """Yields P₂ᵀ p, then P₃ᵀ p, as forms in z, for e = basis z.

        Each pull p is (n,), or (n, n) z.
        """
        own = (self.outputs @ basis)[self.which]
        for degree, rates in enumerate((self.quadratic, self.cubic), 2):
            moved = substituted(rates, degree, own)
            for pull in pulls:
                form = contracted(moved, pull[self.rows], axis=0)
                is_constant = pull.numbers.ndim == 2
                yield form if is_constant else gathered(form, len(pull), degree)


@dataclasses.dataclass(frozen=True, kw_only=True)
class Terms(Rates):
    """What V̇ consists of, at some times or as polynomials in time."""

    step: Exact  #: Duration h that rises are for [s].
    S: Exact  #: S (n, n), cubic.
    rise: Exact  #: H Ṡ (n, n), quadratic.
    weights: Exact  #: λ (n,).
    bearing: Exact  #: β² / λ (n,).
    focus: Exact  #: F (n, n).
    push_weights: Exact  #: λ (2,) of these.
    push_bearing: Exact  #: κ² / λ and w² / λ (2,).


class Arithmetic(NamedTuple):
    """How numbers at T times become terms."""

    line: Callable[[np.ndarray], Exact]  #: Of what is a straight line in between.
    #: Of S and Ṡ, with the step: S and H Ṡ.
    hermite: Callable[[np.ndarray, np.ndarray, Exact], tuple[Exact, Exact]]
    #: β² / λ of bounds and weights; ValueError where λ is not positive and β is.
    bearing: Callable[[np.ndarray, np.ndarray], Exact]


def rates_of(
    nominal: Nominal, line: Callable, at: np.ndarray | slice = slice(None)
) -> dict[str, Any]:
    """Returns the fields of the rates at some times of a flight."""
    n = nominal.states.shape[1]
    which, rows = nonlinear_parts(nominal.model)
    gains = nominal.gains[at, None]
    steady = np.broadcast_to(np.eye(n), (len(gains), n, n))
    table = table_of(n + 1)
    own = table.without(np.setdiff1d(np.arange(n + 1), which))
    rates = nominal.open_loop[at]
    second, third = (
        line(rates[:, rows][..., own & (table.degrees == degree)]) for degree in (2, 3)
    )
    return {
        "rows": rows,
        "which": which,
        "outputs": line(np.concatenate([steady, -gains], axis=1)),
        "linear": line(rates[..., table.of_degree(1)]),
        "quadratic": second,
        "cubic": third,
        "push_slopes": line(nominal.push_slopes[at]),
        "bends": line(nominal.bends[at]),
    }


def terms_of(sets: BoundarySets, step: Exact, by: Arithmetic) -> dict[str, Any]:
    """Returns the fields of the terms of some sets, for a step [s]."""
    rates = rates_of(sets.nominal, by.line)
    seen = np.isin(np.arange(sets.S.shape[1]), rates["which"])  # By R.
    S, rise = by.hermite(sets.S, sets.slopes, step)
    return rates | {
        "step": step,
        "S": S,
        "rise": rise,
        "weights": by.line(sets.weights),
        "bearing": by.bearing(sets.beta, sets.weights),
        "focus": by.line(np.where(np.outer(seen, seen), sets.focus, 0.0)),
        "push_weights": by.line(sets.push_weights),
        "push_bearing": by.bearing(sets.unknown_pushes, sets.push_weights),
    }


def _sampled_bearing(bounds, weights):
    ratio = np.zeros_like(bounds)
    return Sampled(np.divide(bounds**2, weights, out=ratio, where=weights > 0.0))


_SAMPLED = Arithmetic(
    line=Sampled,
    hermite=lambda values, slopes, step: (Sampled(values), Sampled(slopes)),
    bearing=_sampled_bearing,
)


class _GrowthForms(NamedTuple):
    """The forms that make up h (V̇ + slack V), see `growth_forms`."""

    A: Exact  #: (n, n).
    cubic: Exact  #: c₃ (C₃,).
    quartic: Exact  #: c₄ (C₄,).
    G: Exact  #: (n, n).


def growth_forms(terms: Terms, basis: Exact, slack: Exact) -> _GrowthForms:
    """Returns the forms that make up h (V̇ + slack V) on V = 1, for a basis B (n, n).

    With e = B z and V = zᵀ G z,
        -h (V̇ + slack V) >= zᵀ A z + c₃(z) + c₄(z).
    2 eᵀ S G w <= λ |Gᵀ S e|² + w² / λ of both axes of the wind: half of w² each.
    Gᵀ S e = pᵀ z + zᵀ M z, so that its square is a quartic. The command is off by
    eᵀ M e too, of either sign, M the bends.
    """
    h = terms.step
    H = basis.T @ terms.S
    G = H @ basis
    y = terms.outputs @ basis
    half = H @ (terms.linear @ y)
    disturbance = (H * terms.weights) @ H.T
    disturbance = disturbance + terms.bearing.sum() * G
    steady = terms.push_slopes[:, :, 0]
    pushed = H @ steady
    push = (pushed * terms.push_weights[PUSHES]) @ pushed.T
    push = push + terms.push_bearing.sum() * G
    growth = half + half.T + disturbance + push + slack * G
    rise = basis.T @ terms.rise @ basis
    A = -(rise + h * growth)

    cubic, quartic = terms.higher(basis, h * H.T)
    cubic = cubic * -2
    quartic = quartic * -2
    focus = basis.T @ terms.focus @ basis
    if focus.numbers.any():
        quartic = quartic - h * product_form(disturbance, focus)
    for k, bound in enumerate(PUSHES):
        slopes = terms.push_slopes[:, k, 1:]
        along = pushed[:, k]
        varying = basis.T @ slopes.T @ H.T
        if terms.push_bearing[bound].numbers.any():
            weight = h * terms.push_weights[bound]
            cubic = cubic - weight * product_form(along, varying) * 2
            quartic = quartic - weight * product_form(varying, varying)
        if k == 0 and terms.bends.numbers.any():
            known = basis.T @ terms.bends @ basis * 2
            cubic = cubic - h * product_form(along, known)
            quartic = quartic - h * product_form(varying, known)
    return _GrowthForms(A, cubic, quartic, G)


def command_forms(
    rates: Rates, B: Exact, K: Exact, M: Exact, known: Exact
) -> tuple[Exact, Exact, Exact, Exact]:
    """Returns (K - 2 eᵀ M)(P + G eᵀ M e), its parts of degree 1 to 4 in z, e = B z.

    K is (n,), M is Bᵀ M (n, n), and known is Bᵀ M B of the straight line.
    """
    push = rates.push_slopes[:, 0]
    steady = push[:, 0]
    varying = push[:, 1:] @ B
    field = rates.linear @ rates.outputs @ B
    square, bent_square, cube, bent_cube = rates.higher(B, K, M.T)
    bent_square = bent_square + product_form(M @ steady, known)
    second = gathered(known * (K @ steady) - M @ field * 2, len(K))
    third = cube + product_form(K @ varying, known) - bent_square * 2
    fourth = bent_cube + product_form(M @ varying, known)
    return K @ field, square + second, third, fourth * 2


def pull_forms(
    slopes: Exact, B: Exact, K: Exact, M: Exact
) -> tuple[Exact, Exact, Exact]:
    """Returns (K - 2 eᵀ M) G, its parts of degree 0 to 2 in z, e = B z.

    G is of slopes (n, 1 + n) in (1, e), M is Bᵀ M. The third has the sign turned.
    """
    steady = slopes[:, 0]
    varying = slopes[:, 1:] @ B
    return K @ steady, K @ varying - M @ steady * 2, M @ varying * 2


class BoundaryForms(NamedTuple):
    """V̇/V = zᵀ N z + c₃(z) + c₄(z) on the boundary |z| = 1, at each of T times."""

    quadratic: np.ndarray  #: Matrices N (T, n, n) [1/s].
    cubic: np.ndarray  #: Coefficients of c₃ (T, C₃) [1/s].
    quartic: np.ndarray  #: Coefficients of c₄ (T, C₄) [1/s].


def boundary_forms(sets: BoundarySets, G: np.ndarray) -> BoundaryForms:
    """Returns V̇/V on the boundaries, with slopes G (T, n, 3, 1 + n) of pushes."""
    own = terms_of(sets, Sampled([1.0]), _SAMPLED) | {"push_slopes": Sampled(G)}
    basis = Sampled(to_ball(sets.S)[1])
    forms = growth_forms(Terms(**own), basis, Sampled([0.0]))
    return BoundaryForms(*(-form.numbers for form in forms[:3]))
