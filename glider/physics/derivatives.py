"""Stability and control derivatives of a glider.

Signs are those of textbooks: lift up, drag against the flight, nose-up moments, pitch
rates and angles, and an elevator with its trailing edge down are positive (elsewhere
angles turn the other way, see `glider.physics.state`). All numbers come from the
model's dynamics in still air, without the forces of added mass on accelerations.
"""

import math
from typing import NamedTuple

import numpy as np

from glider.physics.compose import initial_extra
from glider.physics.covariance import Covariance
from glider.physics.model import GliderModel

_TINY = 1e-30  # Length of a complex step.
_PART = 1e-3  # Step along a fitted number, in its standard errors.
_ROUNDING = 1e-8  # Relative standard error that is none.


class Condition(NamedTuple):
    """A state in which derivatives are taken [SI]."""

    airspeed: float
    alpha: float
    pitch_rate: float
    elevator: float
    climb: float  #: Angle of the path.
    time: float
    x: float
    z: float


def calc_derivatives(
    model: GliderModel, at: Condition, length: float, covariance: Covariance | None
) -> tuple[np.ndarray, np.ndarray]:
    """C_L, C_D, C_m, each with its slopes by α, q l/2V and δ_e, and their errors.

    Standard errors, to first order, are NaN without a covariance; `length` is l [m].
    """
    numbers = model.vector
    values = _table(model, at, length, numbers)
    if covariance is None:
        return values, np.full(values.shape, math.nan)
    index = model.space.index
    steps = _PART * covariance.std
    slopes = np.zeros((len(values), len(steps)))
    for k, (name, size) in enumerate(zip(covariance.names, steps, strict=True)):
        if name in index and size > 0.0:
            step = size * (np.arange(len(numbers)) == index[name])
            ends = (_table(model, at, length, numbers + s) for s in (step, -step))
            slopes[:, k] = np.subtract(*ends) / 2.0 / size
    std = np.sqrt(np.einsum("ij,jk,ik->i", slopes, covariance.matrix, slopes))
    return values, np.where(std < _ROUNDING * np.abs(values), 0.0, std)


def _meet(model: GliderModel, numbers: np.ndarray, at: Condition) -> tuple:
    """Flow, values of free functions, state and coefficients at a condition."""
    chain = model.chain
    theta = chain.theta_of(numbers, model.gaussians)
    velocity = at.airspeed * np.cos(at.climb), at.airspeed * np.sin(at.climb)
    turned = -at.climb - at.alpha, -at.elevator
    state = [at.x, at.z, *turned, *velocity, -at.pitch_rate]
    flow = chain.flow_of(chain.motion_of(at.time, state, 0.0), 0.0, 0.0, theta.p)
    state += initial_extra(model.kinds, flow, 0.0, theta.c)
    return flow, chain.body_values(flow, theta.gaussians), state, theta.c


def _table(
    model: GliderModel, at: Condition, length: float, numbers: np.ndarray
) -> np.ndarray:
    """The derivatives (12,) with other numbers of the model."""
    p = model.parameters
    speed = at.airspeed
    pressure = 0.5 * p.air_density * p.wing_area * speed**2
    sine = np.sin(at.climb)
    cosine = np.cos(at.climb)
    columns = []
    for name in ("alpha", "pitch_rate", "elevator"):
        moved = at._replace(**{name: getattr(at, name) + 1j * _TINY})
        x, z, moment = model.chain.wrench(*_meet(model, numbers, moved))[2:5]
        forces = [z * cosine - x * sine, -x * cosine - z * sine, -moment / length]
        per = 2.0 * speed / length if name == "pitch_rate" else 1.0
        columns.append(per / _TINY * np.imag(forces))
    return np.transpose([np.real(forces), *columns]).ravel() / pressure


def find_steady_glide(model: GliderModel, speed: float, at: Condition) -> Condition:
    """A glide without acceleration at an airspeed, at the time and place given.

    The condition itself where there is none with the elevator within its limits.
    """
    from scipy.optimize import root  # It takes a tenth of a second.

    p = model.parameters
    steady = at._replace(airspeed=speed, pitch_rate=0.0)
    numbers = model.vector
    arm = p.hinge_offset + p.elevator_offset

    def flown(values: np.ndarray) -> Condition:
        alpha, elevator, climb = values
        return steady._replace(alpha=alpha, elevator=elevator, climb=climb)

    def unbalanced(values: np.ndarray) -> np.ndarray:
        met = _meet(model, numbers, flown(values))
        *forces, turn = model.chain.accelerations(*met)
        return np.array([*forces, turn * p.pitch_inertia / (p.mass * arm)])

    solution = root(unbalanced, [0.1, 0.0, -0.2])
    alpha, elevator, _ = solution.x
    low, high = p.elevator_limits or (-math.pi / 2.0, math.pi / 2.0)
    is_flown = low <= -elevator <= high and abs(alpha) < math.pi / 2.0
    return flown(solution.x) if solution.success and is_flown else at
