"""The quantities of a mapping, picked out of a recording, in our axes and signs.

Each quantity keeps its own clock. The rows of W are forward, left and up in the log's
axes, those of B nose, left and top in the body's axes, as the mapping names them. Then
    p' = W p,   R' = W R Bᵀ,   p_cm = p' - R' r
for a tracked point r ahead of and above the center of mass.
"""

import dataclasses
import functools
import warnings
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from glider.campaign.checks.motion import SPAN
from glider.campaign.importing.recording import (
    Column,
    Recording,
    Vector,
    scale_of,
    spell,
)
from glider.campaign.importing.splitting import FEWEST_ROWS, find_restarts
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
_LONGEST = 0.05  # Step of a log above which commands are logged at changes only [s].
_PLANE = (*SHAPES["position"], "xy", "xz", "01")  # Points in space, or in a plane.
_SAME_TIME = 1e-6  # Time between rows at the same time [s].
_MAX_GAP = 0.1  # Time between two attitudes above which none is interpolated [s].


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


@dataclasses.dataclass(frozen=True, kw_only=True)
class Track:
    """One recording in x forward, y left, z up; n rows in which the body was seen."""

    path: Path
    time: np.ndarray  #: (n,) [s]
    position: np.ndarray  #: (n, 3) [m]; y is zero where it is not logged.
    rotation: np.ndarray  #: (n, 3, 3) from nose, left, top to the axes.
    spatial: bool = True  #: Whether roll and yaw were logged; else they are zero.
    along_throw: bool = False  #: Whether x has yet to be turned along each flight.
    clock: str = ""
    servo: ServoLogs = ServoLogs()  #: Positive trailing edge up.
    notes: tuple[str, ...] = ()  #: On rows that were dropped.
    why: str = ""  #: Of a flight: it begins and ends where it does.
    jitter: float = 0.0  #: Of the stamps about the even steps that were restored [s].
    clock_std: float = 0.0  #: Of the shift of the servo's logs onto this clock [s].

    @property
    def has_measured(self) -> bool:
        """Whether the elevator was measured on the clock of the poses."""
        elevator = self.servo.elevator
        return elevator is not None and elevator.clock == self.clock

    @property
    def span(self) -> tuple[float, float]:
        """Times of the first and last row [s]."""
        return float(self.time[0]), float(self.time[-1])


def make_track(recording: Recording, mapping: ColumnMapping) -> Track:
    """Turns a recording into the axes and signs of this project."""
    frame = mapping.frame
    pick = _Picker(recording, mapping)
    place = pick.position()
    planar = place.values.shape[1] == 2
    world = _world_axes(frame)
    attitude, spatial = pick.attitude(world, planar)
    rotation = _interpolate(attitude, place.time)
    if spatial:
        rotation = world @ rotation @ frame.body.T
    ahead, above = frame.tracked_point
    position = _turn_points(place.values, world)
    position -= rotation @ np.array([ahead, 0.0, above])
    unseen = np.all(place.values == 0.0, axis=1)
    seen = np.isfinite(position).all(axis=1) & ~unseen
    counts = {
        "whose time falls back: they are dropped": place.late,
        "in which the position is zero: the body was not seen": int(np.sum(unseen)),
    }
    return Track(
        path=recording.path,
        time=place.time[seen],
        position=position[seen],
        rotation=rotation[seen],
        spatial=spatial,
        along_throw=not planar and frame.forward in (None, "throw"),
        clock=place.clock,
        notes=tuple(f"{count} rows {why}" for why, count in counts.items() if count),
        servo=pick.servo(),
    )


def take(track: Track, rows: np.ndarray | slice) -> Track:
    """Some rows of a recording."""
    return dataclasses.replace(
        track,
        time=track.time[rows],
        position=track.position[rows],
        rotation=track.rotation[rows],
    )


def turn_along(track: Track) -> Track:
    """Turns x along the line that fits the ground track best, where it must be.

    It points where the flight goes at first: a loop may end behind its beginning.
    """
    if not track.along_throw:
        return track
    ground = track.position[:, :2] - track.position[0, :2]
    _, _, axes = np.linalg.svd(ground - np.mean(ground, axis=0), full_matrices=False)
    first = np.searchsorted(track.time, track.time[0] + SPAN, side="right") - 1
    x, y = axes[0] if ground[first] @ axes[0] >= 0.0 else -axes[0]
    turn = np.array([[x, y, 0.0], [-y, x, 0.0], [0.0, 0.0, 1.0]])
    start = track.position[0] * [1.0, 1.0, 0.0]
    return dataclasses.replace(
        track,
        position=(track.position - start) @ turn.T,
        rotation=turn @ track.rotation if track.spatial else track.rotation,
    )


def angles_of(track: Track) -> tuple[np.ndarray, np.ndarray | None]:
    """Pitch (n,), and roll and yaw (n, 2) where they are known [rad].

    Of the two triples of yaw, pitch and roll for a rotation the one with less roll is
    taken at first, then the one that continues the yaw of the row before: a glider that
    dives past the vertical continues to pitch.
    """
    if not track.spatial:
        ahead = track.rotation[:, :, 0]
        return np.unwrap(np.arctan2(-ahead[:, 2], ahead[:, 0])), None
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # Straight up or down the yaw is taken as zero.
        yaw, pitch, roll = Rotation.from_matrix(track.rotation).as_euler("ZYX").T
    half_turns = np.round((np.unwrap(yaw, period=np.pi) - yaw) / np.pi)
    is_other = (half_turns + (np.abs(roll[:1]) > 0.5 * np.pi)) % 2 == 1
    pitch = np.where(is_other, np.pi - pitch, pitch)
    sideways = np.column_stack([roll, yaw]) + np.pi * is_other[:, None]
    return np.unwrap(within_pi(pitch)), np.unwrap(within_pi(sideways), axis=0)


def within_pi(angle: np.ndarray) -> np.ndarray:
    """Angles within ±π [rad]."""
    return np.angle(np.exp(1j * angle))


def planar_pose(track: Track) -> np.ndarray:
    """Columns x [m], z [m] and pitch [rad] of a flight (n, 3)."""
    return np.column_stack([track.position[:, [0, 2]], angles_of(track)[0]])


class _Picker:
    """Picks the quantities of a recording; refuses those that are not complete."""

    def __init__(self, recording: Recording, mapping: ColumnMapping) -> None:
        self._recording = recording
        self._mapping = mapping
        self._columns = mapping.columns

    def position(self) -> Stream:
        """Positions (n, 3) x, y, z, or (n, 2) x and the axis that is vertical [m]."""
        if "position" in self._columns:
            return self._point("position", self._columns["position"])
        if {"y", "z"} <= self._columns.keys():
            return self._scalars("x", "y", "z")
        return self._scalars("x", "y" if "y" in self._columns else "z")

    def attitude(self, world: np.ndarray, planar: bool) -> tuple[Stream, bool]:
        """Rotations (n, 9) from body to log, row by row, and True.

        Where only the pitch is known they are in our axes, and it is False.
        """
        frame = self._mapping.frame
        name = self._columns.get("attitude")
        if isinstance(name, Markers):
            points = self._markers(name, planar)
            if points.values.shape[1] == 9:
                return points, True
            ahead = _turn_points(points.values, world)
            pitch = points._replace(values=-np.arctan2(ahead[:, [2]], ahead[:, [0]]))
        elif name is not None:
            return self._rotations(name), True
        elif self._columns.keys() >= set(EULER):
            angles = self._scalars(*EULER)
            return self._by_angles(angles, frame.rotation or "ZYX"), True
        else:
            pitch = self._scalars("pitch")
            if (frame.pitch or frame.usual_pitch) == "nose_up":
                pitch = pitch._replace(values=-pitch.values)
        return _turn(pitch, functools.partial(Rotation.from_euler, "y")), False

    def servo(self) -> ServoLogs:
        """What is mapped of the servo, its rows with a number."""
        frame = self._mapping.frame
        logs = []
        for quantity in _SERVO:
            log = None
            if quantity in self._columns:
                log = self._scalars(quantity).known()
                if len(log.time) < 2:
                    reason = "fewer than two rows of it have a number"
                    raise self._error(quantity, reason)
                positive = frame.elevator if quantity == "elevator" else frame.command
                if positive == "trailing_edge_down":
                    log = log._replace(values=-log.values)
            logs.append(log)
        return ServoLogs(*logs)

    def _scalars(self, *quantities: str) -> Stream:
        """Quantities of one group side by side."""
        names = []
        for quantity in quantities:
            name = self._columns.get(quantity)
            if not isinstance(name, str):
                raise InputError(
                    f"{self._mapping.source}: columns: '{quantity}' is missing; "
                    "expected position (or x and z), attitude (or pitch) and time."
                )
            names.append(name)
        found = self._recording.find_each(names, self._field(quantities[0]))
        return self._stream(quantities, found)

    def _rotations(self, name: Names) -> Stream:
        """Rotations (n, 9) of the columns of an attitude."""
        axes, found = self._find("attitude", name, SHAPES["attitude"])
        stream = self._stream(("attitude",) * len(axes), found).known()
        rotation = self._mapping.frame.rotation
        if len(axes) == 9:
            return stream
        if len(axes) == 3:
            return self._by_angles(stream, rotation or self._recording.rotation)
        if isinstance(name, list):  # In any order.
            letters = "".join(part[-1:].lower() for part in name)
            axes = letters if sorted(letters) == sorted("xyzw") else "0123"
        known = ("wxyz", "xyzw") if axes == "0123" else (axes,)
        own = rotation or (self._recording.rotation if axes == "0123" else axes)
        expected = f"{' or '.join(known)}, the order of the quaternion's four numbers"
        self._check_rotation(own in known, own, expected)
        values = stream.values[:, [own.index(letter) for letter in "xyzw"]]
        with np.errstate(over="ignore"):
            norm = np.linalg.norm(values, axis=1)
        # Zeros stand for a body that is not seen; a damaged number may be huge.
        seen = (norm > 0.5) & (norm < 2.0)
        if seen.any() and np.median(np.abs(norm - 1.0)) > 0.01:
            reason = f"a quaternion has a length of {np.median(norm):.3g}; expected 1"
            raise self._error("attitude", reason)
        turns = Stream(stream.time[seen], values[seen], stream.clock)
        return _turn(turns, Rotation.from_quat)

    def _by_angles(self, stream: Stream, rotation: str) -> Stream:
        """Rotations (n, 9) of three angles, in the order in which they are named."""
        known = rotation not in ("", "wxyz", "xyzw")
        expected = "XYZ or rotation_vector, ..., the meaning of its three angles"
        self._check_rotation(known, rotation, expected)
        if rotation == "rotation_vector":
            return _turn(stream, Rotation.from_rotvec)
        signs = np.array([1.0, -1.0 if self._mapping.frame.turns_pitch else 1.0, 1.0])
        order = ["XYZ".index(letter) for letter in rotation.upper()]
        ordered = stream._replace(values=(signs * stream.values)[:, order])
        return _turn(ordered, functools.partial(Rotation.from_euler, rotation))

    def _check_rotation(self, known: bool, found: str, expected: str) -> None:
        """Refuses a `frame: {rotation: ...}` that does not say how angles are read."""
        what = f"{self._recording.path}: {self._field('attitude')}: 'rotation'"
        expect(known, what, found, expected)

    def _markers(self, markers: Markers, planar: bool) -> Stream:
        """Matrices (n, 9) by points: x from tail to nose, y toward the left wing tip.

        In a plane the way from tail to nose (n, 2).
        """
        names = (markers.nose, markers.tail, markers.left, markers.right)
        points = [self._point("attitude", name) for name in names if name]
        for point in points:  # Zeros stand for a marker that is not seen.
            point.values[np.all(point.values == 0.0, axis=1)] = np.nan
        nose, *others = points
        in_plane = nose.values.shape[1] == 2
        is_odd = in_plane and (not planar or len(points) > 2)
        if is_odd or len({point.values.shape for point in points}) > 1:
            reason = "its markers differ in rows or axes, or are in a plane"
            expected = "the same of all, and in a plane a position, nose and tail"
            raise self._error("attitude", f"{reason}; expected {expected}")
        ahead = nose.values - others[0].values
        if in_plane:
            return nose._replace(values=ahead)
        # Without wing tips it is level: square to what is up.
        left = np.cross(unit_vector(self._mapping.frame.up), ahead)
        if markers.left:
            left = others[1].values - others[2].values
        top = np.cross(ahead, left)
        axes = np.stack([ahead, np.cross(top, ahead), top], axis=2)
        with np.errstate(invalid="ignore", divide="ignore"):
            axes /= np.linalg.norm(axes, axis=1, keepdims=True)
        return nose._replace(values=axes.reshape(-1, 9))

    def _point(self, quantity: str, name: Names | Markers) -> Stream:
        """Points (n, 3), or in a plane (n, 2) along it and up or down [m]."""
        axes, found = self._find(quantity, name, _PLANE)
        return self._stream(("position",) * len(axes), found)

    def _find(
        self, quantity: str, name: Names | Markers, shapes: tuple[str, ...]
    ) -> tuple[str, Vector]:
        """Axes, group and columns of a vector: the first of some shapes that fits."""
        field = self._field(quantity)
        if isinstance(name, list):
            for axes in shapes:
                if len(name) == len(axes):
                    return axes, self._recording.find_each(name, field)
        elif isinstance(name, str):
            # A position may be that of a body or a marker.
            owners = (name, f"{name}.Position") if shapes == _PLANE else (name,)
            for owner in owners:
                found = self._recording.find_all(owner, shapes)
                if found is not None:
                    axes, names = found
                    return axes, self._recording.find_each(names, field)
            self._recording.find(name, field)  # Its error lists what is there.
        raise self._error(quantity, f"no columns '{name}' of a vector were found")

    def _stream(self, quantities: Sequence[str], found: Vector) -> Stream:
        group, columns = found
        is_turn = len(columns) in (4, 9)  # A quaternion or a matrix has no unit.
        parts = [column.values for column in columns]
        if not is_turn:
            parts = list(map(self._scaled, quantities, columns))
        values = np.stack(parts, axis=1)
        named = self._columns.get("time", "time")
        times = self._recording.find_times(group, named)
        if times is None:
            reason = f"no column of times was found for '{quantities[0]}'"
            raise self._error("time", f"{reason} (named {named!r})")
        time = self._scaled("time", times)
        known = np.isfinite(time)
        time = time[known]
        values = values[known]
        before = np.maximum.accumulate(np.r_[-np.inf, time])[:-1]
        ahead = time > before
        late = int(np.sum(~ahead))
        starts = find_restarts(time)
        if starts or late > 0.1 * len(ahead):
            row = starts[0] if starts else int(np.argmin(ahead))
            raise self._error(
                "time",
                f"it does not increase at value {row + 1} ({time[row]:.9g} s); "
                "expected the rows in the order of their times, and as many restarts "
                "in each table",
            )
        even = _without_rounding(time[ahead])
        return Stream(even, values[ahead], group.clock, late)

    def _scaled(self, quantity: str, column: Column) -> np.ndarray:
        """A column in SI; refuses a unit that the file contradicts."""
        path = self._recording.path
        if column.fault:
            raise InputError(f"{path}: {column.fault}")
        kind = QUANTITIES[quantity]
        own = spell(column.unit or "")
        field = quantity if quantity in self._mapping.units else kind
        unit = self._mapping.units.get(field, own)
        if unit is None:
            return column.values
        source = f"{self._mapping.source}: units: {field}"
        if own and isinstance(unit, str) and spell(unit) != own:
            raise InputError(
                f"{source}: found '{unit}', but in {path} its unit is '{own}'; "
                "expected the same in both."
            )
        scale = scale_of(unit, kind, source)
        return scale.gain * (column.values - scale.zero)

    def _field(self, quantity: str) -> str:
        return f"columns: {quantity} (of {self._mapping.source})"

    def _error(self, quantity: str, reason: str) -> InputError:
        return InputError(f"{self._recording.path}: {self._field(quantity)}: {reason}.")


def _turn(stream: Stream, make: Callable[[np.ndarray], Rotation]) -> Stream:
    """Rotations (n, 9) that are made of the numbers of each row."""
    stream = stream.known()
    return stream._replace(values=make(stream.values).as_matrix().reshape(-1, 9))


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


def _world_axes(frame: Frame) -> np.ndarray:
    """W (3, 3); where x has yet to be turned along a flight, any axis is forward."""
    forward = frame.forward
    if forward is None or forward == "throw":
        forward = next(axis for axis in "xyz" if axis != frame.up[-1])
    ahead = unit_vector(forward)
    up = unit_vector(frame.up)
    return np.stack([ahead, np.cross(up, ahead), up])


def _turn_points(points: np.ndarray, world: np.ndarray) -> np.ndarray:
    """Points in our axes (n, 3); those in a plane (n, 2) are ahead and up or down."""
    if points.shape[1] == 2:
        points = points @ np.abs(world[[0, 2]])
    return points @ world.T


def _interpolate(turns: Stream, time: np.ndarray) -> np.ndarray:
    """Rotations (n, 3, 3) at times (n,), nan where none of (k, 9) is near."""
    turns = turns.known()
    matrices = turns.values.reshape(-1, 3, 3)
    are_turns = np.linalg.det(matrices) > 0.5  # Zeros are none.
    known = turns.time[are_turns]
    result = np.full((len(time), 3, 3), np.nan)
    if len(known) > 1:
        index = np.clip(np.searchsorted(known, time), 1, len(known) - 1)
        since = time - known[index - 1]
        until = known[index] - time
        exact = np.minimum(np.abs(since), np.abs(until)) < _SAME_TIME
        near = exact | (since + until < _MAX_GAP)
        near &= (since >= 0.0) & (until >= 0.0)
        rotations = Rotation.from_matrix(matrices[are_turns])
        result[near] = Slerp(known, rotations)(time[near]).as_matrix()
    return result
