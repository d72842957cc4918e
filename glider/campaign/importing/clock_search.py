"""How far the elevator's clock is ahead of that of the poses, by the glider's motion.

An elevator turns the glider: of the pitch's acceleration, what pitch, speed and pitch
rate do not explain must follow V² times its angle,
    pitchdd = c + V² (a sin alpha + b cos alpha) + d V q
              + e V² sin(elevator(t + offset) - alpha),
and the offset is that of the best fit. The coefficients (c, a, b, d, e) are called the
effect, the columns that they multiply without the elevator's the base.

Offsets are searched on a grid, by correlation, then refined by least squares, in which
a standard error comes with them.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.optimize import least_squares

from glider.campaign.checks.forces import Motions
from glider.campaign.checks.motion import SPAN, calc_motion
from glider.campaign.importing.track import Stream, Track, planar_pose
from glider.errors import InputError

_STEP = 0.01  # Between the offsets that are tried [s].
_ONLY = 2.0
"""Least ratio of the variance that is unexplained more than `_NEAR` away to that at the
best offset. The signals then correlate by sqrt(1/2) or more."""
_NEAR = 0.25  # [s]
_FORM = 0.004  # Error by the form of the effect, see bench_clock [s].
_ROUNDS = 2  # Of pooling the effect of all recordings, and searching each again.
_FEWEST_FLIGHTS = 4  # That show whether a clock gains.
_FEWEST_ROWS = 20  # Of a flight that shows an offset of its own.
_SHOWN = 3.0  # Standard errors above which a clock gains.


class Offset(NamedTuple):
    """How far a clock is ahead, and how well the signals then follow one another.

    Attributes:
        seconds: by which the clock is ahead [s].
        correlation: of the signals at this offset.
        elsewhere: best correlation more than `_NEAR` away.
        std: standard error of `seconds`, once it is refined [s].
        rate: seconds by which the clock gains in one second of the poses.
        middle: time of the poses at which it is ahead by `seconds` [s].
    """

    seconds: float = 0.0
    correlation: float = 0.0
    elsewhere: float = 0.0
    std: float = 0.0
    rate: float = 0.0
    middle: float = 0.0

    def on_poses(self, time: np.ndarray) -> np.ndarray:
        """Times (n,) of the other clock on that of the poses [s]."""
        since = time - self.seconds - self.middle
        return self.middle + since / (1.0 + self.rate)

    def is_sure(self) -> bool:
        """Whether the signals follow one another, and only at this offset."""
        left = 1.0 - self.correlation**2
        left_elsewhere = 1.0 - self.elsewhere**2
        return self.correlation > 0.0 and left_elsewhere >= _ONLY * left


class _Turning(NamedTuple):
    """The pitch's acceleration in k rows of flights, and what explains it.

    Attributes:
        elevator: its log, on a clock of its own [rad].
        time: of the poses (k,) [s].
        square: squared speed V² (k,) [m²/s²].
        alpha: angle of attack (k,) [rad].
        base: columns (k, 4) of the fit without the elevator's.
        target: pitch acceleration (k,) [rad/s²].
    """

    elevator: Stream
    time: np.ndarray
    square: np.ndarray
    alpha: np.ndarray
    base: np.ndarray
    target: np.ndarray

    def column(self, offset: float) -> np.ndarray:
        """The column of the elevator, V² sin(elevator - alpha) (k,), at an offset [s].

        Before and after its log the elevator rests.
        """
        # The cubics average the acceleration over a window; so is the elevator here.
        window = 0.25 * SPAN * np.array([[-1.0], [0.0], [1.0]])
        at = self.time + offset + window
        log = self.elevator
        angles = np.interp(at, log.time, log.values[:, 0])
        return self.square * np.sin(np.mean(angles, axis=0) - self.alpha)


def find_offsets(recordings: Sequence[Sequence[Track]]) -> list[Offset]:
    """Finds the offset of the elevator's clock in recordings, by the flights of each.

    If one offset fits all recordings it is taken: two clocks that ran on between them.
    Else each has an offset of its own. A single recording of several flights shows the
    rate of its clock as well.

    Measured on seven campaigns of 4 and 10 flights of 0.85 s: it is right to 15 ms.

    Args:
        recordings: the flights of each recording, with the logs of its servo. None has
            an elevator that was measured on the clock of the poses.

    Returns:
        An offset for each recording.

    Raises:
        InputError: no offset fits well, or several do.
    """
    if not recordings:
        return []
    turnings = [_calc_turning(flights) for flights in recordings]
    count = len(turnings)
    common = _search(turnings)
    found = [common] * count
    design = np.ones((count, 1))
    if count > 1 and not common.is_sure():
        found = _search_each(turnings)
        design = np.eye(count)

    # Least squares refines the offsets, and gives their standard errors.
    start = np.linalg.lstsq(design, [own.seconds for own in found], rcond=None)[0]
    parameters, covariance = _refine(turnings, start, design)
    variances = np.diagonal(design @ covariance @ design.T)
    stds = np.hypot(np.sqrt(variances), _FORM)
    each = zip(found, design @ parameters, stds, strict=True)
    refined = [own._replace(seconds=seconds, std=std) for own, seconds, std in each]
    if count == 1:
        refined = [_find_rate(recordings[0], turnings[0], refined[0])]

    for (flight, *_), offset in zip(recordings, refined, strict=True):
        if not offset.is_sure():
            raise InputError(
                f"{flight.path}: the offset between the clocks of poses and elevator "
                f"was not found (they correlate by {offset.correlation:.2f} at best, "
                f"by {offset.elsewhere:.2f} elsewhere); expected 'clock: SECONDS' or "
                "'clock: same' in the mapping."
            )
    return refined


def _calc_turning(flights: Sequence[Track]) -> _Turning:
    """Differentiates the poses of flights of one recording, and makes the base of them.

    Where its elevator was not measured, the commanded angles stand for it.
    """
    servo = flights[0].servo
    elevator = servo.elevator or servo.angle_command
    assert elevator is not None
    motions = [calc_motion(flight.time, planar_pose(flight)) for flight in flights]
    motion = Motions(tuple(motions)).joined

    vx, vz, pitch_rate = motion.velocity.T
    speed = motion.speed
    square = speed**2
    alpha = np.arctan2(-vz, vx) - motion.pose[:, 2]
    across = square * np.sin(alpha)
    along = square * np.cos(alpha)
    base = np.stack([np.ones_like(speed), across, along, speed * pitch_rate], axis=1)
    return _Turning(
        elevator, motion.time, square, alpha, base, target=motion.acceleration[:, 2]
    )


def _search_each(turnings: Sequence[_Turning]) -> list[Offset]:
    """Searches the offset of each recording, with an effect that is common to all.

    Alone, a short flight fits well at several offsets, with another effect at each.
    """
    found = [_search([turning]) for turning in turnings]
    for _ in range(_ROUNDS):
        offsets = np.array([own.seconds for own in found])
        effect, _ = _fit(turnings, offsets)
        found = [_search([turning], effect) for turning in turnings]
    return found


def _find_rate(flights: Sequence[Track], whole: _Turning, common: Offset) -> Offset:
    """Adds the rate of a clock to its offset, where a session's flights show one.

    The offsets of flights by a clock that runs fast are on a line: one is fitted, and
    taken if its slope is significant and the signals then correlate better.

    Args:
        flights: of one recording, the session.
        whole: of all these flights.
        common: offset without a rate.
    """
    each = [_calc_turning([flight]) for flight in flights]
    turnings = [own for own in each if len(own.time) >= _FEWEST_ROWS]
    if len(turnings) < _FEWEST_FLIGHTS:
        return common

    middles = np.array([np.mean(turning.time) for turning in turnings])
    middle = np.mean(middles)
    line = np.column_stack([np.ones_like(middles), middles - middle])
    start = np.array([common.seconds, 0.0])
    (ahead, rate), covariance = _refine(turnings, start, line)
    std, rate_std = np.sqrt(np.diagonal(covariance))
    std = math.hypot(std, _FORM)
    drifting = common._replace(seconds=ahead, std=std, rate=rate, middle=middle)

    # On the poses' clock the log has no offset left.
    log = whole.elevator
    shifted = log._replace(time=drifting.on_poses(log.time))
    [correlation] = _correlate([whole._replace(elevator=shifted)], np.zeros(1))
    is_shown = abs(rate) > _SHOWN * rate_std and correlation > common.correlation
    return drifting._replace(correlation=correlation) if is_shown else common


def _search(turnings: Sequence[_Turning], effect: np.ndarray | None = None) -> Offset:
    """Finds the offset of the best correlation on a grid.

    Args:
        turnings: of recordings that have the same offset.
        effect: coefficients (5,) if they are known, see `_correlate`.

    Returns:
        The best offset; one without a correlation where there is no offset at which all
        recordings overlap with the logs of their servos.
    """
    first = max(own.elevator.time[0] - own.time[-1] for own in turnings)
    last = min(own.elevator.time[-1] - own.time[0] for own in turnings)
    offsets = np.arange(first, last + _STEP, _STEP)
    if not len(offsets):
        return Offset()
    correlations = _correlate(turnings, offsets, effect)
    best = np.argmax(correlations)
    is_far = np.abs(offsets - offsets[best]) > _NEAR
    elsewhere = np.max(correlations[is_far], initial=0.0)
    return Offset(offsets[best], correlations[best], elsewhere)


def _correlate(
    turnings: Sequence[_Turning], offsets: np.ndarray, effect: np.ndarray | None = None
) -> np.ndarray:
    """Correlates the pitch's acceleration and elevators at some offsets.

    The correlation R is that of the elevator with what the base does not explain:
        R² = 1 - |target - base - elevator|² / |target - best base alone|²
    for a known effect, or for the one that fits best at each offset.

    Args:
        turnings: of recordings that have the same offset.
        offsets: (m,) [s].
        effect: coefficients (5,) of base and elevator; None: those that fit best.

    Returns:
        Correlations (m,), 0 where the elevator explains nothing.
    """
    base = np.concatenate([turning.base for turning in turnings])
    target = np.concatenate([turning.target for turning in turnings])
    basis, _ = np.linalg.qr(base)
    alone = target - basis @ (basis.T @ target)
    power = max(alone @ alone, 1e-12)
    if effect is not None:
        alone = target - base @ effect[:-1]

    found = []
    for offset in offsets:
        column = np.concatenate([turning.column(offset) for turning in turnings])
        if effect is not None:
            gain = effect[-1]
        else:
            column -= basis @ (basis.T @ column)
            gain = column @ alone / max(column @ column, 1e-12)
        rest = alone - gain * column
        found.append(math.sqrt(max(0.0, 1.0 - rest @ rest / power)))
    return np.array(found)


def _fit(
    turnings: Sequence[_Turning], offsets: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Fits the effect that is common to recordings, each at an offset of its own.

    Args:
        turnings: of n recordings or flights.
        offsets: of each (n,) [s].

    Returns:
        The effect (5,), and the residual of the pitch acceleration (k,) [rad/s²].
    """
    pairs = zip(turnings, offsets, strict=True)
    column = np.concatenate([turning.column(offset) for turning, offset in pairs])
    base = np.concatenate([turning.base for turning in turnings])
    target = np.concatenate([turning.target for turning in turnings])
    columns = np.column_stack([base, column])
    effect = np.linalg.lstsq(columns, target, rcond=None)[0]
    return effect, target - columns @ effect


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
        return _fit(turnings, design @ parameters)[1]

    def slopes(parameters: np.ndarray) -> np.ndarray:
        """Central differences (k, m): each moves the offsets by `_STEP` at most."""
        steps = np.diag(_STEP / reach)
        changes = [rest(parameters + step) - rest(parameters - step) for step in steps]
        return np.transpose(changes) * reach / (2.0 * _STEP)

    found = least_squares(rest, start, slopes, x_scale=_STEP / reach)
    # Rows within the window of one cubic are not independent.
    dependent = max(SPAN / np.median(np.diff(turnings[0].time)), 1.0)
    variance = np.mean(found.fun**2) * dependent
    inverse = np.linalg.pinv(found.jac)
    return found.x, variance * inverse @ inverse.T
