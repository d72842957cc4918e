"""How do elevators follow their commands? Their delay, lag, sign and gain.

In windows of each flight the elevator's changes are compared with those of a servo
behind the commands,
    angle(t + window) - angle(t) = gain (path(t + window) - path(t)),
whose path has a delay and a lag. A grid of both is tried over all flights at once; the
correlation of the changes says whether the elevator follows, the delay whether both are
on one clock, and the gain whether they have one unit.

Whether and when an elevator follows is asked without a lag, over delays of up to 0.35 s
and with either sign (a turned sign is traced later): a delay, a lag or stops of the
servo lower the correlation; another clock or another flight's commands remove it. The
gain is asked with the delay and the lag together, so that a slow servo keeps it, under
feedback too, where commands answer its lag.
"""

import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from glider.campaign.checks.masks import Masks, masks_of
from glider.campaign.checks.motion import jackknife_error
from glider.campaign.checks.rates import claim_scale
from glider.campaign.logs import Campaign
from glider.errors import InputError
from glider.physics.servo import NO_LIMITS, STOPPING_TIME, Servo, elevator_path

_DELAYS = np.arange(-0.02, 0.355, 0.01)
"""Delays of the elevator that are tried [s]: command_delay and servo_lag are < 0.3."""
_SHIFTS = np.arange(-1.5, 1.51, 0.01)  # Between clocks, for the message [s].
_BOTH_WAYS = np.arange(-0.35, 0.3525, 0.005)  # Delays, to find which comes first [s].
_WINDOW = 0.04  # Time over which a change is taken [s].
_LEADS = 0.015
"""Lead above which an elevator moves before its commands [s]: no servo does. Measured:
-0.025 to 0.005 in 20 campaigns: half a row, as a command is held until the next."""
_AS_GOOD = 2.0
"""Ratio of what delays leave unexplained to what a lead does below which the elevator
may follow: 1.4 in a session under feedback, where a slow servo swings."""
_FOLLOWS = 0.4
"""Correlation of rates below which an elevator does not follow. Measured: 0.96 and more
for a servo without lag, 0.89 and 0.75 with lags of 0.1 and 0.3 s; 0.24 at most for
commands of another flight (20 campaigns, the best of all delays)."""
_MOVES = 0.03  # Least travel of an elevator that moves in any flight [rad].
_MIN_CHANGES = 15  # Least number of changes that show a correlation, or a gain.

_GAIN_DELAYS = np.arange(-0.02, 0.355, 0.02)
"""Delays that are tried for the gain [s]."""
_GAIN_LAGS = np.array([0.0, 0.01, 0.02, 0.04, 0.06, 0.09, 0.13, 0.19, 0.28, 0.4])
"""Lags that are tried [s]: servo_lag is < 0.3; with the last the gain is unknown."""
_FINER = np.linspace(-1.0, 1.0, 9)  # Between the best of these and their neighbors.
_GAIN_WINDOW = 0.1  # Time over which changes are taken for the gain [s].
_TRAVEL = (0.06, 0.2)
"""Share by which the travel may be off; calibrated by bench_travel."""
_SURELY = 6.0  # Standard errors of the gain that must be in it.
_FEWEST_PARTS = 8
"""Parts that a jackknife is over, at least: of fewer flights, parts of flights."""
_SCATTER = 0.05
"""Standard deviation of the gain of one flight, as logs show commands a row late or not
[-]: measured by bench_travel."""


class Elevator(NamedTuple):
    """The elevator of one flight, and the commands that are known.

    Where gaps hide commands, both are those of one piece of the flight.
    """

    name: str  #: Name of the flight.
    time: np.ndarray  #: (k,) of the angles [s].
    angle: np.ndarray  #: (k,) [rad]
    command_time: np.ndarray  #: (n,) of the commands; each row has a new one [s].
    command: np.ndarray  #: (n,) [rad/s]

    @property
    def travel(self) -> float:
        """Range of its angles [rad]; 0 without any."""
        return float(np.ptp(self.angle)) if len(self.angle) else 0.0

    @property
    def ordered_travel(self) -> float:
        """Range of the angles that the commands ask for [rad]."""
        return float(np.ptp(self.follow(self.command_time)))

    def follow(
        self, query: np.ndarray, servo: Servo = NO_LIMITS, lag: float = 0.0
    ) -> np.ndarray:
        """Angles of a servo with a lag [s] behind the commands, at any times [rad]."""
        tape = self.command_time, self.command
        start = float(self.angle[0]) if len(self.angle) else 0.0
        return elevator_path(*tape, query, servo, time_constant=lag, start=start)

    def changes(self, window: float = _WINDOW) -> tuple[np.ndarray, np.ndarray]:
        """Ends (2, k) of windows [s], and by how much the angle changes (k,)."""
        return changes_of(self.time, self.angle, window)


def measure_elevators(
    campaign: Campaign, masks: Mapping[str, Masks]
) -> tuple[Elevator, ...]:
    """Elevators of a campaign's flights; none without a servo."""
    elevators = []
    for flight in campaign.flights if campaign.elevator == "servo" else ():
        assert flight.elevator is not None and flight.command is not None
        mask = masks_of(flight, masks)
        rows = ~(mask.elevator | mask.beyond)
        piece = slice(mask.first, mask.last)
        elevator = Elevator(
            name=flight.name,
            time=flight.time[rows],
            angle=flight.elevator[rows],
            command_time=flight.time[piece],
            command=flight.command[piece],
        )
        elevators.append(elevator)
    return tuple(elevators)


def changes_of(
    time: np.ndarray, angle: np.ndarray, window: float = _WINDOW
) -> tuple[np.ndarray, np.ndarray]:
    """Ends (2, k) of windows in a log (n,) [s], and by how much an angle changes."""
    begin = np.arange(time[0], time[-1] - window, 0.5 * _WINDOW)
    ends = np.stack([begin, begin + window])
    return ends, np.diff(np.interp(ends, time, angle), axis=0)[0]


def check_follows(campaign: Campaign, elevators: Sequence[Elevator]) -> None:
    """Refuses an elevator that does not follow its commands, or precedes them."""
    if not elevators:
        return
    commanded = max(elevator.ordered_travel for elevator in elevators)
    moved = max(elevator.travel for elevator in elevators)
    if commanded < _MOVES and moved < _MOVES:
        return
    if min(moved, commanded) < _MOVES:
        raise InputError(
            f"{campaign.path}: column 'elevator' moves by {moved:.2g} rad at most, and "
            f"'elevator_rate_command' would move it by {commanded:.2g} rad; expected "
            "its measured angle, and the commands that were given."
        )
    servo = campaign.limits
    ahead, delay = calc_correlation(elevators, _BOTH_WAYS, servo=servo)
    correlation = ahead
    if -delay > _LEADS:
        correlation, _ = calc_correlation(elevators, servo=servo)
    follows = abs(correlation)
    if follows < _FOLLOWS:
        shifted, shift = calc_correlation(elevators, _SHIFTS)
        hint = ""
        if abs(shifted) > 2 * _FOLLOWS:
            hint = f"; shifted by {shift:.2f} s they do"
        raise InputError(
            f"{campaign.path}: column 'elevator' does not follow "
            f"'elevator_rate_command' (their rates correlate by {follows:.2f} at any "
            f"delay up to {_DELAYS[-1]:.2g} s{hint}); expected both on the clock of "
            "'time'."
        )
    # Under feedback a slow servo swings: a period before, and turned half a period
    # before, commands explain it about as well.
    is_clear = 1.0 - correlation**2 > _AS_GOOD * (1.0 - ahead**2)
    if -delay > _LEADS and is_clear:
        raise InputError(
            f"{campaign.path}: column 'elevator' moves {-delay:.3f} s before "
            "'elevator_rate_command'; expected both on the clock of 'time'."
        )


def follow_sign(elevators: Sequence[Elevator]) -> int:
    """-1 where elevators clearly turn against their commands, else +1."""
    return -1 if calc_correlation(elevators)[0] < -_FOLLOWS else 1


def calc_correlation(
    elevators: Sequence[Elevator],
    delays: np.ndarray = _DELAYS,
    servo: Servo = NO_LIMITS,
) -> tuple[float, float]:
    """Best correlation of elevators with commands, -1 to 1, and its delay [s].

    Where an elevator slows down before a stop of the servo, it follows no command. Both
    are nan where too few changes are known to judge: no comparison with them holds.
    """
    parts = [_compare(elevator, delays, stops=servo) for elevator in elevators]
    if not parts:
        return math.nan, math.nan
    sums = np.concatenate(parts, axis=-1).sum(axis=-1)
    turned, together, ordered, count = sums[:, :, 0]
    correlation = together / np.sqrt(np.maximum(turned * ordered, 1e-30))
    size = np.abs(correlation)
    best = int(np.argmax(np.where(count < _MIN_CHANGES, -np.inf, size)))
    if count[best] < _MIN_CHANGES:
        return math.nan, math.nan
    return float(correlation[best]), float(delays[best])


def _compare(
    elevator: Elevator,
    delays: np.ndarray,
    lags: Sequence[float] = (0.0,),
    servo: Servo = NO_LIMITS,
    *,
    stops: Servo | None = None,
    window: float = _WINDOW,
) -> np.ndarray:
    """Compares changes of an elevator with those of servos, (4, delays, lags, k).

    Squared changes of the elevator, products with a servo's, its squares, and 1. All
    are 0 where commands are not known, or near a stop if the stops are given. What a
    servo with a lag does since before the log fades away; it is left out.
    """
    if len(elevator.time) < 2:
        return np.zeros((4, len(delays), len(lags), 0))
    ends, change = elevator.changes(window)
    time = elevator.command_time
    since = ends - time[0]
    after = np.clip(np.searchsorted(time, ends), 1, len(time) - 1)
    share = (ends - time[after - 1]) / (time[after] - time[after - 1])
    terms = np.empty((4, len(delays), len(lags), len(change)))
    for k, lag in enumerate(lags):
        fading = -np.diff(np.exp(-since / max(lag, 1e-3)), axis=0)[0]
        fading /= np.linalg.norm(fading) + 1e-30
        own = change - fading @ change * fading
        path = elevator.follow(time - delays[:, None], servo, lag)
        # Between rows, as the log has them: a path that turns there counts less.
        shown = path[:, after - 1]
        shown += share * (path[:, after] - shown)
        ordered = shown[:, 1] - shown[:, 0]
        ordered -= np.outer(ordered @ fading, fading)
        terms[0, :, k] = own**2
        terms[1, :, k] = own * ordered
        terms[2, :, k] = ordered**2
        terms[3, :, k] = 1.0
    if stops is not None:
        late = delays[:, None]
        is_known = (ends[0] - late >= time[0]) & (ends[1] - late <= time[-1])
        slowing = STOPPING_TIME * stops.rate if math.isfinite(stops.rate) else 0.0
        angles = np.interp(ends, elevator.time, elevator.angle)
        is_near = (angles < stops.low + slowing) | (angles > stops.high - slowing)
        is_known &= ~is_near.any(axis=0)
        terms *= is_known[:, None, :]
    return terms


def check_travel(campaign: Campaign, elevators: Sequence[Elevator]) -> tuple[str, ...]:
    """Warns of an elevator that turns farther or less than commanded, or refuses it.

    An elevator in another unit, or behind a gear, turns all commands into other forces.
    """
    if not elevators:
        return ()
    gain, error = _calc_travel(elevators, campaign.limits)
    words = (
        f"the elevator turns {gain:.3g} times as far as commanded: expected one scale "
        "of 'elevator' and its command ('units:', or the servo's gearing as a gain)"
    )
    gain = max(gain, 1e-9)
    return claim_scale(campaign, gain, _SURELY * error / gain, _TRAVEL, words)


def _calc_travel(
    elevators: Sequence[Elevator], servo: Servo = NO_LIMITS
) -> tuple[float, float]:
    """Measured over commanded travel without its sign, and its standard error.

    Least squares over all flights. The servo keeps its limits, or none if that fits
    better: those of commands in another unit are others. The error is that of a
    jackknife over flights, and what logs scatter by; it is infinite if the lag is too
    long.
    """
    shown = [elevator for elevator in elevators if len(elevator.time) > _FEWEST_PARTS]
    if not shown:
        return 0.0, math.inf
    fits = {}
    for one in (servo, NO_LIMITS):
        fits[one] = _find_best(_sum_parts(shown, one, _GAIN_DELAYS, _GAIN_LAGS))
    servo = min(fits, key=lambda one: fits[one].left)
    best = fits[servo]
    is_longest = best.lag == len(_GAIN_LAGS) - 1
    lags = np.interp(best.lag + _FINER, np.arange(len(_GAIN_LAGS)), _GAIN_LAGS)
    delays = np.interp(best.delay + _FINER, np.arange(len(_GAIN_DELAYS)), _GAIN_DELAYS)
    sums = _sum_parts(shown, servo, np.unique(delays), np.unique(lags))
    best = _find_best(sums)
    others = [_find_best(np.delete(sums, k, axis=0)).gain for k in range(len(sums))]
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


def _sum_parts(
    elevators: Sequence[Elevator], servo: Servo, delays: np.ndarray, lags: np.ndarray
) -> np.ndarray:
    """Sums of `_compare` (parts, 4, delays, lags) over flights, or parts of few."""
    parts = math.ceil(_FEWEST_PARTS / len(elevators))
    sums = []
    for elevator in elevators:
        terms = _compare(elevator, delays, list(lags), servo, window=_GAIN_WINDOW)
        starts = np.arange(1, parts) * terms.shape[-1] // parts
        sums += [part.sum(axis=-1) for part in np.split(terms, starts, axis=-1)]
    return np.array(sums)
