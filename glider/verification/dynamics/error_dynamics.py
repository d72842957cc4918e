"""Dynamics of the deviation from a nominal flight: Taylor polynomials and the defect.

With x = x₀(t) + e and u = u₀(t) - K(t) e,
    ė = f(x₀ + e, u₀ - K e) - f(x₀, u₀) + d = F₁ e + F₂(e, e) + F₃(e, e, e) + R(e) + d
as long as the servo follows its command, which the funnel ensures. Between its times x₀
is the cubic Hermite polynomial through its states and slopes, and u₀ a straight line.
That is a flight except for the defect d = f(x₀, u₀) - ẋ₀, which acts like a
disturbance. On the boundary V = 1 it makes V grow by at most
    2 eᵀ S d <= 2 √(dᵀ S d) <= 2 √(δᵀ |S| δ),  where |d_i| <= δ_i.
Taylor models in time enclose d, so that no time in between is missed.
"""

import numpy as np

from glider.physics.model import GliderModel
from glider.verification.dynamics.arithmetic import dependences
from glider.verification.dynamics.confidence import theta_at
from glider.verification.dynamics.jets import (
    Monomials,
    coefficients_of,
    monomials,
    variables,
)
from glider.verification.dynamics.nominal import (
    Nominal,
    closed_loop_rates,
    nominal_path,
    nominal_slopes,
    open_loop_rates,
)
from glider.verification.dynamics.taylor_models import ROUNDING, WIDER, TaylorModel

ORDER = 3
"""Order of the expansion that funnels are built on. With order 2, the remainder leaves
a launch 1.7 cm of height; with order 3, 9 cm."""


def nonlinear_parts(
    model: GliderModel, num_states: int, names: tuple[str, ...] = ()
) -> tuple[list[int], list[int]]:
    """Returns the indices of the variables and of the rates that are not linear.

    Args:
        num_states: n; variable n is the command.
        names: of further variables: numbers of the glider that deviate.
    """
    states = dependences(num_states + 1 + len(names))
    states, deviations = states[: num_states + 1], states[num_states + 1 :]
    command = states.pop()
    theta = theta_at(model, names, deviations)
    rates = open_loop_rates(model, states, command, theta)
    nonlinear: list[frozenset[int]]
    nonlinear = [getattr(rate, "nonlinear", frozenset()) for rate in rates]
    which = frozenset[int]().union(*nonlinear)
    return sorted(which), [row for row, of in enumerate(nonlinear) if of]


def expand(nominal: Nominal) -> np.ndarray:
    """Returns the Taylor coefficients (T, n, M) of ė; the constant is zero.

    The monomials are those of `table_of`.
    """
    states = variables(nominal.states.T, ORDER)
    rates = closed_loop_rates(
        nominal.model, states, nominal.gains.T, nominal.states.T, nominal.inputs
    )
    coefficients = np.array([coefficients_of(rate, states[0]) for rate in rates])
    coefficients = np.moveaxis(coefficients, 2, 0)  # (n, M, T) to (T, n, M).
    coefficients[:, :, 0] = 0.0  # The slope of the nominal flight itself.
    return coefficients


def expand_rates(nominal: Nominal) -> np.ndarray:
    """Returns the Taylor coefficients (T, n, M) of f in n states and the command.

    The constant is f at the nominal; the monomials are those of `table_of(n + 1)`.
    """
    *states, command = variables(np.vstack([nominal.states.T, nominal.inputs]), ORDER)
    rates = open_loop_rates(nominal.model, states, command)
    coefficients = np.array([coefficients_of(rate, command) for rate in rates])
    return np.moveaxis(coefficients, 2, 0)  # (n, M, T) to (T, n, M).


def table_of(num_variables: int) -> Monomials:
    """Returns the monomials that `expand` gives coefficients of."""
    return monomials(num_variables, ORDER)


def evaluate(coefficients: np.ndarray, errors: np.ndarray) -> np.ndarray:
    """Returns ė (..., B, n) by the Taylor polynomials.

    Args:
        coefficients: (..., n, M) of `expand`.
        errors: (..., B, n) deviations e.
    """
    n = errors.shape[-1]
    values = table_of(n).values(errors.reshape(-1, n))
    values = values.reshape(*errors.shape[:-1], -1)
    return values @ np.swapaxes(coefficients, -1, -2)


DEGREE = 5
"""Degree in time; of more, the bounds of the shipped funnels are no lower."""

PIECES = 4
"""Parts of each interval that are enclosed separately. The bound over a whole one is
five times as large as the defect."""


@np.errstate(all="ignore")  # What is infinite is bounded by infinity.
def defect_bounds(nominal: Nominal) -> np.ndarray:
    """Returns δ (T - 1, n), proven bounds of |d| over each interval of time.

    They are infinite where nothing is proven.
    """
    if not np.all(np.isfinite(nominal_slopes(nominal))):
        return np.full_like(nominal.states[1:], np.inf)
    curve = nominal_path(nominal).c  # (4, T - 1, n), powers of t - t_k, highest first.
    share = (np.arange(PIECES) + 0.5) / PIECES
    steps = np.diff(nominal.times)
    center, half = steps[:, None] * share, steps[:, None] * (0.5 / PIECES)
    half = np.broadcast_to(half, center.shape)

    def model(powers):
        """Returns Σ powers[j] (t - t_k)ʲ, each (T - 1), as one Taylor model."""
        return _on_pieces([power[:, None] for power in powers], center, half)

    states, slopes = [], []
    for a3, a2, a1, a0 in np.moveaxis(curve, 2, 0):
        states.append(model([a0, a1, a2, a3]))
        slopes.append(model([a1, 2.0 * a2, 3.0 * a3]))
    u = nominal.inputs
    rates = open_loop_rates(nominal.model, states, model([u[:-1], np.diff(u) / steps]))
    sizes = []
    for rate, slope in zip(rates, slopes, strict=True):
        defect = slope.times(-1.0).plus(rate)
        size = np.abs(defect.coefficients[0]) + defect.spread()
        sizes.append(size.reshape(len(steps), PIECES).max(axis=1) * WIDER)
    bounds = np.array(sizes).T
    return np.where(np.isfinite(bounds), bounds, np.inf)


@np.errstate(all="ignore")
def defect_growth(S: np.ndarray, bounds: np.ndarray) -> np.ndarray:
    """Returns 2 √(δᵀ |S| δ) at each time (T,), rounded up [1/s].

    Args:
        S: (T, n, n).
        bounds: (T - 1, n) of `defect_bounds`; at a time, those of both intervals count.
    """
    around = np.maximum(
        np.concatenate([bounds[:1], bounds]), np.concatenate([bounds, bounds[-1:]])
    )
    square = np.einsum("ti,tij,tj->t", around, np.abs(S), around)
    growth = 2.0 * np.sqrt(square) * WIDER
    return np.where(np.isfinite(growth), growth, np.inf)


def _on_pieces(powers, center, half):
    """Returns Σ powers[j] (center + half s)ʲ, |s| <= 1, on all pieces in a row."""
    table = monomials(1, DEGREE)
    shape = center.shape
    flat = np.zeros((len(table.degrees), center.size))
    flat[0], flat[1] = center.ravel(), half.ravel()
    time = TaylorModel(table, flat, ROUNDING * (np.abs(flat[0]) + flat[1]))
    total = time.constant(np.broadcast_to(powers[-1], shape).ravel())
    for power in powers[-2::-1]:
        total = total.times(time).plus(np.broadcast_to(power, shape).ravel())
    return total
