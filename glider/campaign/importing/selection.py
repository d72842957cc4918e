"""The quantities of a mapping, picked out of a recording and converted to SI.

Axes and signs are still the log's own; each quantity keeps its own clock.
"""

import itertools
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from glider.campaign.importing.recording import (
    Column,
    Recording,
    Vector,
    scale_of,
    spell,
)
from glider.campaign.importing.splitting import FEWEST_ROWS, find_restarts
from glider.campaign.settings import QUANTITIES, Mapping, Markers, Names, unit_vector
from glider.errors import InputError

_SERVO = ("elevator", "elevator_rate_command", "elevator_angle_command")
_ROUNDED = (0.01, 1e-3, 1e-4)  # Last digits of times that are rounded [s].
_LONGEST = 0.05  # Step of a log above which commands are logged at changes only [s].
_EULER = ("roll", "pitch", "yaw")  # About x, y and z.
_POINT = ("xyz", "012")  # Axes of vectors: letters, or indices.
_PLANE = (*_POINT, "xy", "xz", "01")


class Stream(NamedTuple):
    """Numbers with their times."""

    time: np.ndarray  #: (n,) increasing [s].
    values: np.ndarray  #: (n, k)
    clock: str  #: Whose it is.
    late: int = 0  #: Rows that were dropped, as their time fell back.

    @property
    def step(self) -> float:
        """Usual step of a log, whose rows may be those of changes only [s]."""
        return min(float(np.quantile(np.diff(self.time), 0.25)), _LONGEST)

    def known(self) -> "Stream":
        """The rows in which all numbers are finite."""
        rows = np.isfinite(self.values).all(axis=1)
        return self._replace(time=self.time[rows], values=self.values[rows])


class ServoLogs(NamedTuple):
    """What was logged of the elevator's servo."""

    elevator: Stream | None = None  #: (n, 1) as measured [rad].
    rate_command: Stream | None = None  #: (n, 1) [rad/s]
    angle_command: Stream | None = None  #: (n, 1) [rad]

    @property
    def given(self) -> list[Stream]:
        """Those that were logged."""
        return [stream for stream in self if stream is not None]


class Picker:
    """Picks the quantities of a recording; refuses those that are not complete."""

    def __init__(self, recording: Recording, mapping: Mapping) -> None:
        """Picks from a recording as a mapping specifies."""
        self._recording = recording
        self._mapping = mapping

    def position(self) -> Stream:
        """Positions (n, 3) x, y, z, or (n, 2) x and the axis that is vertical [m]."""
        columns = self._mapping.columns
        if "position" in columns:
            return self._vector("position", columns["position"])
        if {"y", "z"} <= columns.keys():
            return self.scalars(("x", "y", "z"))
        second = "y" if "y" in columns else "z"
        self._check_vertical(second)
        return self.scalars(("x", second))

    def attitude(self) -> Stream | None:
        """Quaternions (n, 4) x, y, z, w from body to log; None for a pitch alone.

        Of markers in a plane the way from tail to nose (n, 2), as of a position.
        """
        rotation = self._mapping.frame.rotation or self._recording.rotation
        name = self._mapping.columns.get("attitude")
        if name is None:
            if not all(angle in self._mapping.columns for angle in _EULER):
                return None
            order = self._mapping.frame.rotation or "ZYX"
            return self._angles(self.scalars(_EULER), order)
        if isinstance(name, Markers):
            return self._markers(name)
        shapes = ("012345678", "xyzw", "0123", *_POINT)
        axes, found = self._find("attitude", name, shapes, "of a rotation")
        if len(axes) == 9:
            return _of_matrices(self._stream(("attitude",) * 9, found, scaled=False))
        if len(axes) == 3:
            return self._angles(self._stream(("attitude",) * 3, found), rotation)
        if isinstance(name, list):  # In any order.
            letters = "".join(part[-1:].lower() for part in name)
            axes = letters if sorted(letters) == sorted("xyzw") else "0123"
        stream = self._stream(("attitude",) * 4, found, scaled=False)
        return self._quaternions(stream, axes, rotation)

    def servo(self) -> ServoLogs:
        """What is mapped of the servo."""
        return ServoLogs(*map(self._servo_log, _SERVO))

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
        group = pairs[0][0]
        if any(other is not group for other, _ in pairs):
            raise self._error(
                quantities[0],
                f"{', '.join(quantities)} are in different groups; "
                "expected one with the same times",
            )
        return self._stream(quantities, (group, [column for _, column in pairs]))

    def _servo_log(self, quantity: str) -> Stream | None:
        """The known rows of a quantity; None where the mapping has none."""
        if quantity not in self._mapping.columns:
            return None
        known = self.scalars((quantity,)).known()
        if len(known.time) < 2:
            raise self._error(quantity, "fewer than two rows of it have a number")
        return known

    def _quaternions(self, stream: Stream, axes: str, rotation: str | None) -> Stream:
        if axes == "0123":
            if rotation not in ("wxyz", "xyzw"):
                raise self._error(
                    "attitude",
                    "the order of the quaternion's four numbers is unknown; "
                    "expected frame: {rotation: wxyz} or xyzw",
                )
            axes = rotation
        elif self._mapping.frame.rotation not in (None, axes):
            reason = f"its columns have the order {axes} by their names"
            raise self._error("attitude", f"{reason}; expected no other 'rotation'")
        order = [axes.index(letter) for letter in "xyzw"]
        stream = stream._replace(values=stream.values[:, order])
        with np.errstate(over="ignore"):
            norm = np.linalg.norm(stream.values, axis=1)
        # Zeros stand for a body that is not seen; a damaged number may be huge.
        stream.values[~((norm > 0.5) & (norm < 2.0))] = np.nan
        norm = norm[np.isfinite(norm)]
        if len(norm) and np.median(np.abs(norm - 1.0)) > 0.01:
            reason = f"a quaternion has a length of {np.median(norm):.3g}; expected 1"
            raise self._error("attitude", reason)
        return _turned(stream, Rotation.from_quat)

    def _angles(self, stream: Stream, rotation: str | None) -> Stream:
        if rotation is None or rotation in ("wxyz", "xyzw"):
            raise self._error(
                "attitude",
                "the meaning of its three angles is unknown; expected frame: "
                "{rotation: XYZ}, an order of Euler angles, or rotation_vector",
            )
        frame = self._mapping.frame
        if rotation == "rotation_vector":
            return _turned(stream, Rotation.from_rotvec)
        if frame.turns_pitch:
            stream = stream._replace(values=stream.values * [1.0, -1.0, 1.0])
        order = ["XYZ".index(letter) for letter in rotation.upper()]
        return _turned(stream, lambda v: Rotation.from_euler(rotation, v[:, order]))

    def _markers(self, markers: Markers) -> Stream:
        """Attitude by points: x from tail to nose, y toward the left wing tip.

        In a plane the way from tail to nose.
        """
        names = (markers.nose, markers.tail, markers.left, markers.right)
        points = [self._vector("attitude", name) for name in names if name]
        for point in points:  # Zeros stand for a marker that is not seen.
            point.values[np.all(point.values == 0.0, axis=1)] = np.nan
        if len({point.values.shape for point in points}) > 1:
            reason = "its markers have different rows or axes; expected the same of all"
            raise self._error("attitude", reason)
        nose, tail, *tips = (point.values for point in points)
        ahead = nose - tail
        if ahead.shape[1] == 2:
            if tips:
                reason = (
                    "left and right are not seen in a plane; expected nose and tail"
                )
                raise self._error("attitude", reason)
            return points[0]._replace(values=ahead)
        # Without wing tips it is level: square to what is up.
        level = np.cross(unit_vector(self._mapping.frame.up), ahead)
        left = tips[0] - tips[1] if tips else level
        top = np.cross(ahead, left)
        axes = np.stack([ahead, np.cross(top, ahead), top], axis=2)
        with np.errstate(invalid="ignore", divide="ignore"):
            axes /= np.linalg.norm(axes, axis=1, keepdims=True)
        return _of_matrices(points[0]._replace(values=axes.reshape(len(axes), 9)))

    def _vector(self, quantity: str, name: Names | Markers) -> Stream:
        """Points (n, 3), or in a plane (n, 2) along it and up or down [m]."""
        axes, found = self._find(quantity, name, _PLANE, "with x, y, z")
        if axes in ("xy", "xz") and isinstance(name, str):
            self._check_vertical(axes[1])
        return self._stream(("position",) * len(axes), found)

    def _check_vertical(self, second: str) -> None:
        """Refuses axes in a plane the second of which is not the vertical one."""
        up = self._mapping.frame.up
        if up[-1] != second:
            raise InputError(
                f"{self._mapping.source}: frame: up is {up}, but the columns are x and "
                f"{second}; expected up {second} or -{second}."
            )

    def _find(
        self, quantity: str, name: Names | Markers, shapes: tuple[str, ...], what: str
    ) -> tuple[str, Vector]:
        """Axes, group and columns of a vector: the first of some shapes that fits."""
        field = self._field(quantity)
        if isinstance(name, str):
            # A position may be that of a body or a marker.
            owners = (name, f"{name}.Position") if shapes == _PLANE else (name,)
            for owner, axes in itertools.product(owners, shapes):
                found = self._recording.find_all(owner, axes, field)
                if found is not None:
                    return axes, found
            self._recording.find(name, field)  # Its error lists what is there.
        elif not isinstance(name, Markers):
            for axes in shapes:
                if len(name) == len(axes):
                    return axes, self._recording.find_each(name, field)
        raise self._error(quantity, f"no columns '{name}' {what} were found")

    def _stream(
        self, quantities: tuple[str, ...], found: Vector, *, scaled: bool = True
    ) -> Stream:
        group, columns = found
        parts = [column.values for column in columns]
        if scaled:
            parts = list(map(self._scaled, quantities, columns))
        if len(set(map(len, parts))) > 1:
            reason = "its columns have different lengths; expected the same"
            raise self._error(quantities[0], reason)
        values = np.stack(parts, axis=1)
        named = self._mapping.columns.get("time", "time")
        times = self._recording.find_times(group, named, len(values))
        if times is None:
            reason = f"no column of times was found for '{quantities[0]}'"
            raise self._error("time", f"{reason} (named {named!r})")
        time = self._scaled("time", times)
        known = np.isfinite(time)
        time = time[known]
        values = values[known]
        later = np.diff(time, prepend=-np.inf) > 0.0
        starts = find_restarts(time)
        if starts or (len(later) and np.mean(later) < 0.9):
            row = starts[0] if starts else int(np.argmin(later))
            raise self._error(
                "time",
                f"it does not increase at value {row + 1} ({time[row]:.9g} s); "
                "expected the rows in the order of their times, and as many restarts "
                "in each table",
            )
        ahead = time > np.maximum.accumulate(np.r_[-np.inf, time[:-1]])[: len(time)]
        even = _without_rounding(time[ahead])
        return Stream(even, values[ahead], group.clock, int(np.sum(~ahead)))

    def _scaled(self, quantity: str, column: Column) -> np.ndarray:
        """A column in SI; refuses a unit that the file contradicts."""
        path = self._recording.path
        mapped = self._mapping.units
        if column.fault:
            raise InputError(f"{path}: {column.fault}")
        kind = QUANTITIES[quantity]
        unit = mapped.get(quantity, mapped.get(kind))
        own = spell(column.unit or "")
        if unit is None:
            if own is None:
                return column.values
            scale = scale_of(own, kind, f"{path}: {quantity}")
        else:
            field = quantity if quantity in mapped else kind
            source = f"{self._mapping.source}: units: {field}"
            scale = scale_of(unit, kind, source)
            if own and isinstance(unit, str) and spell(unit) != own:
                raise InputError(
                    f"{source}: found '{unit}', but in {path} its unit is '{own}'; "
                    "expected the same in both."
                )
        return scale.gain * (column.values - scale.zero)

    def _field(self, quantity: str) -> str:
        return f"columns: {quantity} (of {self._mapping.source})"

    def _error(self, quantity: str, reason: str) -> InputError:
        return InputError(f"{self._recording.path}: {self._field(quantity)}: {reason}.")


def _without_rounding(time: np.ndarray) -> np.ndarray:
    """Times (n,) with even steps, where they are rounded and all that is not is that.

    Rows between gaps are on their own. At 7 m/s a millisecond is 7 mm.
    """
    clean = time.copy()
    left = (np.ptp(time / r - np.round(time / r)) for r in _ROUNDED if len(time))
    digit = next((r for r, n in zip(_ROUNDED, left, strict=False) if n < 1e-2), 0.0)
    gaps = np.diff(time) > 1.5 * np.median(np.diff(time)) + digit
    for rows in np.split(np.arange(len(time)), np.flatnonzero(gaps) + 1):
        if digit and len(rows) >= FEWEST_ROWS:
            even = np.polynomial.Polynomial.fit(rows, time[rows], 1)(rows)
            if 1e-3 * digit < np.ptp(even - time[rows]) < 1.1 * digit:
                clean[rows] = even
    return clean


def _of_matrices(stream: Stream) -> Stream:
    """Quaternions of rotation matrices (n, 9), row by row, nan where none is one.

    Zeros stand for a body that is not seen.
    """
    matrices = stream.values.reshape(-1, 3, 3)
    with np.errstate(invalid="ignore"):
        is_one = np.linalg.det(matrices) > 0.5
    values = np.where(is_one[:, None], stream.values, np.nan)
    stream = stream._replace(values=values)
    return _turned(stream, lambda v: Rotation.from_matrix(v.reshape(-1, 3, 3)))


def _turned(stream: Stream, read: Callable[[np.ndarray], Rotation]) -> Stream:
    """Quaternions of a stream's numbers, nan in rows where nothing was seen."""
    seen = np.isfinite(stream.values).all(axis=1)
    quaternion = np.full((len(seen), 4), np.nan)
    quaternion[seen] = read(stream.values[seen]).as_quat()
    return stream._replace(values=quaternion)
