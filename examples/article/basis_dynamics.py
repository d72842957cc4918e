"""A stand-alone model of accelerations: a few features times coefficients.

The article's first model: along the wing, normal to it and in pitch, each
acceleration is a short sum Σ β_j φ_j of `basis_features`.
"""

import dataclasses

import numpy as np

from basis_features import angle_sign, basis_flow, feature_columns
from glider.errors import InputError
from glider.physics.state import NUM_STATES
from regression import Regression, best_subsets, least_squares

CHANNELS = ("tangential", "normal", "pitch")
"""The accelerations, in their order."""

Numbers = tuple[tuple[int, ...], tuple[int, ...], tuple[int, ...]]
"""Numbers of the features of each of CHANNELS."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class SampledFlights:
    """B flights of N explicit Euler steps.

    Attributes:
        states: (B, N + 1, 7) of STATE_NAMES.
        rates: (B, N) elevator rates, held for a step [rad/s].
        step: [s].
    """

    states: np.ndarray
    rates: np.ndarray
    step: float

    @property
    def accelerations(self) -> np.ndarray:
        """(ẍ, z̈, θ̈) at the start of each step, (B, N, 3) [m/s², rad/s²]."""
        return np.diff(self.states[:, :, 4:], axis=1) / self.step

    @property
    def times(self) -> np.ndarray:
        """(N + 1,) of the states [s]."""
        return self.step * np.arange(self.states.shape[1])

    def pick(self, flights: list[int]) -> "SampledFlights":
        """Returns some of the flights."""
        return dataclasses.replace(
            self, states=self.states[flights], rates=self.rates[flights]
        )


@dataclasses.dataclass(frozen=True, kw_only=True)
class BasisFrame:
    """Frame in which the features and the accelerations are taken.

    Attributes:
        arm: from the center of mass back to the elevator's center [m].
        gravity: [m/s²].
        angles: how the states count angles, a key of `basis_features.ANGLES`.
    """

    arm: float
    gravity: float
    angles: str


@dataclasses.dataclass(frozen=True, kw_only=True)
class BasisDynamics:
    """A glider that accelerates by features times coefficients.

    Attributes:
        numbers: of the features of each channel.
        coefficients: (m,), one channel after the other.
        frame: of both.
    """

    numbers: Numbers
    coefficients: np.ndarray
    frame: BasisFrame


def plane_accelerations(flights: SampledFlights, frame: BasisFrame) -> np.ndarray:
    """Returns accelerations without gravity along and normal to the wing and in pitch.

    ẍ_p = ẍ cos θ + (z̈ + g) sin θ,  z̈_p = -ẍ sin θ + (z̈ + g) cos θ,  θ̈, with θ nose
    up. Shape (B N, 3) [m/s², rad/s²].
    """
    sign = angle_sign(frame.angles)
    pitch = sign * flights.states[:, :-1, 2]
    x, z, turn = np.moveaxis(flights.accelerations, -1, 0)
    sine, cosine, z = np.sin(pitch), np.cos(pitch), z + frame.gravity
    along, normal = x * cosine + z * sine, z * cosine - x * sine
    return np.stack([along, normal, sign * turn], axis=-1).reshape(-1, 3)


def sampled_features(
    flights: SampledFlights, frame: BasisFrame, numbers: tuple[int, ...]
) -> np.ndarray:
    """Returns features at the start of each step, (B N, len(numbers))."""
    flow = basis_flow(flights.states[:, :-1], flights.rates, frame.arm, frame.angles)
    return feature_columns(flow, numbers).reshape(-1, len(numbers))


@dataclasses.dataclass(frozen=True, kw_only=True)
class BasisFit:
    """A model fitted to accelerations, and the regression of each channel."""

    model: BasisDynamics
    regressions: tuple[Regression, ...]

    @property
    def score(self) -> float:
        """Sum of the squared errors of all channels, units mixed as published."""
        return float(sum(r.squared_error for r in self.regressions))


def fit_basis(
    flights: SampledFlights, frame: BasisFrame, numbers: Numbers, ridge: float = 0.0
) -> BasisFit:
    """Fits the coefficients of chosen features to the accelerations of flights.

    Features that the flights do not distinguish are fitted all the same: the
    regressions' ranks show it.

    Args:
        flights: to fit.
        frame: of the model.
        numbers: of the features of each channel.
        ridge: as in `least_squares`.

    Raises:
        InputError: a channel has no features, or as `least_squares`.
    """
    for channel, chosen in zip(CHANNELS, numbers, strict=True):
        if not chosen:
            raise InputError(
                f"fit_basis: the {channel} channel has no features; expected at least "
                "one."
            )
    targets = plane_accelerations(flights, frame)
    regressions = tuple(
        least_squares(sampled_features(flights, frame, chosen), target, ridge)
        for chosen, target in zip(numbers, targets.T, strict=True)
    )
    coefficients = np.concatenate([r.coefficients for r in regressions])
    model = BasisDynamics(numbers=numbers, coefficients=coefficients, frame=frame)
    return BasisFit(model=model, regressions=regressions)


def best_numbers(
    flights: SampledFlights, frame: BasisFrame, features: tuple[int, ...], most: int = 3
) -> Numbers:
    """Returns the features that leave the least squared error in each channel.

    Args:
        flights: to fit.
        frame: of the model.
        features: numbers to choose among.
        most: features a channel, 1 to 3.
    """
    columns = sampled_features(flights, frame, features)
    subsets = best_subsets(columns, plane_accelerations(flights, frame), most)
    along, normal, pitch = (
        tuple(features[j] for j in subset.columns) for subset in subsets
    )
    return along, normal, pitch


def basis_rollouts(
    model: BasisDynamics,
    start: np.ndarray,
    rates: np.ndarray,
    step: float,
    coefficients: np.ndarray | None = None,
) -> np.ndarray:
    """Flies a model by explicit Euler steps.

    A flight that diverges holds numbers that are not finite.

    Args:
        model: to fly.
        start: (B, 7) launch states.
        rates: (B, N) elevator rates [rad/s].
        step: [s].
        coefficients: (..., m), real or complex, in place of the model's own.

    Returns:
        States (..., B, N + 1, 7).
    """
    given = model.coefficients if coefficients is None else coefficients
    batch = (*given.shape[:-1], *start.shape)
    states = np.empty((rates.shape[1] + 1, *batch), np.result_type(given, start))
    states[0] = start
    with np.errstate(all="ignore"):
        for k in range(rates.shape[1]):
            slopes = _slopes(model, states[k], rates[:, k], given)
            states[k + 1] = states[k] + step * slopes
    return np.moveaxis(states, 0, -2)


def fly_again(model: BasisDynamics, flights: SampledFlights) -> np.ndarray:
    """Flies a model from flights' launches under their rates, (B, N + 1, 7)."""
    return basis_rollouts(model, flights.states[:, 0], flights.rates, flights.step)


def _slopes(
    model: BasisDynamics, states: np.ndarray, rates: np.ndarray, given: np.ndarray
) -> np.ndarray:
    sign = angle_sign(model.frame.angles)
    flow = basis_flow(states, rates, model.frame.arm, model.frame.angles)
    every = tuple(number for chosen in model.numbers for number in chosen)
    terms = feature_columns(flow, every) * given[..., None, :]
    ends = np.cumsum([len(chosen) for chosen in model.numbers])[:-1]
    along, normal, turn = (part.sum(axis=-1) for part in np.split(terms, ends, axis=-1))
    pitch = sign * states[..., 2]
    sine, cosine = np.sin(pitch), np.cos(pitch)
    slopes = np.empty(states.shape, states.dtype)
    slopes[..., :3] = states[..., 4:]
    slopes[..., 3] = rates
    slopes[..., 4] = along * cosine - normal * sine
    slopes[..., 5] = along * sine + normal * cosine - model.frame.gravity
    slopes[..., NUM_STATES - 1] = sign * turn
    return slopes
