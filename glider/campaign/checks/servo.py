"""How do elevators follow their commands? Their delay, sign and gain.

In windows of each flight the elevator's changes are compared with those of a servo
behind the commands,
    angle(t + window) - angle(t) = path(t + window) - path(t),
whose path has a delay of up to 0.35 s. The correlation of the changes over all flights,
with either sign (a turned sign is traced later), says whether the elevator follows, and
the delay whether both are on one clock: a delay, a lag or stops of the servo lower the
correlation; another clock or another flight's commands remove it.
"""

import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from glider.campaign.checks.masks import Masks, masks_of
from glider.campaign.logs import Campaign, Flight
from glider.compiled.actuators import LOOPS, elevator_path
from glider.physics.held_commands import command_steps
from glider.physics.servo import NO_LIMITS, STOPPING_TIME, Servo

_DELAYS = np.arange(-0.02, 0.355, 0.01)
"""Delays of the elevator that are tried [s]: command_delay and servo_lag are < 0.3."""
_SHIFTS = np.arange(-1.5, 1.51, 0.01)  # Between clocks, for the message [s].
_BOTH_WAYS = np.arange(-0.35, 0.3525, 0.005)  # Delays, to find which comes first [s].
WINDOW = 0.04  # Time over which a change is taken [s].
_LEADS = 0.015
"""Lead above which an elevator moves before its commands [s]: no servo does. Measured:
-0.03 to 0 in 20 campaigns; without a clock of the commands half a row is unknown."""
_AS_GOOD = 2.0
"""Ratio of what delays leave unexplained to what a lead does below which the elevator
may follow: 1.4 in a session under feedback, where a slow servo swings."""
_FOLLOWS = 0.4
"""Correlation of rates below which an elevator does not follow. Measured: 0.96 and more
for a servo without lag, 0.89 and 0.75 with lags of 0.1 and 0.3 s; 0.24 at most for
commands of another flight (20 campaigns, the best of all delays)."""
_MOVES = 0.03  # Least travel of an elevator that moves in any flight [rad].
_MIN_CHANGES = 15  # Least number of changes that show a correlation.


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
    piece = slice(mask.first, None)
    time = flight.time[piece] - begin
    since = flight.command_time
    if since is not None:
        since = since[piece] - begin
    tape = command_steps(time, flight.command[piece], switch_rate, since)
    seen = np.flatnonzero(~mask.elevator[piece])[:1]  # Its noise is what x[3] is for.
    rest = flight.elevator[piece][seen] - elevator_path(*tape, time[seen])
    return CommandTape(*tape, float(np.sum(rest)))


class LateServo(NamedTuple):
    """A servo that elevators may follow; loads are over the largest of a campaign."""

    low: float = -math.inf  #: Stops [rad].
    high: float = math.inf
    rate: float = math.inf  #: Largest [rad/s].
    delay: float = 0.0  #: [s]
    lag: float = 0.0  #: Mean of turning up and down, without load [s].
    skew: float = 0.0  #: Half the difference of both, over their mean.
    lag_by_load: float = 0.0  #: That the largest load adds [s].
    rate_by_load: float = 0.0  #: Share of the rate limit that it takes.
    play: float = 0.0  #: Free, of the elevator behind the servo [rad].
    slew: float = math.inf  #: Largest rate of coming after the commands [rad/s].
    gain: float = 1.0  #: Of the elevator's travel.

    @property
    def even(self) -> "LateServo":
        """The same without what makes it uneven."""
        return LateServo(*self[:5])

    @property
    def limits(self) -> Servo:
        """Its stops and its largest rate."""
        return Servo(*self[:3])


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

    def given(self, commands: np.ndarray) -> "Elevator":
        """The same behind other commands (k,) [rad/s]."""
        return self._replace(tape=self.tape._replace(commands=commands))

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
        start = self.tape.rest if rest is None else rest
        if servo.gain != 1.0:
            path = self.follow(query, servo._replace(gain=1.0), start)
            return start + servo.gain * (path - start)
        limits = servo.limits
        delay, lag, skew, *uneven, _ = servo[3:]
        tape = self.tape.switches + delay, self.tape.commands
        if servo == servo.even:
            return elevator_path(*tape, query, limits, time_constant=lag, start=start)
        form = (lag * (1.0 + skew), lag * (1.0 - skew), *uneven)
        start = float(min(max(start, limits.low), limits.high))
        path = np.empty(len(query))
        loads = self.time[: len(self.load)], self.load
        given = *tape, query, limits, form, *loads
        LOOPS.over(()).uneven_path(*given, start, path)
        return path


def measure_elevators(campaign: Campaign, masks: Mapping[str, Masks]) -> list[Elevator]:
    """Elevators of a campaign's flights; none without a servo."""
    elevators = []
    for flight in campaign.flights if campaign.elevator == "servo" else ():
        assert flight.elevator is not None
        mask = masks_of(flight, masks)
        piece = slice(mask.first, mask.last)
        rows = np.flatnonzero(~mask.elevator[piece])
        angle = flight.elevator[piece][rows]
        tape = command_tape(flight, mask, campaign.switch_rate)
        elevators.append(Elevator(flight.name, flight.time[piece], rows, angle, tape))
    return elevators


def windows_of(elevator: Elevator) -> tuple[np.ndarray, np.ndarray]:
    """Ends (2, k) of windows of an elevator's log [s], and its angles there [rad]."""
    seen = elevator.seen
    begin = np.arange(seen[0], seen[-1] - WINDOW, 0.5 * WINDOW)
    ends = np.stack([begin, begin + WINDOW])
    return ends, np.interp(ends, seen, elevator.angle)


def check_follows(campaign: Campaign, elevators: Sequence[Elevator]) -> None:
    """Refuses an elevator that does not follow its commands, or precedes them."""
    if not elevators:
        return
    commanded = max(float(np.ptp(each.follow(each.time))) for each in elevators)
    moved = max(float(np.ptp(each.angle)) for each in elevators if len(each.angle))
    if commanded < _MOVES and moved < _MOVES:
        return
    if min(moved, commanded) < _MOVES:
        campaign.refuse(
            f"column 'elevator' moves by {moved:.2g} rad at most, and "
            f"'elevator_rate_command' would move it by {commanded:.2g} rad; expected "
            "its measured angle, and the commands that were given."
        )
    servo = campaign.limits
    best, delay = calc_correlation(elevators, _BOTH_WAYS, servo=servo)
    correlation, _ = calc_correlation(elevators, servo=servo)
    follows = abs(correlation)
    if follows < _FOLLOWS:
        shifted, shift = calc_correlation(elevators, _SHIFTS)
        hint = ""
        if abs(shifted) > 2 * _FOLLOWS:
            hint = f"; shifted by {shift:.2f} s they do"
        campaign.refuse(
            f"column 'elevator' does not follow "
            f"'elevator_rate_command' (their rates correlate by {follows:.2f} at any "
            f"delay up to {_DELAYS[-1]:.2g} s{hint}); expected both on the clock of "
            "'time'."
        )
    # Under feedback a slow servo swings: a period before, and turned half a period
    # before, commands explain it about as well.
    is_clear = 1.0 - correlation**2 > _AS_GOOD * (1.0 - best**2)
    if -delay > _LEADS and is_clear:
        campaign.refuse(
            f"column 'elevator' moves {-delay:.3f} s before "
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
    ends, angles = windows_of(elevator)
    time = elevator.time
    change = angles[1] - angles[0]
    late = delays[:, None]
    begin, end = elevator.follow(ends[:, None] - late)
    ordered = end - begin
    is_known = (ends[0] - late >= time[0]) & (ends[1] - late <= time[-1])
    slowing = STOPPING_TIME * stops.rate if math.isfinite(stops.rate) else 0.0
    is_near = (angles < stops.low + slowing) | (angles > stops.high - slowing)
    is_known &= ~is_near.any(axis=0)
    one = np.ones_like(ordered)
    return np.stack([one * change**2, ordered * change, ordered**2, one]) * is_known
