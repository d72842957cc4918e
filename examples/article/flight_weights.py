"""A residual's weights from states: the article's step of identification.

Forward differences of the states give accelerations, which depend on the weights of
C_L, C_D and C_M linearly; ridge regression over all flights so far solves for them.
"""

import dataclasses

import numpy as np

from coefficients import RIDGE, basis_values
from glider.errors import InputError
from glider.physics.compose import compose
from glider.physics.effects import (
    FLOW_VARIABLES,
    FREE_FUNCTIONS,
    NO_GAUSSIANS,
    Gaussians,
)
from glider.physics.effects.free_functions import (
    COEFFICIENTS,
    FreeFunction,
    flow_variables,
    gaussians_of,
)
from glider.physics.model import GliderModel
from glider.physics.state import NUM_STATES

_ACCELERATIONS = slice(4, NUM_STATES)


@dataclasses.dataclass(frozen=True, kw_only=True)
class WeightEquations:
    """Normal equations of a residual's weights: what flights say of them.

    Attributes:
        information: Φᵀ Φ, (p, p), the weights of the basis functions first, then the
            coefficients.
        target: Φᵀ y, (p,).
    """

    information: np.ndarray
    target: np.ndarray

    def __add__(self, other: "WeightEquations") -> "WeightEquations":
        """Returns the equations of both."""
        return WeightEquations(
            information=self.information + other.information,
            target=self.target + other.target,
        )


def weight_equations(
    nominal: GliderModel,
    basis: FreeFunction,
    states: np.ndarray,
    inputs: np.ndarray,
    step: float,
) -> WeightEquations:
    """Computes the normal equations of the weights from one flight.

    Σ_n ‖Π ((x_n+1 - x_n) / h - f(x_n, u_n) - G(x_n, u_n) w)‖², where Π takes
    (ẍ, z̈, θ̈) and G w is what the weights add.

    Args:
        nominal: f, a glider without free functions and without states beyond the rigid
            body's.
        basis: of the residual.
        states: (N + 1, 7) as measured.
        inputs: (N,) elevator rates [rad/s].
        step: h [s].

    Raises:
        InputError: the model cannot be corrected so, or the sizes do not match.
    """
    if nominal.free_functions or any(e.kind.states for e in nominal.effects):
        raise InputError(
            "weight_equations: expected a model without free functions and without "
            "effects that have states."
        )
    if states.shape != (len(inputs) + 1, NUM_STATES):
        raise InputError(
            f"weight_equations: the states have shape {states.shape} and there are "
            f"{len(inputs)} inputs; expected ({len(inputs) + 1}, {NUM_STATES})."
        )
    chain = compose((*nominal.kinds, *FREE_FUNCTIONS.values()))
    theta = nominal.numbers
    now = states[:-1].T

    def accelerations(gaussians: Gaussians) -> np.ndarray:
        given = theta._replace(gaussians=gaussians)
        rates = chain.derivatives(0.0, now, inputs, 0.0, 0.0, given)
        return np.stack(rates[_ACCELERATIONS], axis=1)

    plate = accelerations(NO_GAUSSIANS)
    added = np.stack([accelerations(_constant(k)) - plate for k in COEFFICIENTS], 2)
    flow, _ = chain.meet_air(0.0, now, inputs, 0.0, 0.0, theta)
    values = dict(zip(FLOW_VARIABLES, flow_variables(flow), strict=True))
    psi = basis_values(basis, values)
    columns = psi[:, None, :, None] * added[:, :, None, :]  # (N, 3, M, 3)
    columns = columns.reshape(3 * len(inputs), -1)
    measured = np.diff(states[:, _ACCELERATIONS], axis=0) / step
    target = (measured - plate).ravel()
    return WeightEquations(information=columns.T @ columns, target=columns.T @ target)


def _constant(coefficient: str) -> Gaussians:
    """Returns Gaussians that add one to a coefficient everywhere."""
    one = FreeFunction(constant=True, weights={coefficient: [1.0]})
    return gaussians_of([one])


def solve_weights(equations: WeightEquations, ridge: float = RIDGE) -> np.ndarray:
    """Returns the weights of min ‖y - Φ w‖² + γ ‖w‖², shape (M, 3)."""
    regular = equations.information + ridge * np.eye(len(equations.target))
    return np.linalg.solve(regular, equations.target).reshape(-1, len(COEFFICIENTS))
