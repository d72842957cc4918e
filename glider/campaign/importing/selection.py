"""The quantities of a mapping, picked out of a recording and converted to SI.

Axes and signs are still the log's own; each quantity keeps its own clock.
"""

import dataclasses
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from glider.campaign.importing import units
from glider.campaign.importing.mapping import QUANTITIES, Mapping, Markers
from glider.campaign.importing.recording import Column, Group, Recording
from glider.errors import InputError

_SERVO = ("elevator", "elevator_rate_command", "elevator_angle_command")
_EULER = ("yaw", "pitch", "roll")  # About the log's z, y and x, in this order.


@dataclasses.dataclass(frozen=True, kw_only=True)
class Stream:
    """Numbers with their times."""

    time: np.ndarray  # (n,) increasing [s].
    values: np.ndarray  # (n, k)
    clock: str  # Whose it is.

    def known(self) -> "Stream":
        """The rows in which all numbers are finite."""
        rows = np.isfinite(self.values).all(axis=1)
        return dataclasses.replace(self, time=self.time[rows], values=self.values[rows])


class ServoLogs(NamedTuple):
    """What was logged of the elevator's servo."""

    elevator: Stream | None = None  # (n, 1) as measured [rad].
    rate_command: Stream | None = None  # (n, 1) [rad/s]
    angle_command: Stream | None = None  # (n, 1) [rad]

    @property
    def given(self) -> list[Stream]:
        """Those that were logged."""
        return [stream for stream in self if stream is not None]


@dataclasses.dataclass(frozen=True, kw_only=True)
class Streams:
    """What a mapping picks out of one recording, in SI and the log's own axes."""

    path: Path
    position: Stream  # (n, 3) x, y, z, or (n, 2) x, z [m].
    quaternion: Stream | None  # (n, 4) x, y, z, w: from the body to the log's axes.
    pitch: Stream | None  # (n, 1) [rad], where there is no quaternion.
    servo: ServoLogs


def select(recording: Recording, mapping: Mapping) -> Streams:
    """Picks the quantities of a recording; refuses a pose that is not complete."""
    picker = _Picker(recording, mapping)
    columns = mapping.columns
    if "position" in columns:
        position = picker.vector("position")
    else:
        position = picker.scalars(("x", "y", "z") if "y" in columns else ("x", "z"))
    quaternion = picker.attitude()
    return Streams(
        path=recording.path,
        position=position,
        quaternion=quaternion,
        pitch=None if quaternion else picker.scalars(("pitch",)),
        servo=ServoLogs(*map(picker.optional, _SERVO)),
    )


class _Picker:
    """Finds columns for quantities; holds the recording and the mapping."""

    def __init__(self, recording: Recording, mapping: Mapping) -> None:
        self._recording, self._mapping = recording, mapping

    def vector(self, quantity: str, address: str | None = None) -> Stream:
        """A vector of x, y and z [m], of a quantity or by another address."""
        name = address or self._mapping.columns[quantity]
        for axes in ("xyz", "012"):
            found = self._find_vector(quantity, name, axes)
            if found is not None:
                return self._stream(("position",) * 3, *found)
        raise self._error(quantity, f"no columns '{name}' with x, y, z were found")

    def scalars(self, quantities: tuple[str, ...]) -> Stream:
        """Quantities of one group side by side."""
        pairs = []
        for quantity in quantities:
            name = self._mapping.columns.get(quantity)
            if not isinstance(name, str):
                raise InputError(
                    f"{self._mapping.source}: columns: '{quantity}' is missing; "
                    "expected position (or x and z), attitude (or pitch) and time."
                )
            pairs.append(self._recording.find(name, self._field(quantity)))
        groups = [group for group, _ in pairs]
        if any(group is not groups[0] for group in groups):
            raise self._error(
                quantities[0],
                f"{', '.join(quantities)} are in different groups; "
                "expected one with the same times",
            )
        return self._stream(quantities, groups[0], [column for _, column in pairs])

    def optional(self, quantity: str) -> Stream | None:
        """The known rows of a quantity; None where the mapping has none."""
        if quantity not in self._mapping.columns:
            return None
        stream = self.scalars((quantity,)).known()
        if len(stream.time) < 2:
            raise self._error(quantity, "fewer than two rows of it have a number")
        return stream

    def attitude(self) -> Stream | None:
        """Quaternions; None where only a pitch is mapped."""
        rotation = self._mapping.frame.rotation or self._recording.rotation
        name = self._mapping.columns.get("attitude")
        if name is None:
            if not all(angle in self._mapping.columns for angle in _EULER):
                return None
            angles = self.scalars(_EULER)
            order = rotation if rotation and len(rotation) == 3 else "ZYX"
            turns = Rotation.from_euler(order, _finite(angles.values))
            return _with_turns(angles, turns)
        if isinstance(name, Markers):
            return self._markers(name)
        for axes in ("xyzw", "0123", "xyz", "012"):
            found = self._find_vector("attitude", name, axes)
            if found is not None:
                read = self._quaternions if len(axes) == 4 else self._angles
                return read(axes, rotation, *found)
        raise self._error("attitude", f"no columns '{name}' of a rotation were found")

    def _quaternions(
        self, axes: str, rotation: str | None, group: Group, columns: list[Column]
    ) -> Stream:
        stream = self._stream(("attitude",) * 4, group, columns, scaled=False)
        if axes == "0123":
            if rotation not in ("wxyz", "xyzw"):
                raise self._error(
                    "attitude",
                    "the order of the quaternion's four numbers is unknown; "
                    "expected frame: {rotation: wxyz} or xyzw",
                )
            order = [rotation.index(letter) for letter in "xyzw"]
            stream = dataclasses.replace(stream, values=stream.values[:, order])
        with np.errstate(over="ignore"):
            norm = np.linalg.norm(stream.values, axis=1)
        # Zeros stand for a body that is not seen; a damaged number may be huge.
        stream.values[~((norm > 0.5) & (norm < 2.0))] = np.nan
        norm = norm[np.isfinite(norm)]
        if len(norm) and np.median(np.abs(norm - 1.0)) > 0.01:
            raise self._error(
                "attitude",
                f"a quaternion has a length of {np.median(norm):.3g}; expected 1",
            )
        return _with_turns(stream, Rotation.from_quat(_finite(stream.values, 1.0)))

    def _angles(
        self, axes: str, rotation: str | None, group: Group, columns: list[Column]
    ) -> Stream:
        stream = self._stream(("attitude",) * 3, group, columns)
        if rotation is None or rotation in ("wxyz", "xyzw"):
            raise self._error(
                "attitude",
                "the meaning of its three angles is unknown; expected frame: "
                "{rotation: XYZ}, an order of Euler angles, or rotation_vector",
            )
        known = _finite(stream.values)
        if rotation == "rotation_vector":
            return _with_turns(stream, Rotation.from_rotvec(known))
        order = ["XYZ".index(letter) for letter in rotation.upper()]
        return _with_turns(stream, Rotation.from_euler(rotation, known[:, order]))

    def _markers(self, markers: Markers) -> Stream:
        """Attitude by points: x from tail to nose, y toward the left wing tip."""
        nose = self.vector("attitude", markers.nose)
        tail = self.vector("attitude", markers.tail)
        points = [nose, tail]
        if markers.left is not None:
            points += [
                self.vector("attitude", n) for n in (markers.left, markers.right)
            ]
        if any(p.values.shape != nose.values.shape for p in points):
            raise self._error(
                "attitude", "its markers have different rows; expected the same of all"
            )
        ahead = nose.values - tail.values
        if len(points) == 4:
            left = points[2].values - points[3].values
        else:  # Level: square to what is up.
            axis = self._mapping.frame.up
            up = np.eye(3)["xyz".index(axis[-1])] * (-1.0 if axis[0] == "-" else 1.0)
            left = np.cross(up, ahead)
        top = np.cross(ahead, left)
        axes = np.stack([ahead, np.cross(top, ahead), top], axis=2)
        with np.errstate(invalid="ignore", divide="ignore"):
            axes /= np.linalg.norm(axes, axis=1, keepdims=True)
        stream = dataclasses.replace(nose, values=axes.reshape(len(axes), 9))
        known = np.isfinite(stream.values).all(axis=1)
        turns = Rotation.from_matrix(np.where(known[:, None, None], axes, np.eye(3)))
        return _with_turns(stream, turns)

    def _find_vector(
        self, quantity: str, name: str | list[str] | Markers, axes: str
    ) -> tuple[Group, list[Column]] | None:
        field = self._field(quantity)
        if isinstance(name, str):
            return self._recording.find_all(name, axes, field)
        if isinstance(name, Markers) or len(name) != len(axes) or axes.isdigit():
            return None
        pairs = [self._recording.find(part, field) for part in name]
        return pairs[0][0], [column for _, column in pairs]

    def _stream(
        self,
        quantities: tuple[str, ...],
        group: Group,
        columns: list[Column],
        *,
        scaled: bool = True,
    ) -> Stream:
        parts = [
            self._scaled(quantity, column) if scaled else column.values
            for quantity, column in zip(quantities, columns, strict=True)
        ]
        if len({len(part) for part in parts}) > 1:
            raise self._error(
                quantities[0], "its columns have different lengths; expected the same"
            )
        values = np.stack(parts, axis=1)
        time = self._scaled("time", self._times(group, quantities[0], len(values)))
        known = np.isfinite(time)
        time, values = time[known], values[known]
        later = np.diff(time, prepend=-np.inf) > 0.0
        if len(later) and np.mean(later) < 0.9:
            row = int(np.argmin(later))
            raise self._error(
                "time",
                f"it does not increase at value {row + 1} ({time[row]:.9g} s); "
                "expected the rows in the order of their times",
            )
        ahead = time > np.maximum.accumulate(np.r_[-np.inf, time[:-1]])[: len(time)]
        return Stream(time=time[ahead], values=values[ahead], clock=group.clock)

    def _times(self, group: Group, quantity: str, rows: int) -> Column:
        """The times of a group's rows, of which there are as many."""
        named = self._mapping.columns.get("time", "time")
        for name in [named] if isinstance(named, str) else named:  # type: ignore[union-attr]
            column = group.columns.get(name.removeprefix(f"{group.name}."))
            if column is not None:
                return column
        if group.time in group.columns:  # A damaged log may lack it.
            return group.columns[group.time]
        for other in self._recording.groups:  # Of the same clock, with as many rows.
            for name, column in other.columns.items():
                named_so = named in (name, f"{other.name}.{name}")
                fits = other.clock == group.clock and len(column.values) == rows
                if named_so and fits:
                    return column
        raise self._error(
            "time", f"no column of times was found for '{quantity}' (named {named!r})"
        )

    def _scaled(self, quantity: str, column: Column) -> np.ndarray:
        """A column in SI; refuses a unit that the file contradicts."""
        path, mapped = self._recording.path, self._mapping.units
        if column.fault:
            raise InputError(f"{path}: {column.fault}")
        kind = QUANTITIES[quantity]
        unit = mapped.get(quantity, mapped.get(kind))
        own = units.spell(column.unit or "")
        if unit is None:
            if own is None:
                return column.values
            scale = units.scale_of(own, kind, f"{path}: {quantity}")
        else:
            field = quantity if quantity in mapped else kind
            source = f"{self._mapping.source}: units: {field}"
            scale = units.scale_of(unit, kind, source)
            if own and isinstance(unit, str) and units.spell(unit) != own:
                raise InputError(
                    f"{source}: found '{unit}', but in {path} its unit is '{own}'; "
                    "expected the same in both."
                )
        return scale.gain * (column.values - scale.zero)

    def _field(self, quantity: str) -> str:
        return f"columns: {quantity} (of {self._mapping.source})"

    def _error(self, quantity: str, reason: str) -> InputError:
        return InputError(f"{self._recording.path}: {self._field(quantity)}: {reason}.")


def _finite(values: np.ndarray, filler: float = 0.0) -> np.ndarray:
    """Values with a filler in rows where nothing was seen."""
    return np.where(np.isfinite(values).all(axis=1)[:, None], values, filler)


def _with_turns(stream: Stream, turns: Rotation) -> Stream:
    """Quaternions of a stream, nan in rows where nothing was seen."""
    quaternion = turns.as_quat()
    quaternion[~np.isfinite(stream.values).all(axis=1)] = np.nan
    return dataclasses.replace(stream, values=quaternion)
