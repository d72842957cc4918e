"""Coefficients of the flat plate, corrected by a learned residual.

The article's second model: C(ξ) = C_plate + ψ(ξ)ᵀ w with Gaussian basis functions ψ
of the angle of attack and the elevator, and perhaps of the airspeed, and weights by
ridge regression. The weights found are a `FreeFunction`, which any GliderModel takes.
"""

import dataclasses
import itertools
import math
from collections.abc import Sequence

import numpy as np

from glider.errors import InputError
from glider.physics.aerodynamics import angle_of_attack
from glider.physics.effects.free_functions import COEFFICIENTS, FreeFunction
from glider.sysid.replay.record import Record
from glider.sysid.replay.replayed import make_table
from regression import least_squares

VARIABLES = ("alpha", "elevator", "V", "alphadot", "pitchdot")
"""Variables that the coefficients stand beside [rad, rad, m/s, rad/s, rad/s]."""

RIDGE = 0.1
"""Ridge γ of the article."""

_WIDTH = math.sqrt(0.1)
"""Width of the article's Gaussians in α and elevator [rad]."""

_COUNT = 5
"""Number of centers along each variable."""


def with_weights(
    data: FreeFunction, terms: Sequence[str], weights: np.ndarray
) -> FreeFunction:
    """Returns the functions with weights (M, terms)."""
    named = dict(zip(terms, weights.T.tolist(), strict=True))
    return dataclasses.replace(data, weights=named)


@dataclasses.dataclass(frozen=True, kw_only=True)
class CoefficientData:
    """The article's data set: measured coefficients, the flat plate's beside them.

    Attributes:
        variables: each of VARIABLES, (N,).
        measured: (N, 3) of COEFFICIENTS.
        plate: (N, 3) the nominal model's at the same conditions.
    """

    variables: dict[str, np.ndarray]
    measured: np.ndarray
    plate: np.ndarray


def coefficient_data(records: Sequence[Record], theta: np.ndarray) -> CoefficientData:
    """Returns the coefficients along smoothed flights.

    Accelerations are those of the smoothed poses; the elevator moves as its commands
    say, from where it was first seen. The angle of attack lies within ±π, as in the
    plant that flies the residual, so a glider that tumbles meets the same weights.

    Args:
        records: the flights.
        theta: the nominal model.
    """
    table = make_table(records, theta, [0.0] * len(records))
    variables = {name: table.variables[name] for name in VARIABLES}
    alpha = variables["alpha"]
    variables["alpha"] = angle_of_attack(np.sin(alpha), np.cos(alpha))
    return CoefficientData(
        variables=variables,
        measured=np.stack([table.coefficients[c] for c in COEFFICIENTS], axis=1),
        plate=np.stack([table.modelled[c] for c in COEFFICIENTS], axis=1),
    )


def residual_basis(speeds: tuple[float, float] | None = None) -> FreeFunction:
    """Returns the article's basis functions, without weights.

    5 x 5 centers over α in [0, π] and elevator in [-π/4, π/4], of covariance 0.1 I,
    and a constant: 26 functions. With speeds, 5 times as many and the constant, 126;
    their width in V is the distance of the centers.

    Args:
        speeds: the least and the greatest center in V [m/s], or None.

    Raises:
        InputError: the speeds do not increase.
    """
    axes = [
        np.linspace(0.0, math.pi, _COUNT),
        np.linspace(-math.pi / 4, math.pi / 4, _COUNT),
    ]
    variables, widths = ["alpha", "elevator"], [_WIDTH, _WIDTH]
    if speeds is not None:
        low, high = speeds
        if not low < high:
            raise InputError(
                f"residual_basis: speeds are {low:g} and {high:g} m/s; "
                "the second must be the greater."
            )
        axes.append(np.linspace(low, high, _COUNT))
        variables.append("V")
        widths.append((high - low) / (_COUNT - 1))
    return FreeFunction(
        variables=variables,
        centers=[list(map(float, center)) for center in itertools.product(*axes)],
        widths=widths,
        constant=True,
    )


def basis_values(basis: FreeFunction, variables: dict[str, np.ndarray]) -> np.ndarray:
    """Returns ψ, (N, M), at given values of the basis's variables."""
    values = np.stack([variables[name] for name in basis.variables], axis=1)
    return basis.basis(values)


def fit_residual(
    data: CoefficientData, basis: FreeFunction, ridge: float = RIDGE
) -> FreeFunction:
    """Returns the basis with the weights of min ‖ψ w - (C - C_plate)‖² + γ ‖w‖².

    Args:
        data: to fit.
        basis: its functions.
        ridge: γ.
    """
    columns = basis_values(basis, data.variables)
    solved = least_squares(columns, data.measured - data.plate, ridge)
    return with_weights(basis, COEFFICIENTS, solved.coefficients)


def corrected_coefficients(
    data: CoefficientData, residual: FreeFunction | None
) -> np.ndarray:
    """Returns the flat plate's coefficients with a residual if there is one, (N, 3)."""
    if residual is None:
        return data.plate
    weights = np.array([residual.weights[name] for name in COEFFICIENTS]).T
    return data.plate + basis_values(residual, data.variables) @ weights
