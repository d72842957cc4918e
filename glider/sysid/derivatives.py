"""Stability and control derivatives of a model, with standard errors.

Signs are those of textbooks: lift up, drag against the flight, nose-up moments, pitch
rates and angles, and an elevator with its trailing edge down are positive (elsewhere
angles turn the other way, see `glider.physics.state`). All numbers come from the
model's dynamics in still air, without the forces of added mass on accelerations.
"""

import dataclasses
import functools
import itertools
import math
from collections.abc import Callable

import numpy as np

from glider.physics.compose import initial_extra
from glider.physics.covariance import Covariance
from glider.physics.model import GliderModel
from glider.physics.parameters import PARAMETER_NAMES
from glider.sysid.result import Derivatives, Estimate, Result

_TINY = 1e-30  # Length of a complex step.
_PART = 1e-3  # Step along a fitted number, in its standard errors.
_ROUNDING = 1e-8  # Relative standard error that is none.
# A condition: airspeed, angle of attack, pitch rate, elevator, climb, time, x, z [SI].
_V, _ALPHA, _Q, _ELEVATOR, _CLIMB, *_PLACE = range(8)


def with_derivatives(
    result: Result, trim: float | None = None, chord: float | None = None
) -> Result:
    """A result with the derivatives of its corrected model.

    Args:
        result: of closing the loop.
        trim: airspeed of the steady glide that they are taken at [m/s]. They are at
            the median state of the flights without one, and where there is no such
            glide.
        chord: reference length [m]; by default the arm of the tail.
    """
    model, p = result.model, result.model.parameters
    length = chord or p.hinge_offset + p.elevator_offset
    flown = result.residual_after.variables
    middle = {n: float(np.nanmedian(v)) for n, v in flown.items()}
    airspeed, alpha, *place = (middle[n] for n in ("V", "alpha", "t", "x", "z"))
    attitude = -middle["elevator"], -middle["pitch"] - alpha
    condition = np.array([airspeed, alpha, 0.0, *attitude, *place])
    words = "median state of the flights"
    if trim is not None:
        steady = _steady_glide(model, trim, condition[_PLACE])
        if steady is None:
            words += f", as the model has no steady glide at {trim:g} m/s"
        else:
            condition, words = steady, "steady glide"
    table = functools.partial(_table, model, condition, length)
    values = table(np.concatenate(model.numbers[:2]))
    std = np.full(values.shape, math.nan)
    if result.covariance is not None:
        std = _errors(model, table, result.covariance)
        std[std < _ROUNDING * np.abs(values)] = 0.0
    columns = {"": "-", "_alpha": "1/rad", "_q": "1/rad", "_delta_e": "1/rad"}
    names = itertools.product(("C_L", "C_D", "C_m"), columns.items())
    rows = zip(names, values.tolist(), std.tolist(), strict=True)
    found = Derivatives(
        condition=words,
        airspeed_m_s=float(condition[_V]),
        alpha_rad=float(condition[_ALPHA]),
        delta_e_rad=float(condition[_ELEVATOR]),
        area_m2=p.wing_area,
        length_m=length,
        length="chord" if chord else "arm of the tail",
        values={c + by: Estimate(v, s, unit) for (c, (by, unit)), v, s in rows},
    )
    return dataclasses.replace(result, derivatives=found)


def _errors(
    model: GliderModel,
    table: Callable[[np.ndarray], np.ndarray],
    covariance: Covariance,
) -> np.ndarray:
    """Standard errors of a table of the model's numbers, to first order."""
    numbers = np.concatenate(model.numbers[:2])
    fitted = [*PARAMETER_NAMES]
    fitted += [f"{e.kind}.{c.name}" for e in model.kinds for c in e.coefficients]
    steps = _PART * np.sqrt(np.diag(covariance.matrix))
    slopes = np.zeros((table(numbers).size, len(steps)))
    for k, (name, size) in enumerate(zip(covariance.names, steps, strict=True)):
        if name in fitted and size > 0.0:
            step = size * (np.arange(len(numbers)) == fitted.index(name))
            slopes[:, k] = (table(numbers + step) - table(numbers - step)) / 2.0 / size
    return np.sqrt(np.einsum("ij,jk,ik->i", slopes, covariance.matrix, slopes))


def _meet(model: GliderModel, numbers: np.ndarray, condition: np.ndarray) -> tuple:
    """Flow, terms of the field, state and coefficients at a condition."""
    speed, alpha, q, elevator, climb, t, x, z = condition
    chain = model.chain
    theta = chain.theta_of(numbers, model.residual_field)
    velocity = speed * np.cos(climb), speed * np.sin(climb)
    state = [x, z, -climb - alpha, -elevator, *velocity, -q]
    flow = chain.flow_of(chain.motion_of(t, state, 0.0), 0.0, 0.0, theta.p)
    state += initial_extra(model.kinds, flow, 0.0, theta.c)
    return flow, chain.residual_terms(flow, theta.field), state, theta.c


def _table(
    model: GliderModel, condition: np.ndarray, length: float, numbers: np.ndarray
) -> np.ndarray:
    """C_L, C_D and C_m, each with its derivatives by α, q l/2V and δ_e, (12,)."""
    p = model.parameters
    pressure = 0.5 * p.air_density * p.wing_area * condition[_V] ** 2
    sine, cosine = np.sin(condition[_CLIMB]), np.cos(condition[_CLIMB])
    columns = []
    for entry in (_ALPHA, _Q, _ELEVATOR):
        moved = condition + 1j * _TINY * (np.arange(8) == entry)
        x, z, moment = model.chain.wrench(*_meet(model, numbers, moved))[2:5]
        forces = [z * cosine - x * sine, -x * cosine - z * sine, -moment / length]
        per = 2.0 * condition[_V] / length if entry == _Q else 1.0
        columns.append(per / _TINY * np.imag(forces))
    return np.transpose([np.real(forces), *columns]).ravel() / pressure


def _steady_glide(
    model: GliderModel, speed: float, place: np.ndarray
) -> np.ndarray | None:
    """The condition of a glide without acceleration at an airspeed.

    None where there is none with the elevator within its limits.
    """
    from scipy.optimize import root  # It takes a tenth of a second.

    p, free = model.parameters, [_ALPHA, _ELEVATOR, _CLIMB]
    condition = np.array([speed, 0.1, 0.0, 0.0, -0.2, *place])
    numbers, arm = np.concatenate(model.numbers[:2]), p.hinge_offset + p.elevator_offset

    def unbalanced(values: np.ndarray) -> np.ndarray:
        condition[free] = values
        met = _meet(model, numbers, condition)
        *forces, turn = model.chain.accelerations(*met)
        return np.array([*forces, turn * p.pitch_inertia / (p.mass * arm)])

    solution = root(unbalanced, condition[free])
    alpha, elevator, _ = condition[free] = solution.x
    low, high = p.elevator_limits or (-math.pi / 2.0, math.pi / 2.0)
    is_flown = low <= -elevator <= high and abs(alpha) < math.pi / 2.0
    return condition if solution.success and is_flown else None
