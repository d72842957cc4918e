"""Free functions: effects whose coefficient is a sum of Gaussians, not a number.

Each link of the force chain has one, which adds to the same terms as the library's
effects; what it is of a flow stands in the numbers of a model, not in the text of its
formula. So is the article's learned residual of C_L, C_D and C_M (kind
``rbf_residual``), and what the tracer cannot identify (kind ``unexplained``).
"""

import dataclasses
from collections.abc import Callable, Iterable
from typing import NamedTuple

import numpy as np

from glider.errors import expect
from glider.physics.aerodynamics import angle_of_attack, tail_load
from glider.physics.effects.effect import Coefficient, EffectKind, constant
from glider.physics.effects.wrench import (
    PITCH_MOMENT,
    PROFILE_DRAG,
    dynamic_pressure_area,
)
from glider.physics.formulas import exp, scalar

FLOW_UNITS = {
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

FLOW_VARIABLES = tuple(FLOW_UNITS)

_OF_MOTION = FLOW_VARIABLES[:7]  # What the air may vary with.
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
    stage: str,
    unit: str,
    spread: float,
    words: str,
    adds_to: tuple[str, ...] = (),
    formula: Callable = constant,
) -> EffectKind:
    """Returns an effect whose coefficient is a function of the flow, not a number.

    It adds to the term of its name unless told otherwise. `spread` is what is expected
    of the function before any flight: a tenth of a flat plate's largest coefficients,
    half of a tail's force, a fifth of a wing's, a tenth of the weight, of mass and
    inertia, of a reading what a wide lens or a tilted axis does.
    """
    value = Coefficient("value", unit, scale=spread, lower=-1e3, upper=1e3)
    return EffectKind(
        kind=kind,
        stage=stage,
        adds_to=adds_to or (kind,),
        coefficients=(value,),
        formula=formula,
        words=words,
        is_free=True,
    )


_FORCE = ("force_x", "force_z")
_DRAG = PROFILE_DRAG.formula
_MOMENT = PITCH_MOMENT.formula

_KINDS = (
    _free_function("wind_x", "air", "m/s", 0.5, "air along x that changes"),
    _free_function("wind_z", "air", "m/s", 0.5, "air along z that changes"),
    _free_function("c_lift", "wrench", "-", 0.2, "a lift force", _FORCE, _lift),
    _free_function("c_drag", "wrench", "-", 0.2, "a drag that changes", _FORCE, _DRAG),
    _free_function(
        "c_moment", "wrench", "m", 0.01, "a moment that changes", ("moment",), _MOMENT
    ),
    _free_function(
        "elevator_factor", "surface", "-", 0.5, "a tail's force that changes"
    ),
    _free_function(
        "tail_downwash",
        "geometry",
        "rad",
        0.2,
        "a stream at the tail that turns",
        ("downwash",),
        _downwash,
    ),
    _free_function(
        "tail_angle", "geometry", "rad", 0.2, "a tail that turns", ("elevator_trim",)
    ),
    _free_function("wing_factor", "surface", "-", 0.2, "a wing's force that changes"),
    _free_function(
        "c_normal", "surface", "-", 0.2, "a lift that changes", ("wing_normal",)
    ),
    _free_function(
        "push",
        "wrench",
        "m/s²",
        1.0,
        "a push along the body axis that changes",
        _FORCE,
        _push,
    ),
    _free_function(
        "c_axial",
        "wrench",
        "-",
        0.2,
        "an axial force that changes",
        _FORCE,
        _axial_force,
    ),
    _free_function(
        "added_mass",
        "inertia",
        "-",
        0.1,
        "an added mass that changes",
        formula=_added_mass,
    ),
    _free_function(
        "added_inertia",
        "inertia",
        "-",
        0.1,
        "an added inertia that changes",
        formula=_added_inertia,
    ),
    _free_function(
        "pose_x", "sensor", "m", 0.05, "an error of the measured x that changes"
    ),
    _free_function(
        "pose_z", "sensor", "m", 0.05, "an error of the measured z that changes"
    ),
    _free_function(
        "pose_pitch",
        "sensor",
        "rad",
        0.05,
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

ROWS = {name: row for row, name in enumerate(FREE_FUNCTIONS)}
"""Their rows in arrays."""

GROUPS = {
    "air": ("air",),
    "body": ("geometry", "surface", "wrench", "inertia"),
    "sensor": ("sensor",),
}
"""Stages of the free functions that are evaluated together, in their order."""


def _rows_of(group: str) -> list[int]:
    """Returns the places of a group's kinds in FREE_FUNCTIONS."""
    stages = GROUPS[group]
    return [i for i, kind in enumerate(_KINDS) if kind.stage in stages]


AIR_TERMS = tuple(_KINDS[i].kind for i in _rows_of("air"))
SENSOR_TERMS = tuple(_KINDS[i].kind for i in _rows_of("sensor"))


class Gaussians(NamedTuple):
    """The numbers of a glider's free functions, as arrays that numba takes.

    value_k = Σ_m weights[k, m] exp(-½ Σ_d z_dm²),
    z_dm = (ξ_d - centers[d, m]) inverse_widths[d, m]

    Gaussians are along the rows, for compiled code to take several at once: those of
    the air first, then those that act on the body, then those that sensors show.
    """

    centers: np.ndarray  #: (v, M), in the order of FLOW_VARIABLES.
    #: (v, M), zero where the Gaussian does not depend on the variable; a column of
    #: zeros is a constant.
    inverse_widths: np.ndarray
    weights: np.ndarray  #: (17, M), in the order of FREE_FUNCTIONS.
    num_air: int  #: Number of Gaussians that move the air.
    num_flown: int  #: Number of those, and of the ones that act on the body.
    #: (v + 1, 18), of constants alone (1, 18), or of length zero, of what is added as
    #: linear about a point: its variables in the first column, slopes of the values
    #: along them in the others, and values there in the last row.
    tangent: np.ndarray = np.zeros((0, 1 + len(_KINDS)))


NO_GAUSSIANS = Gaussians(
    np.zeros((len(FLOW_VARIABLES), 0)),
    np.zeros((len(FLOW_VARIABLES), 0)),
    np.zeros((len(_KINDS), 0)),
    0,
    0,
)


@scalar
def motion_variables(motion):
    """Returns the values of those of FLOW_VARIABLES that a Motion has."""
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
def flow_variables(flow):
    """Returns the values of FLOW_VARIABLES in a flow."""
    return (
        *motion_variables(flow),
        flow.speed,
        angle_of_attack(flow.sin_alpha, flow.cos_alpha),
        tail_load(flow),
        flow.pitchdot / np.sqrt(flow.speed * flow.speed + _LEAST_SPEED**2),
    )


@scalar
def basis_function(variables, gaussians, m):
    """Returns a Gaussian at the first of its variables."""
    exponent = 0.0 * variables[0]
    for d in range(len(variables)):
        per = gaussians.inverse_widths[d, m]
        if per != 0.0:
            scaled = (variables[d] - gaussians.centers[d, m]) * per
            exponent = exponent - 0.5 * scaled * scaled
    return exp(exponent)


@dataclasses.dataclass(kw_only=True)
class FreeFunction:
    """Gaussians over some variables, and their weights in one free function or several.

    As it stands in a model file: plain lists of numbers by name.
    """

    kind: str = "rbf_residual"  #: "rbf_residual" or "unexplained".
    #: Names in FLOW_VARIABLES that it depends on.
    variables: list[str] = dataclasses.field(default_factory=list)
    #: One row a Gaussian, one column a variable.
    centers: list[list[float]] = dataclasses.field(default_factory=list)
    #: Standard deviation of the Gaussians in each variable, or of each Gaussian.
    widths: list[float | list[float]] = dataclasses.field(default_factory=list)
    constant: bool = False  #: Whether the last weight is of a constant.
    #: Name in FREE_FUNCTIONS to one weight a Gaussian.
    weights: dict[str, list[float]] = dataclasses.field(default_factory=dict)

    def basis(self, values: np.ndarray) -> np.ndarray:
        """Returns Gaussians and constant (N, M) at values (N, d) of the variables."""
        shape = len(self.centers), len(self.variables)
        centers = np.reshape(self.centers, shape)
        widths = [np.full(len(centers), own) for own in self.widths]
        found = gaussian(values, centers, np.reshape(widths, shape[::-1]).T)
        return np.hstack([found, np.ones((len(values), int(self.constant)))])


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


def gaussians_of(functions: Iterable[FreeFunction]) -> Gaussians:
    """Returns the arrays of free functions, each Gaussian of a group once.

    Raises:
        InputError: one is malformed.
    """
    functions = [*functions]
    if not functions:
        return NO_GAUSSIANS
    parts = [_arrays_of(function) for function in functions]
    shapes = np.hstack([shape for shape, _ in parts])
    weights = np.hstack([own for _, own in parts])
    found = []
    for group in GROUPS:
        rows = _rows_of(group)
        acts = np.flatnonzero(weights[rows].any(axis=0))
        _, first, which = np.unique(
            shapes[:, acts], axis=1, return_index=True, return_inverse=True
        )
        total = np.zeros((len(weights), len(first)))
        for row in rows:
            np.add.at(total[row], which.ravel(), weights[row, acts])
        order = np.argsort(first)  # Else as they were.
        found.append((shapes[:, acts[first[order]]], total[:, order]))
    centers, inverse_widths = np.split(np.hstack([shape for shape, _ in found]), 2)
    counts = [own.shape[1] for _, own in found]
    return Gaussians(
        np.ascontiguousarray(centers),
        np.ascontiguousarray(inverse_widths),
        np.ascontiguousarray(np.hstack([own for _, own in found])),
        counts[0],
        counts[0] + counts[1],
    )


def _arrays_of(function: FreeFunction) -> tuple[np.ndarray, np.ndarray]:
    """Returns centers above inverse widths (2 v, M), and weights (17, M)."""
    _check(function)
    rows = [FLOW_VARIABLES.index(name) for name in function.variables]
    count = len(function.centers)
    centers = np.zeros((len(FLOW_VARIABLES), count + function.constant))
    inverse_widths = np.zeros_like(centers)
    for m, center in enumerate(function.centers):
        centers[rows, m] = center
    for row, width in zip(rows, function.widths, strict=True):
        inverse_widths[row, :count] = 1.0 / np.asarray(width)
    weights = np.zeros((len(_KINDS), centers.shape[1]))
    for name, own in function.weights.items():
        weights[ROWS[name]] = own
    arrays = {"centers": centers, "widths": inverse_widths, "weights": weights}
    for name, array in arrays.items():
        what = f"free function '{function.kind}': {name}"
        expect(bool(np.isfinite(array).all()), what, array, "finite numbers")
    return np.vstack([centers, inverse_widths]), weights


def _check(function: FreeFunction) -> None:
    """Raises InputError where a name is unknown or a length does not fit."""
    what = f"free function '{function.kind}'"
    known = dict.fromkeys(function.variables, FLOW_VARIABLES)
    for name, names in (known | dict.fromkeys(function.weights, ROWS)).items():
        needed = f"one of {', '.join(names)}"
        expect(name in names, f"{what}: a name", name, needed)
    for terms, allowed in ((SENSOR_TERMS, _OF_POSE), (AIR_TERMS, _OF_MOTION)):
        own = [name for name in terms if name in function.weights]
        others = [name for name in function.variables if name not in allowed]
        needed = f"some of {', '.join(allowed)}"
        varied = f"{what}: variables of {', '.join(own)}"
        expect(not own or not others, varied, others, needed)
    needed = (
        f"one width > 0 for each of {', '.join(function.variables)}, or for each center"
    )
    good = len(function.widths) == len(function.variables)
    expect(good, f"{what}: widths", function.widths, needed)
    for width in function.widths:  # NaN is refused below.
        good = not isinstance(width, list) or len(width) == len(function.centers)
        good = good and not np.any(np.less_equal(width, 0.0))
        expect(good, f"{what}: widths", width, needed)
    for m, center in enumerate(function.centers):
        good = len(center) == len(function.variables)
        needed = f"{len(function.variables)} numbers"
        expect(good, f"{what}: center {m}", center, needed)
    count = len(function.centers) + function.constant
    for name, weights in function.weights.items():
        good = len(weights) == count
        expect(good, f"{what}: '{name}'", weights, f"{count} weights")
