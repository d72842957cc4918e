"""How do elevators follow their commands? Their delay and sign.

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
from glider.compiled.actuators import elevator_path
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
_LEAST_SHOWN = 0.28  # Time of changes that shows a correlation, at least [s].


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
    """A servo that elevators may follow."""

    limits: Servo = NO_LIMITS
    delay: float = 0.0  #: [s]
    lag: float = 0.0  #: [s]


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

        It began at `rest`, or at the angle of the tape.
        """
        return elevator_path(
            self.tape.switches,
            self.tape.commands,
            query,
            servo.limits,
            delay=servo.delay,
            time_constant=servo.lag,
            start=self.tape.rest if rest is None else rest,
        )


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


def check_follows(campaign: Campaign, elevators: Sequence[Elevator]) -> None:
    """Refuses an elevator that does not follow its commands, or precedes them."""
    if not elevators:
        return
    ranges = [np.ptp(each.follow(each.time)) for each in elevators]
    ranges += [np.ptp(each.angle) for each in elevators if len(each.angle)]
    if max(ranges) < _MOVES:
        return
    ahead, lag = calc_correlation(elevators, _BOTH_WAYS, campaign.limits)
    if abs(ahead) < _FOLLOWS:
        shifted, shift = calc_correlation(elevators, _SHIFTS)
        hint = f"; shifted by {shift:.2f} s they do" if abs(shifted) > 0.8 else ""
        raise InputError(
            f"{campaign.path}: column 'elevator' does not follow "
            f"'elevator_rate_command' (their rates correlate by {abs(ahead):.2f} at "
            f"any delay up to {_DELAYS[-1]:.2g} s{hint}); expected both on the clock "
            "of 'time'."
        )
    if lag >= -_LEADS:
        return
    # Under feedback a slow servo swings: a period before, and turned half a period
    # before, commands explain it about as well.
    behind, _ = calc_correlation(elevators, _DELAYS, campaign.limits)
    if 1.0 - behind**2 > _AS_GOOD * (1.0 - ahead**2):
        raise InputError(
            f"{campaign.path}: column 'elevator' moves {-lag:.3f} s before "
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
    sums = np.zeros((4, len(delays)))
    for elevator in elevators:
        sums += _compare(elevator, delays, servo)
    turned, together, ordered, count = sums
    correlation = together / np.sqrt(np.maximum(turned * ordered, 1e-30))
    is_shown = count >= _LEAST_SHOWN
    if not is_shown.any():
        return math.nan, math.nan
    best = int(np.argmax(np.where(is_shown, np.abs(correlation), -1.0)))
    return float(correlation[best]), float(delays[best])


def _compare(elevator: Elevator, delays: np.ndarray, stops: Servo) -> np.ndarray:
    """Compares changes of an elevator from row to row of a window's length, (4, d).

    For each of d delays the sums of its squares, products with the commanded changes,
    squares of these, and the time [s] that they show. Changes count where commands are
    known, away from stops.
    """
    time = elevator.seen
    if len(time) < 2:
        return np.zeros((4, len(delays)))
    step = float(np.median(np.diff(time)))
    rows = max(round(_WINDOW / step), 1)
    late = delays[:, None]
    path = elevator.follow(time - late)
    ordered = path[:, rows:] - path[:, :-rows]
    change = elevator.angle[rows:] - elevator.angle[:-rows]
    slowing = STOPPING_TIME * stops.rate if math.isfinite(stops.rate) else 0.0
    is_free = (elevator.angle >= stops.low + slowing) & (
        elevator.angle <= stops.high - slowing
    )
    is_known = is_free[rows:] & is_free[:-rows]
    is_known = is_known & (time[:-rows] - late >= elevator.time[0])
    is_known &= time[rows:] - late <= elevator.time[-1]
    one = np.ones_like(ordered)
    products = one * change**2, ordered * change, ordered**2, one * step
    return (np.stack(products) * is_known).sum(axis=-1)
