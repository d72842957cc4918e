"""The clock step: how far the elevator's clock is ahead of that of the poses.

An elevator turns the glider: of the pitch's acceleration, what pitch, speed and pitch
rate do not explain must follow V² times its angle,
    pitchdd = c + V² (a sin alpha + b cos alpha) + d V q
              + e V² sin(elevator(t + offset) - alpha),
and the offset is that of the best fit.
"""

import dataclasses
import math
from collections.abc import Callable, Iterable, Sequence
from typing import NamedTuple

import numpy as np

from glider.campaign.checks.forces import Motions
from glider.campaign.checks.motion import SPAN, calc_motion
from glider.campaign.importing.track import (
    ServoLogs,
    Stream,
    Track,
    planar_pose,
    turn_along,
)
from glider.campaign.settings import Mapping
from glider.errors import InputError

_STEP = 0.01  # Between the offsets that are tried [s].
_FOLLOWS = 0.5
"""Correlation above which one signal follows the other. Measured: 0.62 to 0.97 for the
practice campaigns' elevators at the right offset."""
_ONLY = 2.0
"""Least ratio of the variance that is unexplained more than `_NEAR` away to that at the
best offset."""
_ONLY_COMMON = 1.5  # The same of an offset of all recordings: chance fits few.
_NEAR = 0.25  # [s]
_ITERATIONS = 20  # Of Gauss-Newton in all offsets.
_COARSE = 0.015  # Standard error of one flight alone, where none is known [s].
_FORM = 0.004  # Error by the form of the effect, see bench_clock [s].
_ROUNDS = 3  # Of pooling the effect of all recordings, and searching each again.
_FEWEST_FLIGHTS = 4  # That show whether a clock gains.
_FEWEST_ROWS = 20  # Of a flight that shows an offset of its own.
_ABSORBED = 0.1  # Delay or lag of a servo that a clock found by it may hide [s].
_OFF = 3.0  # Standard errors above which a clock that is specified is in doubt.

_Follow = Callable[[float], float]  # From an offset [s] to the correlation.
_Flown = tuple[Track, Sequence[Track]]  # A recording, and its flights.


class _Offset(NamedTuple):
    """How far a clock is ahead, and how well the signals then follow one another."""

    seconds: float
    correlation: float
    elsewhere: float  #: Best correlation more than `_NEAR` away.
    std: float = _COARSE  #: Standard error [s].
    rate: float = 0.0  #: Seconds by which it gains in one of the poses.
    middle: float = 0.0  #: Time of the poses at which it is ahead by `seconds` [s].

    def on_poses(self, time: np.ndarray) -> np.ndarray:
        """Times (n,) of the other clock on that of the poses."""
        since = time - self.seconds - self.middle
        return self.middle + since / (1.0 + self.rate)

    def is_sure(self, only: float = _ONLY) -> bool:
        """Whether the signals follow one another, and only at this offset."""
        left = 1.0 - self.correlation**2
        left_elsewhere = 1.0 - self.elsewhere**2
        return self.correlation >= _FOLLOWS and left_elsewhere >= only * left


def join_clocks(
    tracks: list[Track], flights: list[list[Track]], mapping: Mapping
) -> tuple[list[Track], tuple[str, ...]]:
    """Shifts the servos' logs of recordings onto the poses' clocks; and warnings."""
    clock = mapping.clock
    if clock is None:
        differ = any(log.clock != t.clock for t in tracks for log in t.servo.given)
        clock = "find" if differ else "same"
    flying: dict[int, _Flown] = {}
    for place, (track, cuts) in enumerate(zip(tracks, flights, strict=True)):
        turns = track.servo.elevator or track.servo.angle_command
        if cuts and turns and not track.has_measured:
            flying[place] = track, list(map(turn_along, cuts))
    pairs = [*flying.values()]
    if clock not in ("same", "find"):
        offset = _Offset(float(clock), 0.0, 0.0)
        std, warnings = _check_clock(pairs, offset.seconds, mapping.source)
        note = f"clock: shifted by {offset.seconds:g} s, as specified"
        shifted = [_shift(track, offset, std, note) for track in tracks]
        return shifted, warnings
    if clock == "same":
        return tracks, ()
    for track in tracks:
        clocks = {log.clock for log in track.servo.given}
        if track.has_measured and len(clocks) > 1:
            raise InputError(
                f"{mapping.source}: clock: the elevator was measured on the clock of "
                "the poses, and its commands are on another, which the motion does not "
                "show; expected 'clock: SECONDS', 'clock: same', or no commands."
            )
    joined = [*tracks]
    warnings = ()
    found = _find_offsets(pairs) if pairs else []
    for place, offset in zip(flying, found, strict=True):
        track = tracks[place]
        std = offset.std
        note = (
            f"clock: the elevator's is {offset.seconds:+.3f} ± {std:.3f} s ahead of "
            f"that of the poses (correlation {offset.correlation:.2f}); it was shifted "
            "back"
        )
        if offset.rate:
            gained = 1e3 * offset.rate * float(np.ptp(track.time))
            warnings += (
                f"The servo's clock gains {1e6 * offset.rate:.0f} µs in a second on "
                f"that of the poses, {gained:.0f} ms over the session: that was taken "
                "out.",
            )
        if track.servo.elevator is None:
            note += ", and a delay of the servo, if any, with it"
            std = _ABSORBED
        joined[place] = _shift(track, offset, std, note)
    return joined, warnings


def _check_clock(
    flying: Sequence[_Flown], clock: float, source: str
) -> tuple[float, tuple[str, ...]]:
    """Standard error [s] of a clock that a mapping specifies, and a warning if off.

    It was read to half its last digit and a step of the logs; what is found adds.
    """
    digits = max(len(f"{clock:.6f}".rstrip("0").partition(".")[2]), 1)
    steps = [log.step for track, _ in flying for log in track.servo.given]
    read = math.hypot(0.1**digits, max(steps, default=0.0)) / math.sqrt(12.0)
    try:
        offsets = _find_offsets(flying) if flying else []
    except InputError:
        offsets = []
    if not offsets:
        return read, ()
    found = float(np.median([offset.seconds for offset in offsets]))
    std = float(np.median([offset.std for offset in offsets]))
    off = abs(clock - found)
    share = read**2 / (read**2 + std**2)
    if off <= _OFF * math.hypot(std, 0.1 ** max(digits, 2) / math.sqrt(12.0)):
        return math.hypot(share * off, math.sqrt(share) * std), ()
    words = (
        f"'clock' is {clock:g}, and the elevator turns the glider as if its clock were "
        f"{found:.3f} ± {std:.3f} s ahead of the poses'"
    )
    if off > _ABSORBED + _OFF * std:
        raise InputError(f"{source}: {words}; expected that, or 'find'.")
    return off, (f"{words}: it is wrong, or servo or poses are late",)


def _shift(track: Track, offset: _Offset, std: float = 0.0, note: str = "") -> Track:
    """Shifts the servo's logs of another clock onto the clock of the poses."""
    moved = [
        log and log._replace(time=offset.on_poses(log.time)) for log in track.servo
    ]
    if track.has_measured:
        moved[0] = track.servo.elevator
    servo = ServoLogs(*moved)
    notes = (*track.notes, note)
    return dataclasses.replace(track, servo=servo, clock_std=std, notes=notes)


class _Turning(NamedTuple):
    """The pitch's acceleration in the flights of a recording, and what explains it."""

    track: Track
    elevator: Stream
    time: np.ndarray  #: (k,) [s]
    square: np.ndarray  #: (k,) speed² [m²/s²]
    alpha: np.ndarray  #: (k,) angle of attack [rad]
    base: np.ndarray  #: (k, 4) columns without the elevator.
    target: np.ndarray  #: (k,) [rad/s²]

    def column(self, offset: float) -> np.ndarray:
        """V² sin(elevator - alpha) (k,) at an offset; beyond its log it rests."""
        log = self.elevator
        at = self.time + offset
        # The cubics average the acceleration over a window; so is the elevator here.
        delays = (-0.25 * SPAN, 0.0, 0.25 * SPAN)
        angles = [np.interp(at + d, log.time, log.values[:, 0]) for d in delays]
        return self.square * np.sin(np.mean(angles, axis=0) - self.alpha)


def _find_offsets(recordings: Sequence[_Flown]) -> list[_Offset]:
    """Finds the offset of the elevator's clock in recordings, whole and cut to flights.

    If one offset fits all recordings it is taken: two clocks that ran on between them.
    Measured on seven campaigns of 4 and 10 flights of 0.85 s: it is right to 15 ms.
    """
    tracks = [track for track, _ in recordings]
    turnings = [_turning_of(track, flights) for track, flights in recordings]
    # What the elevator must explain is what the rest does not.
    base, target = _stack(turnings)
    rest = np.linalg.lstsq(base, target, rcond=None)[0]
    turnings = [t._replace(target=t.target - t.base @ rest) for t in turnings]
    ranges = [_overlaps(t.track.time, t.elevator.time) for t in turnings]
    first = max(own[0] for own in ranges)
    last = min(own[-1] for own in ranges)
    common = _search(np.arange(first, last + _STEP, _STEP), _follow(turnings))
    if len(recordings) == 1:
        (refined,) = _refine_each(turnings, [common], np.eye(1))
        return _check_found(tracks, [_find_rate(*recordings[0], refined)])
    if common.is_sure(_ONLY_COMMON):
        same = np.ones((len(recordings), 1))
        return _refine_each(turnings, [common] * len(recordings), same)
    # A short flight alone is followed well at several offsets, by another effect each:
    # the effect is common to all.
    pairs = [*zip(ranges, turnings, strict=True)]
    found = [_search(own, _follow([turning])) for own, turning in pairs]
    effects = [_pool([t], [o.seconds]) for t, o in zip(turnings, found, strict=True)]
    effect = np.median(effects, axis=0)
    for _ in range(_ROUNDS):
        found = [_search(own, _follow([turning], effect)) for own, turning in pairs]
        effect = _pool(turnings, [offset.seconds for offset in found])
    return _refine_each(turnings, _check_found(tracks, found), np.eye(len(found)))


def _check_found(tracks: Sequence[Track], found: list[_Offset]) -> list[_Offset]:
    """Refuses recordings whose clock is not found."""
    for track, offset in zip(tracks, found, strict=True):
        if not offset.is_sure():
            raise InputError(
                f"{track.path}: the offset between the clocks of poses and elevator "
                f"was not found (they correlate by {offset.correlation:.2f} at best, "
                f"by {offset.elsewhere:.2f} elsewhere); expected 'clock: SECONDS' or "
                "'clock: same' in the mapping."
            )
    return found


def _find_rate(track: Track, flights: Sequence[Track], common: _Offset) -> _Offset:
    """An offset with the rate of its clock, where a session's flights show one.

    The offsets of flights by a clock that runs fast are on a line.
    """
    turnings = [_turning_of(track, [flight]) for flight in flights]
    turnings = [t for t in turnings if len(t.time) >= _FEWEST_ROWS]
    if len(turnings) < _FEWEST_FLIGHTS:
        return common
    middles = np.array([np.mean(turning.time) for turning in turnings])
    middle = float(np.mean(middles))
    line = np.column_stack([np.ones(len(middles)), middles - middle])
    start = np.full(len(middles), common.seconds)
    offsets, covariance = _refine(turnings, start, line)
    (ahead, rate), *_ = np.linalg.lstsq(line, offsets, rcond=None)
    std, rate_std = np.sqrt(np.diagonal(covariance))
    if abs(rate) < _OFF * rate_std:
        return common
    drifting = common._replace(
        seconds=float(ahead),
        std=math.hypot(std, _FORM),
        rate=float(rate),
        middle=middle,
    )
    shifted = _turning_of(_shift(track, drifting), flights)
    correlation = _follow([shifted])(0.0)
    if correlation <= common.correlation:
        return common
    return drifting._replace(correlation=correlation)


def _refine_each(
    turnings: Sequence[_Turning], found: Sequence[_Offset], design: np.ndarray
) -> list[_Offset]:
    """Offsets of recordings as `_refine` finds them, and their standard errors."""
    start = np.array([offset.seconds for offset in found])
    offsets, covariance = _refine(turnings, start, design)
    variances = np.diagonal(design @ covariance @ design.T)
    stds = np.hypot(np.sqrt(variances), _FORM)
    refined = []
    for old, seconds, std in zip(found, offsets, stds, strict=True):
        refined.append(old._replace(seconds=float(seconds), std=float(std)))
    return refined


def _refine(
    turnings: Sequence[_Turning], start: np.ndarray, design: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Refines offsets together with the effect, by Gauss-Newton.

    Args:
        turnings: of n recordings or flights.
        start: (n,) offsets [s].
        design: (n, k) by how much each offset changes with each of k parameters.

    Returns:
        Offsets (n,) [s], and the covariance of the parameters (k, k).
    """
    base, target = _stack(turnings)
    by_row = np.repeat(design, [len(turning.target) for turning in turnings], axis=0)
    # Rows within the window of one cubic are not independent.
    rate = 1.0 / np.median(np.diff(turnings[0].track.time))
    dependent = max(SPAN * rate, 1.0)
    offsets = start.astype(float)
    for _ in range(_ITERATIONS):
        gain = _pool(turnings, offsets)[-1]
        after = _join_columns(turnings, offsets + _STEP)
        before = _join_columns(turnings, offsets - _STEP)
        slope = gain * (after - before) / (2.0 * _STEP)
        column = _join_columns(turnings, offsets)
        columns = np.column_stack([base, column, slope[:, None] * by_row])
        step = np.linalg.lstsq(columns, target, rcond=None)[0]
        change = design @ step[-design.shape[1] :]
        offsets += change * min(1.0, _STEP / max(np.max(np.abs(change)), 1e-12))
    left = target - columns @ step
    variance = np.mean(left**2) * dependent
    covariance = variance * np.linalg.pinv(columns.T @ columns)
    parameters = slice(-design.shape[1], None)
    return offsets, covariance[parameters, parameters]


def _stack(turnings: Sequence[_Turning]) -> tuple[np.ndarray, np.ndarray]:
    """Base (k, 4) and target (k,) of all recordings, one after the other."""
    base = np.concatenate([turning.base for turning in turnings])
    target = np.concatenate([turning.target for turning in turnings])
    return base, target


def _join_columns(turnings: Sequence[_Turning], offsets: Iterable[float]) -> np.ndarray:
    """Columns (k,) of the elevator, each recording at its offset."""
    pairs = zip(turnings, offsets, strict=True)
    return np.concatenate([turning.column(offset) for turning, offset in pairs])


def _overlaps(time: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Offsets (m,) at which two logs with times (n,) and (k,) overlap."""
    return np.arange(other[0] - time[-1], other[-1] - time[0] + _STEP, _STEP)


def _search(offsets: np.ndarray, follow: _Follow) -> _Offset:
    """The best of some offsets (m,)."""
    if not len(offsets):
        return _Offset(0.0, 0.0, 0.0)
    values = np.array([follow(offset) for offset in offsets])
    best = int(np.argmax(values))
    is_far = np.abs(offsets - offsets[best]) > _NEAR
    elsewhere = float(np.max(values[is_far], initial=0.0))
    return _Offset(float(offsets[best]), float(values[best]), elsewhere)


def _turning_of(track: Track, flights: Sequence[Track]) -> _Turning:
    elevator = track.servo.elevator or track.servo.angle_command
    assert elevator is not None
    each = (calc_motion(flight.time, planar_pose(flight)) for flight in flights)
    motion = Motions(tuple(each)).joined
    vx, vz, rate = motion.velocity.T
    speed = motion.speed
    alpha = np.arctan2(-vz, vx) - motion.pose[:, 2]
    square = speed**2
    lift = [square * np.sin(alpha), square * np.cos(alpha)]
    base = np.column_stack([np.ones(len(speed)), *lift, speed * rate])
    target = motion.acceleration[:, 2]
    return _Turning(track, elevator, motion.time, square, alpha, base, target)


def _pool(turnings: Sequence[_Turning], offsets: Iterable[float]) -> np.ndarray:
    """Effects (5,) of base and elevator in all recordings together."""
    base, target = _stack(turnings)
    design = np.column_stack([base, _join_columns(turnings, offsets)])
    return np.linalg.lstsq(design, target, rcond=None)[0]


def _follow(turnings: Sequence[_Turning], effect: np.ndarray | None = None) -> _Follow:
    """Compares the pitch's acceleration in recordings with their elevators' angles.

    The effect (5,) of base and elevator is known, or the one that fits best.
    """
    base, target = _stack(turnings)
    basis = np.zeros((len(target), 0))
    power = target @ target
    if effect is None:
        basis, _ = np.linalg.qr(base)
        target = target - basis @ (basis.T @ target)
        power = target @ target
    else:
        target = target - base @ effect[:-1]

    def follow(offset: float) -> float:
        column = _join_columns(turnings, [offset] * len(turnings))
        column = column - basis @ (basis.T @ column)
        best = column @ target / max(column @ column, 1e-12)
        gain = best if effect is None else effect[-1]
        rest = target - gain * column
        return math.sqrt(max(0.0, 1.0 - rest @ rest / max(power, 1e-12)))

    return follow
