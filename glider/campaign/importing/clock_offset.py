"""The clock step: how far the elevator's clock is ahead of that of the poses.

An elevator turns the glider: of the pitch's acceleration, what pitch, speed and pitch
rate do not explain must follow V² times its angle,
    pitchdd = c + V² (a sin alpha + b cos alpha) + d V q
              + e V² sin(elevator(t + offset) - alpha),
and the offset is that of the best fit. Where the elevator was measured on the clock of
the poses and the commands on another, the elevator's rate must follow theirs.
"""

import dataclasses
from collections.abc import Callable, Iterable, Sequence
from typing import NamedTuple

import numpy as np

from glider.campaign.checks.elevators import mean_rates
from glider.campaign.checks.forces import join
from glider.campaign.checks.motion import SPAN, calc_motion
from glider.campaign.importing.selection import ServoLogs, Stream
from glider.campaign.importing.track import Track, planar_pose
from glider.errors import InputError
from glider.physics.servo import elevator_path

_STEP = 0.01  # Between the offsets that are tried [s].
_FOLLOWS = 0.5
"""Correlation above which one signal follows the other. Measured: 0.62 to 0.97 for the
practice campaigns' elevators at the right offset."""
_ONLY, _ONLY_COMMON = 2.0, 1.5
"""Ratio of the unexplained variance more than `_NEAR` away to that at the best, least.
A common offset of all recordings needs less: by chance it does not fit many."""
_NEAR = 0.25  # [s]
_ITERATIONS = 10  # Of Gauss-Newton in all offsets.
_COARSE = 0.015  # Standard error where none is known: of one flight alone [s].
_FORM = 0.004  # Beside that of noise: the effect has another form, see bench_clock [s].
_ROUNDS = 3  # Of pooling the effect of all recordings, and searching each again.

Follow = Callable[[float], float]  # From an offset [s] to the correlation.


class Offset(NamedTuple):
    """How far a clock is ahead, and how well the signals then follow one another."""

    seconds: float
    correlation: float
    std: float = _COARSE  #: Standard error [s].


class _Turning(NamedTuple):
    """The pitch's acceleration in the flights of a recording, and what explains it."""

    track: Track
    elevator: Stream
    time: np.ndarray  #: (k,) [s]
    square: np.ndarray  #: (k,) speed² [m²/s²]
    alpha: np.ndarray  #: (k,) angle of attack [rad]
    base: np.ndarray  #: (k, 4) columns without the elevator.
    target: np.ndarray  #: (k,) [rad/s²]

    @property
    def offsets(self) -> np.ndarray:
        """All offsets (m,) at which poses and elevator overlap [s]."""
        return _overlaps(self.track.time, self.elevator.time)

    def column(self, offset: float) -> np.ndarray:
        """V² sin(elevator - alpha) (k,) at an offset; beyond its log it rests."""
        log = self.elevator
        at = self.time + offset
        # The cubics average the acceleration over a window; so is the elevator here.
        delays = (-0.25 * SPAN, 0.0, 0.25 * SPAN)
        angles = [np.interp(at + d, log.time, log.values[:, 0]) for d in delays]
        return self.square * np.sin(np.mean(angles, axis=0) - self.alpha)


def find_offsets(recordings: Sequence[tuple[Track, Sequence[Track]]]) -> list[Offset]:
    """Finds the offset of the elevator's clock in recordings, whole and cut to flights.

    If one offset fits all recordings it is taken: two clocks that ran on between them.
    Measured on seven campaigns of 4 and 10 flights of 0.85 s: it is right to 15 ms.
    """
    if all(is_measured(track) for track, _ in recordings):
        return [_follow_commands(track) for track, _ in recordings]
    turnings = [_turning_of(track, flights) for track, flights in recordings]
    # What the elevator must explain is what the rest does not.
    base, target = (np.concatenate([t[k] for t in turnings]) for k in (5, 6))
    rest = np.linalg.lstsq(base, target, rcond=None)[0]
    turnings = [t._replace(target=t.target - t.base @ rest) for t in turnings]
    several = len(recordings) > 1
    first = max(t.elevator.time[0] - t.track.time[-1] for t in turnings)
    last = min(t.elevator.time[-1] - t.track.time[0] for t in turnings)
    track = turnings[0].track
    offsets = np.arange(first, last + _STEP, _STEP)
    only = _ONLY_COMMON if several else _ONLY
    try:
        common = _best(track, offsets, _follow_pitch(turnings), only=only)
    except InputError:
        if not several:
            raise
        return _find_separate(turnings)
    return _refine(turnings, [common] * len(recordings), common=True)


def shift(track: Track, seconds: float) -> Track:
    """Shifts the servo's logs of another clock onto the clock of the poses."""
    moved = [log and log._replace(time=log.time - seconds) for log in track.servo]
    if is_measured(track):
        moved[0] = track.servo.elevator
    return dataclasses.replace(track, servo=ServoLogs(*moved))


def is_measured(track: Track) -> bool:
    """Whether the elevator was measured on the clock of the poses."""
    elevator = track.servo.elevator
    return elevator is not None and elevator.clock == track.clock


def _find_separate(turnings: Sequence[_Turning]) -> list[Offset]:
    """Finds an offset for each recording, with the elevator's effect common to all.

    A short flight alone is followed well at several offsets, by another effect each.
    """
    alone = [
        _best(t.track, t.offsets, _follow_pitch([t]), sure=False) for t in turnings
    ]
    effects = [_pool([t], [o.seconds]) for t, o in zip(turnings, alone, strict=True)]
    effect = np.median(effects, axis=0)
    for k in range(_ROUNDS):
        last = k == _ROUNDS - 1
        offsets = [
            _best(t.track, t.offsets, _follow_effect(t, effect), sure=last)
            for t in turnings
        ]
        effect = _pool(turnings, [offset.seconds for offset in offsets])
    return _refine(turnings, offsets)


def _refine(
    turnings: Sequence[_Turning], found: Sequence[Offset], *, common: bool = False
) -> list[Offset]:
    """Offsets refined with the effect, by Gauss-Newton, and their standard errors."""
    place = np.zeros(len(found), int) if common else np.arange(len(found))
    offsets = np.array([f.seconds for f in found])
    std = np.full(len(found), _COARSE)
    rate = 1.0 / np.median(np.diff(turnings[0].track.time))
    for _ in range(_ITERATIONS):
        designs = []
        for turning, offset, k in zip(turnings, offsets, place, strict=True):
            around = offset + _STEP * np.array([-1.0, 0.0, 1.0])
            before, column, after = map(turning.column, around)
            shifts = np.zeros((len(column), place[-1] + 1))
            shifts[:, k] = (after - before) / (2.0 * _STEP)
            designs.append(np.column_stack([turning.base, column, shifts]))
        design = np.concatenate(designs)
        design[:, 5:] *= _pool(turnings, offsets)[-1]
        target = np.concatenate([turning.target for turning in turnings])
        step = np.linalg.lstsq(design, target, rcond=None)[0]
        offsets += np.clip(step[5:], -_STEP, _STEP)[place]
        # Rows within the window of one cubic are not independent.
        variance = np.mean((target - design @ step) ** 2) * max(SPAN * rate, 1.0)
        covariance = variance * np.linalg.pinv(design.T @ design)
        std = np.sqrt(np.diagonal(covariance)[5:])[place]
    return [
        Offset(float(s), f.correlation, float(np.hypot(e, _FORM)))
        for f, s, e in zip(found, offsets, std, strict=True)
    ]


def _overlaps(time: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Offsets (m,) at which two logs with times (n,) and (k,) overlap."""
    return np.arange(other[0] - time[-1], other[-1] - time[0] + _STEP, _STEP)


def _best(
    track: Track,
    offsets: np.ndarray,
    follow: Follow,
    *,
    sure: bool = True,
    only: float = _ONLY,
) -> Offset:
    """Best of some offsets (m,); if `sure`, refused where another fits as well."""
    values = np.array(list(map(follow, offsets)))
    best = int(np.argmax(values)) if len(values) else 0
    highest = float(np.max(values, initial=0.0))
    far = np.abs(offsets - offsets[best]) > _NEAR if len(values) else []
    second = float(np.max(values[far], initial=0.0))
    unsure = highest < _FOLLOWS or 1.0 - second**2 < only * (1.0 - highest**2)
    if highest <= 0.0 or (sure and unsure):
        raise InputError(
            f"{track.path}: the offset between the clocks of poses and elevator was "
            f"not found (they correlate by {highest:.2f} at best, by {second:.2f} "
            "elsewhere); expected 'clock: SECONDS' or 'clock: same' in the mapping."
        )
    return Offset(float(offsets[best]), highest)


def _turning_of(track: Track, flights: Sequence[Track]) -> _Turning:
    elevator = track.servo.elevator or track.servo.angle_command
    assert elevator is not None
    motion = join([calc_motion(f.time, planar_pose(f)) for f in flights])
    (vx, vz, rate), speed = motion.velocity.T, motion.speed
    alpha = np.arctan2(-vz, vx) - motion.pose[:, 2]
    square = speed**2
    lift = [square * np.sin(alpha), square * np.cos(alpha)]
    base = np.column_stack([np.ones(len(speed)), *lift, speed * rate])
    target = motion.acceleration[:, 2]
    return _Turning(track, elevator, motion.time, square, alpha, base, target)


def _pool(turnings: Sequence[_Turning], offsets: Iterable[float]) -> np.ndarray:
    """Effects (5,) of base and elevator in all recordings together."""
    pairs = zip(turnings, offsets, strict=True)
    designs = [np.column_stack([t.base, t.column(offset)]) for t, offset in pairs]
    target = np.concatenate([turning.target for turning in turnings])
    return np.linalg.lstsq(np.concatenate(designs), target, rcond=None)[0]


def _follow_effect(turning: _Turning, effect: np.ndarray) -> Follow:
    """Compares the pitch's acceleration with a known effect (5,) of the elevator."""
    target = turning.target - turning.base @ effect[:-1]
    unexplained = turning.target

    def follow(offset: float) -> float:
        rest = target - turning.column(offset) * effect[-1]
        return float(np.sqrt(max(0.0, 1.0 - rest @ rest / (unexplained @ unexplained))))

    return follow


def _follow_pitch(turnings: Sequence[_Turning]) -> Follow:
    """Compares the pitch's acceleration in recordings with their elevators' angles."""
    base, _ = np.linalg.qr(np.concatenate([turning.base for turning in turnings]))
    target = _without(np.concatenate([turning.target for turning in turnings]), base)

    def follow(offset: float) -> float:
        columns = [turning.column(offset) for turning in turnings]
        column = _without(np.concatenate(columns), base)
        size = (column @ column) * (target @ target)
        return float(abs(column @ target) / np.sqrt(max(size, 1e-12)))

    return follow


def _without(column: np.ndarray, base: np.ndarray) -> np.ndarray:
    """The part of a column (n,) that an orthonormal base (n, k) does not explain."""
    return column - base @ (base.T @ column)


def _follow_commands(track: Track) -> Offset:
    """Offset at which the elevator's rate follows the commands best."""
    elevator, rates, angles = track.servo
    command = rates or angles
    assert elevator is not None and command is not None
    path = command.values[:, 0]
    if rates is not None:  # They add up to angles.
        path = elevator_path(command.time, path, command.time)
    ends, rate = mean_rates(elevator.time, elevator.values[:, 0])

    def follow(offset: float) -> float:
        asked = np.diff(np.interp(ends + offset, command.time, path), axis=0)[0]
        size = (rate @ rate) * (asked @ asked)
        return float(abs(rate @ asked) / max(np.sqrt(size), 1e-12))

    return _best(track, _overlaps(track.time, command.time), follow)
