"""The residual field: Gaussian basis functions where no library effect fits.

This is the article's learned residual of C_L, C_D and C_M (kind
``rbf_residual``), generalised: it may depend on any of FIELD_VARIABLES, and it
may also be a motion of the air that varies in space or time. The tracer carries
what it cannot identify (kind ``unexplained``) as such a field.
"""

import dataclasses
from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np

from glider.errors import expect
from glider.physics.aerodynamics import angle_of_attack, tail_load
from glider.physics.formulas import exp, scalar

FIELD_UNITS = {
    **{"x": "m", "z": "m", "t": "s", "pitch": "rad", "V": "m/s", "alpha": "rad"},
    **{"pitchdot": "rad/s", "elevator": "rad", "elevator_rate": "rad/s"},
    **{"tail_load": "Pa", "reduced_rate": "rad/m"},
}
"""Variables that a field may depend on, and their units; see `tail_load`.

The reduced rate is the pitch rate over the airspeed, of which it counts 0.5 m/s at
least: what a turn adds to the angle of attack along a wing.
"""

FIELD_VARIABLES = tuple(FIELD_UNITS)

_LEAST_SPEED = 0.5  # That reduced rates are over, at rest [m/s].

AIR_TERMS = ("wind_x", "wind_z")
"""Velocity of the air, world [m/s]."""

COEFFICIENTS = ("c_lift", "c_drag", "c_moment")
"""Coefficients referred to ½ ρ V² S_w, the moment without a chord [-, -, m]."""

_TAIL_TERMS = ("elevator_factor", "tail_downwash", "tail_angle")
"""Relative change of the elevator's force [-]; angle by which the stream at the tail is
turned down, as by the wing's downwash; angle that is added to the elevator's [rad]."""

_WING_TERMS = ("wing_factor", "c_normal")
"""Relative change of the wing's force; coefficient of its normal force [-]."""

_BODY_TERMS = ("push", "c_axial")
"""Force forward along the body axis over the mass [m/s²]; coefficient of one backward,
referred to ½ ρ V² S_w [-]."""

INERTIA_TERMS = ("added_mass", "added_inertia")
"""Mass of the air that moves with the wing along its normal, over the glider's, and its
pitch inertia, over the glider's [-, -]."""

SENSOR_TERMS = ("pose_x", "pose_z", "pose_pitch")
"""Measured minus true pose [m, m, rad], over _SENSOR_VARIABLES alone."""

_SENSOR_VARIABLES = "x", "z", "pitch"

FIELD_TERMS = (
    *(*AIR_TERMS, *COEFFICIENTS, *_TAIL_TERMS, *_WING_TERMS, *_BODY_TERMS),
    *INERTIA_TERMS,
    *SENSOR_TERMS,
)

TERM_UNITS = {
    **{"wind_x": "m/s", "wind_z": "m/s", "c_moment": "m", "tail_downwash": "rad"},
    **{"tail_angle": "rad", "push": "m/s²"},
    **dict(zip(SENSOR_TERMS, ("m", "m", "rad"), strict=True)),
}
"""Units of the terms that have one."""


class Field(NamedTuple):
    """A sum of Gaussian basis functions, as arrays that numba takes.

    term_k = Σ_m weights[k, m] exp(-½ Σ_d ((ξ_d - centers[d, m]) inverse_widths[d, m])²)

    Functions are along the rows, for compiled code to take several at once.
    """

    centers: np.ndarray  #: (v, M), in the order of FIELD_VARIABLES.
    #: (v, M), zero where the function does not depend on the variable; a column of
    #: zeros is a constant.
    inverse_widths: np.ndarray
    #: (17, M), in the order of FIELD_TERMS; functions with air come first.
    weights: np.ndarray
    num_airs: int  #: Number of functions that move the air.
    #: (v + 1, 18), of constants alone (1, 18), or of length zero, of what is added as
    #: linear about a point: its variables in the first column, slopes of the terms
    #: along them in the others, and values there in the last row.
    tangent: np.ndarray = np.zeros((0, 1 + len(FIELD_TERMS)))


NO_FIELD = Field(
    np.zeros((len(FIELD_VARIABLES), 0)),
    np.zeros((len(FIELD_VARIABLES), 0)),
    np.zeros((len(FIELD_TERMS), 0)),
    0,
)


@scalar
def field_variables(flow):
    """Returns the values of FIELD_VARIABLES in a flow."""
    return (
        flow.x,
        flow.z,
        flow.t + 0.0 * flow.speed,
        flow.pitch,
        flow.speed,
        angle_of_attack(flow.sin_alpha, flow.cos_alpha),
        flow.pitchdot,
        flow.elevator,
        flow.elevator_rate + 0.0 * flow.speed,
        tail_load(flow),
        flow.pitchdot / np.sqrt(flow.speed * flow.speed + _LEAST_SPEED**2),
    )


@scalar
def basis_function(variables, field, m):
    """Returns a basis function of a field at its variables."""
    exponent = 0.0 * variables[0]
    for d in range(len(variables)):
        if field.inverse_widths[d, m] != 0.0:
            scaled = (variables[d] - field.centers[d, m]) * field.inverse_widths[d, m]
            exponent = exponent - 0.5 * scaled * scaled
    return exp(exponent)


@scalar
def field_air(flow, field):
    """Returns the velocity of a field's air, world (x, z) [m/s]."""
    wind_x = wind_z = 0.0 * flow.speed
    if field.num_airs > 0:
        variables = field_variables(flow)
        for m in range(field.num_airs):
            basis = basis_function(variables, field, m)
            wind_x = wind_x + basis * field.weights[0, m]
            wind_z = wind_z + basis * field.weights[1, m]
    if field.tangent.shape[0] > 0:
        variables = field_variables(flow)
        last = field.tangent.shape[0] - 1
        for d in range(last + 1):
            slopes = field.tangent[d]
            apart = 1.0
            if d < last:
                apart = variables[d] - slopes[0]
            wind_x = wind_x + apart * slopes[1]
            wind_z = wind_z + apart * slopes[2]
    return wind_x, wind_z


@scalar
def field_terms(flow, field):
    """Returns the values of FIELD_TERMS in a flow, but for the air's."""
    lift = drag = moment = tail = 0.0 * flow.speed
    turn = angle = wing = normal = push = axial = 0.0 * flow.speed
    mass = inertia = 0.0 * flow.speed
    pose_x = pose_z = pose_pitch = 0.0 * flow.speed
    if field.weights.shape[1] > 0:
        variables = field_variables(flow)
        for m in range(field.weights.shape[1]):
            basis = basis_function(variables, field, m)
            lift = lift + basis * field.weights[2, m]
            drag = drag + basis * field.weights[3, m]
            moment = moment + basis * field.weights[4, m]
            tail = tail + basis * field.weights[5, m]
            turn = turn + basis * field.weights[6, m]
            angle = angle + basis * field.weights[7, m]
            wing = wing + basis * field.weights[8, m]
            normal = normal + basis * field.weights[9, m]
            push = push + basis * field.weights[10, m]
            axial = axial + basis * field.weights[11, m]
            mass = mass + basis * field.weights[12, m]
            inertia = inertia + basis * field.weights[13, m]
            pose_x = pose_x + basis * field.weights[14, m]
            pose_z = pose_z + basis * field.weights[15, m]
            pose_pitch = pose_pitch + basis * field.weights[16, m]
    if field.tangent.shape[0] > 0:
        variables = field_variables(flow)
        last = field.tangent.shape[0] - 1
        for d in range(last + 1):
            slopes = field.tangent[d]
            apart = 1.0
            if d < last:
                apart = variables[d] - slopes[0]
            lift = lift + apart * slopes[3]
            drag = drag + apart * slopes[4]
            moment = moment + apart * slopes[5]
            tail = tail + apart * slopes[6]
            turn = turn + apart * slopes[7]
            angle = angle + apart * slopes[8]
            wing = wing + apart * slopes[9]
            normal = normal + apart * slopes[10]
            push = push + apart * slopes[11]
            axial = axial + apart * slopes[12]
            mass = mass + apart * slopes[13]
            inertia = inertia + apart * slopes[14]
    wrenches = lift, drag, moment, tail, turn, angle, wing, normal, push, axial
    return (*wrenches, mass, inertia, pose_x, pose_z, pose_pitch)


@dataclasses.dataclass(kw_only=True)
class FieldData:
    """A field as it stands in a model file: plain lists of numbers by name."""

    kind: str = "rbf_residual"  #: "rbf_residual" or "unexplained".
    #: Names in FIELD_VARIABLES that it depends on.
    variables: list[str] = dataclasses.field(default_factory=list)
    #: One row a basis function, one column a variable.
    centers: list[list[float]] = dataclasses.field(default_factory=list)
    #: Standard deviation of the Gaussians in each variable, or of each Gaussian.
    widths: list[float | list[float]] = dataclasses.field(default_factory=list)
    constant: bool = False  #: Whether the last row of weights is of a constant.
    #: Name in FIELD_TERMS to one weight a basis function.
    weights: dict[str, list[float]] = dataclasses.field(default_factory=dict)
    #: Further fields over other variables that add to it.
    more: list["FieldData"] = dataclasses.field(default_factory=list)


def of_sensors(field: Field) -> Field:
    """Returns the part of a field that sensors read."""
    return _part(field, slice(-len(SENSOR_TERMS), None))


def of_motion(field: Field) -> Field:
    """Returns the part of a field that moves the glider."""
    return _part(field, slice(-len(SENSOR_TERMS)))


def _part(field: Field, terms: slice) -> Field:
    """Returns the basis functions of a field that some terms have."""
    acts = field.weights[terms].any(axis=0)
    return field if acts.all() else _of_functions(field, np.flatnonzero(acts))


def _of_functions(field: Field, which: np.ndarray) -> Field:
    """Returns some basis functions of a field, those with air first."""
    is_air = np.any(field.weights[: len(AIR_TERMS), which], axis=0)
    which = np.concatenate([which[is_air], which[~is_air]])
    return field._replace(
        centers=field.centers.take(which, 1),
        inverse_widths=field.inverse_widths.take(which, 1),
        weights=field.weights.take(which, 1),
        num_airs=int(is_air.sum()),
    )


def gaussians(
    field: Field, variables: Sequence[int] | np.ndarray, values: np.ndarray
) -> np.ndarray:
    """Returns the basis functions (N, M) at values (N, d) of some of FIELD_VARIABLES.

    `variables` are d indices into FIELD_VARIABLES, all that the field depends on.
    """
    scaled = values[:, :, None] - field.centers[variables]
    scaled = scaled * field.inverse_widths[variables]
    return np.exp(-0.5 * np.sum(scaled**2, axis=1))


def joined(parts: Iterable[Field]) -> Field:
    """Returns the sum of fields, each basis function of theirs once."""
    parts = [*parts]
    centers = np.hstack([part.centers for part in parts])
    inverse_widths = np.hstack([part.inverse_widths for part in parts])
    _, first, which = np.unique(
        np.vstack([centers, inverse_widths]),
        axis=1,
        return_index=True,
        return_inverse=True,
    )
    weights = np.zeros((len(FIELD_TERMS), len(first)))
    added = np.hstack([part.weights for part in parts])
    np.add.at(weights.T, which.ravel(), added.T)
    unique = Field(centers.take(first, 1), inverse_widths.take(first, 1), weights, 0)
    return _of_functions(unique, np.argsort(first))  # Else as they were.


def make_field(data: FieldData) -> Field:
    """Returns the arrays of a field; raises InputError where it is malformed."""
    field = f"field '{data.kind}'"
    names = dict.fromkeys(data.variables, FIELD_VARIABLES)
    for name, known in (names | dict.fromkeys(data.weights, FIELD_TERMS)).items():
        expect(name in known, f"{field}: a name", name, f"one of {', '.join(known)}")
    read = [name for name in SENSOR_TERMS if name in data.weights]
    if read:
        others = sorted({*data.variables} - {*_SENSOR_VARIABLES})
        expect(not others, f"{field}: variables of {read[0]}", others, "x, z and pitch")
    needed = (
        f"one width > 0 for each of {', '.join(data.variables)}, or for each center"
    )
    good = len(data.widths) == len(data.variables)
    expect(good, f"{field}: widths", data.widths, needed)
    for own in data.widths:  # NaN is refused below.
        good = not isinstance(own, list) or len(own) == len(data.centers)
        good = good and not np.any(np.less_equal(own, 0.0))
        expect(good, f"{field}: widths", own, needed)
    count = len(data.centers) + data.constant
    centers = np.zeros((len(FIELD_VARIABLES), count))
    inverse_widths = np.zeros_like(centers)
    rows = [FIELD_VARIABLES.index(name) for name in data.variables]
    for m, center in enumerate(data.centers):
        good = len(center) == len(rows)
        needed = f"{len(rows)} numbers"
        expect(good, f"{field}: center {m}", center, needed)
        centers[rows, m] = center
    for row, own in zip(rows, data.widths, strict=True):
        inverse_widths[row, : len(data.centers)] = 1.0 / np.asarray(own)
    weights = np.zeros((len(FIELD_TERMS), count))
    for name, values in data.weights.items():
        good = len(values) == count
        expect(good, f"{field}: '{name}'", values, f"{count} weights")
        weights[FIELD_TERMS.index(name)] = values
    whole = joined(
        [Field(centers, inverse_widths, weights, 0), *map(make_field, data.more)]
    )
    for name, array in zip(("centers", "widths", "weights"), whole[:3], strict=True):
        expect(np.isfinite(array).all(), f"{field}: {name}", array, "finite numbers")
    return whole
