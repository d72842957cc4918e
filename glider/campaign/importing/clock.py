"""The clock step: how far the elevator's clock is ahead of that of the poses.

An elevator turns the glider: of the pitch's acceleration, what pitch, speed and pitch
rate do not explain must follow V² times its angle,
    pitchdd = c + V² (a sin alpha + b cos alpha) + d V q
              + e V² sin(elevator(t + offset) - alpha),
and the offset is that at which it does best. Where the elevator was measured on the
clock of the poses and the commands on another, the elevator's rate must follow theirs.
"""

import dataclasses
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from glider.campaign.checks.motion import SPAN, calc_motion
from glider.campaign.importing.selection import Stream
from glider.campaign.importing.track import Track, angles_of
from glider.errors import InputError

_STEP = 0.01  # Between the offsets that are tried [s].
_FINE = 0.001  # ... round the best of them [s].
_COVERED = 0.8  # Share of the flights that the other log must cover.
_FOLLOWS = 0.5
"""Correlation from which on one signal follows the other. Measured: 0.62 to 0.97 for
the practice campaigns' elevators at the right offset."""
_ONLY = 1.15
"""Ratio to the best correlation of an offset more than `_NEAR` away, at least: else
either could be meant."""
_NEAR = 0.25  # [s]
_ROUNDS = 3  # Of pooling what recordings say of the glider, and asking each again.


@dataclasses.dataclass(frozen=True, kw_only=True)
class Offset:
    """How far a clock is ahead, and how well the signals then follow one another."""

    seconds: float
    correlation: float


class _Turning(NamedTuple):
    """The pitch's acceleration in a recording's flights, and what explains it."""

    time: np.ndarray  # (k,) [s]
    square: np.ndarray  # (k,) speed² [m²/s²]
    alpha: np.ndarray  # (k,) angle of attack [rad]
    base: np.ndarray  # (k, 4) columns without the elevator.
    target: np.ndarray  # (k,) [rad/s²]
    elevator: Stream


def find_offsets(recordings: Sequence[tuple[Track, Sequence[Track]]]) -> list[Offset]:
    """Returns the offset of the elevator's clock in each recording.

    Each recording alone says roughly where it is and what the elevator does; what it
    does is the same in all of them, and then tells the offset of each more closely.

    Args:
        recordings: each whole, and the flights cut out of it, at least one.

    Raises:
        InputError: at no offset they follow one another, or at several.
    """
    if all(_is_measured(track) for track, _ in recordings):
        return [_search(track, *_follow_rates(track)) for track, _ in recordings]
    turnings = [_turning_of(track, flights) for track, flights in recordings]
    alone: list[Offset | None] = []
    for (track, _), turning in zip(recordings, turnings, strict=True):
        try:
            alone.append(_search(track, turning.elevator.time, _follow_pitch(turning)))
        except InputError:
            if len(recordings) == 1:
                raise
            alone.append(None)
    known = [offset for offset in alone if offset is not None]
    if not known:
        raise _not_found(recordings[0][0], 0.0, 0.0)
    if len(recordings) == 1:
        return known
    found = alone
    for _ in range(_ROUNDS):
        effect = _pool(
            [(t, o.seconds) for t, o in zip(turnings, found, strict=True) if o]
        )
        found = [
            _search(track, turning.elevator.time, _follow_pitch(turning, effect))
            for (track, _), turning in zip(recordings, turnings, strict=True)
        ]
    return [offset for offset in found if offset is not None]


def _is_measured(track: Track) -> bool:
    """Whether the elevator was measured on the clock of the poses, beside commands."""
    return track.elevator is not None and track.elevator.clock == track.clock


def shift(track: Track, seconds: float) -> Track:
    """Returns a recording whose logs of other clocks are on the clock of its poses."""

    def moved(stream: Stream | None) -> Stream | None:
        if stream is None or (stream is track.elevator and stream.clock == track.clock):
            return stream
        return dataclasses.replace(stream, time=stream.time - seconds)

    return dataclasses.replace(
        track,
        elevator=moved(track.elevator),
        rate_command=moved(track.rate_command),
        angle_command=moved(track.angle_command),
    )


Follow = Callable[[float], float]
"""From an offset [s] to the correlation, 0 where too little is covered."""


def _search(track: Track, other: np.ndarray, follow: Follow) -> Offset:
    """Returns the best of all offsets at which the two logs overlap.

    Args:
        track: the recording.
        other: (k,) times of the log on the other clock [s].
        follow: tells how well it fits.
    """
    offsets = np.arange(
        other[0] - track.time[-1], other[-1] - track.time[0] + _STEP, _STEP
    )
    values = np.array([follow(offset) for offset in offsets])
    best = int(np.argmax(values))
    far = np.abs(offsets - offsets[best]) > _NEAR
    second = float(np.max(values[far], initial=0.0))
    if values[best] < _FOLLOWS or values[best] < _ONLY * second:
        raise _not_found(track, float(values[best]), second)
    fine = offsets[best] + np.arange(-_STEP, _STEP + _FINE / 2, _FINE)
    values = np.array([follow(offset) for offset in fine])
    best = int(np.argmax(values))
    return Offset(seconds=float(fine[best]), correlation=float(values[best]))


def _not_found(track: Track, best: float, second: float) -> InputError:
    return InputError(
        f"{track.path}: the offset between the clocks of poses and elevator was not "
        f"found (they correlate by {best:.2f} at best, by {second:.2f} elsewhere); "
        "clock: SECONDS, or clock: same, is needed in the mapping."
    )


def _turning_of(track: Track, flights: Sequence[Track]) -> _Turning:
    elevator = track.elevator or track.angle_command
    assert elevator is not None
    times, squares, alphas, bases, targets = [], [], [], [], []
    for flight in flights:
        pitch, _ = angles_of(flight)
        pose = np.column_stack([flight.position[:, [0, 2]], pitch])
        motion = calc_motion(flight.time, pose)
        v, speed = motion.velocity, motion.speed
        alpha = np.arctan2(-v[:, 1], v[:, 0]) - motion.pose[:, 2]
        times.append(motion.time)
        squares.append(speed**2)
        alphas.append(alpha)
        bases.append(
            np.column_stack(
                [
                    np.ones(len(speed)),
                    speed**2 * np.sin(alpha),
                    speed**2 * np.cos(alpha),
                    speed * v[:, 2],
                ]
            )
        )
        targets.append(motion.acceleration[:, 2])
    return _Turning(
        np.concatenate(times),
        np.concatenate(squares),
        np.concatenate(alphas),
        np.concatenate(bases),
        np.concatenate(targets),
        elevator,
    )


def _column(turning: _Turning, offset: float) -> np.ndarray | None:
    """Returns V² sin(elevator - alpha) (k,) at an offset; None if it is not logged."""
    log, at = turning.elevator, turning.time + offset
    inside = (at >= log.time[0]) & (at <= log.time[-1])
    if np.mean(inside) < _COVERED:
        return None
    # The cubics see the acceleration over a window: so must the elevator be.
    delays = (-0.25 * SPAN, 0.0, 0.25 * SPAN)
    angles = [np.interp(at + d, log.time, log.values[:, 0]) for d in delays]
    return turning.square * np.sin(np.mean(angles, axis=0) - turning.alpha)


def _pool(known: Sequence[tuple[_Turning, float]]) -> np.ndarray:
    """Returns the effects (5,) of base and elevator in all recordings together."""
    designs, targets = [], []
    for turning, offset in known:
        column = _column(turning, offset)
        assert column is not None
        designs.append(np.column_stack([turning.base, column]))
        targets.append(turning.target)
    design, target = np.concatenate(designs), np.concatenate(targets)
    return np.linalg.lstsq(design, target, rcond=None)[0]


def _follow_pitch(turning: _Turning, effect: np.ndarray | None = None) -> Follow:
    """Returns what compares the pitch's acceleration with an elevator's angle.

    Args:
        turning: of a recording.
        effect: (5,) of base and elevator, where it is known from other recordings.
    """
    base, _ = np.linalg.qr(turning.base)
    target = _without(turning.target, base)
    if effect is not None:
        target = turning.target - turning.base @ effect[:-1]

    def follow(offset: float) -> float:
        column = _column(turning, offset)
        if column is None:
            return 0.0
        if effect is not None:
            rest = target - column * effect[-1]
            return float(np.sqrt(max(0.0, 1.0 - rest @ rest / (target @ target))))
        column = _without(column, base)
        size = (column @ column) * (target @ target)
        return float(abs(column @ target) / np.sqrt(max(size, 1e-12)))

    return follow


def _follow_rates(track: Track) -> tuple[np.ndarray, Follow]:
    """Returns the commands' times, and what compares them with an elevator's rate."""
    elevator, command = track.elevator, track.rate_command or track.angle_command
    assert elevator is not None and command is not None
    rates = _as_rate(command, is_angle=track.rate_command is None)
    window = 0.04
    begin = np.arange(elevator.time[0], elevator.time[-1] - window, window / 2)
    ends = np.stack([begin, begin + window])
    rate = np.diff(np.interp(ends, elevator.time, elevator.values[:, 0]), axis=0)[0]
    path = np.concatenate(
        [[0.0], np.cumsum(rates.values[:-1, 0] * np.diff(rates.time))]
    )

    def follow(offset: float) -> float:
        inside = (ends[0] + offset >= rates.time[0]) & (
            ends[1] + offset <= rates.time[-1]
        )
        if np.mean(inside) < _COVERED:
            return 0.0
        told = np.diff(np.interp(ends + offset, rates.time, path), axis=0)[0]
        size = np.sqrt((rate[inside] @ rate[inside]) * (told[inside] @ told[inside]))
        return float(abs(rate[inside] @ told[inside]) / max(size, 1e-12))

    return rates.time, follow


def _as_rate(command: Stream, *, is_angle: bool) -> Stream:
    """Returns the rates that commands ask for."""
    if not is_angle:
        return command
    steps = np.diff(command.time)
    rate = np.append(np.diff(command.values[:, 0]) / steps, 0.0)
    return dataclasses.replace(command, values=rate[:, None])


def _without(column: np.ndarray, base: np.ndarray) -> np.ndarray:
    """Returns what an orthonormal base (n, k) does not explain of a column (n,)."""
    return column - base @ (base.T @ column)
