"""The clock step: how far the elevator's clock is ahead of that of the poses.

An elevator turns the glider: of the pitch's acceleration, what pitch, speed and pitch
rate do not explain must follow V² times its angle,
    pitchdd = c + V² (a sin alpha + b cos alpha) + d V q
              + e V² sin(elevator(t + offset) - alpha),
and the offset is that of the best fit, among even steps and between three of them.
"""

import dataclasses
import math
from collections.abc import Callable, Sequence
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
_FORM = 0.004  # Error by the form of the effect, see bench_clock [s].
_ROUNDS = 3  # Of pooling the effect of all recordings, and searching each again.
_FASTEST = 5e-3  # Rate of a clock that is found [s/s].
_FEWEST_FLIGHTS = 4  # That show whether a clock gains.
_ABSORBED = 0.1  # Delay or lag of a servo that a clock found by it may hide [s].
_OFF = 3.0  # Standard errors above which a clock that is specified is in doubt.

_Flown = tuple[Track, Sequence[Track]]  # A recording, and its flights.


class _Offset(NamedTuple):
    """How far a clock is ahead, and how well the signals then follow one another."""

    seconds: float
    correlation: float = 0.0
    elsewhere: float = 0.0  #: Best correlation more than `_NEAR` away.
    std: float = 0.0  #: Standard error [s].
    rate: float = 0.0  #: Seconds by which it gains in one of the poses.
    middle: float = 0.0  #: Time of the poses at which it is ahead by `seconds` [s].

    def on_poses(self, time: np.ndarray) -> np.ndarray:
        """Times (n,) of the other clock on that of the poses."""
        since = time - self.seconds - self.middle
        return self.middle + since / (1.0 + self.rate)

    def moved(self, seconds: float) -> "_Offset":
        """An offset that is ahead by more."""
        return self._replace(seconds=self.seconds + seconds)

    def drifting(self, rate: float) -> "_Offset":
        """An offset of another rate."""
        return self._replace(rate=rate)

    def is_sure(self, only: float) -> bool:
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
    if clock == "same":
        return tracks, ()
    flying: dict[int, _Flown] = {}
    for place, (track, cuts) in enumerate(zip(tracks, flights, strict=True)):
        turns = track.servo.elevator or track.servo.angle_command
        if cuts and turns and not track.has_measured:
            flying[place] = track, list(map(turn_along, cuts))
    recordings = [*flying.values()]
    if clock != "find":
        offset = _Offset(float(clock))
        std, warnings = _check_clock(recordings, offset.seconds, mapping.source)
        note = f"clock: shifted by {offset.seconds:g} s, as specified"
        return [_shift(track, offset, std, note) for track in tracks], warnings
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
    found = _find_offsets(recordings) if recordings else []
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
    recordings: Sequence[_Flown], clock: float, source: str
) -> tuple[float, tuple[str, ...]]:
    """Standard error [s] of a clock that a mapping specifies, and a warning if off.

    It was read to half its last digit and a step of the logs; what is found adds.
    """
    digits = max(len(f"{clock:.6f}".rstrip("0").partition(".")[2]), 1)
    last = 0.1**digits
    steps = [log.step for track, _ in recordings for log in track.servo.given]
    read = math.hypot(last, max(steps, default=0.0)) / math.sqrt(12.0)
    try:
        offsets = _find_offsets(recordings) if recordings else []
    except InputError:
        offsets = []
    if not offsets:
        return read, ()
    found = float(np.median([offset.seconds for offset in offsets]))
    std = float(np.median([offset.std for offset in offsets]))
    off = abs(clock - found)
    if off <= _OFF * math.hypot(std, min(last, 0.01) / math.sqrt(12.0)):
        share = read**2 / (read**2 + std**2)
        return math.hypot(share * off, math.sqrt(share) * std), ()
    words = (
        f"'clock' is {clock:g}, and the elevator turns the glider as if its clock were "
        f"{found:.3f} ± {std:.3f} s ahead of the poses'"
    )
    if off > _ABSORBED + _OFF * std:
        raise InputError(f"{source}: {words}; expected that, or 'find'.")
    return off, (f"{words}: it is wrong, or servo or poses are late",)


def _shift(track: Track, offset: _Offset, std: float, note: str) -> Track:
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
    """The pitch's acceleration in flights of a recording, and what explains it."""

    elevator: Stream
    time: np.ndarray  #: (k,) [s]
    square: np.ndarray  #: (k,) speed² [m²/s²]
    alpha: np.ndarray  #: (k,) angle of attack [rad]
    base: np.ndarray  #: (k, 4) columns without the elevator.
    target: np.ndarray  #: (k,) [rad/s²]

    def column(self, offset: _Offset) -> np.ndarray:
        """V² sin(elevator - alpha) (k,) at an offset; beyond its log it rests."""
        log = self.elevator
        at = self.time + offset.seconds + offset.rate * (self.time - offset.middle)
        # The cubics average the acceleration over a window; so is the elevator here.
        delays = (-0.25 * SPAN, 0.0, 0.25 * SPAN)
        angles = [np.interp(at + d, log.time, log.values[:, 0]) for d in delays]
        return self.square * np.sin(np.mean(angles, axis=0) - self.alpha)


def _measure_turning(track: Track, flights: Sequence[Track]) -> _Turning:
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
    return _Turning(elevator, motion.time, square, alpha, base, target)


def _find_offsets(recordings: Sequence[_Flown]) -> list[_Offset]:
    """Finds the offset of the elevator's clock in recordings, whole and cut to flights.

    If one offset fits all recordings it is taken: two clocks that ran on between them.
    Measured on seven campaigns of 4 and 10 flights of 0.85 s: it is right to 15 ms.
    """
    turnings = [_measure_turning(*recording) for recording in recordings]
    found = [_search(turnings)] * len(recordings)
    only = _ONLY
    if len(recordings) == 1:
        [(_, flights)] = recordings
        if len(flights) >= _FEWEST_FLIGHTS:
            found = [_find_rate(turnings[0], *found)]
    elif not found[0].is_sure(_ONLY_COMMON):
        # A short flight alone is followed well at several offsets, by another effect
        # each: the effect is common to all.
        found = [_search([own]) for own in turnings]
        pairs = zip(turnings, found, strict=True)
        effect = np.median([_pool([own], [old]) for own, old in pairs], axis=0)
        for _ in range(_ROUNDS):
            found = [_search([own], effect=effect) for own in turnings]
            effect = _pool(turnings, found)
    else:
        only = _ONLY_COMMON
    for (track, _), offset in zip(recordings, found, strict=True):
        if not offset.is_sure(only):
            raise InputError(
                f"{track.path}: the offset between the clocks of poses and elevator "
                f"was not found (they correlate by {offset.correlation:.2f} at best, "
                f"by {offset.elsewhere:.2f} elsewhere); expected 'clock: SECONDS' or "
                "'clock: same' in the mapping."
            )
    return [own._replace(std=math.hypot(own.std, _FORM)) for own in found]


def _find_rate(turning: _Turning, common: _Offset) -> _Offset:
    """An offset with the rate of its clock, where the flights of a session show one."""
    middle = float(np.mean(turning.time))
    half = 0.5 * float(np.ptp(turning.time))
    rates = np.arange(-_FASTEST, _FASTEST, _STEP / half)
    nearby = np.arange(-_NEAR, _NEAR, _STEP)
    offset = common._replace(middle=middle)
    for _ in range(2 * _ROUNDS):  # Flights are unevenly apart.
        rate = _search([turning], rates, offset.drifting)
        offset = offset._replace(rate=rate.seconds)
        ahead = _search([turning], nearby, offset.moved)
        offset = offset.moved(ahead.seconds)
    if ahead.correlation <= common.correlation or abs(offset.rate) < _OFF * rate.std:
        return common
    return offset._replace(correlation=ahead.correlation, std=ahead.std)


def _search(
    turnings: Sequence[_Turning],
    tried: np.ndarray | None = None,
    offset_of: Callable[[float], _Offset] = _Offset,
    effect: np.ndarray | None = None,
) -> _Offset:
    """The likeliest of offsets, and its standard error.

    Args:
        turnings: of recordings that have one offset.
        tried: even steps (m,) of what `offset_of` makes an offset of, which is found;
            by default the seconds at which all logs overlap.
        offset_of: makes an offset of a tried value.
        effect: (5,) of base and elevator; by default the one that fits best.
    """
    if tried is None:
        first = max(own.elevator.time[0] - own.time[-1] for own in turnings)
        last = min(own.elevator.time[-1] - own.time[0] for own in turnings)
        tried = np.arange(first, last + _STEP, _STEP)
    if len(tried) < 3:
        return _Offset(0.0)
    base, target = _stack(turnings)
    basis = base[:, :0]
    if effect is None:
        basis, _ = np.linalg.qr(base)
        target = target - basis @ (basis.T @ target)
    else:
        target = target - base @ effect[:-1]
    left = np.ones(len(tried))  # Shares that the elevator does not explain.
    for k, value in enumerate(tried):
        column = _stack_columns(turnings, [offset_of(value)] * len(turnings))
        column = column - basis @ (basis.T @ column)
        gain = (column @ target) / max(column @ column, 1e-12)
        if effect is not None:
            gain = effect[-1]
        rest = target - gain * column
        left[k] = (rest @ rest) / max(target @ target, 1e-12)
    correlations = np.sqrt(np.maximum(1.0 - left, 0.0))
    best = int(np.clip(np.argmin(left), 1, len(tried) - 2))
    is_far = np.abs(tried - tried[best]) > _NEAR
    elsewhere = np.max(correlations[is_far], initial=0.0)
    # Rows within the window of one cubic are not independent.
    step = float(np.median(np.diff(turnings[0].time)))
    count = len(target) / max(SPAN / step, 1.0)
    costs = 0.5 * count * left[best - 1 : best + 2] / max(left[best], 1e-9)
    bend = max(costs[0] - 2.0 * costs[1] + costs[2], 1e-6)
    apart = tried[best] - tried[best - 1]
    shift = np.clip(0.5 * (costs[0] - costs[2]) / bend, -1.0, 1.0)
    return _Offset(
        seconds=float(tried[best] + apart * shift),
        correlation=float(correlations[best]),
        elsewhere=float(elsewhere),
        std=float(apart / math.sqrt(bend)),
    )


def _pool(turnings: Sequence[_Turning], offsets: Sequence[_Offset]) -> np.ndarray:
    """Effects (5,) of base and elevator in all recordings together."""
    base, target = _stack(turnings)
    columns = np.column_stack([base, _stack_columns(turnings, offsets)])
    return np.linalg.lstsq(columns, target, rcond=None)[0]


def _stack(turnings: Sequence[_Turning]) -> tuple[np.ndarray, np.ndarray]:
    """Base (k, 4) and target (k,) of all recordings, one after the other."""
    base = np.concatenate([turning.base for turning in turnings])
    target = np.concatenate([turning.target for turning in turnings])
    return base, target


def _stack_columns(
    turnings: Sequence[_Turning], offsets: Sequence[_Offset]
) -> np.ndarray:
    """Columns (k,) of the elevator, each recording at its offset."""
    pairs = zip(turnings, offsets, strict=True)
    return np.concatenate([turning.column(offset) for turning, offset in pairs])
