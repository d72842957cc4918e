"""How is the flat plate wrong? Its coefficients corrected by a learned residual.

The article's second model: C(ξ) = C_plate + ψ(ξ)ᵀ w with Gaussian basis functions ψ
of the angle of attack and the elevator, and perhaps of the airspeed, and weights by
ridge regression. The weights found are a `FieldData`, which flies in any GliderModel.
"""

import dataclasses
import itertools
import math
from collections.abc import Sequence

import numpy as np
from threadpoolctl import threadpool_limits

from glider.campaign.logs import (
    Campaign,
    Flight,
    split_flights,
)
from glider.errors import InputError
from glider.physics.aerodynamics import angle_of_attack
from glider.physics.effects import FIELD_VARIABLES
from glider.physics.effects.field import (
    FieldData,
    make_field,
)
from glider.sysid.fit.prediction import measure_errors
from glider.sysid.fit.regression import least_squares
from glider.sysid.replay.noise import measure_noise
from glider.sysid.replay.problem import Problem
from glider.sysid.replay.record import prepare
from glider.sysid.replay.residual import make_table
from glider.sysid.replay.vehicle import (
    Vehicle,
    make_vehicle,
)
from glider.sysid.result import Errors

COEFFICIENTS = ("c_lift", "c_drag", "c_moment")
"""Referred to ½ ρ V² S_w, the moment without a chord [-, -, m]."""

VARIABLES = ("alpha", "elevator", "V", "alphadot", "pitchdot")
"""What the coefficients stand beside [rad, rad, m/s, rad/s, rad/s]."""

RIDGE = 0.1
"""γ of the article."""

_WIDTH = math.sqrt(0.1)
"""Of the article's Gaussians in α and elevator [rad]."""

_COUNT = 5
"""Centers along each variable."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class CoefficientData:
    """The article's data set: measured coefficients, the flat plate's beside them.

    Attributes:
        variables: each of VARIABLES, (N,).
        measured: (N, 3) of COEFFICIENTS.
        plate: (N, 3) the drawing's at the same conditions.
    """

    variables: dict[str, np.ndarray]
    measured: np.ndarray
    plate: np.ndarray


def coefficient_data(problem: Problem, theta: np.ndarray) -> CoefficientData:
    """Returns the coefficients along smoothed flights.

    Accelerations are those of the smoothed poses; the elevator moves as its commands
    say, from where it was first seen. The angle of attack lies within ±π, as in the
    plant that flies the residual, so a glider that tumbles meets the same weights.

    Args:
        problem: the flights; their field does not count.
        theta: the drawing.
    """
    table = make_table(problem.records, theta, [0.0] * len(problem.records))
    variables = {name: table.variables[name] for name in VARIABLES}
    alpha = variables["alpha"]
    variables["alpha"] = angle_of_attack(np.sin(alpha), np.cos(alpha))
    return CoefficientData(
        variables=variables,
        measured=np.stack([table.coefficients[c] for c in COEFFICIENTS], axis=1),
        plate=np.stack([table.modelled[c] for c in COEFFICIENTS], axis=1),
    )


def residual_basis(speeds: tuple[float, float] | None = None) -> FieldData:
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
    return FieldData(
        variables=variables,
        centers=[list(map(float, center)) for center in itertools.product(*axes)],
        widths=widths,
        constant=True,
    )


def basis_values(basis: FieldData, variables: dict[str, np.ndarray]) -> np.ndarray:
    """Returns ψ, (N, M), at given values of the basis's variables."""
    field = make_field(dataclasses.replace(basis, weights={}))
    columns = [FIELD_VARIABLES.index(name) for name in basis.variables]
    values = np.stack([variables[name] for name in basis.variables], axis=1)
    scaled = values[:, None, :] - field.centers[None][:, :, columns]
    scaled = scaled * field.inverse_widths[None][:, :, columns]
    return np.exp(-0.5 * np.sum(scaled**2, axis=2))


def fit_residual(
    data: CoefficientData, basis: FieldData, ridge: float = RIDGE
) -> FieldData:
    """Returns the basis with the weights of min ‖ψ w - (C - C_plate)‖² + γ ‖w‖².

    Args:
        data: to fit.
        basis: its functions.
        ridge: γ.
    """
    columns = basis_values(basis, data.variables)
    solved = least_squares(columns, data.measured - data.plate, ridge)
    return with_weights(basis, solved.coefficients)


def with_weights(basis: FieldData, weights: np.ndarray) -> FieldData:
    """Returns the field of a basis with weights (M, 3) of COEFFICIENTS."""
    named = dict(zip(COEFFICIENTS, weights.T.tolist(), strict=True))
    return dataclasses.replace(basis, weights=named)


def corrected_coefficients(
    data: CoefficientData, field: FieldData | None
) -> np.ndarray:
    """Returns the flat plate's coefficients with a residual if there is one, (N, 3)."""
    if field is None:
        return data.plate
    weights = np.array([field.weights[name] for name in COEFFICIENTS]).T
    return data.plate + basis_values(field, data.variables) @ weights


@dataclasses.dataclass(frozen=True, kw_only=True)
class ResidualModel:
    """What one model of the coefficients makes of flights that it has not seen.

    Attributes:
        field: its residual; None for the flat plate alone.
        rms: (3,) RMS error of COEFFICIENTS.
        errors: of accelerations and of free rollouts.
    """

    field: FieldData | None
    rms: np.ndarray
    errors: Errors


@dataclasses.dataclass(frozen=True, kw_only=True)
class ResidualStudy:
    """The flat plate beside residuals learned from a campaign.

    Attributes:
        fitted: data of the flights that were fitted.
        held_out: of those that were not.
        unseen: the held-out flights.
        models: "plate", then a residual for each basis, by their number of weights.
    """

    fitted: CoefficientData
    held_out: CoefficientData
    unseen: tuple[Flight, ...]
    models: dict[str, ResidualModel]


def learn_residuals(
    campaign: Campaign, held_out: float = 0.3, seed: int = 0, ridge: float = RIDGE
) -> ResidualStudy:
    """Fits 26 weights a coefficient, and 126 with airspeed, to a campaign's flights.

    The centers in airspeed span what the fitted flights flew, but for a hundredth at
    either end.

    Args:
        campaign: whose drawing is known, with a servo.
        held_out: share of the flights that errors are measured on.
        seed: of the split.
        ridge: γ.

    Raises:
        InputError: the drawing or the elevator is not known, or the split fails.
    """
    vehicle = make_vehicle(campaign)
    if not vehicle.is_known or campaign.elevator != "servo":
        raise InputError(
            f"{campaign.path}: coefficients need the whole drawing of the vehicle and "
            "a logged elevator; the campaign lacks one of them."
        )
    with threadpool_limits(limits=1, user_api="blas"):  # Small matrices.
        return _learn(campaign, vehicle, split_flights(campaign, held_out, seed), ridge)


def _learn(
    campaign: Campaign,
    vehicle: Vehicle,
    split: tuple[tuple[Flight, ...], tuple[Flight, ...]],
    ridge: float,
) -> ResidualStudy:
    noise = measure_noise(campaign)
    fitting, unseen = (
        Problem(records=prepare(flights, campaign, noise), noise=noise)
        for flights in split
    )
    data = coefficient_data(fitting, vehicle.theta)
    test = coefficient_data(unseen, vehicle.theta)
    low, high = np.quantile(data.variables["V"], [0.01, 0.99])
    bases = (residual_basis(), residual_basis((float(low), float(high))))
    fields = [None, *(fit_residual(data, basis, ridge) for basis in bases)]
    models = [_try(unseen, vehicle.theta, test, field) for field in fields]
    return ResidualStudy(
        fitted=data,
        held_out=test,
        unseen=split[1],
        models=dict(zip(_names(fields), models, strict=True)),
    )


def _names(fields: Sequence[FieldData | None]) -> list[str]:
    return ["plate" if f is None else str(len(f.centers) + 1) for f in fields]


def _try(
    unseen: Problem,
    theta: np.ndarray,
    test: CoefficientData,
    field: FieldData | None,
) -> ResidualModel:
    if field is not None:
        unseen = dataclasses.replace(unseen, field=make_field(field))
    values = corrected_coefficients(test, field)
    return ResidualModel(
        field=field,
        rms=np.sqrt(np.mean((test.measured - values) ** 2, axis=0)),
        errors=measure_errors(unseen, theta)[0],
    )
