"""A study of what a learned residual is worth on flights that it has not seen."""

import dataclasses
from collections.abc import Sequence

import numpy as np
from threadpoolctl import threadpool_limits

from coefficients import (
    RIDGE,
    CoefficientData,
    coefficient_data,
    corrected_coefficients,
    fit_residual,
    residual_basis,
)
from glider.campaign.logs import Campaign, Flight, split_flights
from glider.errors import InputError
from glider.physics.effects.free_functions import (
    COEFFICIENTS,
    FreeFunction,
    gaussians_of,
)
from glider.sysid.fit.prediction import RolloutModel, measure_errors
from glider.sysid.likelihood.scales import start_scales
from glider.sysid.replay.record import Noise, Record, measure_noise, prepare
from glider.sysid.replay.vehicle import Vehicle, make_vehicle
from glider.sysid.result import Errors

WORDS = {"plate": "flat plate", "26": "26 weights", "126": "126 weights"}
"""Names of the models for people."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class ResidualModel:
    """One model of the coefficients, and its errors on flights that it has not seen.

    Attributes:
        residual: its free functions; None for the flat plate alone.
        rms: (3,) RMS error of COEFFICIENTS.
        errors: of accelerations and of free rollouts.
    """

    residual: FreeFunction | None
    rms: np.ndarray
    errors: Errors

    def key_figures(self) -> dict[str, object]:
        """Returns its errors, for a file."""
        return {
            **dict(zip(COEFFICIENTS, self.rms.tolist(), strict=True)),
            "equation": dataclasses.asdict(self.errors.equation),
            "rollout": dataclasses.asdict(self.errors.rollout),
        }


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

    def key_figures(self) -> dict[str, object]:
        """Returns rows of flights and what each model errs by, for a file."""
        fitted, held_out = (len(data.plate) for data in (self.fitted, self.held_out))
        return {
            "rows": {"fitted": fitted, "held_out": held_out},
            "models": {name: m.key_figures() for name, m in self.models.items()},
        }

    def describe(self) -> str:
        """Returns a line for each model."""
        return "\n".join(
            f"{WORDS[name]}: C_L {model.rms[0]:.3f}, C_D {model.rms[1]:.3f}, "
            f"C_M {model.rms[2]:.4f} m off (RMS); rollouts "
            f"{1000 * model.errors.position_rms_m:.0f} mm"
            for name, model in self.models.items()
        )


def learn_residuals(
    campaign: Campaign, held_out: float = 0.3, seed: int = 0, ridge: float = RIDGE
) -> ResidualStudy:
    """Fits 26 weights a coefficient, and 126 with airspeed, to a campaign's flights.

    The centers in airspeed span what the fitted flights flew, but for a hundredth at
    either end.

    Args:
        campaign: whose nominal model is known, with a servo.
        held_out: share of the flights that errors are measured on.
        seed: of the split.
        ridge: γ.

    Raises:
        InputError: the nominal model or the elevator is not known, or the split fails.
    """
    vehicle = make_vehicle(campaign)
    if not vehicle.is_known or campaign.elevator != "servo":
        raise InputError(
            f"{campaign.path}: coefficients need all parameters of the vehicle and "
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
    fitting, unseen = (prepare(flights, campaign, noise) for flights in split)
    data = coefficient_data(fitting, vehicle.theta)
    test = coefficient_data(unseen, vehicle.theta)
    low, high = np.quantile(data.variables["V"], [0.01, 0.99])
    bases = (residual_basis(), residual_basis((float(low), float(high))))
    fields = [None, *(fit_residual(data, basis, ridge) for basis in bases)]
    models = [_try(unseen, vehicle.theta, noise, test, field) for field in fields]
    return ResidualStudy(
        fitted=data,
        held_out=test,
        unseen=split[1],
        models=dict(zip(_names(fields), models, strict=True)),
    )


def _names(fields: Sequence[FreeFunction | None]) -> list[str]:
    return ["plate" if f is None else str(len(f.centers) + 1) for f in fields]


def _try(
    unseen: Sequence[Record],
    theta: np.ndarray,
    noise: Noise,
    test: CoefficientData,
    residual: FreeFunction | None,
) -> ResidualModel:
    functions = [] if residual is None else [residual]
    flown = RolloutModel(
        theta=theta,
        gaussians=gaussians_of(functions),
        scales=start_scales(noise),
        per_flight_trims=False,
    )
    flown = flown.on(unseen)
    values = corrected_coefficients(test, residual)
    return ResidualModel(
        residual=residual,
        rms=np.sqrt(np.mean((test.measured - values) ** 2, axis=0)),
        errors=measure_errors(flown, unseen),
    )
