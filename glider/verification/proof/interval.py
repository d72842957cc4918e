"""A funnel between two of its times, as polynomials in time without rounding.

With τ from 0 to 1 along the interval and h its duration: S is cubic, and so is x₀; u₀,
the gains K, the weights λ and β² / λ, the focus F, the slopes G of pushes and the open
loop's Taylor polynomials P in (e, δu) are straight lines. The deviation of the command
is δu = -K e.

Of its sets it is determined exactly whether they are ellipsoids, within the servo's
limits, and within a ball.

Of a set of gliders, δ = A v with |v| <= 1. The center
is x₀ + X A v, X the cubic Hermite polynomial between the times, and the command there
differs by U A v, U = -K X unless it is held; their time is s from -1 to 1.
"""

import dataclasses
from fractions import Fraction

import numpy as np

from glider.compiled.taylor import ROUNDING, WIDER
from glider.physics.confidence import ConfidenceSet
from glider.physics.servo import STOPPING_TIME
from glider.verification.dynamics.nominal import (
    hermite_powers,
    line_powers,
    nonlinear_parts,
    rate_dependences,
)
from glider.verification.funnel.boundary import Arithmetic, Terms, terms_of
from glider.verification.funnel.funnel import Funnel
from glider.verification.sos.exact import (
    Exact,
    at_least,
    exact,
    hermite,
    in_time,
    is_positive_definite,
    joined,
    line,
)


@dataclasses.dataclass(frozen=True, kw_only=True)
class Interval(Terms):
    """An interval of a funnel, or a part of one; halving it changes no polynomial."""

    #: The servo's limits, a (n,) and b (): it follows its command where aᵀ e < b.
    limits: tuple[tuple[Exact, Exact], ...]
    span: tuple[float, float] = (-1.0, 1.0)  #: First and last s of this part.

    def halves(self) -> tuple["Interval", ...]:
        """Returns the first half and the second."""

        def half(value, side):
            if isinstance(value, tuple):
                return tuple(half(part, side) for part in value)
            return value.halves()[side] if isinstance(value, Exact) else value

        first = self.span[0]
        middle = 0.5 * sum(self.span)
        last = self.span[1]
        return tuple(
            Interval(**{k: half(v, side) for k, v in vars(self).items()} | {"span": of})
            for side, of in enumerate([(first, middle), (middle, last)])
        )


def make_interval(piece: Funnel) -> Interval:
    """Returns the polynomials of a funnel of two times; λ > 0 where β is.

    Raises:
        ValueError: a number is not finite, or λ is not positive where β is.
    """
    first, last = map(exact, piece.nominal.times)
    step = last - first
    terms = terms_of(piece, step, Arithmetic(line, hermite, _bearings))
    return Interval(**terms, limits=_limits(piece, step))


def _bearings(bounds, weights):
    """Returns the straight line between β² / λ at both ends, each rounded up."""
    return in_time(*map(_bearing, bounds, weights))


def _bearing(beta, weights):
    """Returns β² / λ (n,), rounded up; zero where β is.

    Raises:
        ValueError: λ is not positive where β is, or one of them is negative.
    """
    weighed = (beta > 0.0) & (weights > 0.0)
    if not np.all(np.where(beta == 0.0, weights >= 0.0, weighed)):
        raise ValueError("a weight is zero")
    parts = [
        at_least(Fraction(b) ** 2 / Fraction(w)) if b > 0.0 else exact(0.0)
        for b, w in zip(beta, weights, strict=True)
    ]
    return joined(*(part[None] for part in parts), axis=1)


def _limits(piece, step):
    """Returns a and b, of either way of the rate limit and of both stops.

    The command may be off by its error, and centers reach some of b. The rate of one
    that is held is that of its sample (`glider.verification.proof.held`).
    """
    path, _ = hermite(piece.nominal.states, piece.nominal.slopes, step)
    reach = _centers_reach(piece, step)
    nominal = piece.nominal
    command, gains, error = map(line, (nominal.inputs, nominal.gains, piece.errors))
    servo = nominal.model.parameters.servo
    low, high, rate, ahead_by, of_rate, of_travel = map(
        exact, [*servo, STOPPING_TIME, *reach]
    )
    demanded = exact(nominal.demanded)
    left = rate - error - of_rate
    ahead = demanded @ path + ahead_by * command
    less = ahead_by * error + of_travel
    travel = demanded - ahead_by * gains
    rates = (-gains, left - command), (gains, left + command)
    stops = (travel, high - less - ahead), (-travel, ahead - (low + less))
    return stops if piece.settings.period else rates + stops


_HALVINGS = 3
"""Times that an interval is halved where a form is not seen to be definite."""

_COVER_ROOM = 1e-4
"""Share by which a ball is larger than it need be, for what was not sampled."""

_FLOOR = 0.05
"""Share of each variable's spread that is added to the sets before they are covered:
where they are flatter they may be covered loosely, but that must not tilt the ball."""

LEAST_SPREAD = 1e-4
"""Spread that each variable has at least: without feedback, the command has none."""

_COVER_SAMPLES = 9
"""Times of an interval that the ball is made for."""


def stays_definite(matrix: Exact, halvings: int = _HALVINGS) -> bool:
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
    B = exact(basis)
    C = interval.outputs[interval.which]
    rows = joined(interval.S, C.T, axis=2), joined(C, B @ B.T, axis=2)
    return stays_definite(joined(*rows, axis=1))


def tight_cover(interval: Interval) -> tuple[np.ndarray, float]:
    """Returns a basis whose ball should cover the sets tightly, and its stretch.

    That is how much wider it is than the set in the middle, along some axis.
    """
    shadows = []
    for k in range(_COVER_SAMPLES):
        share = Fraction(k, _COVER_SAMPLES - 1)
        S = interval.S.at(share).to_float()
        C = interval.outputs.at(share).to_float()[interval.which]
        shadows.append(C @ np.linalg.solve(S, C.T))
    middle = np.maximum(np.diagonal(shadows[_COVER_SAMPLES // 2]), LEAST_SPREAD**2)
    turned = np.array(shadows) + _FLOOR**2 * np.diag(middle)
    # The least that holds two ellipsoids, nearly: their mean and half their difference.
    L = np.linalg.cholesky(0.5 * (turned[0] + turned[-1]))
    L_inv = np.linalg.inv(L)
    turned = L_inv @ turned @ L_inv.T
    values, vectors = np.linalg.eigh(0.5 * (turned[-1] - turned[0]))
    cover = np.eye(len(L)) + (vectors * np.abs(values)) @ vectors.T
    more = max(np.linalg.eigvalsh(one - cover)[-1] for one in turned)
    values, vectors = np.linalg.eigh(cover)
    wider = np.sqrt(values + max(more, 0.0) + _COVER_ROOM)
    basis = L @ (vectors * wider) @ vectors.T
    return basis, float(np.sqrt(np.max(np.sum(basis**2, axis=1) / middle)))


def gliders_path(piece: Funnel) -> tuple[np.ndarray, np.ndarray]:
    """Returns where the gliders of a set fly, in powers of s, lowest first.

    That is X A of the states and U A of the command, (n + 1, r, 5), and Ẋ A
    (n, r, 3) [1/s]; r is 0 for one glider.
    """
    nominal = piece.nominal
    gliders = piece.gliders
    A = gliders.confidence.factor
    times = nominal.times
    path, slopes = hermite_powers(times, gliders.shifts @ A, gliders.slopes @ A)
    states = np.pad(path, ((0, 0), (0, 0), (0, 1)))
    if piece.settings.period:  # It is held.
        command = np.outer(gliders.commands[0] @ A, np.eye(5)[0])
    else:
        mean, change = line_powers(nominal.gains)
        command = -np.einsum("i,irk->rk", mean, states)
        command[:, 1:] -= np.einsum("i,irk->rk", change, states[..., :-1])
    return np.concatenate([states, command[None]]), slopes


def _centers_reach(piece: Funnel, step: Exact) -> tuple[float, float]:
    """Returns bounds of U δ, and of X δ of the elevator and τ U δ, over an interval."""
    gliders = piece.gliders
    X, _ = hermite(gliders.shifts, gliders.slopes, step)
    is_held = piece.settings.period > 0.0
    U = exact(gliders.commands[0]) if is_held else line(-piece.nominal.gains) @ X
    travel = exact(piece.nominal.demanded) @ X + exact(STOPPING_TIME) * U
    return exact_reach(piece.allowed, U), exact_reach(piece.allowed, travel)


def exact_reach(confidence: ConfidenceSet, along: Exact) -> float:
    """Returns a bound of aᵀ δ over a set and all times, for a (m,), rounded up."""
    sizes = np.abs((along @ exact(confidence.factor)).bernstein()).max(axis=0)
    return float(np.linalg.norm(sizes) * WIDER)


def gliders_defect(piece: Funnel) -> np.ndarray:
    """Returns bounds δ (n,) of what X δ lacks to be a flight, in the rates.

    It is zero for the rates that are not linear, which have it in R.
    """
    n = piece.num_states
    inputs, slopes = gliders_path(piece)
    _, rows = nonlinear_parts(piece.nominal.model)
    jacobian = piece.nominal.open_loop[0][:, 1 : n + 2]
    wanted = np.einsum("ij,jrk->irk", jacobian, inputs)
    wanted[..., :3] -= slopes
    sizes = np.einsum("ij,jrk->ir", np.abs(jacobian), np.abs(inputs))
    sizes += np.abs(slopes).sum(axis=2)
    found = np.abs(wanted).sum(axis=(1, 2)) + ROUNDING * sizes.sum(axis=1)
    found[rows] = 0.0
    return found * WIDER


def acts_elsewhere(piece: Funnel) -> str:
    """Returns what acts where R does not account for it, a clause; empty for nothing.

    That is in an otherwise linear rate, or on a state that R does not depend on.
    """
    model = piece.nominal.model
    n = piece.num_states
    which, rows = nonlinear_parts(model)
    is_windy = piece.settings.wind > 0.0
    for fault, names, in_wind in (
        ("the wind acts where the remainder leaves it out", (), is_windy),
        ("a linear rate depends on a number that deviates", piece.allowed.names, False),
    ):
        depends, bent = rate_dependences(model, names, in_wind)
        elsewhere = np.setdiff1d(np.arange(n + 1), which)
        linear = np.delete(depends, rows, axis=0)
        if bent[:, elsewhere].any() or linear[:, n + 1 :].any():
            return fault
    return ""
