"""The frame step: a recording turned into the axes and signs of this project.

The rows of W are forward, left and up in the log's axes, those of B nose, left and top
in the body's axes, as the mapping names them. Then
    p' = W p,   R' = W R Bᵀ,   p_cm = p' - R' r
for a tracked point r ahead of and above the center of mass.
"""

import dataclasses
import warnings
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from glider.campaign.checks.motion import SPAN
from glider.campaign.importing.recording import Recording
from glider.campaign.importing.selection import Picker, ServoLogs, Stream
from glider.campaign.settings import Frame, Mapping, unit_vector
from glider.errors import InputError

_MAX_GAP = 0.1  # Time between two attitudes above which none is interpolated [s].


_FEW_STEPS = 3.0
"""Steps from row to row, over the usual one, by which a body may move on to zero."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Track:
    """One recording in x forward, y left, z up; n rows in which the body was seen."""

    path: Path
    time: np.ndarray  #: (n,) [s]
    position: np.ndarray  #: (n, 3) [m]; y is zero where it is not logged.
    rotation: np.ndarray | None  #: (n, 3, 3) from nose, left, top to the axes.
    pitch: np.ndarray | None  #: (n,) positive nose down [rad], where no rotation is.
    along_throw: bool  #: Whether x has yet to be turned along each flight.
    clock: str
    servo: ServoLogs  #: Positive trailing edge up.
    notes: tuple[str, ...] = ()  #: On rows that were dropped.
    why: str = ""  #: Of a flight: it begins and ends where it does.
    jitter: float = 0.0  #: Of the stamps about the even steps that were restored [s].
    clock_std: float = 0.0  #: Of the shift of the servo's logs onto this clock [s].

    @property
    def has_measured(self) -> bool:
        """Whether the elevator was measured on the clock of the poses."""
        elevator = self.servo.elevator
        return elevator is not None and elevator.clock == self.clock


def make_track(recording: Recording, mapping: Mapping) -> Track:
    """Turns a recording into the axes and signs of this project."""
    frame = mapping.frame
    pick = Picker(recording, mapping)
    logged = pick.position()
    attitude = pick.attitude() or pick.scalars(("pitch",))
    signs = (frame.elevator, frame.command, frame.command)
    servo = ServoLogs(*map(_signed, pick.servo(), signs))
    time = logged.time
    position = logged.values
    planar = position.shape[1] == 2
    world, along_throw = _world_axes(frame, planar)
    if planar:
        position = np.insert(position, 1, 0.0, axis=1)
    rotation = pitch = None
    if attitude.values.shape[1] == 4:
        rotation = world @ _rotations(attitude, time) @ frame.body.T
        seen = np.isfinite(rotation).all(axis=(1, 2))
    elif attitude.values.shape[1] == 2:
        if not planar:
            raise InputError(
                f"{recording.path}: columns: attitude (of {mapping.source}): its "
                "markers have two axes, and the position three; expected the same."
            )
        ahead = np.insert(attitude.values, 1, 0.0, axis=1) @ world.T
        pitch = -np.arctan2(ahead[:, 2], ahead[:, 0])
        pitch = _pitches(attitude._replace(values=pitch[:, None]), time)
        seen = np.isfinite(pitch)
    else:
        pitch = _pitches(attitude, time)
        pitch *= 1.0 if (frame.pitch or frame.usual_pitch) == "nose_down" else -1.0
        seen = np.isfinite(pitch)
    zeros = _are_zeros(logged)
    counts = {
        "whose time falls back: they are dropped": logged.late,
        "in which the position is zero: the body was not seen": int(np.sum(zeros)),
    }
    position = position @ world.T
    seen &= np.isfinite(position).all(axis=1) & ~zeros
    ahead, above = frame.tracked_point
    if rotation is not None:
        position = position - rotation @ np.array([ahead, 0.0, above])
    elif pitch is not None and (ahead or above):
        cos = np.cos(pitch)
        sin = np.sin(pitch)
        position[:, 0] -= ahead * cos + above * sin
        position[:, 2] -= above * cos - ahead * sin
    return Track(
        path=recording.path,
        time=time[seen],
        position=position[seen],
        rotation=None if rotation is None else rotation[seen],
        pitch=None if pitch is None else np.unwrap(pitch[seen]),
        along_throw=along_throw,
        clock=logged.clock,
        notes=tuple(f"{count} rows {why}" for why, count in counts.items() if count),
        servo=servo,
    )


def _are_zeros(place: Stream) -> np.ndarray:
    """Rows (n,) at zero, of a body that cameras do not see: not one that passes there.

    It would come from, or go to, a place that is a few steps away.
    """
    zeros = np.all(place.values == 0.0, axis=1)
    others = np.flatnonzero(np.isfinite(place.values).all(axis=1) & ~zeros)
    if not zeros.any() or len(others) < 2:
        return zeros
    steps = np.linalg.norm(np.diff(place.values[others], axis=0), axis=1)
    index = np.searchsorted(others, np.flatnonzero(zeros))
    beside = others[np.clip([index - 1, index], 0, len(others) - 1)]
    away = np.linalg.norm(place.values[beside], axis=2).min(axis=0)
    zeros[zeros] = away > _FEW_STEPS * np.median(steps)
    return zeros


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
    """Turns x along the line that fits the ground track best, where it must be.

    It points where the flight goes at first: a loop may end behind its beginning.
    """
    if not track.along_throw:
        return track
    ground = track.position[:, :2]
    _, _, axes = np.linalg.svd(ground - np.mean(ground, axis=0), full_matrices=False)
    first = np.searchsorted(track.time, track.time[0] + SPAN, side="right") - 1
    along = axes[0] * np.sign(axes[0] @ (ground[first] - ground[0]) or 1.0)
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
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # Straight up or down the yaw is taken as zero.
        yaw, pitch, roll = Rotation.from_matrix(track.rotation).as_euler("ZYX").T
    over = np.abs(roll) > 0.5 * np.pi
    ways = np.array([[roll, pitch, yaw], [roll + np.pi, np.pi - pitch, yaw + np.pi]])
    turns = np.exp(1j * ways)
    for k in range(1, len(over)):
        before = turns[int(over[k - 1]), :, k - 1]
        steps = np.abs(turns[:, :, k] - before).sum(axis=1)
        over[k] = steps[1] < steps[0]
    chosen = np.angle(turns[over.astype(int), :, np.arange(len(over))])
    roll, pitch, yaw = np.unwrap(chosen, axis=0).T
    return pitch, np.column_stack([roll, yaw])


def planar_pose(track: Track) -> np.ndarray:
    """Columns x [m], z [m] and pitch [rad] of a flight (n, 3)."""
    return np.column_stack([track.position[:, [0, 2]], angles_of(track)[0]])


def _world_axes(frame: Frame, planar: bool) -> tuple[np.ndarray, bool]:
    """W (3, 3), and whether x has yet to be turned along each flight.

    In a plane the log's axes are x and the vertical one, whatever its name, which
    becomes z.
    """
    forward = frame.forward
    up = unit_vector(frame.up)
    if planar:
        # y is not logged: it is what makes the axes right-handed.
        ahead = unit_vector("-x" if forward == "-x" else "x")
        return np.stack([ahead, np.zeros(3), np.sum(up) * unit_vector("z")]), False
    along_throw = forward is None or forward == "throw"
    if forward is None or along_throw:  # Any axis will do until then.
        forward = next(axis for axis in "xyz" if axis != frame.up[-1])
    ahead = unit_vector(forward)
    return np.stack([ahead, np.cross(up, ahead), up]), along_throw


def _rotations(stream: Stream, time: np.ndarray) -> np.ndarray:
    """Rotations (n, 3, 3) at times (n,), nan where no attitude is near."""
    known = stream.known()
    result = np.full((len(time), 3, 3), np.nan)
    if len(known.time) > 1:
        near = _is_near(known.time, time)
        slerp = Slerp(known.time, Rotation.from_quat(known.values))
        result[near] = slerp(time[near]).as_matrix()
    return result


def _pitches(stream: Stream, time: np.ndarray) -> np.ndarray:
    """Pitches (n,) at times (n,), nan where none is near [rad]."""
    known = stream.known()
    if len(known.time) < 2:
        return np.full(len(time), np.nan)
    pitch = np.interp(time, known.time, np.unwrap(known.values[:, 0]))
    return np.where(_is_near(known.time, time), pitch, np.nan)


def _is_near(known: np.ndarray, time: np.ndarray) -> np.ndarray:
    """Whether times (n,) lie between two known ones that are close to one another."""
    index = np.clip(np.searchsorted(known, time), 1, len(known) - 1)
    exact = np.isclose(time, known[index]) | np.isclose(time, known[index - 1])
    near = exact | (known[index] - known[index - 1] < _MAX_GAP)
    return near & (time >= known[0]) & (time <= known[-1])


def _signed(stream: Stream | None, positive: str) -> Stream | None:
    if stream is None or positive == "trailing_edge_up":
        return stream
    return stream._replace(values=-stream.values)
