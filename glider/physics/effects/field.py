"""Free functions: effects whose coefficient is a sum of Gaussians, not a number.

This is the article's learned residual of C_L, C_D and C_M (kind
``rbf_residual``), generalised: it may depend on any of FIELD_VARIABLES, and it
may also be a motion of the air that varies in space or time. The tracer carries
what it cannot identify (kind ``unexplained``) as such a field.
"""

import dataclasses
from collections.abc import Callable, Iterable
from typing import NamedTuple

import numpy as np

from glider.errors import expect
from glider.physics.aerodynamics import angle_of_attack, tail_load
from glider.physics.effects.effect import Coefficient, EffectKind, constant
from glider.physics.effects.wrench import dynamic_pressure_area
from glider.physics.formulas import exp, scalar

FIELD_UNITS = {
    "x": "m",
    "z": "m",
    "t": "s",
    "pitch": "rad",
    "pitchdot": "rad/s",
    "elevator": "rad",
    "elevator_rate": "rad/s",
    "V": "m/s",
    "alpha": "rad",
    "tail_load": "Pa",
    "reduced_rate": "rad/m",
}
"""Variables that a free function may depend on, those of the motion first, and units.

The reduced rate is the pitch rate over the airspeed, of which it counts 0.5 m/s at
least: what a turn adds to the angle of attack along a wing. See also `tail_load`.
"""

FIELD_VARIABLES = tuple(FIELD_UNITS)

_OF_MOTION = FIELD_VARIABLES[:7]  # What the air may vary with.
_OF_POSE = ("x", "z", "pitch")  # What the error of a reading may vary with.

_LEAST_SPEED = 0.5  # That reduced rates are over, at rest [m/s].

COEFFICIENTS = ("c_lift", "c_drag", "c_moment")
"""Coefficients referred to ½ ρ V² S_w, the moment without a chord [-, -, m]."""


@scalar
def _lift(flow, value):
    """It turns the velocity up."""
    size = value * dynamic_pressure_area(flow)
    return -size * flow.air_z, size * flow.air_x


@scalar
def _drag(flow, value):
    size = -value * dynamic_pressure_area(flow)
    return size * flow.air_x, size * flow.air_z


@scalar
def _moment(flow, value):
    return value * dynamic_pressure_area(flow) * flow.speed


@scalar
def _push(flow, value):
    force = flow.mass * value
    return force * flow.cos_pitch, -force * flow.sin_pitch


@scalar
def _axial_force(flow, value):
    force = -value * dynamic_pressure_area(flow) * flow.speed
    return force * flow.cos_pitch, -force * flow.sin_pitch


@scalar
def _downwash(flow, value):
    return value * flow.speed


@scalar
def _added_mass(flow, value):
    return flow.mass * value


@scalar
def _added_inertia(flow, value):
    return flow.pitch_inertia * value


def _free_function(
    kind: str,
    unit: str,
    spread: float,
    stage: str,
    adds_to: tuple[str, ...],
    words: str,
    formula: Callable = constant,
) -> EffectKind:
    """Returns an effect whose coefficient is a function of the flow, not a number.

    `spread` is what is expected of the function before any flight: a tenth of a flat
    plate's largest coefficients, half of a tail's force, a fifth of a wing's, a tenth
    of the weight, of mass and inertia, of a reading what a wide lens or a tilted axis
    does.
    """
    value = Coefficient("value", unit, scale=spread, lower=-1e3, upper=1e3)
    return EffectKind(
        kind=kind,
        stage=stage,
        adds_to=adds_to,
        coefficients=(value,),
        formula=formula,
        words=words,
    )


_FORCE = ("force_x", "force_z")

_KINDS = (
    _free_function(
        "wind_x", "m/s", 0.5, "air", ("wind_x",), "air along x that changes"
    ),
    _free_function(
        "wind_z", "m/s", 0.5, "air", ("wind_z",), "air along z that changes"
    ),
    _free_function(
        "c_lift", "-", 0.2, "wrench", _FORCE, "a lift across the stream", _lift
    ),
    _free_function("c_drag", "-", 0.2, "wrench", _FORCE, "a drag that changes", _drag),
    _free_function(
        "c_moment", "m", 0.01, "wrench", ("moment",), "a moment that changes", _moment
    ),
    _free_function(
        "elevator_factor",
        "-",
        0.5,
        "surface",
        ("elevator_factor",),
        "a tail's force that changes",
    ),
    _free_function(
        "tail_downwash",
        "rad",
        0.2,
        "geometry",
        ("downwash",),
        "a stream at the tail that turns",
        _downwash,
    ),
    _free_function(
        "tail_angle", "rad", 0.2, "geometry", ("elevator_trim",), "a tail that turns"
    ),
    _free_function(
        "wing_factor",
        "-",
        0.2,
        "surface",
        ("wing_factor",),
        "a wing's force that changes",
    ),
    _free_function(
        "c_normal", "-", 0.2, "surface", ("wing_normal",), "a lift that changes"
    ),
    _free_function(
        "push",
        "m/s²",
        1.0,
        "wrench",
        _FORCE,
        "a push along the body axis that changes",
        _push,
    ),
    _free_function(
        "c_axial",
        "-",
        0.2,
        "wrench",
        _FORCE,
        "an axial force that changes",
        _axial_force,
    ),
    _free_function(
        "added_mass",
        "-",
        0.1,
        "inertia",
        ("added_mass",),
        "an added mass that changes",
        _added_mass,
    ),
    _free_function(
        "added_inertia",
        "-",
        0.1,
        "inertia",
        ("added_inertia",),
        "an added inertia that changes",
        _added_inertia,
    ),
    _free_function(
        "pose_x",
        "m",
        0.05,
        "sensor",
        ("pose_x",),
        "an error of the measured x that changes",
    ),
    _free_function(
        "pose_z",
        "m",
        0.05,
        "sensor",
        ("pose_z",),
        "an error of the measured z that changes",
    ),
    _free_function(
        "pose_pitch",
        "rad",
        0.05,
        "sensor",
        ("pose_pitch",),
        "an error of the measured pitch that changes",
    ),
)

FREE_FUNCTIONS = {kind.kind: kind for kind in _KINDS}
"""Effects whose coefficient is a free function, by name: one a link of the force chain.

Coefficients refer to ½ ρ V² S_w. A push is over the mass, a stream at the tail is
turned down as by the wing's downwash, factors are relative changes of a force, added
mass and inertia are over the glider's own, and what is read is the measured minus the
true pose.
"""

FIELD_TERMS = tuple(FREE_FUNCTIONS)

GROUPS = {
    "air": ("air",),
    "body": ("geometry", "surface", "wrench", "inertia"),
    "sensor": ("sensor",),
}
"""Stages of the free functions that are evaluated together, in their order."""


def rows_of(group: str) -> list[int]:
    """Returns the places of a group's kinds in FREE_FUNCTIONS."""
    stages = GROUPS[group]
    return [i for i, kind in enumerate(_KINDS) if kind.stage in stages]


AIR_TERMS = tuple(FIELD_TERMS[i] for i in rows_of("air"))
SENSOR_TERMS = tuple(FIELD_TERMS[i] for i in rows_of("sensor"))


class Field(NamedTuple):
    """The numbers of a glider's free functions, as arrays that numba takes.

    value_k = Σ_m weights[k, m] exp(-½ Σ_d z_dm²),
    z_dm = (ξ_d - centers[d, m]) inverse_widths[d, m]

    Gaussians are along the rows, for compiled code to take several at once: those of
    the air first, then those that act on the body, then those that sensors show.
    """

    centers: np.ndarray  #: (v, M), in the order of FIELD_VARIABLES.
    #: (v, M), zero where the Gaussian does not depend on the variable; a column of
    #: zeros is a constant.
    inverse_widths: np.ndarray
    weights: np.ndarray  #: (17, M), in the order of FREE_FUNCTIONS.
    num_air: int  #: Number of Gaussians that move the air.
    num_flown: int  #: Number of those, and of the ones that act on the body.
    #: (v + 1, 18), of constants alone (1, 18), or of length zero, of what is added as
    #: linear about a point: its variables in the first column, slopes of the values
    #: along them in the others, and values there in the last row.
    tangent: np.ndarray = np.zeros((0, 1 + len(FIELD_TERMS)))


NO_FIELD = Field(
    np.zeros((len(FIELD_VARIABLES), 0)),
    np.zeros((len(FIELD_VARIABLES), 0)),
    np.zeros((len(FIELD_TERMS), 0)),
    0,
    0,
)


@scalar
def motion_variables(motion):
    """Returns the values of those of FIELD_VARIABLES that a Motion has."""
    return (
        motion.x,
        motion.z,
        motion.t + 0.0 * motion.xdot,
        motion.pitch,
        motion.pitchdot,
        motion.elevator,
        motion.elevator_rate + 0.0 * motion.xdot,
    )


@scalar
def field_variables(flow):
    """Returns the values of FIELD_VARIABLES in a flow."""
    return (
        *motion_variables(flow),
        flow.speed,
        angle_of_attack(flow.sin_alpha, flow.cos_alpha),
        tail_load(flow),
        flow.pitchdot / np.sqrt(flow.speed * flow.speed + _LEAST_SPEED**2),
    )


@scalar
def basis_function(variables, field, m):
    """Returns a Gaussian of a field at the first of its variables."""
    exponent = 0.0 * variables[0]
    for d in range(len(variables)):
        if field.inverse_widths[d, m] != 0.0:
            scaled = (variables[d] - field.centers[d, m]) * field.inverse_widths[d, m]
            exponent = exponent - 0.5 * scaled * scaled
    return exp(exponent)


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


def gaussian(values: np.ndarray, centers: np.ndarray, widths: np.ndarray) -> np.ndarray:
    """Returns Gaussians (n, M) about centers (M, d) at values (n, d)."""
    squares = np.zeros((len(values), len(centers)))
    for own, center, width in zip(values.T, centers.T, widths.T, strict=True):
        apart = own[:, None] - center  # In place: pairs of variables have many.
        apart /= width
        apart *= apart
        squares += apart
    squares *= -0.5
    return np.exp(squares, out=squares)


def gaussians(data: FieldData, values: np.ndarray) -> np.ndarray:
    """Returns the basis functions (N, M) at values (N, d) of the data's variables."""
    centers = np.array(data.centers).reshape(-1, len(data.variables))
    widths = [np.full(len(centers), own) for own in data.widths]
    found = gaussian(values, centers, np.reshape(widths, (-1, len(centers))).T)
    return np.hstack([found, np.ones((len(values), int(data.constant)))])


def joined(parts: Iterable[Field]) -> Field:
    """Returns the sum of fields, each Gaussian that a group of theirs has once."""
    parts = [*parts]
    shapes = np.vstack(
        [
            np.hstack([part.centers for part in parts]),
            np.hstack([part.inverse_widths for part in parts]),
        ]
    )
    added = np.hstack([part.weights for part in parts])
    kept = []
    weights = []
    ends = []
    for group in GROUPS:
        rows = rows_of(group)
        acts = np.flatnonzero(added[rows].any(axis=0))
        own, first, which = np.unique(
            shapes[:, acts], axis=1, return_index=True, return_inverse=True
        )
        total = np.zeros((len(first), len(FIELD_TERMS)))
        of_group = np.zeros((len(acts), len(FIELD_TERMS)))
        of_group[:, rows] = added[rows][:, acts].T
        np.add.at(total, which.ravel(), of_group)
        order = np.argsort(first)  # Else as they were.
        kept.append(own[:, order])
        weights.append(total[order].T)
        ends.append(len(first))
    centers, inverse_widths = np.split(np.hstack(kept), 2)
    return Field(
        np.ascontiguousarray(centers),
        np.ascontiguousarray(inverse_widths),
        np.ascontiguousarray(np.hstack(weights)),
        ends[0],
        ends[0] + ends[1],
    )


def make_field(data: FieldData) -> Field:
    """Returns the arrays of a field; raises InputError where it is malformed."""
    field = f"field '{data.kind}'"
    names = dict.fromkeys(data.variables, FIELD_VARIABLES)
    for name, known in (names | dict.fromkeys(data.weights, FIELD_TERMS)).items():
        expect(name in known, f"{field}: a name", name, f"one of {', '.join(known)}")
    for terms, allowed in ((SENSOR_TERMS, _OF_POSE), (AIR_TERMS, _OF_MOTION)):
        own = [name for name in terms if name in data.weights]
        others = [name for name in data.variables if name not in allowed]
        needed = f"some of {', '.join(allowed)}"
        what = f"{field}: variables of {', '.join(own)}"
        expect(not own or not others, what, others, needed)
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
    arrays = {"centers": centers, "widths": inverse_widths, "weights": weights}
    for name, array in arrays.items():
        expect(np.isfinite(array).all(), f"{field}: {name}", array, "finite numbers")
    own = Field(centers, inverse_widths, weights, 0, 0)
    return joined([own, *map(make_field, data.more)])
