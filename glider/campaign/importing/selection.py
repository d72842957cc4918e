"""The quantities of a mapping, picked out of a log and brought to SI.

Axes and signs are still the log's own; each quantity keeps its own clock.
"""

import dataclasses
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from glider.campaign.importing import units
from glider.campaign.importing.mapping import QUANTITIES, Mapping
from glider.campaign.importing.raw import Column, Group, RawTable
from glider.errors import InputError

_EULER = ("yaw", "pitch", "roll")  # About the log's z, y and x, in this order.


@dataclasses.dataclass(frozen=True, kw_only=True)
class Stream:
    """Numbers with their times."""

    time: np.ndarray  # (n,) increasing [s].
    values: np.ndarray  # (n, k)
    clock: str  # Whose it is.


@dataclasses.dataclass(frozen=True, kw_only=True)
class Streams:
    """What a mapping picks out of one recording, in SI and the log's own axes."""

    path: Path
    position: Stream  # (n, 3) x, y, z, or (n, 2) x, z [m].
    quaternion: Stream | None  # (n, 4) x, y, z, w: from the body to the log's axes.
    pitch: Stream | None  # (n, 1) [rad], where there is no quaternion.
    elevator: Stream | None  # (n, 1) [rad]
    rate_command: Stream | None  # (n, 1) [rad/s]
    angle_command: Stream | None  # (n, 1) [rad]


def select(raw: RawTable, mapping: Mapping) -> Streams:
    """Returns the quantities of a recording.

    Raises:
        InputError: a column is missing, or a pose is not complete.
    """
    picker = _Picker(raw, mapping)
    position = picker.vector("position", "xyz")
    if position is None:
        names = ("x", "y", "z") if "y" in mapping.columns else ("x", "z")
        position = picker.scalars(names)
    quaternion, pitch = picker.attitude(), None
    if quaternion is None:
        pitch = picker.scalars(("pitch",))
    return Streams(
        path=raw.path,
        position=position,
        quaternion=quaternion,
        pitch=pitch,
        elevator=picker.optional("elevator"),
        rate_command=picker.optional("elevator_rate_command"),
        angle_command=picker.optional("elevator_angle_command"),
    )


class _Picker:
    """Finds columns for quantities; holds the log and the mapping."""

    def __init__(self, raw: RawTable, mapping: Mapping) -> None:
        self._raw, self._mapping = raw, mapping

    def vector(self, quantity: str, axes: str) -> Stream | None:
        """Returns a vector that the mapping names as one; None where it does not."""
        name = self._mapping.columns.get(quantity)
        if name is None:
            return None
        digits = "0123"[: len(axes)]
        found = self._find_vector(quantity, name, axes)
        found = found or self._find_vector(quantity, name, digits)
        if found is None:
            raise self._error(
                quantity, f"no columns '{name}' with {', '.join(axes)} were found"
            )
        return self._stream(quantity, *found)

    def scalars(self, quantities: tuple[str, ...]) -> Stream:
        """Returns quantities of one group side by side."""
        pairs = []
        for quantity in quantities:
            name = self._mapping.columns.get(quantity)
            if not isinstance(name, str):
                raise self._missing(quantity)
            pairs.append(self._raw.find(name, self._field(quantity)))
        groups = [group for group, _ in pairs]
        if any(group is not groups[0] for group in groups):
            raise self._error(
                quantities[0],
                f"{', '.join(quantities)} lie in different"
                " groups; one with the same times is needed",
            )
        return self._stream(quantities, groups[0], [column for _, column in pairs])

    def optional(self, quantity: str) -> Stream | None:
        """Returns a quantity; None where the mapping has none."""
        return self.scalars((quantity,)) if quantity in self._mapping.columns else None

    def attitude(self) -> Stream | None:
        """Returns quaternions; None where only a pitch is mapped."""
        rotation = self._mapping.frame.rotation or self._raw.rotation
        name = self._mapping.columns.get("attitude")
        if name is None:
            if not all(angle in self._mapping.columns for angle in _EULER):
                return None
            angles = self.scalars(_EULER)
            turn = Rotation.from_euler(rotation or "ZYX", _finite(angles.values))
            return _masked(angles, turn)
        for axes in ("xyzw", "0123", "xyz", "012"):
            found = self._find_vector("attitude", name, axes)
            if found is not None:
                return self._read_attitude(axes, rotation, *found)
        raise self._error("attitude", f"no columns '{name}' of a rotation were found")

    def _read_attitude(
        self, axes: str, rotation: str | None, group: Group, columns: list[Column]
    ) -> Stream:
        if len(axes) == 4:
            stream = self._stream("attitude", group, columns, scaled=False)
            if axes == "0123":
                if rotation not in ("wxyz", "xyzw"):
                    raise self._error(
                        "attitude",
                        "the order of the quaternion's four numbers is not "
                        "told; frame: {rotation: wxyz} or xyzw is needed",
                    )
                order = [rotation.index(letter) for letter in "xyzw"]
                stream = dataclasses.replace(stream, values=stream.values[:, order])
            self._check_unit_norm(stream.values)
            return _masked(stream, Rotation.from_quat(_finite(stream.values, 1.0)))
        stream = self._stream("attitude", group, columns)
        if rotation is None or rotation in ("wxyz", "xyzw"):
            raise self._error(
                "attitude",
                "what its three angles mean is not told; frame: {rotation: "
                "XYZ} is needed, an order of Euler angles, or rotation_vector",
            )
        if rotation == "rotation_vector":
            return _masked(stream, Rotation.from_rotvec(_finite(stream.values)))
        order = ["XYZ".index(letter) for letter in rotation.upper()]
        angles = _finite(stream.values)[:, order]
        return _masked(stream, Rotation.from_euler(rotation, angles))

    def _check_unit_norm(self, quaternion: np.ndarray) -> None:
        norm = np.linalg.norm(quaternion, axis=1)
        off = np.abs(norm[np.isfinite(norm)] - 1.0)
        if len(off) and np.median(off) > 0.01:
            raise self._error(
                "attitude",
                f"a quaternion has a length of {np.nanmedian(norm):.3g}; 1 is needed",
            )

    def _find_vector(
        self, quantity: str, name: str | list[str], axes: str
    ) -> tuple[Group, list[Column]] | None:
        field = self._field(quantity)
        if isinstance(name, str):
            return self._raw.find_all(name, axes, field)
        if len(name) != len(axes) or axes.isdigit():
            return None
        pairs = [self._raw.find(part, field) for part in name]
        return pairs[0][0], [column for _, column in pairs]

    def _stream(
        self,
        quantity: str | tuple[str, ...],
        group: Group,
        columns: list[Column],
        *,
        scaled: bool = True,
    ) -> Stream:
        names = (quantity,) * len(columns) if isinstance(quantity, str) else quantity
        values = np.stack(
            [
                self._scaled(name, column) if scaled else column.values
                for name, column in zip(names, columns, strict=True)
            ],
            axis=1,
        )
        time, clock = self._time(group, names[0])
        known = np.isfinite(time)
        time, values = time[known], values[known]
        later = np.diff(time, prepend=-np.inf) > 0.0
        if np.mean(later) < 0.9:
            row = int(np.argmin(later))
            raise self._error(
                "time",
                f"it does not increase at value {row + 1} ({time[row]:.9g} s); "
                "the times of the rows in their order are needed",
            )
        ahead = time > np.maximum.accumulate(np.r_[-np.inf, time[:-1]])
        return Stream(time=time[ahead], values=values[ahead], clock=clock)

    def _time(self, group: Group, quantity: str) -> tuple[np.ndarray, str]:
        """Returns the times of a group's rows [s], and whose clock they are of."""
        named = self._mapping.columns.get("time", "time")
        for name in [named] if isinstance(named, str) else named:
            column = group.columns.get(name.removeprefix(f"{group.name}."))
            if column is not None:
                return self._scaled("time", column), group.clock
        if group.time is not None:
            return self._scaled("time", group.columns[group.time]), group.clock
        rows = len(next(iter(group.columns.values())).values)
        for other in self._raw.groups:  # Of the same clock, with as many rows.
            for name, column in other.columns.items():
                named_so = named in (name, f"{other.name}.{name}")
                fits = other.clock == group.clock and len(column.values) == rows
                if named_so and fits:
                    return self._scaled("time", column), group.clock
        raise self._error(
            "time",
            f"no column of times was found for '{quantity}'"
            + (f" (the mapping says {named!r})" if named else ""),
        )

    def _scaled(self, quantity: str, column: Column) -> np.ndarray:
        """Returns a column in SI; refuses a unit that the file contradicts."""
        kind, told = QUANTITIES[quantity], self._mapping.units
        field = quantity if quantity in told else kind
        source = f"{self._mapping.source}: units: {field}"
        if column.fault:
            raise InputError(f"{self._raw.path}: {column.fault}")
        own = column.unit if column.unit and units.spell(column.unit) else None
        if field not in told:
            if own is None:
                return column.values
            return _apply(
                units.scale_of(own, kind, f"{self._raw.path}: {quantity}"),
                column.values,
            )
        scale = units.scale_of(told[field], kind, source)
        plain = isinstance(told[field], str)
        if own and plain and units.spell(str(told[field])) != units.spell(own):
            raise InputError(
                f"{source}: found '{told[field]}', but {self._raw.path} says "
                f"that its unit is '{own}'; the same in both is needed."
            )
        return _apply(scale, column.values)

    def _field(self, quantity: str) -> str:
        return f"columns: {quantity} (of {self._mapping.source})"

    def _missing(self, quantity: str) -> InputError:
        return InputError(
            f"{self._mapping.source}: columns: '{quantity}' is missing; position (or "
            "x and z), attitude (or pitch) and time are needed of every log."
        )

    def _error(self, quantity: str, reason: str) -> InputError:
        return InputError(f"{self._raw.path}: {self._field(quantity)}: {reason}.")


def _apply(scale: units.Scale, values: np.ndarray) -> np.ndarray:
    return scale.gain * (values - scale.zero)


def _finite(values: np.ndarray, filler: float = 0.0) -> np.ndarray:
    """Returns values with a filler in rows where nothing was seen."""
    return np.where(np.isfinite(values).all(axis=1)[:, None], values, filler)


def _masked(stream: Stream, turn: Rotation) -> Stream:
    """Returns quaternions with nan again where nothing was seen."""
    unseen = ~np.isfinite(stream.values).all(axis=1)
    quaternion = turn.as_quat()
    quaternion[unseen] = np.nan
    return dataclasses.replace(stream, values=quaternion)
