"""A funnel between two of its times, as polynomials in time without rounding.

With τ from 0 to 1 along the interval and h its duration: S is cubic, and so is x₀; u₀,
the gains K, the weights λ and β² / λ, and the open loop's Taylor polynomials P in
(e, δu) are straight lines. The deviation of the command is δu = -K e.

Of its sets it is determined exactly whether they are ellipsoids, within the servo's
limits, and within a ball.
"""

import dataclasses
from fractions import Fraction
from typing import Any

import numpy as np

from glider.physics.servo import STOPPING_TIME
from glider.physics.state import ELEVATOR
from glider.verification.dynamics.nominal import nonlinear_parts, table_of
from glider.verification.funnel.funnel import Funnel
from glider.verification.proof.interval_gliders import servo_reach
from glider.verification.sos.exact import (
    Exact,
    InTime,
    at_least,
    exact,
    hermite,
    is_positive_definite,
    line,
)


@dataclasses.dataclass(frozen=True, kw_only=True)
class Interval:
    """An interval of a funnel, or a part of one; halving it changes no polynomial.

    Attributes:
        step: duration h of the funnel's own interval [s].
        rows: indices (r,) of the rates that are not linear.
        which: indices (m,) of the variables (e, δu) that these depend on.
        S: S (n, n), cubic.
        rise: h Ṡ (n, n), quadratic.
        outputs: C (n + 1, n): (e, δu) = C e.
        linear: jacobian of the rates (n, n + 1), P₁.
        quadratic: coefficients (r, C₂) of P₂, in the variables that count.
        cubic: coefficients (r, C₃) of P₃.
        weights: λ (n,).
        bearing: β² / λ (n,), rounded up.
        limits: the servo's limits, a (n,) and b (): it follows its command where aᵀ e <
            b.
    """

    step: Exact
    rows: list[int]
    which: list[int]
    S: InTime
    rise: InTime
    outputs: InTime
    linear: InTime
    quadratic: InTime
    cubic: InTime
    weights: InTime
    bearing: InTime
    limits: tuple[tuple[InTime, InTime], ...]

    def halves(self) -> tuple["Interval", "Interval"]:
        """Returns the first half and the second."""
        fixed = ("step", "rows", "which", "limits")
        names = [f.name for f in dataclasses.fields(self) if f.name not in fixed]
        parts = {name: getattr(self, name).halves() for name in names}
        limits = [(a.halves(), b.halves()) for a, b in self.limits]

        def side(which: int) -> Interval:
            changes: dict[str, Any] = {name: p[which] for name, p in parts.items()}
            changes["limits"] = tuple((a[which], b[which]) for a, b in limits)
            return dataclasses.replace(self, **changes)

        return side(0), side(1)


def make_interval(piece: Funnel) -> Interval:
    """Returns the polynomials of a funnel of two times; λ > 0 where β is."""
    nominal, n = piece.nominal, piece.num_states
    which, rows = nonlinear_parts(nominal.model)
    first, last = map(exact, nominal.times)
    step = last - first
    S, rise = hermite(piece.S, piece.slopes, step)
    rates, table = nominal.open_loop, table_of(n + 1)
    own = table.without(np.setdiff1d(np.arange(n + 1), which))

    def part(degree):
        return line(*rates[:, rows][..., own & (table.degrees == degree)])

    command, gains = line(*nominal.inputs), line(*nominal.gains)
    angle, _ = hermite(nominal.states[:, ELEVATOR], nominal.slopes[:, ELEVATOR], step)
    limits = _limits(nominal, command, gains, angle)
    return Interval(
        step=step,
        rows=rows,
        which=which,
        S=S,
        rise=rise,
        outputs=line(*(np.vstack([np.eye(n), -K]) for K in nominal.gains)),
        linear=line(*rates[..., table.of_degree(1)]),
        quadratic=part(2),
        cubic=part(3),
        weights=line(*piece.weights),
        bearing=InTime(tuple(map(_bearing, piece.beta, piece.weights))),
        # The centers of a set of gliders may reach some of b.
        limits=tuple((a, b - exact(servo_reach(piece, a, step))) for a, b in limits),
    )


def _bearing(beta, weights):
    """Returns β² / λ (n,), rounded up; zero where β is."""
    parts = [
        at_least(Fraction(b) ** 2 / Fraction(w)) if b > 0.0 else exact(0.0)
        for b, w in zip(beta, weights, strict=True)
    ]
    low = min(part.exponent for part in parts)
    return Exact([part.at(low) for part in parts], low)


def at_time(funnel: Funnel, k: int) -> Interval:
    """Returns the polynomials of a funnel at one of its times: none changes in time.

    They are of the closed loop, so that which and rows are of e alone, and h is 1 s.
    """
    nominal, n = funnel.nominal, funnel.num_states
    rates, table = nominal.closed_loop[k], table_of(n)

    def constant(values):
        return InTime((exact(values),))

    rows = np.flatnonzero(rates[:, table.degrees > 1].any(axis=1)).tolist()
    command, gains = constant(nominal.inputs[k]), constant(nominal.gains[k])
    return Interval(
        step=exact(1.0),
        rows=rows,
        which=list(range(n)),
        S=constant(funnel.S[k]),
        rise=constant(funnel.slopes[k]),
        outputs=constant(np.eye(n)),
        linear=constant(rates[:, table.of_degree(1)]),
        quadratic=constant(rates[rows, table.of_degree(2)]),
        cubic=constant(rates[rows, table.of_degree(3)]),
        weights=constant(funnel.weights[k]),
        bearing=InTime((_bearing(funnel.beta[k], funnel.weights[k]),)),
        limits=_limits(nominal, command, gains, constant(nominal.states[k, ELEVATOR])),
    )


def _limits(nominal, command, gains, angle):
    """Returns a and b, of either way of the rate limit and of both stops."""
    servo = nominal.model.parameters.servo
    low, high, rate, ahead_by = map(exact, [*servo, STOPPING_TIME])
    ahead = angle + ahead_by * command
    travel = exact(np.eye(len(nominal.states[0]))[ELEVATOR]) - ahead_by * gains
    return (
        (-gains, rate - command),
        (gains, rate + command),
        (travel, high - ahead),
        (-travel, ahead - low),
    )


HALVINGS = 3
"""Times that an interval is halved where a form is not seen to be definite."""

COVER_ROOM = 1e-4
"""Share by which a ball is larger than it need be, for what was not sampled."""

FLOOR = 0.05
"""Share of each variable's spread that is added to the sets before they are covered:
where they are flatter they may be covered loosely, but that must not tilt the ball."""

COVER_SAMPLES = 9
"""Times of an interval that the ball is made for."""


def stays_definite(matrix: InTime, halvings: int = HALVINGS) -> bool:
    """Returns whether a symmetric matrix is positive definite throughout, for sure."""
    if all(map(is_positive_definite, matrix.parts)):
        return True
    if not (halvings and is_positive_definite(matrix.parts[0])):
        return False
    return all(stays_definite(half, halvings - 1) for half in matrix.halves())


def keeps_servo(interval: Interval) -> bool:
    """Returns whether the sets keep the servo within its limits, for sure.

    aᵀ e < b on the ellipsoid where b > 0 and b² S - a aᵀ is positive definite.
    """
    for a, b in interval.limits:
        left = b * b * interval.S - a[:, None] @ a[None]
        if not (stays_definite(b[None, None]) and stays_definite(left)):
            return False
    return True


def covers(interval: Interval, basis: np.ndarray) -> bool:
    """Returns whether all y of the sets are basis w with |w| <= 1, for sure.

    This holds if C S⁻¹ Cᵀ < basis basisᵀ, that is, if the matrix
        S   Cᵀ
        C   basis basisᵀ
    is positive definite.
    """
    B, degree = exact(basis), interval.S.degree
    blocks = interval.S, interval.outputs[interval.which], InTime((B @ B.T,))
    parts = zip(*(block.raised(degree).parts for block in blocks), strict=True)
    return stays_definite(InTime(tuple(_joined(*part) for part in parts)))


def tight_cover(interval: Interval) -> tuple[np.ndarray, float]:
    """Returns a basis whose ball should cover the sets tightly, and its stretch.

    That is how much wider it is than the set in the middle, along some axis.
    """
    shadows = []
    for k in range(COVER_SAMPLES):
        share = Fraction(k, COVER_SAMPLES - 1)
        S = interval.S.at(share).to_float()
        C = interval.outputs.at(share).to_float()[interval.which]
        shadows.append(C @ np.linalg.solve(S, C.T))
    middle = np.diagonal(shadows[COVER_SAMPLES // 2])
    turned = np.array(shadows) + FLOOR**2 * np.diag(middle)
    # The least that holds two ellipsoids, nearly: their mean and half their difference.
    L = np.linalg.cholesky(0.5 * (turned[0] + turned[-1]))
    L_inv = np.linalg.inv(L)
    turned = L_inv @ turned @ L_inv.T
    values, vectors = np.linalg.eigh(0.5 * (turned[-1] - turned[0]))
    cover = np.eye(len(L)) + (vectors * np.abs(values)) @ vectors.T
    more = max(np.linalg.eigvalsh(one - cover)[-1] for one in turned)
    values, vectors = np.linalg.eigh(cover)
    wider = np.sqrt(values + max(more, 0.0) + COVER_ROOM)
    basis = L @ (vectors * wider) @ vectors.T
    return basis, float(np.sqrt(np.max(np.sum(basis**2, axis=1) / middle)))


def _joined(S, C, ball):
    low = min(S.exponent, C.exponent, ball.exponent)
    rows = [[S.at(low), C.at(low).T], [C.at(low), ball.at(low)]]
    return Exact(np.block(rows), low)
