"""An enclosure of the Taylor remainder R over an interval of time, on boxes.

The rates that are not linear depend on some of the deviations e and of the command's,
which is -K e: y = C(τ) e, with C linear in τ from 0 to 1 along the interval. About the
nominal they have Taylor polynomials P in y, a straight line in time between those at
its ends, and
    R(τ, y) = f(x₀(τ) + y, u₀(τ) + y) - ẋ₀(τ) - P(τ, y):
what the degree, the straight line and the nominal's defect leave out. All y of the sets
are basis w with |w| <= 1, and boxes are of w and of time, s = 2 τ - 1. The basis is
turned so that R varies most along w₁, then along w₂, and so on.

For a set of gliders, δ = A v, y is the deviation from each one's own center:
    R(τ, y, δ) = f(x₀ + X δ + y, u₀ - K X δ + y; c₀ + δ) - ẋ₀ - Ẋ δ - P(τ, y),
and boxes are of w, v and s. What X A v has beyond the degree in (v, s) is bounded.

Pushes from outside, the command's error κ q₁, |q₁| <= 1, and the wind w (q₂, q₃),
|(q₂, q₃)| <= 1, act in f too. Their part G q, G a straight line in time and linear in
e, is not in R: V̇ has it as it is. Boxes are then of w, v, q and s; q has what is not
zero.
"""

import dataclasses
import functools
import itertools

import numpy as np

from glider.compiled.taylor import ROUNDING, WIDER
from glider.physics.confidence import ConfidenceSet, theta_at
from glider.physics.model import GliderModel
from glider.verification.dynamics.nominal import (
    ORDER,
    for_one_glider,
    hermite_powers,
    line_powers,
    nonlinear_parts,
    open_loop_rates,
    table_of,
)
from glider.verification.dynamics.numbers import monomials
from glider.verification.dynamics.taylor_models import Recording, spread
from glider.verification.funnel.boundary import PUSHES
from glider.verification.funnel.funnel import Funnel
from glider.verification.funnel.growth import DIFFERENCE
from glider.verification.proof.boxes import excess_in_balls, run_on_boxes, shifted_from
from glider.verification.proof.interval import gliders_path
from glider.verification.sos.forms import change_variables
from glider.verification.sos.sphere import normalized

_SAMPLES = 1000
"""Points on the sphere where R and its variation are sampled."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class TaylorRemainder:
    """R over the sets of an interval, ready to be enclosed on boxes of (w, s).

    Polynomials are in (w, v, q, s), by `numbers.monomials(m + r + p + 1, ORDER)`; there
    is no v for one glider alone, and no q where nothing pushes.
    """

    model: GliderModel  #: Glider whose rates they are.
    rows: list[int]  #: Indices (r,) of the rates that are not linear.
    basis: np.ndarray  #: Matrix (m, m) of y = basis w.
    #: Polynomials (n + 1, M) of the states x₀ + y, and of the command.
    inputs: np.ndarray
    #: Polynomials (r, M) of ẋ₀ + P + G q, without what is of degree ORDER + 1.
    polynomials: np.ndarray
    highest: np.ndarray  #: What these lack, divided by s: polynomials (r, M).
    rounding: np.ndarray  #: Bounds (r,) of what rounding leaves out of the two.
    #: Polynomials (r, M) of the bounds β (1 + yᵀ F y) that R has to keep.
    limits: np.ndarray
    span: tuple[float, float]  #: First and last s.
    allowed: ConfidenceSet  #: Set of the gliders that fly.
    beyond: np.ndarray  #: Bounds (n + 1,) of what the inputs lack of that.
    pushes: np.ndarray  #: Bounds (2,) of the command's error [rad/s], the wind [m/s].

    @property
    def dimension(self) -> int:
        """Number of the boxes' coordinates."""
        acting = len(_acting(self.pushes))
        return len(self.basis) + self.allowed.dimension + acting + 1

    @property
    def balls(self) -> tuple[slice, ...]:
        """Coordinates of w, of v and of the wind."""
        m = len(self.basis)
        found = [slice(0, len(self.basis))]
        if self.allowed.dimension:
            found.append(slice(m, m + self.allowed.dimension))
        if self.pushes[1] > 0.0:
            found.append(slice(self.dimension - 3, self.dimension - 1))
        return tuple(found)

    def bounds(
        self, center: np.ndarray, half: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Encloses |R| / β on boxes, center and half (d, B).

        Returns:
            bounds (r, B) on the parts of the boxes in the unit balls; what is surely
            reached in the balls, in the center or anywhere in boxes that touch them,
            (r, B); how much each coordinate is to blame for the bounds, (r, d, B).
        """
        table = monomials(self.dimension, ORDER)
        program, polynomials, lacks = self._program
        found, left = run_on_boxes(program, table, polynomials, lacks, center, half)
        rates, remainders, limits = np.split(found, 3)
        _, lost, lacking = np.split(left, 3)
        lost = (lost + lacking) * WIDER
        # |R| - β, of either sign; the bound adds the rounding of the difference.
        excess, blame = excess_in_balls(
            table, remainders, lost, limits, rates, center, half, self.balls
        )
        reach = spread(limits, lost)
        mean = limits[:, 0]
        high = mean + reach
        low = mean - reach
        inside = [np.sum(center[ball] ** 2, axis=0) <= 1.0 for ball in self.balls]
        within = np.all(inside, axis=0)
        surely = np.abs(remainders[:, 0])
        surely -= np.where(within, lost, spread(remainders, lost))
        # |R| / β <= 1 + (|R| - β) / β, with the worst β on the box.
        with np.errstate(divide="ignore", invalid="ignore"):
            above = WIDER + excess / np.maximum(low, 0.0)
            most = np.where(excess > 0.0, above, 1.0 + excess / high)
            return most, np.maximum(surely, 0.0) / high, blame / limits[:, :1]

    @functools.cached_property
    def _program(self):
        """What computes the rates, R and the limits on a box, for each row.

        Returned with the polynomials (I, M) that are its inputs and what these lack,
        (I,).
        """
        m = len(self.basis)
        d = self.dimension
        unit = np.eye(1 + d, self.inputs.shape[1])
        factor = self.allowed.factor
        deviations = factor @ unit[1 + m : 1 + m + factor.shape[1]]
        air = self.pushes[1] * unit[[d - 2, d - 1]]
        groups = [self.inputs, deviations, air, unit[[d]]]
        groups += [self.highest, self.polynomials, self.limits]
        lacks = [np.zeros(len(group)) for group in groups]
        lacks[0], lacks[-2] = self.beyond, self.rounding
        polynomials = np.concatenate(groups)
        program = _recorded(
            self.model,
            d,
            self.allowed.names,
            tuple(self.rows),
            bool(self.pushes[1] > 0.0),
            tuple(map(len, groups)),
            shifted_from(monomials(d, ORDER), polynomials).tobytes(),
        )
        return program, polynomials, np.concatenate(lacks)


@for_one_glider
def _recorded(model, d, names, rows, is_windy, sizes, present):
    """Returns what computes f, f - ẋ₀ - P and the limit of each row, in d variables.

    Inputs are groups of these sizes; present is of `Recording.program`, as bytes.
    """
    recording = Recording(monomials(d, ORDER))
    models = iter(recording.inputs(sum(sizes)))
    inputs, deviated, wind, (time,), highest, polynomials, limits = (
        list(itertools.islice(models, size)) for size in sizes
    )
    theta = theta_at(model, names, deviated)
    air = wind if is_windy else [0.0, 0.0]
    rates = open_loop_rates(model, inputs[:-1], inputs[-1], theta, air)
    rates = [rates[row] for row in rows]
    each = zip(rates, polynomials, highest, strict=True)
    remainders = [rate - known - time * top for rate, known, top in each]
    flat = np.frombuffer(present, dtype=bool)
    there = flat.reshape(-1, len(recording.table.degrees))
    return recording.program([*rates, *remainders, *limits], there)


def make_remainder(
    piece: Funnel, basis: np.ndarray, span: tuple[float, float] = (-1.0, 1.0)
) -> TaylorRemainder:
    """Prepares the enclosure of R on a part of a funnel of two times.

    Args:
        basis: (m, m): all y of the sets there are basis w with |w| <= 1.
        span: first and last s of the part.
    """
    nominal = piece.nominal
    n = piece.num_states
    which, rows = nonlinear_parts(nominal.model)
    m = len(which)
    moved, drift = gliders_path(piece)
    pushes = piece.pushes.max(axis=0)
    first_push = 1 + m + moved.shape[1]
    table = monomials(first_push + len(_acting(pushes)), ORDER)

    P = _taylor_part(nominal, which, rows)
    P_mean, P_change = line_powers(P)
    path, slopes = hermite_powers(nominal.times, nominal.states, nominal.slopes)
    command = line_powers(nominal.inputs)
    s = 0.5 * sum(span)
    middle = np.append(path @ s ** np.arange(ORDER + 1), command @ [1.0, s])
    basis = _turned(nominal.model, middle, P_mean + s * P_change, basis)

    path = np.vstack([path, np.pad(command, (0, ORDER - 1))])
    inputs = _along(table, m, path, moved[..., :ORDER])
    inputs[which, 1 : m + 1] = basis
    inputs[n, first_push] += pushes[0]  # Zero where q does not have it.
    polynomials, highest = _in_ball(table, basis, P_mean, P_change)
    polynomials += _along(table, m, slopes[rows], drift[rows])
    G = nominal.push_slopes[:, rows] * pushes[PUSHES, None]
    ends = line_powers(_turned_slopes(G, which, basis))
    for q, k in enumerate(_acting(pushes), first_push):
        for y in range(m + 1):
            _add(polynomials, table, [q, y], ends[:, :, k, y].T)

    sizes = change_variables(np.abs(P).max(axis=0), np.abs(basis)).sum(axis=1)
    spread = _turned_slopes(np.abs(G), which, np.abs(basis))
    sizes += 2.0 * spread.sum(axis=(0, 2, 3))
    beyond = np.abs(moved[..., ORDER:]).sum(axis=(1, 2))
    beyond += ROUNDING * np.abs(moved).sum(axis=(1, 2))
    return TaylorRemainder(
        model=nominal.model,
        rows=rows,
        basis=basis,
        inputs=inputs,
        polynomials=polynomials,
        highest=highest,
        rounding=2.0 * ROUNDING * WIDER * sizes,
        limits=_limits(piece, basis, table),
        span=span,
        allowed=piece.allowed,
        beyond=beyond * WIDER,
        pushes=pushes,
    )


def _taylor_part(nominal, which, rows):
    """Returns P (2, r, M) at both times, in the variables that count.

    It has no constant, which is in ẋ₀.
    """
    count = nominal.states.shape[1] + 1
    others = np.setdiff1d(np.arange(count), which)
    own = table_of(count).without(others)
    P = nominal.open_loop[:, rows][..., own]
    P[..., 0] = 0.0
    return P


def _add(polynomials, table, factors, powers):
    """Adds a product of monomials, times powers of s (r, K), to polynomials (r, M)."""
    product = table.exponents[factors].sum(axis=0)
    for power in powers.T:
        polynomials[:, table.place(product)] += power
        product[-1] += 1  # Of s.


def _along(table, m, path, moved):
    """Returns polynomials (r, M) of a path (r, K) and what v moves it by, (r, V, J)."""
    found = np.zeros((len(path), len(table.degrees)))
    _add(found, table, [0], path)
    for v in range(moved.shape[1]):
        _add(found, table, [1 + m + v], moved[:, v])
    return found


def _in_ball(table, basis, mean, change):
    """Returns polynomials (r, M) of mean + s change, in y; what they lack, over s."""
    mean, change = (change_variables(p, basis) for p in (mean, change))
    low = table_of(len(basis)).degrees < ORDER
    plain = table.without(slice(len(basis), None))
    timed = table.without(slice(len(basis), -1)) & (table.exponents[:, -1] == 1)
    found, highest = np.zeros((2, len(mean), len(table.degrees)))
    found[:, plain], found[:, timed] = mean, change[:, low]
    highest[:, plain] = np.where(low, 0.0, change)
    return found, highest


def _turned_slopes(slopes, which, basis):
    """Returns slopes (..., 1 + m) in (1, w), given those in (1, e), (..., 1 + n)."""
    states = [1 + i for i in which if i + 1 < slopes.shape[-1]]
    moved = slopes[..., states] @ basis[: len(states)]
    return np.concatenate([slopes[..., :1], moved], axis=-1)


def _acting(pushes):
    """Returns which of the command's error and both axes of the wind are not zero."""
    return [k for k, bound in enumerate(pushes[PUSHES]) if bound > 0.0]


def _limits(piece, basis, table):
    """Returns polynomials (r, M) that are at most β (1 + eᵀ F e), in (w, v, s).

    F is of the states that R depends on. What is of degree 4 has a factor s², which is
    half of one, and what it may be less is subtracted: |wᵀ F w| <= |F| on the ball.
    """
    which, rows = nonlinear_parts(piece.nominal.model)
    states = [i for i in which if i < piece.num_states]
    B = basis[: len(states)]  # The command is the last of all.
    F = piece.focus[:, states][:, :, states]
    beta, beta_change = line_powers(piece.beta[:, rows])
    focus, focus_change = line_powers(B.T @ F @ B)
    limits = np.zeros((len(rows), len(table.degrees)))
    _add(limits, table, [0], np.stack([beta, beta_change], axis=1))
    for i, j in itertools.product(range(len(basis)), repeat=2):
        constant = beta * focus[i, j] + 0.5 * beta_change * focus_change[i, j]
        slope = beta_change * focus[i, j] + beta * focus_change[i, j]
        _add(limits, table, [1 + i, 1 + j], np.stack([constant, slope], axis=1))

    sizes = np.abs(B).T @ np.abs(F).max(axis=0) @ np.abs(B)
    rounding = ROUNDING * piece.beta[:, rows].max(axis=0) * sizes.sum()
    lost = 0.5 * np.abs(beta_change) * np.linalg.norm(focus_change)
    limits[:, 0] -= (lost + rounding) * WIDER
    return limits


def _turned(model, center, polynomials, basis):
    """Returns a basis with axes in the order of how much R varies."""
    which, rows = nonlinear_parts(model)
    table = table_of(len(which))

    def remainder(w):
        y = w @ basis.T
        inputs = np.repeat(center[:, None], len(y), axis=1)
        inputs[which] += y.T
        found = open_loop_rates(model, list(inputs[:-1]), inputs[-1])
        rates = np.array([found[row] for row in rows]).T
        return rates - table.values(y) @ polynomials.T

    m = len(basis)
    rng = np.random.default_rng(0)
    w = normalized(rng.normal(size=(_SAMPLES, m)))
    steps = DIFFERENCE * np.eye(m)
    points = np.concatenate([0.0 * steps, steps, -steps])[:, None] + w
    values = remainder(points.reshape(-1, m))
    here, ahead, back = values.reshape(3, m, _SAMPLES, -1)
    largest = np.abs(here - remainder(np.zeros((1, m)))).max(axis=(0, 1))
    slopes = (ahead - back) / np.maximum(largest, 1e-300)
    _, axes = np.linalg.eigh(np.einsum("ibr,jbr->ij", slopes, slopes))
    return basis @ axes[:, ::-1]
