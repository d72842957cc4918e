"""The clock step: how far the elevator's clock is ahead of that of the poses.

An elevator turns the glider: of the pitch's acceleration, what pitch, speed and pitch
rate do not explain must follow V² times its angle,
    pitchdd = c + V² (a sin alpha + b cos alpha) + d V q
              + e V² sin(elevator(t + offset) - alpha),
and the offset is that of the best fit.
"""

import dataclasses
import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.optimize import least_squares

from glider.campaign.checks.forces import Motions
from glider.campaign.checks.motion import SPAN, calc_motion
from glider.campaign.importing.track import (
    ServoLogs,
    Stream,
    Track,
    planar_pose,
    turn_along,
)
from glider.campaign.settings import ColumnMapping
from glider.errors import InputError

_STEP = 0.01  # Between the offsets that are tried [s].
_FOLLOWS = 0.5
"""Correlation above which one signal follows the other. Measured: 0.62 to 0.97 for the
practice campaigns' elevators at the right offset."""
_ONLY = 2.0
"""Least ratio of the variance that is unexplained more than `_NEAR` away to that at the
best offset."""
_NEAR = 0.25  # [s]
_COARSE = 0.015  # Standard error of one flight alone, where none is known [s].
_FORM = 0.004  # Error by the form of the effect, see bench_clock [s].
_ROUNDS = 3  # Of pooling the effect of all recordings, and searching each again.
_FEWEST_FLIGHTS = 4  # That show whether a clock gains.
_FEWEST_ROWS = 20  # Of a flight that shows an offset of its own.
_ABSORBED = 0.1  # Delay or lag of a servo that a clock found by it may hide [s].
_OFF = 3.0  # Standard errors above which a clock that is specified is in doubt.

_Flown = tuple[Track, Sequence[Track]]  # A recording, and its flights.


class _Offset(NamedTuple):
    """How far a clock is ahead, and how well the signals then follow one another."""

    seconds: float = 0.0
    correlation: float = 0.0
    elsewhere: float = 0.0  #: Best correlation more than `_NEAR` away.
    std: float = _COARSE  #: Standard error [s].
    rate: float = 0.0  #: Seconds by which it gains in one of the poses.
    middle: float = 0.0  #: Time of the poses at which it is ahead by `seconds` [s].

    def on_poses(self, time: np.ndarray) -> np.ndarray:
        """Times (n,) of the other clock on that of the poses."""
        since = time - self.seconds - self.middle
        return self.middle + since / (1.0 + self.rate)

    def is_sure(self) -> bool:
        """Whether the signals follow one another, and only at this offset."""
        left = 1.0 - self.correlation**2
        left_elsewhere = 1.0 - self.elsewhere**2
        return self.correlation >= _FOLLOWS and left_elsewhere >= _ONLY * left


def join_clocks(
    tracks: list[Track], flights: list[list[Track]], mapping: ColumnMapping
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
    pairs = [*flying.values()]
    if clock != "find":
        offset = _Offset(float(clock))
        std, warnings = _check_clock(pairs, offset.seconds, mapping.source)
        note = f"clock: shifted by {offset.seconds:g} s, as specified"
        shifted = [_shift(track, offset, std, note) for track in tracks]
        return shifted, warnings
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
    for place, offset in zip(flying, _find_offsets(pairs), strict=True):
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
        offsets = _find_offsets(flying)
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
    """The pitch's acceleration in flights of a recording, and what explains it."""

    elevator: Stream
    time: np.ndarray  #: (k,) [s]
    square: np.ndarray  #: (k,) speed² [m²/s²]
    alpha: np.ndarray  #: (k,) angle of attack [rad]
    base: np.ndarray  #: (k, 4) columns without the elevator.
    target: np.ndarray  #: (k,) [rad/s²]

    def column(self, offset: float) -> np.ndarray:
        """V² sin(elevator - alpha) (k,) at an offset; beyond its log it rests."""
        log = self.elevator
        # The cubics average the acceleration over a window; so is the elevator here.
        at = self.time + offset + 0.25 * SPAN * np.array([[-1.0], [0.0], [1.0]])
        angles = np.interp(at, log.time, log.values[:, 0])
        return self.square * np.sin(np.mean(angles, axis=0) - self.alpha)


def _turning_of(track: Track, flights: Sequence[Track]) -> _Turning:
    elevator = track.servo.elevator or track.servo.angle_command
    assert elevator is not None
    each = (calc_motion(flight.time, planar_pose(flight)) for flight in flights)
    motion = Motions(tuple(each)).joined
    vx, vz, rate = motion.velocity.T
    speed = motion.speed
    alpha = np.arctan2(-vz, vx) - motion.pose[:, 2]
    lift = [np.ones(len(speed)), speed**2 * np.sin(alpha), speed**2 * np.cos(alpha)]
    return _Turning(
        elevator=elevator,
        time=motion.time,
        square=speed**2,
        alpha=alpha,
        base=np.column_stack([*lift, speed * rate]),
        target=motion.acceleration[:, 2],
    )


def _find_offsets(recordings: Sequence[_Flown]) -> list[_Offset]:
    """Finds the offset of the elevator's clock in recordings, whole and cut to flights.

    If one offset fits all recordings it is taken: two clocks that ran on between them.
    Measured on seven campaigns of 4 and 10 flights of 0.85 s: it is right to 15 ms.
    """
    if not recordings:
        return []
    turnings = [_turning_of(track, flights) for track, flights in recordings]
    count = len(turnings)
    common = _search(turnings)
    found = [common] * count
    design = np.ones((count, 1))
    is_one = count > 1 and common.is_sure()
    if not is_one:
        # A short flight alone is followed well at several offsets, by another effect
        # each: the effect is common to all.
        design = np.eye(count)
        effect = None
        for _ in range(_ROUNDS if count > 1 else 1):
            found = [_search([turning], effect) for turning in turnings]
            stacked = _stack(turnings, np.array([own.seconds for own in found]))
            effect = np.linalg.lstsq(*stacked, rcond=None)[0]
    start = np.linalg.lstsq(design, [own.seconds for own in found], rcond=None)[0]
    parameters, covariance = _refine(turnings, start, design)
    variances = np.diagonal(design @ covariance @ design.T)
    stds = np.hypot(np.sqrt(variances), _FORM)
    refined = []
    for own, seconds, std in zip(found, design @ parameters, stds, strict=True):
        refined.append(own._replace(seconds=float(seconds), std=float(std)))
    if count == 1:
        refined = [_find_rate(*recordings[0], refined[0])]
    for (track, _), offset in zip(recordings, refined, strict=True):
        if not (is_one or offset.is_sure()):
            raise InputError(
                f"{track.path}: the offset between the clocks of poses and elevator "
                f"was not found (they correlate by {offset.correlation:.2f} at best, "
                f"by {offset.elsewhere:.2f} elsewhere); expected 'clock: SECONDS' or "
                "'clock: same' in the mapping."
            )
    return refined


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
    start = np.array([common.seconds, 0.0])
    (ahead, rate), covariance = _refine(turnings, start, line)
    std, rate_std = np.sqrt(np.diagonal(covariance))
    drifting = common._replace(
        seconds=float(ahead),
        std=math.hypot(std, _FORM),
        rate=float(rate),
        middle=middle,
    )
    shifted = _turning_of(_shift(track, drifting), flights)
    [correlation] = _correlate([shifted], np.zeros(1))
    is_shown = abs(rate) > _OFF * rate_std and correlation > common.correlation
    return drifting._replace(correlation=correlation) if is_shown else common


def _search(turnings: Sequence[_Turning], effect: np.ndarray | None = None) -> _Offset:
    """The best offset at which all recordings overlap with the logs of their servos."""
    first = max(t.elevator.time[0] - t.time[-1] for t in turnings)
    last = min(t.elevator.time[-1] - t.time[0] for t in turnings)
    offsets = np.arange(first, last + _STEP, _STEP)
    if not len(offsets):
        return _Offset()
    values = _correlate(turnings, offsets, effect)
    best = int(np.argmax(values))
    is_far = np.abs(offsets - offsets[best]) > _NEAR
    elsewhere = float(np.max(values[is_far], initial=0.0))
    return _Offset(float(offsets[best]), float(values[best]), elsewhere)


def _correlate(
    turnings: Sequence[_Turning], offsets: np.ndarray, effect: np.ndarray | None = None
) -> np.ndarray:
    """Correlations (m,) of the pitch's acceleration and elevators at m offsets.

    Of what the elevator must explain, as the rest does not. The effect (5,) of base and
    elevator is known, or the one that fits best.
    """
    base = np.concatenate([turning.base for turning in turnings])
    target = np.concatenate([turning.target for turning in turnings])
    basis, _ = np.linalg.qr(base)
    alone = target - basis @ (basis.T @ target)
    power = max(float(alone @ alone), 1e-12)
    if effect is not None:
        basis = basis[:, :0]
        alone = target - base @ effect[:-1]
    found = []
    for offset in offsets:
        column = np.concatenate([turning.column(offset) for turning in turnings])
        column -= basis @ (basis.T @ column)
        gain = column @ alone / max(column @ column, 1e-12)
        rest = alone - (gain if effect is None else effect[-1]) * column
        found.append(math.sqrt(max(0.0, 1.0 - rest @ rest / power)))
    return np.array(found)


def _stack(
    turnings: Sequence[_Turning], offsets: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Base and elevator (k, 5) and target (k,) of recordings, each at its offset."""
    pairs = zip(turnings, offsets, strict=True)
    column = np.concatenate([turning.column(offset) for turning, offset in pairs])
    base = np.concatenate([turning.base for turning in turnings])
    target = np.concatenate([turning.target for turning in turnings])
    return np.column_stack([base, column]), target


def _refine(
    turnings: Sequence[_Turning], start: np.ndarray, design: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Refines parameters of offsets, with the effect that fits best at each of them.

    Args:
        turnings: of n recordings or flights.
        start: parameters (m,) to begin with.
        design: (n, m) offsets [s] by each of the parameters.

    Returns:
        The parameters (m,), and their covariance (m, m).
    """
    reach = np.max(np.abs(design), axis=0)

    def rest(parameters: np.ndarray) -> np.ndarray:
        columns, target = _stack(turnings, design @ parameters)
        return target - columns @ np.linalg.lstsq(columns, target, rcond=None)[0]

    def slopes(parameters: np.ndarray) -> np.ndarray:
        steps = np.diag(_STEP / reach)
        changes = [rest(parameters + step) - rest(parameters - step) for step in steps]
        return np.transpose(changes) * reach / (2.0 * _STEP)

    found = least_squares(rest, start, slopes, x_scale=_STEP / reach)
    # Rows within the window of one cubic are not independent.
    dependent = max(SPAN / float(np.median(np.diff(turnings[0].time))), 1.0)
    variance = np.mean(found.fun**2) * dependent
    return found.x, variance * np.linalg.pinv(found.jac.T @ found.jac)
