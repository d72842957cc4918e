"""The picking step: a recording becomes a track in our axes and signs, by a mapping.

A mapping names the columns of each quantity, their units, and the axes of the log. Each
quantity is picked with its own times; the attitudes are interpolated to those of the
positions. With the rows of W forward, left and up in the log's axes, and the rows of B
nose, left and top in the body's axes as they are logged,

    p' = W p,   R' = W R Bᵀ,   p_cm = p' - R' r

for a tracked point r that is ahead of and above the center of mass.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from glider.campaign.importing.recording import (
    Column,
    Group,
    Recording,
    Vector,
    scale_of,
    spell,
)
from glider.campaign.importing.splitting import FEWEST_ROWS, find_restarts
from glider.campaign.importing.track import ServoLogs, Stream, Track
from glider.campaign.settings import (
    EULER,
    QUANTITIES,
    SHAPES,
    ColumnMapping,
    Frame,
    Markers,
    Names,
    unit_vector,
)
from glider.errors import InputError, expect

_SERVO = ("elevator", "elevator_rate_command", "elevator_angle_command")
_ROUNDED = (0.01, 1e-3, 1e-4)  # Last digits of times that are rounded [s].
_PLANE = (*SHAPES["position"], "xy", "xz", "01")  # Points in space, or in a plane.
_SAME_TIME = 1e-6  # Time between rows at the same time [s].
_MAX_GAP = 0.1  # Time between two attitudes above which none is interpolated [s].


def make_track(recording: Recording, mapping: ColumnMapping) -> Track:
    """Turns a recording into the axes and signs of this project.

    Args:
        recording: of one flight or several, in its own units and axes.
        mapping: says which of its columns are which quantities.

    Returns:
        The rows with a position and an attitude near it in time. Rows in which the
        position is zero are left out: systems write it for a body that is not seen.

    Raises:
        InputError: a quantity is missing, or its columns, times or unit are wrong.
    """
    frame = mapping.frame
    picker = _Picker(recording, mapping)
    place = picker.position()
    is_planar = place.values.shape[1] == 2
    world = _world_axes(frame)

    attitude, is_spatial = picker.attitude(world, is_planar)
    rotation = _interpolate(attitude, place.time)
    if is_spatial:
        rotation = world @ rotation @ frame.body.T
    ahead, above = frame.tracked_point
    position = _turn_points(place.values, world)
    position -= rotation @ np.array([ahead, 0.0, above])

    is_zero = np.all(place.values == 0.0, axis=1)
    is_seen = np.isfinite(position).all(axis=1) & ~is_zero
    counts = {
        "whose time falls back: they are dropped": place.late,
        "in which the position is zero: the body was not seen": int(np.sum(is_zero)),
    }
    return Track(
        path=recording.path,
        time=place.time[is_seen],
        position=position[is_seen],
        rotation=rotation[is_seen],
        spatial=is_spatial,
        along_throw=not is_planar and frame.forward in (None, "throw"),
        clock=place.clock,
        notes=tuple(f"{count} rows {why}" for why, count in counts.items() if count),
        servo=picker.servo(),
    )


class _Picker(NamedTuple):
    """Picks the quantities of a recording; refuses those that are not complete.

    Attributes:
        recording: the columns as they were logged.
        mapping: their names, units and axes.
    """

    recording: Recording
    mapping: ColumnMapping

    def position(self) -> Stream:
        """Returns positions in the log's axes [m].

        They are x, y and z (n, 3), or in a plane x and the vertical axis (n, 2).
        """
        columns = self.mapping.columns
        if "position" in columns:
            return self._point("position", columns["position"])
        if {"y", "z"} <= columns.keys():
            return self._scalars("x", "y", "z")
        return self._scalars("x", "y" if "y" in columns else "z")

    def attitude(self, world: np.ndarray, is_planar: bool) -> tuple[Stream, bool]:
        """Returns attitudes as matrices, row by row (n, 9).

        Args:
            world: W (3, 3), rows forward, left and up in the log's axes.
            is_planar: whether the positions are in a plane.

        Returns:
            Rotations from the body's axes to the log's, and True. Where only the pitch
            is known: turns about our y axis, and False.
        """
        frame = self.mapping.frame
        columns = self.mapping.columns
        name = columns.get("attitude")
        if isinstance(name, Markers):
            axes = self._markers(name, is_planar)
            if axes.values.shape[1] == 9:
                return axes, True
            ahead = _turn_points(axes.values, world)
            pitch = axes._replace(values=-np.arctan2(ahead[:, [2]], ahead[:, [0]]))
        elif name is not None:
            return self._rotations(name), True
        elif columns.keys() >= set(EULER):
            angles = self._scalars(*EULER)
            return self._by_angles(angles, frame.rotation or "ZYX"), True
        else:
            pitch = self._scalars("pitch")
            if (frame.pitch or frame.usual_pitch) == "nose_up":
                pitch = pitch._replace(values=-pitch.values)
        pitch = pitch.known()
        return _with_matrices(pitch, Rotation.from_euler("y", pitch.values)), False

    def servo(self) -> ServoLogs:
        """Returns what is mapped of the servo, positive trailing edge up."""
        return ServoLogs(*map(self._servo_log, _SERVO))

    def _servo_log(self, quantity: str) -> Stream | None:
        """Rows (n, 1) of an angle or rate that have a number; None if not mapped."""
        if quantity not in self.mapping.columns:
            return None
        log = self._scalars(quantity).known()
        if len(log.time) < 2:
            raise self._error(quantity, "fewer than two rows of it have a number")
        frame = self.mapping.frame
        positive = frame.elevator if quantity == "elevator" else frame.command
        if positive == "trailing_edge_down":
            log = log._replace(values=-log.values)
        return log

    def _rotations(self, name: Names) -> Stream:
        """Rotations (n, 9) by three angles, a quaternion or the nine of a matrix."""
        axes, found = self._find("attitude", name, SHAPES["attitude"])
        stream = self._stream(("attitude",) * len(axes), found).known()
        if len(axes) == 9:
            return stream
        if len(axes) == 3:
            meaning = self.mapping.frame.rotation or self.recording.rotation
            return self._by_angles(stream, meaning)
        if isinstance(name, list):
            axes = "".join(part[-1:].lower() for part in name)
        return self._by_quaternions(stream, axes)

    def _by_quaternions(self, stream: Stream, axes: str) -> Stream:
        """Rotations (n, 9) of quaternions (n, 4).

        Args:
            stream: the numbers of the quaternions. Rows whose length is far from 1 are
                left out: the body was not seen, or the log is damaged.
            axes: last letters of the columns' names. If these are w, x, y and z they
                are the order; otherwise the mapping or the format has to specify it.
        """
        orders = ["wxyz", "xyzw"]
        usual = self.recording.rotation
        if sorted(axes) == sorted("xyzw"):
            orders = [axes]
            usual = axes
        order = self.mapping.frame.rotation or usual
        self._check_rotation(
            order in orders,
            order,
            f"{' or '.join(orders)}, the order of the quaternion's four numbers",
        )

        values = stream.values[:, [order.index(letter) for letter in "xyzw"]]
        with np.errstate(over="ignore"):
            norm = np.linalg.norm(values, axis=1)
        is_seen = (norm > 0.5) & (norm < 2.0)
        if is_seen.any() and np.median(np.abs(norm - 1.0)) > 0.01:
            raise self._error(
                "attitude",
                f"a quaternion has a length of {np.median(norm):.3g}; expected 1",
            )
        seen = stream._replace(time=stream.time[is_seen])
        return _with_matrices(seen, Rotation.from_quat(values[is_seen]))

    def _by_angles(self, stream: Stream, rotation: str) -> Stream:
        """Rotations (n, 9) of three angles.

        Args:
            stream: roll, pitch and yaw, or the numbers of a rotation vector (n, 3)
                [rad].
            rotation: order of the turns as SciPy has it, about moving axes in capitals
                and about fixed ones in small letters; or "rotation_vector".
        """
        self._check_rotation(
            rotation not in ("", "wxyz", "xyzw"),
            rotation,
            "XYZ or rotation_vector, ..., the meaning of its three angles",
        )
        stream = stream.known()
        angles = stream.values
        if rotation == "rotation_vector":
            return _with_matrices(stream, Rotation.from_rotvec(angles))
        if self.mapping.frame.turns_pitch:
            angles = angles * [1.0, -1.0, 1.0]
        order = ["XYZ".index(letter) for letter in rotation.upper()]
        return _with_matrices(stream, Rotation.from_euler(rotation, angles[:, order]))

    def _check_rotation(self, is_known: bool, found: str, expected: str) -> None:
        """Refuses a `frame: {rotation: ...}` that does not say how angles are read."""
        expect(
            is_known,
            f"{self.recording.path}: {self._field('attitude')}: 'rotation'",
            found,
            expected,
        )

    def _markers(self, markers: Markers, is_planar: bool) -> Stream:
        """Rotations (n, 9) by points: x from tail to nose, y toward the left wing tip.

        With a = nose - tail and l = left - right the matrices have the columns a,
        (a × l) × a and a × l, each divided by its length. Without wing tips the wings
        are taken as level: l = up × a.

        Returns:
            The rotations; of markers in a plane a (n, 2) [m] alone. They are nan where
            a marker was not seen.
        """
        names = (markers.nose, markers.tail, markers.left, markers.right)
        points = [self._point("attitude", name) for name in names if name]
        for point in points:  # Zeros stand for a marker that is not seen.
            point.values[np.all(point.values == 0.0, axis=1)] = np.nan
        nose, tail, *tips = points
        in_plane = nose.values.shape[1] == 2
        is_odd = in_plane and (tips or not is_planar)
        if is_odd or len({point.values.shape for point in points}) > 1:
            raise self._error(
                "attitude",
                "its markers differ in rows or axes, or are in a plane; expected the "
                "same of all, and in a plane a position, nose and tail",
            )

        ahead = nose.values - tail.values
        if in_plane:
            return nose._replace(values=ahead)
        if markers.left:
            left_tip, right_tip = tips
            left = left_tip.values - right_tip.values
        else:
            left = np.cross(unit_vector(self.mapping.frame.up), ahead)
        top = np.cross(ahead, left)
        axes = np.stack([ahead, np.cross(top, ahead), top], axis=2)
        with np.errstate(invalid="ignore", divide="ignore"):
            axes /= np.linalg.norm(axes, axis=1, keepdims=True)
        return nose._replace(values=axes.reshape(-1, 9))

    def _point(self, quantity: str, name: Names | Markers) -> Stream:
        """Points (n, 3), or in a plane (n, 2) along it and up or down [m]."""
        axes, found = self._find(quantity, name, _PLANE)
        return self._stream(("position",) * len(axes), found)

    def _scalars(self, *quantities: str) -> Stream:
        """Quantities of one group side by side (n, k), in SI units."""
        names = []
        for quantity in quantities:
            name = self.mapping.columns.get(quantity)
            if not isinstance(name, str):
                raise InputError(
                    f"{self.mapping.source}: columns: '{quantity}' is missing; "
                    "expected position (or x and z), attitude (or pitch) and time."
                )
            names.append(name)
        found = self.recording.find_each(names, self._field(quantities[0]))
        return self._stream(quantities, found)

    def _find(
        self, quantity: str, name: Names | Markers, shapes: tuple[str, ...]
    ) -> tuple[str, Vector]:
        """Finds the columns of a vector.

        Args:
            quantity: for messages.
            name: common name of the columns, or a list of all their names.
            shapes: axes that the columns may have, in letters or digits as in SHAPES.

        Returns:
            The axes of the first shape that fits, and the group and its columns.
        """
        field = self._field(quantity)
        if isinstance(name, list):
            for axes in shapes:
                if len(name) == len(axes):
                    return axes, self.recording.find_each(name, field)
        elif isinstance(name, str):
            # A position may be that of a body or a marker.
            owners = (name, f"{name}.Position") if shapes == _PLANE else (name,)
            for owner in owners:
                found = self.recording.find_all(owner, shapes)
                if found is not None:
                    axes, names = found
                    return axes, self.recording.find_each(names, field)
            self.recording.find(name, field)  # Its error lists what is there.
        raise self._error(quantity, f"no columns '{name}' of a vector were found")

    def _stream(self, quantities: Sequence[str], found: Vector) -> Stream:
        """Columns of a group side by side (n, k) in SI units, with their times.

        Rows without a time are left out, and so are those whose time falls back, unless
        they are many. A time that starts again is refused: tables of several flights
        were split before.

        Args:
            quantities: of the columns, one each.
            found: the group, and k of its columns.
        """
        group, columns = found
        if len(columns) in (4, 9):  # A quaternion or a matrix has no unit.
            parts = [column.values for column in columns]
        else:
            parts = list(map(self._scaled, quantities, columns))
        values = np.stack(parts, axis=1)
        time = self._times(group, quantities[0])
        has_time = np.isfinite(time)
        time = time[has_time]
        values = values[has_time]

        latest_before = np.maximum.accumulate(np.r_[-np.inf, time])[:-1]
        is_later = time > latest_before
        late = int(np.sum(~is_later))
        restarts = find_restarts(time)
        if restarts or late > 0.1 * len(time):
            row = restarts[0] if restarts else int(np.argmin(is_later))
            raise self._error(
                "time",
                f"it does not increase at value {row + 1} ({time[row]:.9g} s); "
                "expected the rows in the order of their times, and as many restarts "
                "in each table",
            )
        even = _without_rounding(time[is_later])
        return Stream(even, values[is_later], group.clock, late)

    def _times(self, group: Group, quantity: str) -> np.ndarray:
        """Times (n,) of a group's rows [s]; the quantity is for the message."""
        named = self.mapping.columns.get("time", "time")
        times = self.recording.find_times(group, named)
        if times is None:
            raise self._error(
                "time",
                f"no column of times was found for '{quantity}' (named {named!r})",
            )
        return self._scaled("time", times)

    def _scaled(self, quantity: str, column: Column) -> np.ndarray:
        """A column (n,) in SI units.

        Its unit is that of the mapping for the quantity, or for its kind, or else that
        of the file. One that the file contradicts is refused.
        """
        path = self.recording.path
        if column.fault:
            raise InputError(f"{path}: {column.fault}")
        units = self.mapping.units
        kind = QUANTITIES[quantity]
        own = spell(column.unit or "")
        field = quantity if quantity in units else kind
        unit = units.get(field, own)
        if unit is None:
            return column.values
        source = f"{self.mapping.source}: units: {field}"
        if own and isinstance(unit, str) and spell(unit) != own:
            raise InputError(
                f"{source}: found '{unit}', but in {path} its unit is '{own}'; "
                "expected the same in both."
            )
        scale = scale_of(unit, kind, source)
        return scale.gain * (column.values - scale.zero)

    def _field(self, quantity: str) -> str:
        return f"columns: {quantity} (of {self.mapping.source})"

    def _error(self, quantity: str, reason: str) -> InputError:
        return InputError(f"{self.recording.path}: {self._field(quantity)}: {reason}.")


def _with_matrices(stream: Stream, rotations: Rotation) -> Stream:
    """The times of a stream with a rotation for each, as matrices (n, 9)."""
    return stream._replace(values=rotations.as_matrix().reshape(-1, 9))


def _without_rounding(time: np.ndarray) -> np.ndarray:
    """Times (n,) with even steps in place of rounded ones [s].

    A line is fitted to the rows between two gaps. It replaces their times where it
    differs from them by no more than the last digit: at 7 m/s a millisecond is 7 mm.
    """
    clean = time.copy()
    digit = _last_digit(time)
    if not digit:
        return clean
    steps = np.diff(time)
    is_gap = steps > 1.5 * np.median(steps) + digit
    for rows in np.split(np.arange(len(time)), np.flatnonzero(is_gap) + 1):
        if len(rows) >= FEWEST_ROWS:
            even = np.polynomial.Polynomial.fit(rows, time[rows], 1)(rows)
            if 1e-3 * digit < np.ptp(even - time[rows]) < 1.1 * digit:
                clean[rows] = even
    return clean


def _last_digit(time: np.ndarray) -> float:
    """The coarsest of `_ROUNDED` that times (n,) are rounded to [s]; 0.0: none.

    They may be shifted by a constant.
    """
    for digit in _ROUNDED:
        count = time / digit
        if len(time) and np.ptp(count - np.round(count)) < 1e-2:
            return digit
    return 0.0


def _world_axes(frame: Frame) -> np.ndarray:
    """W (3, 3), rows forward, left and up in the log's axes.

    Where x has yet to be turned along each flight, any level axis is forward.
    """
    forward = frame.forward
    if forward is None or forward == "throw":
        forward = "xyz".replace(frame.up[-1], "")[0]
    ahead = unit_vector(forward)
    up = unit_vector(frame.up)
    return np.stack([ahead, np.cross(up, ahead), up])


def _turn_points(points: np.ndarray, world: np.ndarray) -> np.ndarray:
    """Points in our axes (n, 3); those in a plane (n, 2) are ahead and up or down."""
    if points.shape[1] == 2:
        points = points @ np.abs(world[[0, 2]])
    return points @ world.T


def _interpolate(turns: Stream, time: np.ndarray) -> np.ndarray:
    """Interpolates attitudes to other times, along great circles (slerp).

    Args:
        turns: matrices (k, 9); rows that are no rotations are left out.
        time: (n,) [s].

    Returns:
        Rotations (n, 3, 3). They are nan outside the attitudes' times and in gaps
        between them of `_MAX_GAP` and more, except at the ends of a gap.
    """
    turns = turns.known()
    matrices = turns.values.reshape(-1, 3, 3)
    is_turn = np.linalg.det(matrices) > 0.5
    known = turns.time[is_turn]
    result = np.full((len(time), 3, 3), np.nan)
    if len(known) < 2:
        return result

    index = np.clip(np.searchsorted(known, time), 1, len(known) - 1)
    since = time - known[index - 1]
    until = known[index] - time
    is_within = (since >= 0.0) & (until >= 0.0)
    is_exact = np.minimum(since, until) < _SAME_TIME
    near = is_within & (is_exact | (since + until < _MAX_GAP))
    rotations = Rotation.from_matrix(matrices[is_turn])
    result[near] = Slerp(known, rotations)(time[near]).as_matrix()
    return result
