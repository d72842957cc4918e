"""How do elevators follow their commands? Their delay, sign and gain.

In windows of each flight the elevator's changes are compared with those of a servo
behind the commands,
    angle(t + window) - angle(t) = path(t + window) - path(t),
whose path has a delay of up to 0.35 s. The correlation of the changes over all flights,
with either sign (a turned sign is traced later), says whether the elevator follows, and
the delay whether both are on one clock: a delay, a lag or stops of the servo lower the
correlation; another clock or another flight's commands remove it.

The gain, by which the angles say whether both have one unit, is fitted with a delay and
a lag, so that a slow servo keeps it, under feedback too, where commands answer its lag.
"""

import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from scipy.optimize import brute

from glider.campaign.checks.masks import Masks, masks_of
from glider.campaign.checks.rates import claim_scale
from glider.campaign.logs import Campaign, Flight
from glider.compiled.actuators import LOOPS, elevator_path
from glider.errors import InputError
from glider.physics.held_commands import command_steps
from glider.physics.servo import NO_LIMITS, STOPPING_TIME, Servo

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

_TRIED = slice(-0.02, 0.355, 0.03), slice(0.003, 0.4, 0.04)
"""Delays and lags that are tried for the gain [s]: command_delay and servo_lag are less
than 0.3 s."""
_FEW = 8  # Flights that show a delay and a lag, about.
_LONGEST_LAG = 0.36  # Lag above which the gain of a servo is unknown [s].
_TRAVEL = (0.06, 0.2)
"""Share by which the travel may be off; calibrated by bench_travel."""
_SURELY = 5.0  # Standard errors of the gain that must be in it (bench_travel).
_FEWEST_ROWS = 8  # Of a flight that shows a gain.
_SCATTER = 0.065
"""Standard deviation of the gain of one flight, as logs show commands a row late or not
[-]: measured by bench_travel."""


class CommandTape(NamedTuple):
    """The held commands of a flight, from its first row whose commands are known."""

    switches: np.ndarray  #: (k,) when each begins [s].
    commands: np.ndarray  #: (k,) [rad/s]
    rest: float  #: Angle of the elevator before the first [rad].


def command_tape(
    flight: Flight, mask: Masks, switch_rate: float | None, begin: float = 0.0
) -> CommandTape:
    """Returns when commands switch [s], counted from `begin`, and to what."""
    assert flight.command is not None and flight.elevator is not None
    # What was commanded before a gap that hides commands does not count.
    rows = np.arange(mask.first, len(flight.time))
    time = flight.time - begin
    since = flight.command_time
    if since is not None:
        since = (since - begin)[rows]
    tape = command_steps(time[rows], flight.command[rows], switch_rate, since)
    seen = rows[~mask.elevator[rows]]
    if not len(seen):
        return CommandTape(*tape, 0.0)
    first = seen[0]  # Its noise is what x[3] is for.
    [travel] = elevator_path(*tape, time[[first]])
    return CommandTape(*tape, float(flight.elevator[first] - travel))


class LateServo(NamedTuple):
    """A servo that elevators may follow; loads are over the largest of a campaign."""

    limits: Servo = NO_LIMITS
    delay: float = 0.0  #: [s]
    lag: float = 0.0  #: Mean of turning up and down, without load [s].
    skew: float = 0.0  #: Half the difference of both, over their mean.
    lag_by_load: float = 0.0  #: That the largest load adds [s].
    rate_by_load: float = 0.0  #: Share of the rate limit that it takes.
    play: float = 0.0  #: Free, of the elevator behind the servo [rad].
    slew: float = math.inf  #: Largest rate of coming after the commands [rad/s].

    @property
    def even(self) -> "LateServo":
        """The same without what makes it uneven."""
        return LateServo(*self[:3])


_UNLIMITED = LateServo()


class Elevator(NamedTuple):
    """The measured elevator of a flight, and the commands that it may follow.

    Where gaps hide commands, both are those of one piece of the flight.
    """

    name: str  #: Name of the flight.
    time: np.ndarray  #: (n,) of the rows of the piece [s].
    rows: np.ndarray  #: (m,) those that count.
    angle: np.ndarray  #: (m,) measured there [rad].
    tape: CommandTape
    load: np.ndarray = np.zeros(1)  #: (n,) or (1,) at the rows, the largest is 1.

    @property
    def seen(self) -> np.ndarray:
        """Times (m,) of the angles [s]."""
        return self.time[self.rows]

    def follow(
        self,
        query: np.ndarray,
        servo: LateServo = _UNLIMITED,
        rest: float | None = None,
    ) -> np.ndarray:
        """Angles of a servo behind the commands, at any times [rad].

        It began at `rest`, or at the angle of the tape. For an uneven servo the times
        increase.
        """
        tape = self.tape
        start = tape.rest if rest is None else rest
        lag = servo.lag
        if servo != servo.even:
            uneven = servo[4:]
            lags = (lag * (1.0 + servo.skew), lag * (1.0 - servo.skew))
            start = float(min(max(start, servo.limits.low), servo.limits.high))
            path = np.empty(len(query))
            begins = tape.switches + servo.delay
            loads = self.time[: len(self.load)], self.load
            form = (*lags, *uneven)
            given = begins, tape.commands, query, servo.limits, form, *loads
            LOOPS.over(()).uneven_path(*given, start, path)
            return path
        return elevator_path(
            tape.switches,
            tape.commands,
            query,
            servo.limits,
            delay=servo.delay,
            time_constant=lag,
            start=start,
        )


def measure_elevators(
    campaign: Campaign, masks: Mapping[str, Masks], *, at_rows: bool = True
) -> list[Elevator]:
    """Elevators of a campaign's flights; none without a servo.

    Commands begin at the rows that show them first, or where a clock gave them.
    """
    elevators = []
    for flight in campaign.flights if campaign.elevator == "servo" else ():
        assert flight.elevator is not None and flight.command is not None
        mask = masks_of(flight, masks)
        piece = slice(mask.first, mask.last)
        time = flight.time[piece]
        rows = np.flatnonzero(~mask.elevator[piece])
        angle = flight.elevator[piece][rows]
        if at_rows:
            rest = float(angle[0]) if len(angle) else 0.0
            tape = CommandTape(time, flight.command[piece], rest)
        else:
            tape = command_tape(flight, mask, campaign.switch_rate)
        elevators.append(Elevator(flight.name, time, rows, angle, tape))
    return elevators


def _changes_of(time: np.ndarray, angle: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Ends (2, k) of windows in a log (n,) [s], and by how much an angle changes."""
    begin = np.arange(time[0], time[-1] - _WINDOW, 0.5 * _WINDOW)
    ends = np.stack([begin, begin + _WINDOW])
    return ends, np.diff(np.interp(ends, time, angle), axis=0)[0]


def check_follows(campaign: Campaign, elevators: Sequence[Elevator]) -> None:
    """Refuses an elevator that does not follow its commands, or precedes them."""
    if not elevators:
        return
    commanded = max(float(np.ptp(each.follow(each.time))) for each in elevators)
    moved = max(float(np.ptp(each.angle)) for each in elevators if len(each.angle))
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
    if not elevators:
        return math.nan, math.nan
    sums = [np.sum(_compare(own, delays, servo), axis=-1) for own in elevators]
    turned, together, ordered, count = np.sum(sums, axis=0)
    correlation = together / np.sqrt(np.maximum(turned * ordered, 1e-30))
    size = np.abs(correlation)
    best = int(np.argmax(np.where(count < _MIN_CHANGES, -np.inf, size)))
    if count[best] < _MIN_CHANGES:
        return math.nan, math.nan
    return float(correlation[best]), float(delays[best])


def _compare(elevator: Elevator, delays: np.ndarray, stops: Servo) -> np.ndarray:
    """Compares changes of an elevator with the commanded ones, (4, delays, k).

    Squared changes of the elevator, products with the commanded ones, squares of these,
    and 1. All are 0 where commands are not known, or near a stop.
    """
    if len(elevator.rows) < 2:
        return np.zeros((4, len(delays), 0))
    ends, change = _changes_of(elevator.seen, elevator.angle)
    time = elevator.time
    after = np.clip(np.searchsorted(time, ends), 1, len(time) - 1)
    share = (ends - time[after - 1]) / (time[after] - time[after - 1])
    late = delays[:, None]
    path = elevator.follow(time - late)
    # Between rows, as the log has them: a path that turns there counts less.
    shown = path[:, after - 1]
    shown += share * (path[:, after] - shown)
    ordered = shown[:, 1] - shown[:, 0]
    is_known = (ends[0] - late >= time[0]) & (ends[1] - late <= time[-1])
    slowing = STOPPING_TIME * stops.rate if math.isfinite(stops.rate) else 0.0
    angles = np.interp(ends, elevator.seen, elevator.angle)
    is_near = (angles < stops.low + slowing) | (angles > stops.high - slowing)
    is_known &= ~is_near.any(axis=0)
    one = np.ones_like(ordered)
    return np.stack([one * change**2, ordered * change, ordered**2, one]) * is_known


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
    elevators: Sequence[Elevator], limits: Servo = NO_LIMITS
) -> tuple[float, float]:
    """Measured over commanded travel without its sign, and its standard error.

    Least squares over all flights, of a delay and a lag that fit a few of them. The
    servo keeps its limits, or none if that fits better, as those of commands in another
    unit are others. The limits that elevators reach excuse a gain that is not one, if
    they fit better. The error is what flights scatter by; it is infinite if the lag is
    too long.
    """
    shown = [elevator for elevator in elevators if len(elevator.rows) > _FEWEST_ROWS]
    if not shown:
        return 0.0, math.inf
    few = shown[:: max(1, len(shown) // _FEW)]
    fits = []
    for own in (limits, NO_LIMITS, _reached(few)):

        def left(late: np.ndarray, own: Servo = own) -> float:
            return _compare_travel(few, _late_servo(own, late))[0]

        servo = _late_servo(own, brute(left, _TRIED))
        fits.append((*_compare_travel(shown, servo), servo.lag))
    excuse = fits.pop()
    least, gain, lag = min(fits)
    if excuse[0] < least and abs(excuse[1] - 1.0) < abs(gain - 1.0):
        _, gain, lag = excuse
    error = _SCATTER / math.sqrt(len(shown))
    if lag > _LONGEST_LAG and gain <= 1.0:
        error = math.inf
    return gain, error


def _reached(elevators: Sequence[Elevator]) -> Servo:
    """Limits that elevators reach: where they end, and how fast they turn."""
    angles = np.concatenate([each.angle for each in elevators])
    changes = [_changes_of(each.seen, each.angle)[1] for each in elevators]
    fastest = float(np.max(np.abs(np.concatenate(changes)))) / _WINDOW
    return Servo(float(np.min(angles)), float(np.max(angles)), fastest)


def _late_servo(limits: Servo, late: np.ndarray) -> LateServo:
    """A servo with a delay and a lag (2,) [s]."""
    return LateServo(limits, float(late[0]), abs(float(late[1])))


def _compare_travel(
    elevators: Sequence[Elevator], servo: LateServo
) -> tuple[float, float]:
    """Squares that a servo leaves of elevators [rad²], and their gain over its path."""
    measured = []
    paths = []
    for elevator in elevators:
        path = elevator.follow(elevator.seen, servo)
        measured.append(elevator.angle - np.mean(elevator.angle))
        paths.append(path - np.mean(path))
    angle = np.concatenate(measured)
    path = np.concatenate(paths)
    gain = float(angle @ path) / max(float(path @ path), 1e-30)
    left = float(np.sum((angle - gain * path) ** 2))
    return left, abs(gain)
