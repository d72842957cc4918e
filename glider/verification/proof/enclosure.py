"""What the Taylor polynomial leaves out on boxes of deviations: an enclosure.

Deviations of the set are e = T w with |w| <= 1. The rates that are not linear depend on
a few combinations of e only, so that w has fewer entries than e; T is turned so that R
varies most along w₁, then along w₂, and so on.
"""

import dataclasses

import numpy as np

from glider.verification.dynamics.error_dynamics import (
    ORDER,
    closed_loop_rates,
    curved_parts,
    table_of,
)
from glider.verification.dynamics.jets import monomials
from glider.verification.dynamics.nominal import Nominal
from glider.verification.dynamics.taylor_models import (
    ROUNDING,
    WIDER,
)
from glider.verification.funnel.remainder import remainder_of
from glider.verification.proof.boxes import (
    blame_of,
    bound_in_ball,
    row_on_boxes,
    shifted,
)
from glider.verification.sos.forms import (
    change_variables,
    to_ball,
)

LOOSE = 1e-8
"""Of Tᵀ S T - I: with less, the ball of w holds all deviations of the set."""

SAMPLES = 1000
"""Points where the variation of R is looked at."""

DIFFERENCE = 1e-4
"""Of w, for the slopes of R there."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Rest:
    """R over a set at one time, ready to be enclosed on boxes of w."""

    nominal: Nominal
    """The flight."""

    at: int
    """Index of the time."""

    rows: list[int]
    """(r,) the rates that are not linear; R of the others is rounding."""

    T: np.ndarray
    """(n, m) e = T w."""

    polynomials: np.ndarray
    """(r, M) of these rates, in w."""

    still: np.ndarray
    """(r,) of these rates at the nominal."""

    spurious: np.ndarray
    """(r,) bound of what rounding leaves out of them."""

    largest: np.ndarray
    """(r,) |R| that was seen: no proof can be of less. Infinite if there is none."""

    def bounds(
        self, center: np.ndarray, half: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Returns how large |R| is on boxes: at most, at least, and why.

        Args:
            center: (m, B) of boxes.
            half: (m, B) their half-widths.

        Returns:
            bounds (r, B) of |R| on the parts of the boxes with |w| <= RADIUS; what it
            surely reaches in their centers, if in the unit ball, (r, B); how much each
            w_i is to blame for the bounds, (r, m, B).
        """
        table = monomials(len(center), ORDER)
        rates = _rates_on(table, self.nominal, self.at, self.T, center, half)
        within = np.sum(center**2, axis=0) <= 1.0
        most, least, blame = [], [], []
        for i, row in enumerate(self.rows):
            polynomial = shifted(table, self.polynomials[i], center, half)
            rest = rates[row] - self.still[i] - polynomial
            unknown = (rest.rest + self.spurious[i]) * WIDER
            most.append(
                bound_in_ball(rest.coefficients, unknown, center, half, table.exponents)
            )
            least.append(np.where(within, np.abs(rest.coefficients[0]) - unknown, 0.0))
            blame.append(blame_of(rest, rates[row]))
        return np.array(most), np.array(least), np.array(blame)


def make_rest(
    nominal: Nominal, at: int, coefficients: np.ndarray, S: np.ndarray
) -> Rest:
    """Prepares the enclosure of R = ė - p(e) over {eᵀ S e <= 1}.

    Args:
        nominal: the flight.
        at: index of the time.
        coefficients: (T, n, M) of p, as `expand` gives them.
        S: (n, n).
    """
    n = len(S)
    which, rows = curved_parts(nominal.model, n)
    m = len(which)
    variables = np.vstack([np.eye(n), -nominal.gains[at]])[which]
    back = to_ball(S)[1]
    # z = V w: the first m columns of V move the variables, the others do not.
    T = back @ np.linalg.svd(variables @ back)[2].T
    turn, largest = _active(nominal, at, coefficients, T[:, :m], rows)
    T[:, :m] = T[:, :m] @ turn
    if not np.abs(T.T @ S @ T - np.eye(n)).sum() < LOOSE:
        largest = np.full(len(rows), np.inf)  # S is all but singular.
    polynomials = change_variables(coefficients[at], T)[rows]
    sizes = change_variables(np.abs(coefficients[at]), np.abs(T))[rows]
    inside = ~table_of(n).exponents[:, m:].any(axis=1)
    # Exactly, there would be nothing outside.
    outside = np.abs(polynomials[:, ~inside]).sum(axis=1)
    point = np.zeros((m, 1))
    rates = _rates_on(monomials(m, ORDER), nominal, at, T[:, :m], point, point)
    still = [rates[row] for row in rows]
    rounded = ROUNDING * sizes.sum(axis=1) + [rate.rest[0] for rate in still]
    return Rest(
        nominal=nominal,
        at=at,
        rows=rows,
        T=T[:, :m],
        polynomials=polynomials[:, inside],
        still=np.array([rate.coefficients[0, 0] for rate in still]),
        spurious=(outside + rounded) * WIDER,
        largest=largest,
    )


def _rates_on(table, nominal, at, T, center, half):
    """Returns ẋ of the closed loop as models on boxes of w."""
    x0 = nominal.states[at]
    states = [
        row_on_boxes(table, row, center, half).plus(x)
        for row, x in zip(T, x0, strict=True)
    ]
    return closed_loop_rates(
        nominal.model, states, nominal.gains[at], x0, nominal.inputs[at]
    )


def _active(nominal, at, coefficients, T, rows):
    """Returns axes of w (columns) by how much R varies along them, and max |R|."""
    m = T.shape[1]

    def rest(w):
        e = w @ T.T
        found = remainder_of(nominal, coefficients, np.array([at]), e[None])
        return found[0][:, rows]

    w = np.random.default_rng(0).normal(size=(SAMPLES, m))
    w /= np.linalg.norm(w, axis=1, keepdims=True)
    steps = DIFFERENCE * np.eye(m)
    slopes = np.array([rest(w + step) - rest(w - step) for step in steps])
    largest = np.abs(rest(w)).max(axis=0)
    slopes /= np.maximum(largest, 1e-300)
    _, axes = np.linalg.eigh(np.einsum("ibr,jbr->ij", slopes, slopes))
    return axes[:, ::-1], largest
