"""Cruise: steady straight flight, and the infinite-horizon LQR that holds it.

A glider without thrust holds no height: its cruise is a straight glide down. The
regulator therefore holds the line and the speed, not the place along the line.
"""

import dataclasses
import math

import numpy as np
from pydrake.systems.controllers import LinearQuadraticRegulator
from pydrake.systems.framework import OutputPortSelection
from pydrake.systems.primitives import AffineSystem, FirstOrderTaylorApproximation
from scipy.optimize import least_squares

from glider.errors import InputError, show
from glider.physics.model import GliderModel
from glider.systems.plant import GliderPlant

_LARGEST_ACCELERATION = 1e-8
"""Largest acceleration of a trim [m/s², rad/s²]."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Trim:
    """A steady straight flight through the origin."""

    state: np.ndarray
    """(n,) with the effects' own states."""

    @property
    def speed(self) -> float:
        """Speed over ground [m/s]."""
        return math.hypot(*self.state[4:6])

    @property
    def slope(self) -> float:
        """Angle of the path, positive when it climbs [rad]."""
        return math.atan2(self.state[5], self.state[4])


@dataclasses.dataclass(frozen=True, kw_only=True)
class CruiseWeights:
    """Weights of the cruise regulator; the effects' own states weigh nothing."""

    state: tuple[float, ...] = (10.0, 10.0, 1.0, 1.0, 1.0, 1.0)
    """Weights of the distance from the line [m], then of pitch, elevator, xdot, zdot
    and pitchdot."""

    rate: float = 0.1
    """Weight of the elevator-rate command."""

    def __post_init__(self):
        """Raises InputError where Riccati's equation would have no solution."""
        values = np.asarray(self.state, dtype=float)
        if values.shape != (6,) or not np.all(np.isfinite(values) & (values >= 0.0)):
            raise InputError(
                f"CruiseWeights: 'state' is {show(self.state)}; 6 finite numbers, none "
                "negative, are needed."
            )
        if not (math.isfinite(self.rate) and self.rate > 0.0):
            raise InputError(
                f"CruiseWeights: 'rate' is {show(self.rate)}; a positive number is "
                "needed."
            )


def find_trim(model: GliderModel, speed: float | None = None) -> Trim:
    """Finds pitch, elevator and velocity without acceleration at rate 0.

    Args:
        model: the glider.
        speed: of the flight [m/s], on the slope that results; None for level
            flight at the speed that results, which needs thrust.

    Raises:
        InputError: no such flight is found within the elevator's travel.
    """
    if speed is not None and not (math.isfinite(speed) and speed > 0.0):
        raise InputError(
            f"The speed is {show(speed)} m/s; a positive number is needed."
        )
    p = model.parameters
    v = 7.0 if speed is None else speed
    alpha = min(p.mass * p.gravity / (p.air_density * p.wing_area * v * v), 0.6)

    theta, derivatives = model.numbers, model.chain.derivatives

    def state_of(unknown):
        pitch, elevator, last = unknown
        if speed is None:
            velocity = (last, 0.0)
        else:
            velocity = (speed * math.cos(last), speed * math.sin(last))
        return model.initial_state([0.0, 0.0, pitch, elevator, *velocity, 0.0])

    def accelerations(unknown):
        rates = derivatives(0.0, state_of(unknown), 0.0, 0.0, 0.0, theta)
        return np.array(rates[4:7])

    if speed is None:
        guess, low, high = [-alpha, alpha, v], [-0.7, -1.5, 0.5], [0.7, 1.5, 60.0]
    else:
        guess, low, high = [0.0, alpha, -alpha], [-1.5] * 3, [1.5] * 3
    found = least_squares(
        accelerations, guess, bounds=(low, high), xtol=1e-15, ftol=1e-15, gtol=1e-15
    )
    state = state_of(found.x)
    worst = float(np.max(np.abs(accelerations(found.x))))
    down, up, _ = p.servo
    if worst > _LARGEST_ACCELERATION or not down <= state[3] <= up:
        what = "level flight" if speed is None else f"flight at {speed:g} m/s"
        raise InputError(
            f"No steady {what} was found: the best has an acceleration of "
            f"{worst:.2g} at an elevator of {state[3]:.3f} rad; its travel is "
            f"{down:.3f} to {up:.3f}."
        )
    return Trim(state=state)


def cruise_regulator(
    model: GliderModel, trim: Trim, weights: CruiseWeights | None = None
) -> AffineSystem:
    """Makes the System u = -K (x - x_trim), without the place along the line.

    The error is e = T (x - x_trim): the distance n · (x, z) from the line with
    its normal n = (-sin γ, cos γ), then all states but x and z.

    Args:
        model: the glider.
        trim: what to hold, of `find_trim`.
        weights: None for the defaults.

    Returns:
        An AffineSystem "regulator" from the state (n,) to the command (1,).

    Raises:
        InputError: the glider does not fly alike all along the line.
    """
    weights = CruiseWeights() if weights is None else weights
    n = len(trim.state)
    plant = GliderPlant(model, fast=False)  # Differentiated once: not worth compiling.
    context = plant.CreateDefaultContext()
    context.SetContinuousState(trim.state)
    port = plant.GetInputPort("elevator_rate")
    port.FixValue(context, [0.0])
    linear = FirstOrderTaylorApproximation(
        plant, context, port.get_index(), OutputPortSelection.kNoOutput
    )
    A, B = linear.A(), linear.B()
    cosine, sine = math.cos(trim.slope), math.sin(trim.slope)
    if np.max(np.abs(A[:, :2] @ [cosine, sine])) > _LARGEST_ACCELERATION:
        raise InputError(
            "The glider's dynamics change along the line; no cruise is steady there."
        )
    T = np.zeros((n - 1, n))
    T[0, :2] = -sine, cosine
    T[1:, 2:] = np.eye(n - 2)
    Q = np.diag(np.append(weights.state, np.zeros(n - 1 - len(weights.state))))
    try:
        # T has orthonormal rows, so that its transpose leads back.
        K, _ = LinearQuadraticRegulator(T @ A @ T.T, T @ B, Q, [[weights.rate]])
    except RuntimeError as error:
        raise InputError(f"The cruise cannot be held: {error}") from None
    gain = K @ T
    regulator = AffineSystem(D=-gain, y0=gain @ trim.state)
    regulator.set_name("regulator")
    return regulator
