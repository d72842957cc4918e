"""How a deviation from the nominal flight goes on: Taylor polynomials along it.

With x = x₀(t) + e and u = u₀(t) - K(t) e,
    ė = f(x₀ + e, u₀ - K e) - f(x₀, u₀) = F₁ e + F₂(e, e) + F₃(e, e, e) + R(e)
as long as the servo follows its command, which the funnel sees to.
"""

import numpy as np

from glider.physics.model import GliderModel
from glider.verification.dynamics import dependence
from glider.verification.dynamics.jets import (
    Monomials,
    coefficients_of,
    monomials,
    variables,
)
from glider.verification.dynamics.nominal import Nominal

ORDER = 3
"""Of the expansion that funnels are built on. Order 2 is not enough: its remainder
eats the funnel."""


def open_loop_rates(model, states, command):
    """Returns ẋ for any kind of number, servo limits apart.

    Args:
        model: the GliderModel.
        states: n numbers x.
        command: u.
    """
    return model.chain.derivatives(0.0, states, command, 0.0, 0.0, model.numbers)


def closed_loop_rates(model, states, gains, nominal, inputs):
    """Returns ẋ of the closed loop for any kind of number, servo limits apart.

    Args:
        model: the GliderModel.
        states: n numbers, jets or arrays x.
        gains: n numbers or arrays K.
        nominal: n numbers or arrays x₀.
        inputs: u₀, a number or an array.
    """
    command = inputs
    for gain, x, x0 in zip(gains, states, nominal, strict=True):
        command = command - gain * (x - x0)
    return open_loop_rates(model, states, command)


def curved_parts(model: GliderModel, num_states: int) -> tuple[list[int], list[int]]:
    """Returns which variables and which rates are not linear.

    Args:
        model: the glider.
        num_states: n; variable n is the command.
    """
    *states, command = dependence.variables(num_states + 1)
    rates = open_loop_rates(model, states, command)
    curved: list[frozenset[int]]
    curved = [getattr(rate, "curved", frozenset()) for rate in rates]
    which = frozenset[int]().union(*curved)
    return sorted(which), [row for row, of in enumerate(curved) if of]


def expand(nominal: Nominal, order: int = ORDER) -> np.ndarray:
    """Returns the Taylor coefficients of ė, shape (T, n, M); the constant is zero.

    The monomials are those of `table_of`.
    """
    states = variables(nominal.states.T, order)
    rates = closed_loop_rates(
        nominal.model, states, nominal.gains.T, nominal.states.T, nominal.inputs
    )
    # (n, M, T) to (T, n, M)
    coefficients = np.array([coefficients_of(rate, states[0]) for rate in rates])
    coefficients = np.moveaxis(coefficients, 2, 0)
    coefficients[:, :, 0] = 0.0  # The slope of the nominal flight itself.
    return coefficients


def table_of(num_states: int, order: int = ORDER) -> Monomials:
    """Returns the monomials that `expand` gives coefficients of."""
    return monomials(num_states, order)


def evaluate(
    coefficients: np.ndarray, errors: np.ndarray, order: int = ORDER
) -> np.ndarray:
    """Returns the polynomial error dynamics at deviations.

    Args:
        coefficients: (n, M) of one time.
        errors: (B, n).
        order: of the expansion.

    Returns:
        ė, (B, n).
    """
    return table_of(errors.shape[1], order).values(errors) @ coefficients.T
