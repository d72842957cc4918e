"""Stability and control derivatives of a model, with standard errors.

Coefficients and signs are those of textbooks: lift up, drag against the flight, nose-up
moments, pitch rates and angles positive, and an elevator positive trailing edge down
(elsewhere in this package angles turn the other way, see `glider.physics.state`). The
glider flies through still air without angular acceleration; forces of added mass, which
act on accelerations, are not included. All numbers come from the model's own dynamics,
by complex steps.
"""

import math
import re

import numpy as np

from glider.errors import InputError
from glider.physics.compose import coefficient_slices, initial_extra
from glider.physics.covariance import Covariance
from glider.physics.model import GliderModel
from glider.physics.parameters import NUM_PARAMETERS, PARAMETER_NAMES
from glider.sysid.result import Derivatives, Estimate, ResidualTable

COEFFICIENTS = ("C_L", "C_D", "C_m")
VARIABLES = ("_alpha", "_q", "_delta_e")

_TINY = 1e-30
"""Length of a complex step."""

_PART = 1e-3
"""Step along a coefficient for the propagation of errors, in its standard errors."""

_ROUNDING = 1e-8
"""Relative standard error that is none."""

_V, _ALPHA, _Q, _ELEVATOR, _CLIMB = range(5)
"""Entries of a condition: airspeed [m/s], angle of attack [rad], pitch rate [rad/s],
elevator and angle of climb [rad], all of them with the signs of textbooks."""


def parse_trim(text: str) -> tuple[int, float]:
    """The entry of a condition that a trim fixes, "6.5" [m/s] or "8deg", and its value.

    Raises:
        InputError: it is neither.
    """
    found = re.fullmatch(r"\s*([-+]?[0-9.]+)\s*(deg|m/s|)\s*", text)
    try:
        value = float(found[1]) if found else math.nan
    except ValueError:
        value = math.nan
    if found and found[2] == "deg" and abs(value) < 90.0:
        return _ALPHA, math.radians(value)
    if not (found and found[2] != "deg" and value > 0.0):
        raise InputError(
            f"the trim is '{text}'; expected an airspeed [m/s] such as 6.5, or an "
            "angle of attack such as 8deg."
        )
    return _V, value


def derivatives_of(
    model: GliderModel,
    covariance: Covariance | None,
    flown: ResidualTable,
    trim: str | None = None,
    chord: float | None = None,
) -> Derivatives:
    """The derivatives of a model.

    Args:
        model: of the glider.
        covariance: of what was fitted; all else counts as exact.
        flown: its flights: they are at their median state without a trim, and where
            the glider has no steady glide at that trim.
        trim: of a steady glide, see `parse_trim`.
        chord: reference length [m]; by default the arm of the tail.
    """
    p = model.parameters
    length, name = chord, "chord"
    if length is None:
        length, name = p.hinge_offset + p.elevator_offset, "arm of the tail"
    middle = {n: float(np.nanmedian(v)) for n, v in flown.variables.items()}
    climb = -middle["pitch"] - middle["alpha"]
    condition = np.array(
        [middle["V"], middle["alpha"], 0.0, -middle["elevator"], climb]
    )
    glider = _Glider(model, tuple(middle[n] for n in ("t", "x", "z")), length)
    words = "median state of the flights"
    if trim is not None:
        steady = glider.steady_glide(*parse_trim(trim))
        if steady is None:
            words += f", as the model has no steady glide at {trim}"
        else:
            condition, words = steady, "steady glide"
    values = glider.table(glider.numbers, condition)
    std = glider.errors(condition, covariance).reshape(values.shape)
    std[std < _ROUNDING * np.abs(values)] = 0.0
    names = [c + by for c in COEFFICIENTS for by in ("", *VARIABLES)]
    units = len(COEFFICIENTS) * ("-", "1/rad", "1/rad", "1/rad")
    rows = zip(names, values.flat, std.flat, units, strict=True)
    estimates = {n: Estimate(float(v), float(s), unit) for n, v, s, unit in rows}
    return Derivatives(
        condition=words,
        airspeed_m_s=float(condition[_V]),
        alpha_rad=float(condition[_ALPHA]),
        delta_e_rad=float(condition[_ELEVATOR]),
        area_m2=p.wing_area,
        length_m=length,
        length=name,
        values=estimates,
    )


class _Glider:
    """A model at a time and place, with its coefficients' reference length [m]."""

    def __init__(
        self, model: GliderModel, place: tuple[float, ...], length: float
    ) -> None:
        self.model, self.place, self.length = model, place, length
        numbers = model.numbers
        self.numbers = np.concatenate([numbers.p, numbers.c])

    def _meet(self, numbers: np.ndarray, condition: np.ndarray) -> tuple:
        """Flow, terms of the field, state and coefficients at a condition."""
        chain, (t, x, z) = self.model.chain, self.place
        speed, alpha, q, elevator, climb = condition
        theta = chain.theta_of(numbers, self.model.residual_field)
        velocity = speed * np.cos(climb), speed * np.sin(climb)
        state = [x, z, -climb - alpha, -elevator, *velocity, -q]
        flow = chain.flow_of(chain.motion_of(t, state, 0.0), 0.0, 0.0, theta.p)
        state += initial_extra(self.model.kinds, flow, 0.0, theta.c)
        return flow, chain.residual_terms(flow, theta.field), state, theta.c

    def coefficients(self, numbers: np.ndarray, condition: np.ndarray) -> np.ndarray:
        """C_L, C_D and C_m, referred to the model's nominal wing."""
        flown = self._meet(numbers, condition)
        x, z, moment = self.model.chain.wrench(*flown)[2:5]
        sine, cosine = np.sin(condition[_CLIMB]), np.cos(condition[_CLIMB])
        forces = [z * cosine - x * sine, -x * cosine - z * sine, -moment / self.length]
        p = self.model.parameters
        pressure = 0.5 * p.air_density * p.wing_area * condition[_V] ** 2
        return np.array(forces) / pressure

    def table(self, numbers: np.ndarray, condition: np.ndarray) -> np.ndarray:
        """Coefficients and their derivatives by VARIABLES, (3, 4)."""
        columns = [self.coefficients(numbers, condition)]
        per = {_ALPHA: 1.0, _Q: 2.0 * condition[_V] / self.length, _ELEVATOR: 1.0}
        for entry, size in per.items():
            moved = condition.astype(complex)
            moved[entry] += 1j * _TINY
            slope = np.imag(self.coefficients(numbers, moved)) / _TINY
            columns.append(size * slope)
        return np.stack(columns, axis=1)

    def errors(
        self, condition: np.ndarray, covariance: Covariance | None
    ) -> np.ndarray:
        """Standard errors of `table` (12,), by the delta method; NaN without any."""
        if covariance is None:
            return np.full(12, math.nan)
        slices = coefficient_slices(self.model.kinds)
        std = np.sqrt(np.diag(covariance.matrix))
        slopes = np.zeros((12, len(std)))
        for k, (name, size) in enumerate(zip(covariance.names, std, strict=True)):
            place = self._place(name, slices)
            if place is None or size == 0.0:
                continue
            ends = []
            for step in (_PART * size, -_PART * size):
                moved = self.numbers.copy()
                moved[place] += step
                ends.append(self.table(moved, condition))
            slopes[:, k] = (ends[0] - ends[1]).ravel() / (2.0 * _PART * size)
        return np.sqrt(np.einsum("ij,jk,ik->i", slopes, covariance.matrix, slopes))

    def _place(self, name: str, slices: dict[str, slice]) -> int | None:
        """Where a parameter or an acting coefficient is among the numbers."""
        if name in PARAMETER_NAMES:
            return PARAMETER_NAMES.index(name)
        kind, _, coefficient = name.partition(".")
        for acting in self.model.kinds:
            if acting.kind == kind:
                names = [c.name for c in acting.coefficients]
                return NUM_PARAMETERS + slices[kind].start + names.index(coefficient)
        return None

    def steady_glide(self, entry: int, value: float) -> np.ndarray | None:
        """The condition of a glide without acceleration that has a value in an entry.

        None where there is none with the elevator within its limits.
        """
        from scipy.optimize import root  # It takes a tenth of a second.

        p = self.model.parameters
        weight, arm = p.mass * p.gravity, p.hinge_offset + p.elevator_offset
        speed = math.sqrt(2.0 * weight / (p.air_density * p.wing_area))
        condition = np.array([speed, 0.1, 0.0, 0.0, -0.2])
        condition[entry] = value
        free = [i for i in (_V, _ALPHA, _ELEVATOR, _CLIMB) if i != entry]

        def unbalanced(values: np.ndarray) -> np.ndarray:
            condition[free] = values
            flow, terms, state, c = self._meet(self.numbers, condition)
            *forces, turn = self.model.chain.accelerations(flow, terms, state, c)
            return np.array([*forces, turn * p.pitch_inertia / (p.mass * arm)])

        solution = root(unbalanced, condition[free])
        condition[free] = solution.x
        low, high = p.elevator_limits or (-math.pi / 2.0, math.pi / 2.0)
        possible = condition[_V] > 0.0 and abs(condition[_ALPHA]) < math.pi / 2.0
        if solution.success and possible and low <= -condition[_ELEVATOR] <= high:
            return condition
        return None
