"""Do elevators turn as far as commanded?

An elevator in another unit, or behind a gear, turns all commands into other forces. Its
changes are fitted by those of a servo: gain, delay and first-order lag, together. So a
servo that is slow keeps its gain, under feedback too, where commands answer its lag.
"""

import math
from collections.abc import Mapping, Sequence

import numpy as np

from glider.campaign.checks.clocks import (
    NOISES,
    claim_scale,
    follow_commands,
    known_angles,
    known_commands,
    mean_rates,
)
from glider.campaign.checks.masks import Masks
from glider.campaign.logs import Campaign, Flight
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


def check_travel(campaign: Campaign, masks: Mapping[str, Masks]) -> tuple[str, ...]:
    """Warns of an elevator that turns farther or less than commanded, or refuses it."""
    if campaign.elevator != "servo":
        return ()
    gain, error = calc_travel(campaign.flights, masks, campaign.limits)
    words = (
        f"the elevator turns {gain:.3g} times as far as commanded: expected one scale "
        "of 'elevator' and its command ('units:', or the servo's gearing as a gain)"
    )
    gain = max(gain, 1e-9)
    return claim_scale(campaign, gain, NOISES * error / gain, _TRAVEL, words)


def calc_travel(
    flights: Sequence[Flight], masks: Mapping[str, Masks], servo: Servo = NO_LIMITS
) -> tuple[float, float]:
    """Measured over commanded travel without its sign, and its standard error.

    Least squares over all flights. The servo keeps its limits, or none if that fits
    better: those of commands in another unit are others. The error is that of a
    jackknife over flights, and what logs scatter by; it is infinite if the lag is too
    long.
    """
    flights = [f for f in flights if len(known_angles(f, masks)[0]) > _FEWEST]
    if not flights:
        return 0.0, np.inf
    found = []
    for one in dict.fromkeys([servo, NO_LIMITS]):
        sums = _sums(flights, masks, one, _DELAYS, _LAGS)
        at, _ = _find_best(sums)
        found.append((_unexplained(sums)[at], one, at))
    _, servo, (first, second) = min(found, key=lambda fit: fit[0])
    lags = np.interp(second + _FINER, np.arange(len(_LAGS)), _LAGS)
    delays = np.interp(first + _FINER, np.arange(len(_DELAYS)), _DELAYS)
    sums = _sums(flights, masks, servo, np.unique(delays), np.unique(lags))
    best, gain = _find_best(sums)
    changes = float(np.sum(sums, axis=0)[(3, *best)])
    parts = np.arange(len(sums))
    others = [_find_best(sums[parts != k])[1] for k in parts]
    spread = np.std(others) * np.sqrt(len(parts) - 1.0)
    error = math.hypot(spread, _SCATTER / math.sqrt(len(flights)))
    is_known = changes > _MIN_CHANGES and (second < len(_LAGS) - 1 or abs(gain) > 1.0)
    return abs(gain), float(error) if is_known else np.inf


def _find_best(sums: np.ndarray) -> tuple[tuple[int, int], float]:
    """Rows of the best delay and lag in sums (parts, 4, ...), and the gain."""
    _, product, power, _ = np.sum(sums, axis=0)
    first, second = np.unravel_index(np.argmin(_unexplained(sums)), power.shape)
    at = int(first), int(second)
    return at, float(product[at] / max(power[at], 1e-30))


def _unexplained(sums: np.ndarray) -> np.ndarray:
    """Sum of squares (delays, lags) that a servo with the best gain leaves."""
    square, product, power, _ = np.sum(sums, axis=0)
    return square - product**2 / np.maximum(power, 1e-30)


def _sums(
    flights: Sequence[Flight],
    masks: Mapping[str, Masks],
    servo: Servo,
    delays: np.ndarray,
    lags: np.ndarray,
) -> np.ndarray:
    """Sums (parts, 4, delays, lags) over flights, or over parts of few flights.

    Of squared changes of the elevator, of products with a servo's, of its squares, and
    their number.

    A servo may turn at the start, because of earlier commands: that part of a change,
    which fades as exp(-t / lag), is taken out of both.
    """
    parts = math.ceil(_FEWEST / len(flights))
    sums = np.zeros((len(flights), parts, 4, len(delays), len(lags)))
    for flight, found in zip(flights, sums, strict=True):
        ends, change = mean_rates(*known_angles(flight, masks), _WINDOW)
        if len(change) < parts:
            continue
        rows = known_commands(flight, masks)
        time = flight.time[rows]
        late = time - delays[:, None]
        paths = [follow_commands(flight, masks, late, servo, lag) for lag in lags]
        path = np.stack(paths, axis=1)  # (delays, lags, rows)
        place = np.interp(ends, time, np.arange(len(time)))
        before = np.minimum(place.astype(int), len(time) - 2)
        share = place - before
        at = path[..., before] * (1.0 - share) + path[..., before + 1] * share
        turned = at[..., 1, :] - at[..., 0, :]  # (delays, lags, changes)
        since = (ends - time[0]) / np.maximum(lags, 1e-3)[:, None, None]
        fading = np.exp(-since[:, 0]) - np.exp(-since[:, 1])
        fading /= np.sqrt(np.sum(fading**2, axis=1, keepdims=True)) + 1e-30
        own = change - (fading @ change)[:, None] * fading  # (lags, changes)
        turned -= np.einsum("dlk,lk->dl", turned, fading)[..., None] * fading
        terms = np.broadcast_arrays(own**2, own * turned, turned**2, 1.0)
        starts = np.arange(parts) * len(change) // parts
        found[:] = np.moveaxis(np.add.reduceat(np.stack(terms), starts, axis=-1), -1, 0)
    return sums.reshape(-1, *sums.shape[2:])
