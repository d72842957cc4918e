"""The clock step: how far the elevator's clock is ahead of that of the poses.

An elevator turns the glider: of the pitch's acceleration, what pitch, speed and pitch
rate do not explain must follow V² times its angle,
    pitchdd = c + V² (a sin alpha + b cos alpha) + d V q
              + e V² sin(elevator(t + offset) - alpha),
and the offset is that at which it does best. Where the elevator was measured on the
clock of the poses and the commands on another, the elevator's rate must follow theirs.
"""

import contextlib
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
_COVERED = 0.95  # Share of the flights that the other log must cover.
_FOLLOWS = 0.5
"""Correlation from which on one signal follows the other. Measured: 0.62 to 0.97 for
the practice campaigns' elevators at the right offset."""
_ONLY = 2.0
"""Ratio of what is left unexplained at any offset more than `_NEAR` away to what is
left at the best, at least: else either could be meant. A common offset of all
recordings needs less, `_ONLY_COMMON`: by chance it does not fit many."""
_ONLY_COMMON = 1.5
_NEAR = 0.25  # [s]
_STEPS = 10  # Of Gauss-Newton in all offsets.
_SEEDS = 4  # Recordings that may say first what the elevator does.
_PEAKS = 3  # Offsets of each that are tried.
_ROUNDS = 3  # Of pooling what recordings say of the glider, and asking each again.


Follow = Callable[[float], float]
"""From an offset [s] to the correlation, 0 where too little is covered."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Offset:
    """How far a clock is ahead, and how well the signals then follow one another."""

    seconds: float
    correlation: float
    std: float | None = None  # Standard error [s], where it is known.


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

    If one offset fits all recordings it is that: two clocks that ran on between them.
    Else what the elevator does is still the same in all: what one says of it tells the
    offsets of the others, and all together say it better. Measured on seven simulated
    campaigns of 4 and 10 flights of 0.85 s: one offset is right to 15 ms.

    Args:
        recordings: each whole, and the flights cut out of it, at least one.

    Raises:
        InputError: at no offset they follow one another, or at several.
    """
    if all(_is_measured(track) for track, _ in recordings):
        return [_search(track, *_follow_rates(track)) for track, _ in recordings]
    turnings = [_turning_of(track, flights) for track, flights in recordings]
    if len(recordings) == 1:
        other = turnings[0].elevator.time
        return [_search(recordings[0][0], other, _follow_pitch(turnings[0]))]
    with contextlib.suppress(InputError):  # Two clocks that run on between recordings.
        times = [turning.elevator.time for turning in turnings]
        begin = max(
            t[0] - r.time[-1] for t, (r, _) in zip(times, recordings, strict=True)
        )
        end = min(
            t[-1] - r.time[0] for t, (r, _) in zip(times, recordings, strict=True)
        )
        tried = np.arange(begin, end, _STEP)
        follow = _follow_all(turnings)
        common = _best(recordings[0][0], tried, follow, only=_ONLY_COMMON)
        return [common] * len(recordings)
    effect = _first_effect([t for t, _ in recordings], turnings)
    for k in range(_ROUNDS):
        offsets = [
            _search(
                track,
                turning.elevator.time,
                _follow_pitch(turning, effect),
                sure=k == _ROUNDS - 1,
            )
            for (track, _), turning in zip(recordings, turnings, strict=True)
        ]
        known = [(t, o.seconds) for t, o in zip(turnings, offsets, strict=True)]
        effect = _pool(known)
    closer, std = _refine(turnings, np.array([o.seconds for o in offsets]))
    return [
        dataclasses.replace(offset, seconds=float(s), std=float(error))
        for offset, s, error in zip(offsets, closer, std, strict=True)
    ]


def _first_effect(tracks: Sequence[Track], turnings: Sequence[_Turning]) -> np.ndarray:
    """Returns effects (5,) of base and elevator with which to begin.

    A short flight alone is followed well at several offsets. Each of them says what the
    elevator does; the one is taken that the other flights agree with best.
    """
    few = list(zip(tracks, turnings, strict=True))[:_SEEDS]
    best, effect = -1.0, np.zeros(5)
    for track, turning in few:
        offsets, values = _scan(track, turning.elevator.time, _follow_pitch(turning))
        for _ in range(_PEAKS):
            peak = int(np.argmax(values))
            if values[peak] <= 0.0:
                break
            here = _pool([(turning, float(offsets[peak]))])
            agreement = sum(
                float(np.max(_scan(t, o.elevator.time, _follow_pitch(o, here))[1]))
                for t, o in few
            )
            if agreement > best:
                best, effect = agreement, here
            values[np.abs(offsets - offsets[peak]) < 0.5 * _NEAR] = 0.0
    return effect


def _scan(
    track: Track, other: np.ndarray, follow: Follow
) -> tuple[np.ndarray, np.ndarray]:
    """Returns all offsets (m,) at which two logs overlap, and how well each fits."""
    offsets = np.arange(
        other[0] - track.time[-1], other[-1] - track.time[0] + _STEP, _STEP
    )
    return offsets, np.array([follow(offset) for offset in offsets])


def _refine(
    turnings: Sequence[_Turning], offsets: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Returns offsets (m,) that fit best with what the elevator does, and their errors.

    Gauss-Newton in the effects and in all offsets at once: one after the other they
    hold each other back, for pitch rates follow the elevator.
    """
    offsets, std = offsets.copy(), np.full(len(offsets), np.nan)
    for _ in range(_STEPS):
        effect = _pool(list(zip(turnings, offsets, strict=True)))
        designs, rests = [], []
        for k, (turning, offset) in enumerate(zip(turnings, offsets, strict=True)):
            here = [_column(turning, offset + d) for d in (-_STEP, 0.0, _STEP)]
            if any(column is None for column in here):
                return offsets, std
            before, column, after = np.array(here)
            shifts = np.zeros((len(column), len(offsets)))
            shifts[:, k] = effect[-1] * (after - before) / (2.0 * _STEP)
            designs.append(np.column_stack([turning.base, column, shifts]))
            rests.append(turning.target - designs[-1][:, :5] @ effect)
        design, rest = np.concatenate(designs), np.concatenate(rests)
        step = np.linalg.lstsq(design, rest, rcond=None)[0]
        offsets += np.clip(step[5:], -_STEP, _STEP)
        # Rows within one cubic's window are no news of one another.
        rate = 1.0 / np.median(np.diff(turnings[0].time))
        variance = np.mean((rest - design @ step) ** 2) * max(SPAN * rate, 1.0)
        covariance = variance * np.linalg.pinv(design.T @ design)
        std = np.sqrt(np.diagonal(covariance)[5:])
    return offsets, std


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


def _search(
    track: Track, other: np.ndarray, follow: Follow, *, sure: bool = True
) -> Offset:
    """Returns the best of all offsets at which the two logs overlap.

    Args:
        track: the recording.
        other: (k,) times of the log on the other clock [s].
        follow: tells how well it fits.
        sure: whether to refuse where another fits nearly as well.
    """
    offsets, _ = _scan(track, other, lambda _: 0.0)
    return _best(track, offsets, follow, sure=sure)


def _best(
    track: Track,
    offsets: np.ndarray,
    follow: Follow,
    *,
    sure: bool = True,
    only: float = _ONLY,
) -> Offset:
    """Returns the best of some offsets (m,), more closely; see `_search`, `_ONLY`."""
    if not len(offsets):
        raise _not_found(track, 0.0, 0.0)
    values = np.array([follow(offset) for offset in offsets])
    best = int(np.argmax(values))
    far = np.abs(offsets - offsets[best]) > _NEAR
    second = float(np.max(values[far], initial=0.0))
    left, left_elsewhere = 1.0 - values[best] ** 2, 1.0 - second**2
    unsure = values[best] < _FOLLOWS or left_elsewhere < only * left
    if values[best] <= 0.0 or (sure and unsure):
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


def _follow_all(turnings: Sequence[_Turning]) -> Follow:
    """Returns what compares all recordings with their elevators at one offset."""
    base = np.concatenate([turning.base for turning in turnings])
    base, _ = np.linalg.qr(base)
    target = _without(np.concatenate([turning.target for turning in turnings]), base)

    def follow(offset: float) -> float:
        columns = []
        for turning in turnings:
            column = _column(turning, offset)
            if column is None:
                return 0.0
            columns.append(column)
        column = _without(np.concatenate(columns), base)
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
