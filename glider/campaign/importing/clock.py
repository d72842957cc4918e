"""The clock step: how far the elevator's clock is ahead of that of the poses.

An elevator turns the glider: of the pitch's acceleration, what pitch, speed and pitch
rate do not explain must follow V² times its angle,
    pitchdd = c + V² (a sin alpha + b cos alpha) + d V q + e V² elevator(t + offset),
and the offset is that at which it does best. Where the elevator was measured on the
clock of the poses and the commands on another, the elevator's rate must follow theirs.
"""

import dataclasses
from collections.abc import Callable, Sequence

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


@dataclasses.dataclass(frozen=True, kw_only=True)
class Offset:
    """How far a clock is ahead, and how well the signals then follow one another."""

    seconds: float
    correlation: float


def find_offset(track: Track, flights: Sequence[Track]) -> Offset | None:
    """Returns the offset of the elevator's clock; None where nothing can follow.

    Args:
        track: the whole recording.
        flights: cut out of it.

    Raises:
        InputError: at no offset they follow one another, or at several.
    """
    command = track.rate_command or track.angle_command
    if track.elevator is not None and track.elevator.clock == track.clock:
        if command is None:
            return None
        rates = _as_rate(command, is_angle=track.rate_command is None)
        return _search(track, command.time, _follow_rates(track.elevator, rates))
    turning = track.elevator or track.angle_command
    if turning is None:
        return None
    return _search(track, turning.time, _follow_pitch(flights, turning))


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
    begin = other[0] - track.time[-1]
    end = other[-1] - track.time[0]
    offsets = np.arange(begin, end + _STEP, _STEP)
    values = np.array([follow(offset) for offset in offsets])
    best = int(np.argmax(values))
    far = np.abs(offsets - offsets[best]) > _NEAR
    second = float(np.max(values[far], initial=0.0))
    if values[best] < _FOLLOWS or values[best] < _ONLY * second:
        raise InputError(
            f"{track.path}: the offset between the clocks of poses and elevator was "
            f"not found (they correlate by {values[best]:.2f} at best, by {second:.2f} "
            "elsewhere); clock: SECONDS, or clock: same, is needed in the mapping."
        )
    fine = offsets[best] + np.arange(-_STEP, _STEP + _FINE / 2, _FINE)
    values = np.array([follow(offset) for offset in fine])
    best = int(np.argmax(values))
    return Offset(seconds=float(fine[best]), correlation=float(values[best]))


def _follow_pitch(flights: Sequence[Track], turning: Stream) -> Follow:
    """Returns what compares the pitch's acceleration with an elevator's angle."""
    parts = []
    for flight in flights:
        pitch, _ = angles_of(flight)
        pose = np.column_stack([flight.position[:, [0, 2]], pitch])
        motion = calc_motion(flight.time, pose)
        if len(motion.time) < 8:
            continue
        v, speed = motion.velocity, motion.speed
        alpha = np.arctan2(-v[:, 1], v[:, 0]) - motion.pose[:, 2]
        base, _ = np.linalg.qr(
            np.column_stack(
                [
                    np.ones(len(speed)),
                    speed**2 * np.sin(alpha),
                    speed**2 * np.cos(alpha),
                    speed * v[:, 2],
                ]
            )
        )
        target = _without(motion.acceleration[:, 2], base)
        parts.append((motion.time, speed**2, base, target))
    quarter = 0.25 * SPAN

    def follow(offset: float) -> float:
        products, squares, targets, covered, rows = 0.0, 0.0, 0.0, 0, 0
        for time, square, base, target in parts:
            at = time + offset
            inside = (at >= turning.time[0]) & (at <= turning.time[-1])
            rows += len(time)
            covered += int(np.sum(inside))
            # The cubics see the acceleration over a window: so must the elevator be.
            angle = np.mean(
                [
                    np.interp(at + d, turning.time, turning.values[:, 0])
                    for d in (-quarter, 0.0, quarter)
                ],
                axis=0,
            )
            column = _without(square * angle, base)
            products += float(column @ target)
            squares += float(column @ column)
            targets += float(target @ target)
        if covered < _COVERED * rows or squares <= 1e-12:
            return 0.0
        return abs(products) / np.sqrt(squares * targets)

    return follow


def _follow_rates(elevator: Stream, rates: Stream) -> Follow:
    """Returns what compares an elevator's measured rate with commanded rates."""
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
        moves = np.abs(rate) > 0.0
        if np.sum(inside & moves) < _COVERED * np.sum(moves):
            return 0.0
        told = np.diff(np.interp(ends + offset, rates.time, path), axis=0)[0]
        size = np.sqrt((rate[inside] @ rate[inside]) * (told[inside] @ told[inside]))
        return float(abs(rate[inside] @ told[inside]) / max(size, 1e-12))

    return follow


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
