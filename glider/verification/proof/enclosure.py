"""An enclosure of the Taylor remainder R on boxes of deviations.

Deviations of the set are e = basis w with |w| <= 1. The rates that are not linear
depend on a few combinations of e only, so that w has fewer entries than e; the basis is
turned so that R varies most along w₁, then along w₂, and so on. What rounding leaves of
the other entries of w in these combinations is enclosed too.
"""

import dataclasses

import numpy as np

from glider.verification.dynamics.error_dynamics import (
    ORDER,
    closed_loop_rates,
    nonlinear_parts,
    table_of,
)
from glider.verification.dynamics.nominal import Nominal
from glider.verification.dynamics.taylor_models import (
    ROUNDING,
    WIDER,
)
from glider.verification.funnel.ascent import DIFFERENCE
from glider.verification.funnel.remainder import remainder_of
from glider.verification.proof.boxes import (
    BALL_ERROR,
    RADIUS,
    blame_of,
    bound_in_ball,
    row_on_boxes,
    shifted,
)
from glider.verification.sos.forms import (
    change_variables,
    to_ball,
)
from glider.verification.sos.sphere import normalized

TURN_SAMPLES = 1000
"""Points on the sphere where the variation of R is looked at, to turn the basis."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class TaylorRemainder:
    """R over a set at one time, ready to be enclosed on boxes of w."""

    nominal: Nominal
    """Nominal flight."""

    at: int
    """Index of the time."""

    rows: list[int]
    """Indices (r,) of the rates that are not linear; R of the others is rounding."""

    basis: np.ndarray
    """Matrix (n, m) of e = basis w."""

    polynomials: np.ndarray
    """Taylor polynomials (r, M) of these rates' deviations, in w."""

    dropped: np.ndarray
    """Bounds (n + 1,) of what each deviation and the command may differ by from what w
    makes of it, where the rates that are not linear depend on it; else zero."""

    nominal_rates: np.ndarray
    """These rates (r,) at the nominal."""

    rounding: np.ndarray
    """Bounds (r,) of what rounding leaves out of the two."""

    largest: np.ndarray
    """Largest |R| (r,) that was seen: no proof can be of less. Infinite where no proof
    can be at all, because the set is nearly flat."""

    def bounds(
        self, center: np.ndarray, half: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Encloses |R| on boxes.

        Args:
            center: (m, B) of boxes.
            half: (m, B) their half-widths.

        Returns:
            bounds (r, B) of |R| on the parts of the boxes with |w| <= RADIUS; what it
            surely reaches in their centers, if in the unit ball, (r, B); how much each
            w_i is to blame for the bounds, (r, m, B).
        """
        table = table_of(len(center))
        rates = _rates_on(
            table, self.nominal, self.at, self.basis, self.dropped, center, half
        )
        within = np.sum(center**2, axis=0) <= 1.0
        most, least, blame = [], [], []
        for i, row in enumerate(self.rows):
            polynomial = shifted(table, self.polynomials[i], center, half)
            difference = rates[row] - self.nominal_rates[i] - polynomial
            coefficients = difference.coefficients
            unknown = (difference.remainder + self.rounding[i]) * WIDER
            most.append(
                bound_in_ball(coefficients, unknown, center, half, table.exponents)
            )
            least.append(np.where(within, np.abs(coefficients[0]) - unknown, 0.0))
            blame.append(blame_of(difference, rates[row]))
        return np.array(most), np.array(least), np.array(blame)


def make_remainder(
    nominal: Nominal, at: int, coefficients: np.ndarray, S: np.ndarray
) -> TaylorRemainder:
    """Prepares the enclosure of R = ė - p(e) over {eᵀ S e <= 1} at one time.

    Args:
        nominal: the flight.
        at: index of the time.
        coefficients: (T, n, M) of p, as `expand` gives them.
        S: (n, n).
    """
    n = len(S)
    which, rows = nonlinear_parts(nominal.model, n)
    m = len(which)
    variables = np.vstack([np.eye(n), -nominal.gains[at]])[which]
    L_inv_T = to_ball(S)[1]
    # z = V w: the first m columns of V move the variables, the others do not.
    basis = L_inv_T @ np.linalg.svd(variables @ L_inv_T)[2].T
    turn, largest = _active(nominal, at, coefficients, basis[:, :m], rows)
    basis[:, :m] = basis[:, :m] @ turn
    error = np.abs(basis.T @ S @ basis - np.eye(n)).sum()
    error += ROUNDING * (np.abs(basis).T @ np.abs(S) @ np.abs(basis)).sum()
    if not error < BALL_ERROR:
        largest = np.full(len(rows), np.inf)  # S is all but singular.
    dropped = np.zeros(n + 1)
    dropped[which] = np.abs(variables @ basis[:, m:]).sum(axis=1)
    dropped[which] += ROUNDING * (np.abs(variables) @ np.abs(basis)).sum(axis=1)
    dropped *= RADIUS * WIDER
    polynomials = change_variables(coefficients[at], basis)[rows]
    sizes = change_variables(np.abs(coefficients[at]), np.abs(basis))[rows]
    inside = ~table_of(n).exponents[:, m:].any(axis=1)
    # Exactly, there would be nothing outside.
    outside = np.abs(polynomials[:, ~inside]).sum(axis=1) * RADIUS**ORDER
    point = np.zeros((m, 1))
    none = np.zeros(n + 1)
    rates = _rates_on(table_of(m), nominal, at, basis[:, :m], none, point, point)
    at_nominal = [rates[row] for row in rows]
    rounded = ROUNDING * sizes.sum(axis=1) * RADIUS**ORDER
    rounded += [rate.remainder[0] for rate in at_nominal]
    return TaylorRemainder(
        nominal=nominal,
        at=at,
        rows=rows,
        basis=basis[:, :m],
        polynomials=polynomials[:, inside],
        dropped=dropped,
        nominal_rates=np.array([rate.coefficients[0, 0] for rate in at_nominal]),
        rounding=(outside + rounded) * WIDER,
        largest=largest,
    )


def _rates_on(table, nominal, at, basis, dropped, center, half):
    """Returns ẋ of the closed loop as Taylor models on boxes of w."""
    x0, nothing = nominal.states[at], np.zeros(basis.shape[1])
    states = []
    for row, x, missing in zip(basis, x0, dropped[:-1], strict=True):
        state = row_on_boxes(table, row, center, half).plus(x)
        state.remainder = state.remainder + missing
        states.append(state)
    command = row_on_boxes(table, nothing, center, half).plus(nominal.inputs[at])
    command.remainder = command.remainder + dropped[-1]
    return closed_loop_rates(nominal.model, states, nominal.gains[at], x0, command)


def _active(nominal, at, coefficients, basis, rows):
    """Returns axes of w (columns) by how much R varies along them, and max |R|."""
    m = basis.shape[1]

    def remainder(w):
        e = w @ basis.T
        found = remainder_of(nominal, coefficients, np.array([at]), e[None])
        return found[0][:, rows]

    w = normalized(np.random.default_rng(0).normal(size=(TURN_SAMPLES, m)))
    steps = DIFFERENCE * np.eye(m)
    slopes = np.array([remainder(w + step) - remainder(w - step) for step in steps])
    largest = np.abs(remainder(w)).max(axis=0)
    slopes /= np.maximum(largest, 1e-300)
    _, axes = np.linalg.eigh(np.einsum("ibr,jbr->ij", slopes, slopes))
    return axes[:, ::-1], largest
