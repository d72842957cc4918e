"""Schema of campaign.yaml and of a MAP file: a vehicle, and how its logs are mapped.

Both files have the fields of `Settings`. `vehicle:`, the rates, `servo:` and `notes:`
make a `Campaign` without flights. The others make a `ColumnMapping`: which columns of a
log are which quantities, in which units and axes. A file without them is of logs in the
columns of a campaign, in SI units. Values are checked when a schema is filled; the
errors name the field.
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

    Attributes:
        nose: columns of a point at the nose.
        tail: columns of one behind it.
        left: columns of one at the left wing tip.
        right: columns of one at the right wing tip.
    """

    nose: Names
    tail: Names
    left: Names | None = None
    right: Names | None = None

    def __post_init__(self):
        """Raises InputError where one wing tip is missing, or a point has no name."""
        for point, names in vars(self).items():
            expect(
                names is None or len(names) > 0,
                f"columns: attitude: field '{point}'",
                names,
                "the columns of a point",
            )
        if (self.left is None) != (self.right is None):
            raise InputError(
                "columns: attitude has one of 'left' and 'right'; expected both, or "
                "neither."
            )


# The parameters of GliderParameters as optional fields: None is unknown.
_Known: Any = dataclasses.make_dataclass(
    "_Known",
    [(name, float | None, None) for name in PARAMETER_NAMES],
    frozen=True,
    kw_only=True,
)


@dataclasses.dataclass(frozen=True, kw_only=True)
class Frame:
    """Axes and signs of a log; "" stands for those of the preset `axes`.

    FRAME_CHOICES has the values of the fields that are not below, and what they mean.

    Attributes:
        axes: preset, "NED" or "ENU".
        forward: None and "throw": along each flight.
        rotation: how an attitude is logged: an order of Euler angles or of the numbers
            of a quaternion, or "rotation_vector"; None: as the format has it.
        tracked_point: ahead of and above the mass center [m].
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
        expect(
            self.axes in _PRESETS,
            "frame: field 'axes'",
            self.axes,
            "NED, ENU, or the axes by name: up, forward, nose, top",
        )
        preset = _PRESETS[self.axes] | {"command": self.elevator}
        del preset["pitch"]  # That of a column `pitch` alone, see `usual_pitch`.
        for name, value in preset.items():
            if not getattr(self, name):
                object.__setattr__(self, name, value)
        for name, (values, meaning) in FRAME_CHOICES.items():
            value = getattr(self, name) or values[0]
            expect(
                value in values,
                f"frame: field '{name}'",
                value,
                f"{meaning}, one of {', '.join(values)}",
            )
        turn = self.rotation or "wxyz"
        expect(
            turn in _ROTATIONS or "".join(sorted(turn)) in ("XYZ", "xyz"),
            "frame: field 'rotation'",
            turn,
            f"an order of Euler angles, as ZYX, or {', '.join(_ROTATIONS)}",
        )
        self._check_axes()

    def _check_axes(self) -> None:
        """Refuses two directions along one axis, and a point without two numbers."""
        for one, other in (("up", "forward"), ("nose", "top")):
            axes = [getattr(self, one), getattr(self, other) or "throw"]
            expect(
                axes[0][-1] != axes[1][-1],
                f"frame: [{one}, {other}]",
                axes,
                "two different axes",
            )
        point = self.tracked_point
        expect(
            len(point) == 2 and all(map(math.isfinite, point)),
            "frame: field 'tracked_point'",
            point,
            "[ahead, above] of the mass center in m",
        )

    @property
    def usual_pitch(self) -> str:
        """What a positive pitch means where the frame does not specify it."""
        return _PRESETS[self.axes]["pitch"]

    @property
    def turns_pitch(self) -> bool:
        """Whether Euler angles' pitch is the opposite of a turn about the body's y.

        A turn about y moves the nose along y × nose: up or down, by where the top is.
        """
        nose_moves = np.cross(unit_vector("y"), unit_vector(self.nose))
        up = float(nose_moves @ unit_vector(self.top))
        expect(
            up or not self.pitch,
            "frame: field 'pitch'",
            self.pitch,
            "nose and top along x and z of the body",
        )
        return self.pitch not in ("", "nose_up" if up > 0.0 else "nose_down")

    @property
    def body(self) -> np.ndarray:
        """Rows nose, left and top in the body's axes as they are logged (3, 3)."""
        nose = unit_vector(self.nose)
        top = unit_vector(self.top)
        return np.stack([nose, np.cross(top, nose), top])


@dataclasses.dataclass(frozen=True)
class ColumnMapping:
    """How a log becomes flights.

    Attributes:
        source: the file that says so.
        columns: names of a log's columns, by quantity.
        units: by quantity, or by kind of quantity.
        frame: axes and signs.
        clock: "same", "find", or how far the servo's is ahead of the poses' [s]; None:
            "find" where they differ in the files.
        join: patterns of files that make one recording.
    """

    source: str
    columns: dict[str, Names | Markers]
    units: dict[str, Unit]
    frame: Frame
    clock: str | float | None
    join: tuple[str, ...]


def unit_vector(axis: str) -> np.ndarray:
    """An axis such as "-z" as a unit vector (3,)."""
    sign = -1.0 if axis.startswith("-") else 1.0
    return sign * np.eye(3)["xyz".index(axis[-1])]


@dataclasses.dataclass(frozen=True, kw_only=True)
class Vehicle(_Known):
    """What is known of a glider, in SI units: its parameters, and its elevator.

    Attributes:
        elevator_limits: trailing edge down and up [rad]; None: unknown.
        elevator_rate_limit: [rad/s]; None: unknown.
        elevator: "servo", or "fixed" at an unknown angle, which is the same in all
            flights or "fixed_per_flight".
    """

    elevator_limits: list[float] | None = None
    elevator_rate_limit: float | None = None
    elevator: str = "servo"

    def __post_init__(self):
        """Raises InputError where a value cannot be."""
        kinds = ("servo", "fixed", "fixed_per_flight")
        expect(
            self.elevator in kinds,
            "field 'elevator' of vehicle",
            self.elevator,
            ", ".join(kinds),
        )
        fields = dataclasses.asdict(self)
        del fields["elevator"]
        given = {name: value for name, value in fields.items() if value is not None}
        check_parameters(given)
        check_units(given)


@dataclasses.dataclass(frozen=True, kw_only=True)
class Settings:
    """Fields of campaign.yaml, or of a MAP file.

    Attributes:
        vehicle: what is known of the glider.
        pose_rate: of the cameras [Hz]; None: as the logs show.
        command_rate: at which commands change [Hz]; None: they change at rows.
        servo: how the columns of a servo were made.
        notes: of an import.
        columns, units, frame, clock, join: see `ColumnMapping`.
    """

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
        """Raises InputError where a value cannot be; makes a frame of a preset."""
        for name in ("pose_rate", "command_rate"):
            rate = getattr(self, name)
            expect(
                rate is None or 0 < rate < math.inf,
                f"field '{name}'",
                rate,
                "a positive number of Hz",
            )
        is_number = isinstance(self.clock, float) and math.isfinite(self.clock)
        expect(
            is_number or self.clock in (None, "same", "find"),
            "field 'clock'",
            self.clock,
            "'same', 'find', or how many seconds the elevator's clock is ahead of that "
            "of the poses",
        )
        join = self.join or ["*", "*"]
        expect(
            len(join) > 1 and all(pattern.count("*") == 1 for pattern in join),
            "field 'join'",
            join,
            "two or more names of files with one * each: those with the same text for "
            "* are one recording",
        )
        if isinstance(self.frame, str):
            object.__setattr__(self, "frame", Frame(axes=self.frame))
        for name, unit in (self.units or {}).items():
            kinds = (*UNITS, *QUANTITIES)
            expect(name in kinds, "field of units", name, ", ".join(kinds))
            scale_of(unit, QUANTITIES.get(name, name), f"units: {name}")
        _check_columns(self.columns or {})

    def campaign(self, folder: Path) -> Campaign:
        """Returns the campaign without flights, which has the folder's name."""
        vehicle = {}
        for name in PARAMETER_NAMES:
            value = getattr(self.vehicle, name)
            if value is not None:
                vehicle[name] = float(value)
        limits = self.vehicle.elevator_limits
        return Campaign(
            name=folder.resolve().name,
            path=folder,
            vehicle=vehicle,
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
        """Returns how logs are mapped; None where no field says so.

        `source` names the file in messages.
        """
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
        fits = isinstance(value, str) or name == "attitude"
        if isinstance(value, list):
            fits = name in ("time", "position", "attitude")
        expect(fits, f"columns: field '{name}'", value, "the name of a column")
    beside = INSTEAD | {"elevator_rate_command": "elevator_angle_command"}
    for name in sorted(columns):
        why = ""
        if name in ("roll", "yaw") and not columns.keys() >= set(EULER):
            why = "without all of roll, pitch and yaw"
        if beside.get(name) in columns:
            why = f"beside '{beside[name]}'"
        if why:
            raise InputError(
                f"columns: '{name}' has no effect {why}; expected no such field."
            )
    named = [show(own) for q, own in columns.items() if q != "elevator_angle_command"]
    for own in named:
        expect(named.count(own) == 1, "columns: two quantities", own, "two columns")


def read_settings(file: Path) -> tuple[Campaign, ColumnMapping | None]:
    """Reads a campaign.yaml or a MAP file.

    Returns:
        The campaign without flights, and how its logs are mapped; None: they are in a
        campaign's own columns.
    """
    settings = schema.load_yaml(Settings, file, "a campaign.yaml or a MAP file")
    return settings.campaign(file.parent), settings.mapping(str(file))
