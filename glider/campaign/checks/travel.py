"""Do elevators turn as far as commanded?

An elevator in another unit, or behind a gear, turns all commands into other forces. Its
changes are fitted by those of a servo: gain, delay and first-order lag, together. So a
servo that is slow keeps its gain, under feedback too, where commands answer its lag.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from glider.campaign.checks.clocks import NOISES, claim_scale
from glider.campaign.checks.elevators import Elevator, mean_rates
from glider.campaign.checks.motion import jackknife_error
from glider.campaign.logs import Campaign
from glider.physics.servo import NO_LIMITS, Servo

_DELAYS = np.arange(-0.02, 0.355, 0.02)
"""Delays that are tried [s]: command_delay is < 0.3."""
_LAGS = np.array([0.0, 0.01, 0.02, 0.04, 0.06, 0.09, 0.13, 0.19, 0.28, 0.4])
"""Lags that are tried [s]: servo_lag is < 0.3; with the last the gain is unknown."""
_FINER = np.linspace(-1.0, 1.0, 9)  # Between the best of these and their neighbors.
_TRAVEL = 0.06, 0.2
"""Part by which the travel may be off; calibrated by bench_travel."""
_FEWEST = 8
"""Parts that a jackknife is over, at least: of fewer flights, parts of flights."""
_WINDOW = 0.1  # Time over which changes are taken [s].
_SCATTER = 0.05
"""Standard deviation of the gain of one flight, as logs show commands a row late or not
[-]: measured by bench_travel."""
_MIN_CHANGES = 15  # Changes that a gain is taken from, at least.


def check_travel(campaign: Campaign, elevators: Sequence[Elevator]) -> tuple[str, ...]:
    """Warns of an elevator that turns farther or less than commanded, or refuses it."""
    if not elevators:
        return ()
    gain, error = calc_travel(elevators, campaign.limits)
    words = (
        f"the elevator turns {gain:.3g} times as far as commanded: expected one scale "
        "of 'elevator' and its command ('units:', or the servo's gearing as a gain)"
    )
    gain = max(gain, 1e-9)
    return claim_scale(campaign, gain, NOISES * error / gain, _TRAVEL, words)


def calc_travel(
    elevators: Sequence[Elevator], servo: Servo = NO_LIMITS
) -> tuple[float, float]:
    """Measured over commanded travel without its sign, and its standard error.

    Least squares over all flights. The servo keeps its limits, or none if that fits
    better: those of commands in another unit are others. The error is that of a
    jackknife over flights, and what logs scatter by; it is infinite if the lag is too
    long.
    """
    shown = [elevator for elevator in elevators if len(elevator.time) > _FEWEST]
    if not shown:
        return 0.0, np.inf
    best = None
    for one in dict.fromkeys([servo, NO_LIMITS]):
        fit = _find_best(_sums(shown, one, _DELAYS, _LAGS))
        if best is None or fit.left < best.left:
            best = fit
            servo = one
    assert best is not None
    is_longest = best.lag == len(_LAGS) - 1
    lags = np.interp(best.lag + _FINER, np.arange(len(_LAGS)), _LAGS)
    delays = np.interp(best.delay + _FINER, np.arange(len(_DELAYS)), _DELAYS)
    sums = _sums(shown, servo, np.unique(delays), np.unique(lags))
    best = _find_best(sums)
    others = []
    for k in range(len(sums)):
        others.append(_find_best(np.delete(sums, k, axis=0)).gain)
    error = math.hypot(jackknife_error(others), _SCATTER / math.sqrt(len(shown)))
    if best.changes <= _MIN_CHANGES or (is_longest and abs(best.gain) <= 1.0):
        error = math.inf
    return abs(best.gain), error


class _Best(NamedTuple):
    """The delay and lag of a servo that leave least unexplained."""

    delay: int  #: Row of the delays.
    lag: int  #: Row of the lags.
    gain: float  #: Measured over commanded travel.
    left: float  #: Sum of squares that is left [rad²].
    changes: float  #: Number of them.


def _find_best(sums: np.ndarray) -> _Best:
    """The best fit by sums (parts, 4, delays, lags)."""
    square, product, power, count = np.sum(sums, axis=0)
    left = square - product**2 / np.maximum(power, 1e-30)
    delay, lag = np.unravel_index(np.argmin(left), left.shape)
    at = int(delay), int(lag)
    gain = product[at] / max(power[at], 1e-30)
    return _Best(*at, float(gain), float(left[at]), float(count[at]))


def _sums(
    elevators: Sequence[Elevator], servo: Servo, delays: np.ndarray, lags: np.ndarray
) -> np.ndarray:
    """Sums (parts, 4, delays, lags) over flights, or over parts of few flights.

    Of squared changes of the elevator, of products with a servo's, of its squares, and
    their number.

    A servo may turn at the start, because of earlier commands: that part of a change,
    which fades as exp(-t / lag), is taken out of both.
    """
    parts = math.ceil(_FEWEST / len(elevators))
    found = []
    for elevator in elevators:
        ends, change = mean_rates(elevator.time, elevator.angle, _WINDOW)
        time = elevator.command_time
        late = time - delays[:, None]
        since = ends - time[0]
        starts = np.arange(1, parts) * len(change) // parts
        terms = np.empty((4, len(delays), len(lags), len(change)))
        for k, lag in enumerate(lags):
            fading = -np.diff(np.exp(-since / max(lag, 1e-3)), axis=0)[0]
            fading /= np.linalg.norm(fading) + 1e-30
            own = change - fading @ change * fading
            paths = elevator.follow(late, servo, lag)
            # Between rows, as the log has them: a path that turns there counts less.
            turned = np.array([np.interp(ends, time, path) for path in paths])
            turned = turned[:, 1] - turned[:, 0]
            turned -= np.outer(turned @ fading, fading)
            terms[0, :, k] = own**2
            terms[1, :, k] = own * turned
            terms[2, :, k] = turned**2
            terms[3, :, k] = 1.0
        found += [part.sum(axis=-1) for part in np.split(terms, starts, axis=-1)]
    return np.array(found)
