"""Schema of campaign.yaml and of a MAP file: a vehicle, and how its logs are mapped.

A mapping: which columns of a log are which quantities, in which units and axes.
"""

import dataclasses
import math
from pathlib import Path
from typing import Any

import numpy as np

from glider.campaign.importing.recording import UNITS, Unit, scale_of
from glider.campaign.logs import Campaign, ServoLog
from glider.errors import InputError, expect, printable, show
from glider.files import schema
from glider.physics.parameters import PARAMETER_NAMES, check_parameters, check_units

QUANTITIES = {
    "time": "time",
    "position": "length",
    "attitude": "angle",
    "x": "length",
    "y": "length",
    "z": "length",
    "roll": "angle",
    "pitch": "angle",
    "yaw": "angle",
    "elevator": "angle",
    "elevator_rate_command": "rate",
    "elevator_angle_command": "angle",
}
"""Quantities that `columns:` may name, and the kind of unit of each."""

AXES = tuple(sign + axis for axis in "xyz" for sign in ("", "-"))
_PRESETS: dict[str, dict[str, str]] = {
    "NED": {"up": "-z", "nose": "x", "top": "-z", "pitch": "nose_up"},
    "ENU": {"up": "z", "nose": "x", "top": "z", "pitch": "nose_down"},
}
_ELEVATOR = ("trailing_edge_up", "trailing_edge_down")
EULER = ("roll", "pitch", "yaw")  #: About x, y and z.
SHAPES = {
    "attitude": ("012345678", "xyzw", "0123", "xyz", "012"),
    "position": ("xyz", "012"),
}
"""Axes that the columns of a vector may have: letters, or indices."""
INSTEAD = dict.fromkeys("xyz", "position") | dict.fromkeys(EULER, "attitude")
"""Quantities that make others needless."""
_ROTATIONS = ("wxyz", "xyzw", "rotation_vector")
FRAME_CHOICES = {
    "up": (AXES, "the axis of the log that points up"),
    "forward": ((*AXES, "throw"), "the axis of the log along the throw"),
    "nose": (AXES, "the axis of the body that points to the nose"),
    "top": (AXES, "the axis of the body that points up in level flight"),
    "pitch": (("nose_down", "nose_up"), "where a positive pitch turns the nose"),
    "elevator": (_ELEVATOR, "where a positive elevator turns its trailing edge"),
    "command": (_ELEVATOR, "where a positive command turns the trailing edge"),
}
"""Values that a field of `frame:` may have, and what it means."""


Names = str | list[str]  # Columns of a vector: their common name, or all names.


@dataclasses.dataclass(frozen=True, kw_only=True)
class Markers:
    """Points of the glider that give its attitude: the pitch is that of tail to nose.

    With left and right the roll is known, too; without them it is taken for zero. Of a
    video they have two axes, and no left and right.
    """

    nose: Names
    tail: Names
    left: Names | None = None
    right: Names | None = None

    def __post_init__(self):
        """Raises InputError where one wing tip is missing."""
        if (self.left is None) != (self.right is None):
            one = "columns: attitude has one of 'left' and 'right'"
            raise InputError(f"{one}; expected both, or neither.")


_Known: Any = dataclasses.make_dataclass(
    "_Known",
    [(name, float | None, None) for name in PARAMETER_NAMES],
    frozen=True,
    kw_only=True,
)


@dataclasses.dataclass(frozen=True, kw_only=True)
class Frame:
    """Axes and signs of a log; "" stands for those of the preset `axes`.

    What the fields mean is in FRAME_CHOICES; `rotation` is how an attitude is logged.
    """

    axes: str = "ENU"
    up: str = ""
    forward: str | None = None
    nose: str = ""
    top: str = ""
    pitch: str = ""
    elevator: str = "trailing_edge_up"
    command: str = ""
    rotation: str | None = None
    tracked_point: list[float] = dataclasses.field(default_factory=lambda: [0.0, 0.0])

    def __post_init__(self):
        """Fills in the preset; InputError for what cannot be."""
        presets = "NED, ENU, or the axes by name: up, forward, nose, top"
        expect(self.axes in _PRESETS, "frame: field 'axes'", self.axes, presets)
        for name, value in (_PRESETS[self.axes] | {"command": self.elevator}).items():
            if not getattr(self, name) and name != "pitch":
                object.__setattr__(self, name, value)
        for name, (values, meaning) in FRAME_CHOICES.items():
            value = getattr(self, name) or values[0]
            expected = f"{meaning}, one of {', '.join(values)}"
            expect(value in values, f"frame: field '{name}'", value, expected)
        turn = self.rotation or "wxyz"
        known = turn in _ROTATIONS or "".join(sorted(turn)) in ("XYZ", "xyz")
        expected = f"an order of Euler angles, as ZYX, or {', '.join(_ROTATIONS)}"
        expect(known, "frame: field 'rotation'", turn, expected)
        for one, other in (("up", "forward"), ("nose", "top")):
            axes = [getattr(self, one), getattr(self, other) or "throw"]
            what = f"frame: [{one}, {other}]"
            expect(axes[0][-1] != axes[1][-1], what, axes, "two different axes")
        point = self.tracked_point
        expected = "[ahead, above] of the mass center in m"
        known = len(point) == 2 and all(map(math.isfinite, point))
        expect(known, "frame: field 'tracked_point'", point, expected)

    @property
    def usual_pitch(self) -> str:
        """What a positive pitch means where the frame does not specify it."""
        return _PRESETS[self.axes]["pitch"]

    @property
    def turns_pitch(self) -> bool:
        """Whether Euler angles' pitch is the opposite of a turn about the body's y."""
        nose_moves = np.cross(unit_vector("y"), unit_vector(self.nose))
        up = float(nose_moves @ unit_vector(self.top))
        axes = "nose and top along x and z of the body"
        expect(up or not self.pitch, "frame: field 'pitch'", self.pitch, axes)
        return self.pitch not in ("", "nose_up" if up > 0.0 else "nose_down")

    @property
    def body(self) -> np.ndarray:
        """Rows nose, left and top in the body's axes as they are logged (3, 3)."""
        nose = unit_vector(self.nose)
        top = unit_vector(self.top)
        return np.stack([nose, np.cross(top, nose), top])


@dataclasses.dataclass(frozen=True)
class ColumnMapping:
    """How a log becomes flights."""

    source: str  #: The file that says so.
    columns: dict[str, Names | Markers]  #: By quantity.
    units: dict[str, Unit]  #: By quantity or kind.
    frame: Frame
    clock: str | float | None  #: "same", "find", an offset [s]; None: by the files.
    join: tuple[str, ...]  #: Patterns of files that make one recording.


def unit_vector(axis: str) -> np.ndarray:
    """An axis such as "-z" as a unit vector (3,)."""
    sign = -1.0 if axis.startswith("-") else 1.0
    return sign * np.eye(3)["xyz".index(axis[-1])]


@dataclasses.dataclass(frozen=True, kw_only=True)
class Vehicle(_Known):
    """What is known of a glider, in SI units; None: unknown."""

    elevator_limits: list[float] | None = None
    elevator_rate_limit: float | None = None
    elevator: str = "servo"

    def __post_init__(self):
        """Raises InputError where a value cannot be."""
        kinds = ("servo", "fixed", "fixed_per_flight")
        known = self.elevator in kinds
        expect(known, "field 'elevator' of vehicle", self.elevator, ", ".join(kinds))
        names = (*PARAMETER_NAMES, "elevator_limits", "elevator_rate_limit")
        given = {name: getattr(self, name) for name in names}
        given = {name: value for name, value in given.items() if value is not None}
        check_parameters(given)
        check_units(given)


@dataclasses.dataclass(frozen=True, kw_only=True)
class Settings:
    """Fields of campaign.yaml, or of a MAP file."""

    vehicle: Vehicle = Vehicle()
    pose_rate: float | None = None
    command_rate: float | None = None
    servo: ServoLog = ServoLog()
    notes: list[str] | None = None
    columns: dict[str, Names | Markers] | None = None
    units: dict[str, Unit] | None = None
    frame: Frame | str | None = None
    clock: float | str | None = None
    join: list[str] | None = None

    def __post_init__(self):
        """Raises InputError where a value cannot be."""
        for name in ("pose_rate", "command_rate"):
            rate = getattr(self, name)
            known = rate is None or 0 < rate < math.inf
            expect(known, f"field '{name}'", rate, "a positive number of Hz")
        number = isinstance(self.clock, float) and math.isfinite(self.clock)
        known = number or self.clock in (None, "same", "find")
        expected = (
            "'same', 'find', or how many seconds the elevator's clock is ahead of that "
            "of the poses"
        )
        expect(known, "field 'clock'", self.clock, expected)
        join = self.join or ["*", "*"]
        known = len(join) > 1 and all(pattern.count("*") == 1 for pattern in join)
        expected = (
            "two or more names of files with one * each: those with the same text for "
            "* are one recording"
        )
        expect(known, "field 'join'", join, expected)
        if isinstance(self.frame, str):
            object.__setattr__(self, "frame", Frame(axes=self.frame))
        for name, unit in (self.units or {}).items():
            kinds = (*UNITS, *QUANTITIES)
            expect(name in kinds, "field of units", name, ", ".join(kinds))
            scale_of(unit, QUANTITIES.get(name, name), f"units: {name}")
        _check_columns(self.columns or {})

    def campaign(self, folder: Path) -> Campaign:
        """Campaign without flights."""
        known = {name: getattr(self.vehicle, name) for name in PARAMETER_NAMES}
        limits = self.vehicle.elevator_limits
        return Campaign(
            name=folder.resolve().name,
            path=folder,
            vehicle={n: float(v) for n, v in known.items() if v is not None},
            elevator=self.vehicle.elevator,
            elevator_limits=(limits[0], limits[1]) if limits else None,
            elevator_rate_limit=self.vehicle.elevator_rate_limit,
            pose_rate=self.pose_rate,
            command_rate=self.command_rate,
            flights=(),
            notes=tuple(map(printable, self.notes or ())),
            servo=self.servo,
        )

    def mapping(self, source: str) -> ColumnMapping | None:
        """How logs are mapped; None where no field says so."""
        parts = (self.columns, self.units, self.frame, self.clock, self.join)
        if all(part is None for part in parts):
            return None
        assert not isinstance(self.frame, str)
        return ColumnMapping(
            source=source,
            columns=self.columns or {},
            units=self.units or {},
            frame=self.frame or Frame(),
            clock=self.clock,
            join=tuple(self.join or ()),
        )


def _check_columns(columns: dict[str, Names | Markers]) -> None:
    """Refuses columns that would be ignored, or that are one column."""
    known = [*QUANTITIES, "flight"]
    for name, value in columns.items():
        expect(name in known, "field of columns", name, ", ".join(known))
        is_list = isinstance(value, list) and name in ("time", "position", "attitude")
        fits = isinstance(value, str) or is_list or name == "attitude"
        expect(fits, f"columns: field '{name}'", value, "the name of a column")
    beside = INSTEAD | {"elevator_rate_command": "elevator_angle_command"}
    for name in sorted(columns):
        why = f"beside '{beside[name]}'" if beside.get(name) in columns else ""
        if name in ("roll", "yaw") and not columns.keys() >= {*EULER}:
            why = why or "without all of roll, pitch and yaw"
        if why:
            words = f"columns: '{name}' has no effect {why}; expected no such field."
            raise InputError(words)
    named = [show(own) for q, own in columns.items() if q != "elevator_angle_command"]
    for own in named:
        expect(named.count(own) == 1, "columns: two quantities", own, "two columns")


def read_settings(file: Path) -> tuple[Campaign, ColumnMapping | None]:
    """Reads a campaign without flights, and how its logs are mapped if they are."""
    settings = schema.load_yaml(Settings, file, "a campaign.yaml or a MAP file")
    return settings.campaign(file.parent), settings.mapping(str(file))
