"""A mapping: which columns of a log are which quantities, in which units and axes.

It stands in a MAP file or in campaign.yaml as `columns:`, `units:`, `frame:`, `clock:`
and `join:`, beside what is known of the vehicle.
"""

import dataclasses
import math
from typing import NamedTuple

from glider.campaign.fields import check_fields
from glider.campaign.importing import units
from glider.errors import InputError, show

MAPPING_FIELDS = ("columns", "units", "frame", "clock", "join")
"""Fields that make a mapping."""

QUANTITIES = {
    "time": "time",
    "x": "length",
    "y": "length",
    "z": "length",
    "position": "length",
    "roll": "angle",
    "pitch": "angle",
    "yaw": "angle",
    "attitude": "angle",
    "elevator": "angle",
    "elevator_rate_command": "rate",
    "elevator_angle_command": "angle",
}
"""What `columns:` may name, and of which kind its unit is."""

VECTORS = ("position", "attitude")
"""Quantities of several columns."""

_AXES = tuple(sign + axis for axis in "xyz" for sign in ("", "-"))
_PRESETS: dict[str, dict[str, str]] = {
    "NED": {"up": "-z", "nose": "x", "top": "-z", "pitch": "nose_up"},
    "ENU": {"up": "z", "nose": "x", "top": "z", "pitch": "nose_down"},
}
_PITCH = ("nose_down", "nose_up")
_ELEVATOR = ("trailing_edge_up", "trailing_edge_down")
_ROTATIONS = ("wxyz", "xyzw", "rotation_vector")


class Choice(NamedTuple):
    """Values that a field of `frame:` may have, and what it means."""

    values: tuple[str, ...]
    meaning: str


_CHOICES = {
    "up": Choice(_AXES, "axis of the log that points up"),
    "forward": Choice((*_AXES, "throw"), "axis of the log along the throw"),
    "nose": Choice(_AXES, "axis of the body that points to the nose"),
    "top": Choice(_AXES, "axis of the body that points up in level flight"),
    "pitch": Choice(_PITCH, "where a positive pitch turns the nose"),
    "elevator": Choice(_ELEVATOR, "where a positive elevator turns its trailing edge"),
    "command": Choice(_ELEVATOR, "the same of the command"),
}


@dataclasses.dataclass(frozen=True, kw_only=True)
class Frame:
    """Axes and signs of a log; the defaults are those of this project.

    Attributes:
        up: axis of the log that points up, e.g. "-z".
        forward: axis along the throw; "throw": wherever each flight goes.
        nose: axis of the body that points to the nose, where attitudes are logged.
        top: axis of the body that points up in level flight.
        pitch: what a positive pitch means, where it is logged as such.
        elevator: what a positive elevator means.
        command: what a positive command means.
        rotation: how the attitude is logged: an order of Euler angles about the turning
            axes, e.g. "ZYX", an order of a quaternion's numbers, or "rotation_vector".
        tracked_point: ahead of and above the center of mass [m].
    """

    up: str = "z"
    forward: str | None = None
    nose: str = "x"
    top: str = "z"
    pitch: str = "nose_down"
    elevator: str = "trailing_edge_up"
    command: str = "trailing_edge_up"
    rotation: str | None = None
    tracked_point: tuple[float, float] = (0.0, 0.0)


@dataclasses.dataclass(frozen=True, kw_only=True)
class Mapping:
    """How a log becomes flights."""

    source: str  # The file that tells it.
    columns: dict[str, str | list[str]]  # Quantity to column, or columns of a vector.
    units: dict[str, object]  # Quantity or kind to unit.
    frame: Frame
    clock: str | float | None  # "same", "find", an offset [s]; None: by the files.
    join: tuple[str, ...]  # Patterns of files that make one recording.


def parse_mapping(settings: dict, source: str) -> Mapping | None:
    """Returns the mapping of a file's settings; None where it has none.

    Raises:
        InputError: a field has a value that it cannot have.
    """
    if not any(name in settings for name in MAPPING_FIELDS):
        return None
    columns = check_fields(
        settings.get("columns", {}), tuple(QUANTITIES), f"{source}: columns"
    )
    for name, value in columns.items():
        many = isinstance(value, list) and all(isinstance(v, str) for v in value)
        if not isinstance(value, str) and not (many and name in (*VECTORS, "time")):
            raise InputError(
                f"{source}: columns: field '{name}' is {show(value)}; "
                "the name of a column is needed."
            )
    told = check_fields(
        settings.get("units", {}), (*units.KINDS, *QUANTITIES), f"{source}: units"
    )
    for name, unit in told.items():
        units.scale_of(unit, QUANTITIES.get(name, name), f"{source}: units: {name}")
    return Mapping(
        source=source,
        columns=dict(columns),
        units=dict(told),
        frame=_parse_frame(settings.get("frame", {}), f"{source}: frame"),
        clock=_parse_clock(settings.get("clock"), source),
        join=_parse_join(settings.get("join", []), source),
    )


def _parse_frame(fields: object, source: str) -> Frame:
    if isinstance(fields, str):
        fields = {"axes": fields}
    known = ("axes", *_CHOICES, "rotation", "tracked_point")
    fields = dict(check_fields(fields, known, source))
    axes = fields.pop("axes", "ENU")
    if axes not in _PRESETS:
        raise InputError(
            f"{source}: field 'axes' is {show(axes)}; one of {', '.join(_PRESETS)} is "
            "needed, or the axes one by one: up, forward, nose, top."
        )
    if "elevator" in fields:
        fields.setdefault("command", fields["elevator"])
    fields = {**_PRESETS[axes], **fields}
    for name, choice in _CHOICES.items():
        if name in fields and fields[name] not in choice.values:
            raise InputError(
                f"{source}: field '{name}' is {show(fields[name])}; "
                f"{choice.meaning} is needed, one of {', '.join(choice.values)}."
            )
    rotation = fields.get("rotation")
    euler = isinstance(rotation, str) and sorted(rotation.upper()) == ["X", "Y", "Z"]
    if rotation is not None and rotation not in _ROTATIONS and not euler:
        raise InputError(
            f"{source}: field 'rotation' is {show(rotation)}; an order of Euler angles "
            f"is needed, as ZYX, or one of {', '.join(_ROTATIONS)}."
        )
    for one, other in (("up", "forward"), ("nose", "top")):
        if fields.get(one, "?")[-1] == fields.get(other, "??")[-1]:
            raise InputError(
                f"{source}: '{one}' is {show(fields[one])} and '{other}' is "
                f"{show(fields[other])}; "
                "two different axes are needed."
            )
    point = fields.pop("tracked_point", [0.0, 0.0])
    numbers = isinstance(point, list) and len(point) == 2
    if not numbers or not all(_is_finite(value) for value in point):
        raise InputError(
            f"{source}: field 'tracked_point' is {show(point)}; "
            "[ahead, above] of the center of mass in m is needed."
        )
    return dataclasses.replace(
        Frame(**fields), tracked_point=(float(point[0]), float(point[1]))
    )


def _parse_clock(clock: object, source: str) -> str | float | None:
    if clock is None or clock in ("same", "find"):
        return clock if isinstance(clock, str) else None
    if _is_finite(clock):
        return float(clock)  # type: ignore[arg-type]
    raise InputError(
        f"{source}: field 'clock' is {show(clock)}; 'same' or 'find' is needed, or how "
        "many seconds the elevator's clock is ahead of that of the poses."
    )


def _parse_join(join: object, source: str) -> tuple[str, ...]:
    patterns = isinstance(join, list) and all(
        isinstance(p, str) and p.count("*") == 1 for p in join
    )
    if not patterns or (join and len(join) < 2):  # type: ignore[arg-type]
        raise InputError(
            f"{source}: field 'join' is {show(join)}; two or more names of files with "
            "one * each are needed: those with the same text for * are one recording."
        )
    return tuple(join)  # type: ignore[arg-type]


def _is_finite(value: object) -> bool:
    number = isinstance(value, (int, float)) and not isinstance(value, bool)
    return number and math.isfinite(value)  # type: ignore[arg-type]
