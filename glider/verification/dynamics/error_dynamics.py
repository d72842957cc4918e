"""Dynamics of the deviation from a nominal flight, as Taylor polynomials along it.

With x = x₀(t) + e and u = u₀(t) - K(t) e,
    ė = f(x₀ + e, u₀ - K e) - f(x₀, u₀) = F₁ e + F₂(e, e) + F₃(e, e, e) + R(e)
as long as the servo follows its command, which the funnel sees to.
"""

import numpy as np

from glider.physics.model import GliderModel
from glider.verification.dynamics.arithmetic import dependences
from glider.verification.dynamics.deviations import theta_at
from glider.verification.dynamics.jets import (
    Monomials,
    coefficients_of,
    monomials,
    variables,
)
from glider.verification.dynamics.nominal import (
    Nominal,
    closed_loop_rates,
    open_loop_rates,
)

ORDER = 3
"""Order of the expansion that funnels are built on. With order 2, the remainder leaves
a launch 1.7 cm of height; with order 3, 9 cm."""


def nonlinear_parts(
    model: GliderModel, num_states: int, names: tuple[str, ...] = ()
) -> tuple[list[int], list[int]]:
    """Returns the indices of the variables and of the rates that are not linear.

    Args:
        model: the glider.
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
