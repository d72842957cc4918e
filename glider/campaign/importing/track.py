"""Tracks: recorded poses in x forward, y left, z up, and what was logged of the servo.

`picking` makes the track of a recording, `cutting` takes the flights out of it, and
`clock_offset` shifts the servo's logs onto the clock of the poses. Until then each log
keeps its own times. Rotations map nose, left and top of the body to the axes; angles
are in radians and positive about +y, so that nose up is a negative pitch.
"""

import dataclasses
import warnings
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from glider.campaign.checks.motion import SPAN

_LONGEST = 0.05  # Step of a log above which commands are logged at changes only [s].


class Stream(NamedTuple):
    """Numbers with their times.

    Attributes:
        time: (n,) increasing [s].
        values: (n, k) numbers in SI units.
        clock: name of the clock that the times are of.
        late: number of rows that were dropped, as their time fell back.
    """

    time: np.ndarray
    values: np.ndarray
    clock: str
    late: int = 0

    @property
    def step(self) -> float:
        """Usual time between the rows of a log that may have those of changes only [s].

        It is the lower quartile, and at most `_LONGEST`.
        """
        usual = float(np.quantile(np.diff(self.time), 0.25))
        return min(usual, _LONGEST)

    def known(self) -> "Stream":
        """Returns the rows in which all numbers are finite."""
        rows = np.isfinite(self.values).all(axis=1)
        return self._replace(time=self.time[rows], values=self.values[rows])


class ServoLogs(NamedTuple):
    """What was logged of the elevator's servo; None where it was not.

    Attributes:
        elevator: (n, 1) measured angle, positive trailing edge up [rad].
        rate_command: (n, 1) commanded rate [rad/s].
        angle_command: (n, 1) commanded angle [rad].
    """

    elevator: Stream | None = None
    rate_command: Stream | None = None
    angle_command: Stream | None = None

    @property
    def given(self) -> list[Stream]:
        """Those that were logged."""
        return [stream for stream in self if stream is not None]


@dataclasses.dataclass(frozen=True, kw_only=True)
class Track:
    """The n rows of a recording, or of one flight in it, in which the body was seen.

    Attributes:
        path: of the recording.
        time: (n,) [s].
        position: (n, 3) of the mass center [m]; y is zero where it is not logged.
        rotation: (n, 3, 3) from nose, left and top to x, y and z.
        spatial: whether roll and yaw were logged; otherwise they are zero.
        along_throw: whether x has yet to be turned along each flight.
        clock: name of the clock of the poses.
        servo: logs of the servo, each with times of its own.
        notes: sentences on rows that were dropped, and on shifted clocks.
        why: reason for which a flight begins and ends where it does.
        jitter: standard deviation of the stamps about the even steps that were
            restored [s].
        clock_std: standard error of the shift of the servo's logs onto this clock [s].
    """

    path: Path
    time: np.ndarray
    position: np.ndarray
    rotation: np.ndarray
    spatial: bool = True
    along_throw: bool = False
    clock: str = ""
    servo: ServoLogs = ServoLogs()
    notes: tuple[str, ...] = ()
    why: str = ""
    jitter: float = 0.0
    clock_std: float = 0.0

    @property
    def has_measured(self) -> bool:
        """Whether the elevator was measured on the clock of the poses."""
        elevator = self.servo.elevator
        return elevator is not None and elevator.clock == self.clock

    @property
    def span(self) -> tuple[float, float]:
        """Times of the first and last row [s]."""
        return float(self.time[0]), float(self.time[-1])


def take(track: Track, rows: np.ndarray | slice) -> Track:
    """Returns some rows of a track, chosen by index, mask or slice."""
    return dataclasses.replace(
        track,
        time=track.time[rows],
        position=track.position[rows],
        rotation=track.rotation[rows],
    )


def turn_along(track: Track) -> Track:
    """Turns a flight about the vertical until x is along its ground track.

    The line is the one that fits best, the first principal axis of x and y. It points
    where the flight goes in its first `SPAN` seconds, as a loop may end behind its
    beginning. x and y begin at zero then. A track whose x is mapped is returned as it
    is.
    """
    if not track.along_throw:
        return track
    start = track.position[0] * [1.0, 1.0, 0.0]
    position = track.position - start
    ground = position[:, :2]
    _, _, axes = np.linalg.svd(ground - np.mean(ground, axis=0), full_matrices=False)
    forward = axes[0]
    early = np.searchsorted(track.time, track.time[0] + SPAN, side="right") - 1
    if ground[early] @ forward < 0.0:
        forward = -forward

    x, y = forward
    turn = np.array([[x, y, 0.0], [-y, x, 0.0], [0.0, 0.0, 1.0]])
    rotation = track.rotation
    if track.spatial:
        rotation = turn @ rotation
    return dataclasses.replace(track, position=position @ turn.T, rotation=rotation)


def angles_of(track: Track) -> tuple[np.ndarray, np.ndarray | None]:
    """Returns pitch (n,), and roll and yaw (n, 2) where they are known [rad].

    A rotation has two triples of angles: (yaw, pitch, roll) and
    (yaw + π, π - pitch, roll + π). The first row has the one with less roll, the others
    the one that continues the yaw of the row before: a glider that dives past the
    vertical continues to pitch.
    """
    if not track.spatial:
        nose = track.rotation[:, :, 0]
        return np.unwrap(np.arctan2(-nose[:, 2], nose[:, 0])), None
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # Straight up or down the yaw is taken as zero.
        yaw, pitch, roll = Rotation.from_matrix(track.rotation).as_euler("ZYX").T

    half_turns = np.round((np.unwrap(yaw, period=np.pi) - yaw) / np.pi)
    starts_inverted = np.abs(roll[:1]) > 0.5 * np.pi  # (1,), or (0,) without rows.
    is_other = (half_turns + starts_inverted) % 2 == 1
    pitch = np.where(is_other, np.pi - pitch, pitch)
    roll_and_yaw = np.column_stack([roll, yaw]) + np.pi * is_other[:, None]
    return np.unwrap(within_pi(pitch)), np.unwrap(within_pi(roll_and_yaw), axis=0)


def within_pi(angle: np.ndarray) -> np.ndarray:
    """Returns angles of any shape, wrapped into ±π [rad]."""
    return np.angle(np.exp(1j * angle))


def planar_pose(track: Track) -> np.ndarray:
    """Returns columns x [m], z [m] and pitch [rad] of a flight, shape (n, 3)."""
    pitch, _ = angles_of(track)
    return np.column_stack([track.position[:, [0, 2]], pitch])
