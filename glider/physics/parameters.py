"""The nominal parameters of a glider: names, file and checks."""

import dataclasses
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from glider.errors import InputError, expect, show
from glider.files import schema
from glider.physics.effects.free_functions import Gaussians
from glider.physics.servo import Servo


class Parameters(NamedTuple):
    """The parameters that enter the dynamics, by name, as compiled loops take them.

    Floats, AutoDiffXd, Expression or complex numbers; units as in GliderParameters.
    """

    mass: float
    pitch_inertia: float
    wing_area: float
    elevator_area: float
    wing_offset: float
    hinge_offset: float
    elevator_offset: float
    air_density: float
    gravity: float


class Theta(NamedTuple):
    """All parameters of a glider's dynamics, as compiled loops take them."""

    p: Parameters  #: Parameters of the flat-plate glider.
    c: np.ndarray  #: Coefficients of the acting effects, one effect after the other.
    gaussians: Gaussians  #: Of the free functions.


PARAMETER_NAMES = Parameters._fields
NUM_PARAMETERS = len(PARAMETER_NAMES)


@dataclasses.dataclass(frozen=True, kw_only=True)
class GliderParameters:
    """A rigid glider: a fixed wing plate and a hinged elevator plate.

    The defaults are the glider of the perching and identification notebooks.

    Attributes:
        mass: of the whole glider [kg].
        pitch_inertia: about +y through the center of mass [kg m²].
        wing_area: [m²].
        elevator_area: [m²].
        wing_offset: of the wing's center of pressure, ahead of the center of mass [m].
        hinge_offset: of the elevator's hinge, behind the center of mass [m].
        elevator_offset: of the elevator's center of pressure, behind its hinge [m].
        air_density: [kg/m³].
        gravity: [m/s²].
        elevator_limits: travel, trailing edge down and up [rad]; None if unknown.
        elevator_rate_limit: of the servo, either way [rad/s]; None if unknown.
    """

    mass: float = 0.08
    pitch_inertia: float = 0.0015
    wing_area: float = 0.0885
    elevator_area: float = 0.0147
    wing_offset: float = 0.0
    hinge_offset: float = 0.27
    elevator_offset: float = 0.022
    air_density: float = 1.204
    gravity: float = 9.81
    elevator_limits: list[float] | None = dataclasses.field(
        default_factory=lambda: [-0.4463, 0.9473]
    )
    elevator_rate_limit: float | None = 13.0

    def __post_init__(self):
        """Raises InputError where a value is not physical."""
        check_parameters(vars(self))

    @property
    def servo(self) -> Servo:
        """The limits of the elevator's servo; InputError where they are unknown."""
        if self.elevator_limits is None or self.elevator_rate_limit is None:
            raise InputError(
                "this glider's model has no servo limits; expected elevator_limits and "
                "elevator_rate_limit in its parameters, to plan or to fly with a servo."
            )
        low, high = map(float, self.elevator_limits)
        return Servo(low, high, float(self.elevator_rate_limit))


MAX_ANGLE = 6.3
"""Largest angle [rad]; more are degrees. A full turn, with room for logs that round it:
2 pi in nine digits, as campaigns are written, is more than 2 pi."""

_LEAST_GYRATION = 1 / 20
"""Least radius of gyration √(I/m) over the distance of the elevator's hinge.

Tail and boom alone, 1/400 of the mass at the hinge, have it. Of gliders it is about a
half; a mass in grams divides it by 32, so that such a glider is below."""

_POSITIVE = {"mass", "pitch_inertia", "wing_area", "elevator_area", "air_density"}
_POSITIVE |= {"elevator_rate_limit", "hinge_offset"}  # The tail is behind.


def check_parameters(values: dict) -> None:
    """Raises InputError unless values are physical; those of the servo may be None."""
    for name, value in values.items():
        what = f"field '{name}'"
        if name in ("elevator_limits", "elevator_rate_limit") and value is None:
            continue
        if name == "elevator_limits":
            pair = isinstance(value, (list, tuple)) and len(value) == 2
            rises = pair and all(map(is_number, value)) and value[0] < value[1]
            expect(rises, what, value, "[lower, upper] in radians with lower < upper")
            small = max(map(abs, value)) <= MAX_ANGLE
            expect(small, what, value, "radians (this looks like degrees)")
            continue
        expect(is_number(value), what, value, "a finite number")
        expect(name not in _POSITIVE or value > 0, what, value, "a positive number")
        expect(name != "gravity" or value >= 0, what, value, "a number not negative")


def check_units(values: Mapping[str, Any]) -> None:
    """Raises InputError where parameters cannot be of one glider.

    Its wing lies ahead of its tail; mass, pitch inertia and tail have a possible radius
    of gyration. Only what is given counts: defaults belong to another glider.
    """
    if {"wing_offset", "hinge_offset"} <= values.keys():
        arm = values["hinge_offset"] + values.get("elevator_offset", 0.0)
        wing = values["wing_offset"]
        expected = f"m, less than the {arm:g} to the tail (is it in another unit?)"
        expect(abs(wing) < arm, "field 'wing_offset'", wing, expected)
    if not {"mass", "pitch_inertia", "hinge_offset"} <= values.keys():
        return
    mass, inertia, arm = (
        values[name] for name in ("mass", "pitch_inertia", "hinge_offset")
    )
    found = f"{math.sqrt(inertia / mass):.2g}"
    if float(found) < _LEAST_GYRATION * arm:
        raise InputError(
            f"fields 'mass' and 'pitch_inertia' are {show(mass)} kg and "
            f"{show(inertia)} kg m²: a radius of gyration of {found} m; expected at "
            f"least {_LEAST_GYRATION:.2g} of 'hinge_offset', {show(arm)} m (is the "
            "mass in grams?)."
        )


def is_number(value: object) -> bool:
    """Whether a value is a finite number."""
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        return False
    return math.isfinite(value)


def load_parameters(path: Path | str) -> GliderParameters:
    """Loads a vehicle; a misspelt field or a value out of range is an InputError.

    A file gives only what differs from the article's glider.
    """
    return schema.load_yaml(GliderParameters, path, "a vehicle")
