"""The frame step: a recording turned into the axes and signs of this project.

The rows of W are forward, left and up in the log's axes, those of B nose, left and top
in the body's axes, as the mapping names them. Then
    p' = W p,   R' = W R Bᵀ,   p_cm = p' - R' r
for a tracked point r ahead of and above the center of mass.
"""

import dataclasses
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from glider.campaign.importing.mapping import Frame, Mapping
from glider.campaign.importing.selection import ServoLogs, Stream, Streams
from glider.errors import InputError

_MAX_GAP = 0.1
"""Time between two attitudes above which none is interpolated [s]."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Track:
    """One recording in x forward, y left, z up; n rows in which the body was seen."""

    path: Path
    time: np.ndarray  # (n,) [s]
    position: np.ndarray  # (n, 3) [m]; y is zero where it is not logged.
    rotation: np.ndarray | None  # (n, 3, 3) from nose, left, top to the axes.
    pitch: np.ndarray | None  # (n,) positive nose down [rad], where no rotation is.
    along_throw: bool  # Whether x has yet to be turned along each flight.
    clock: str
    servo: ServoLogs  # Positive trailing edge up.


def make_track(streams: Streams, mapping: Mapping) -> Track:
    """Turns a recording into the axes and signs of this project."""
    frame = mapping.frame
    planar = streams.position.values.shape[1] == 2
    world, along_throw = _world_axes(frame, planar, mapping.source)
    position = streams.position.values
    if planar:
        position = np.insert(position, 1, 0.0, axis=1)
    time = streams.position.time
    rotation = pitch = None
    if streams.quaternion is not None:
        rotation = world @ _rotations(streams.quaternion, time) @ _body_axes(frame).T
        seen = np.isfinite(rotation).all(axis=(1, 2))
    else:
        assert streams.pitch is not None
        pitch = _pitches(streams.pitch, time)
        pitch *= 1.0 if frame.pitch == "nose_down" else -1.0
        seen = np.isfinite(pitch)
    position = position @ world.T
    seen &= np.isfinite(position).all(axis=1)
    ahead, above = frame.tracked_point
    if rotation is not None:
        position = position - rotation @ np.array([ahead, 0.0, above])
    elif pitch is not None and (ahead or above):
        cos, sin = np.cos(pitch), np.sin(pitch)
        position[:, 0] -= ahead * cos + above * sin
        position[:, 2] -= above * cos - ahead * sin
    return Track(
        path=streams.path,
        time=time[seen],
        position=position[seen],
        rotation=None if rotation is None else rotation[seen],
        pitch=None if pitch is None else np.unwrap(pitch[seen]),
        along_throw=along_throw,
        clock=streams.position.clock,
        servo=ServoLogs(
            _signed(streams.servo.elevator, frame.elevator),
            _signed(streams.servo.rate_command, frame.command),
            _signed(streams.servo.angle_command, frame.command),
        ),
    )


def take(track: Track, rows: np.ndarray | slice) -> Track:
    """Some rows of a recording."""
    return dataclasses.replace(
        track,
        time=track.time[rows],
        position=track.position[rows],
        rotation=None if track.rotation is None else track.rotation[rows],
        pitch=None if track.pitch is None else track.pitch[rows],
    )


def turn_along(track: Track) -> Track:
    """Turns a flight along the throw: x along its way over the ground, y = 0 at first.

    The way is the line that fits the horizontal positions best. Other flights stay.
    """
    if not track.along_throw:
        return track
    ground = track.position[:, :2]
    _, _, axes = np.linalg.svd(ground - np.mean(ground, axis=0), full_matrices=False)
    along = axes[0] * np.sign(axes[0] @ (ground[-1] - ground[0]) or 1.0)
    turn = np.array([[along[0], along[1], 0.0], [-along[1], along[0], 0.0], [0, 0, 1]])
    start = np.append(ground[0], 0.0)
    return dataclasses.replace(
        track,
        position=(track.position - start) @ turn.T,
        rotation=None if track.rotation is None else turn @ track.rotation,
    )


def angles_of(track: Track) -> tuple[np.ndarray, np.ndarray | None]:
    """Pitch (n,), and roll and yaw (n, 2) where they are known [rad].

    Of the two triples of yaw, pitch and roll for a rotation the one with less roll is
    taken at first, then the one that continues the row before: a glider that dives past
    the vertical continues to pitch, and one that rolls over continues to roll.
    """
    if track.rotation is None:
        assert track.pitch is not None
        return track.pitch, None
    turn = track.rotation
    yaw = np.arctan2(turn[:, 1, 0], turn[:, 0, 0])
    pitch = -np.arcsin(np.clip(turn[:, 2, 0], -1.0, 1.0))
    roll = np.arctan2(turn[:, 2, 1], turn[:, 2, 2])
    over = np.abs(roll) > 0.5 * np.pi
    ways = np.array([[roll, pitch, yaw], [roll + np.pi, np.pi - pitch, yaw + np.pi]])
    turns = np.exp(1j * ways)
    for k in range(1, len(over)):
        before = turns[int(over[k - 1]), :, k - 1]
        steps = np.abs(turns[:, :, k] - before).sum(axis=1)
        over[k] = steps[1] < steps[0]
    pitch = np.where(over, np.pi - pitch, pitch)
    roll = np.where(over, roll + np.pi, roll)
    yaw = np.where(over, yaw + np.pi, yaw)
    upright = [np.angle(np.exp(1j * angle)) for angle in (roll, yaw)]
    pitch = np.unwrap(np.angle(np.exp(1j * pitch)))
    return pitch, np.unwrap(np.column_stack(upright), axis=0)


def _world_axes(frame: Frame, planar: bool, source: str) -> tuple[np.ndarray, bool]:
    """W (3, 3), and whether x has yet to be turned along each flight."""
    forward = frame.forward
    up = _unit(frame.up)
    if planar:
        forward = forward or "x"
        if frame.up[-1] != "z" or forward[-1] != "x":
            raise InputError(
                f"{source}: frame: up is {frame.up} and forward is {forward}, but the "
                "columns are x and z; expected up z or -z and forward x or -x."
            )
        # y is not logged: it is what makes the axes right-handed.
        return np.stack([_unit(forward), np.zeros(3), up]), False
    if forward is None or forward == "throw":
        rest = next(axis for axis in "xyz" if axis != frame.up[-1])
        ahead = _unit(rest)
    else:
        ahead = _unit(forward)
    return np.stack([ahead, np.cross(up, ahead), up]), forward in (None, "throw")


def _body_axes(frame: Frame) -> np.ndarray:
    nose, top = _unit(frame.nose), _unit(frame.top)
    return np.stack([nose, np.cross(top, nose), top])


def _unit(axis: str) -> np.ndarray:
    sign = -1.0 if axis.startswith("-") else 1.0
    return sign * np.eye(3)["xyz".index(axis[-1])]


def _rotations(stream: Stream, time: np.ndarray) -> np.ndarray:
    """Rotations (n, 3, 3) at times (n,), nan where no attitude is near."""
    known = stream.known()
    result = np.full((len(time), 3, 3), np.nan)
    if len(known.time) < 2:
        return result
    inside = (time >= known.time[0]) & (time <= known.time[-1])
    inside &= _is_near(known.time, time)
    slerp = Slerp(known.time, Rotation.from_quat(known.values))
    result[inside] = slerp(time[inside]).as_matrix()
    return result


def _pitches(stream: Stream, time: np.ndarray) -> np.ndarray:
    """Pitches (n,) at times (n,), nan where none is near [rad]."""
    known = stream.known()
    if len(known.time) < 2:
        return np.full(len(time), np.nan)
    pitch = np.unwrap(known.values[:, 0])
    pitch = np.interp(time, known.time, pitch, left=np.nan, right=np.nan)
    return np.where(_is_near(stream.time, time), pitch, np.nan)


def _is_near(known: np.ndarray, time: np.ndarray) -> np.ndarray:
    """Whether times (n,) lie between two known ones that are close to one another."""
    index = np.clip(np.searchsorted(known, time), 1, len(known) - 1)
    exact = np.isclose(time, known[index]) | np.isclose(time, known[index - 1])
    return exact | (known[index] - known[index - 1] < _MAX_GAP)


def _signed(stream: Stream | None, positive: str) -> Stream | None:
    if stream is None or positive == "trailing_edge_up":
        return stream
    return dataclasses.replace(stream, values=-stream.values)
