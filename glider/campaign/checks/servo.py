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
    """The held commands of a flight, from its first row whose commands are known.

    Attributes:
        switches: (k,) when each command begins [s].
        commands: (k,) [rad/s].
        rest: angle of the elevator before the first command [rad].
    """

    switches: np.ndarray
    commands: np.ndarray
    rest: float


def command_tape(
    flight: Flight, mask: Masks, switch_rate: float | None, begin: float = 0.0
) -> CommandTape:
    """Returns when the commands of a flight switch, and to what.

    The elevator rested where its first measured angle is met by a servo that follows
    every command; the noise of that angle is left to the launch state x[3].

    Args:
        flight: with a servo.
        mask: its excluded rows.
        switch_rate: of the commands' clock, as `command_steps` takes it [Hz].
        begin: time of the log from which the switches are counted [s].
    """
    assert flight.command is not None and flight.elevator is not None
    # What was commanded before a gap that hides commands does not count.
    piece = slice(mask.first, None)
    time = flight.time[piece] - begin
    since = flight.command_time
    if since is not None:
        since = since[piece] - begin
    steps = command_steps(time, flight.command[piece], switch_rate, since)

    # Of the first angle that counts; zero without any.
    first = np.flatnonzero(~mask.elevator[piece])[:1]
    rest = flight.elevator[piece][first] - elevator_path(*steps, time[first])
    return CommandTape(*steps, float(rest.sum()))


class LateServo(NamedTuple):
    """A servo that elevators may follow.

    It is even if it has nothing but limits, a delay and a lag. Loads are those of the
    air on the elevator, over the largest of a campaign.

    Attributes:
        low: stop of the trailing edge down [rad].
        high: stop of the trailing edge up [rad].
        rate: largest rate either way [rad/s].
        delay: of the commands [s].
        lag: mean of the time constants of turning up and down, without load [s].
        skew: half the difference of both, over their mean.
        lag_by_load: what the largest load adds to the lag [s].
        rate_by_load: share that the largest load takes from the rate limit.
        play: free travel of the elevator behind the servo [rad].
        slew: largest rate of coming after the commands [rad/s].
        gain: travel of the elevator over that of the servo.
    """

    low: float = -math.inf
    high: float = math.inf
    rate: float = math.inf
    delay: float = 0.0
    lag: float = 0.0
    skew: float = 0.0
    lag_by_load: float = 0.0
    rate_by_load: float = 0.0
    play: float = 0.0
    slew: float = math.inf
    gain: float = 1.0

    @property
    def even(self) -> "LateServo":
        """The same servo with its limits, delay and lag alone."""
        return LateServo(*self[:5])

    @property
    def limits(self) -> Servo:
        """Its stops and its largest rate."""
        return Servo(*self[:3])


_UNLIMITED = LateServo()


class Elevator(NamedTuple):
    """The measured elevator of a flight, and the commands that it may follow.

    Where gaps hide commands, both are those of one piece of the flight.

    Attributes:
        name: of the flight.
        time: (n,) of the rows of the piece [s].
        rows: (m,) indices of those whose angle counts.
        angle: (m,) measured there [rad].
        tape: the commands.
        load: (n,) of the air at the rows, over the largest of a campaign; or (1,).
    """

    name: str
    time: np.ndarray
    rows: np.ndarray
    angle: np.ndarray
    tape: CommandTape
    load: np.ndarray = np.zeros(1)

    @property
    def seen(self) -> np.ndarray:
        """Times (m,) of the angles [s]."""
        return self.time[self.rows]

    def given(self, commands: np.ndarray) -> "Elevator":
        """Returns the same elevator behind other commands (k,) [rad/s]."""
        return self._replace(tape=self.tape._replace(commands=commands))

    def follow(
        self,
        query: np.ndarray,
        servo: LateServo = _UNLIMITED,
        rest: float | None = None,
    ) -> np.ndarray:
        """Returns the angles of a servo behind the commands [rad].

        Args:
            query: (m,) times, in any order for an even servo, increasing for others
                [s].
            servo: it begins within its stops.
            rest: angle before the first command [rad]; None: that of the tape.
        """
        start = self.tape.rest if rest is None else rest
        if servo.gain != 1.0:
            path = self.follow(query, servo._replace(gain=1.0), start)
            return start + servo.gain * (path - start)

        limits = servo.limits
        lag = servo.lag
        tape = self.tape.switches + servo.delay, self.tape.commands
        if servo == servo.even:
            return elevator_path(*tape, query, limits, time_constant=lag, start=start)

        up = lag * (1.0 + servo.skew)
        down = lag * (1.0 - servo.skew)
        form = up, down, servo.lag_by_load, servo.rate_by_load, servo.play, servo.slew
        start = float(min(max(start, limits.low), limits.high))
        loads = self.time[: len(self.load)], self.load
        path = np.empty(len(query))
        LOOPS.over(()).uneven_path(*tape, query, limits, form, *loads, start, path)
        return path


def measure_elevators(campaign: Campaign, masks: Mapping[str, Masks]) -> list[Elevator]:
    """Returns the elevators of a campaign's flights; none without a servo.

    Args:
        campaign: the flights; where gaps hide commands, of one piece of each.
        masks: rows that are excluded, and the piece, by the flights' names.
    """
    if campaign.elevator != "servo":
        return []
    elevators = []
    for flight in campaign.flights:
        assert flight.elevator is not None
        mask = masks_of(flight, masks)
        piece = slice(mask.first, mask.last)
        rows = np.flatnonzero(~mask.elevator[piece])
        angle = flight.elevator[piece][rows]
        tape = command_tape(flight, mask, campaign.switch_rate)
        elevators.append(Elevator(flight.name, flight.time[piece], rows, angle, tape))
    return elevators


def windows_of(elevator: Elevator) -> tuple[np.ndarray, np.ndarray]:
    """Returns the ends (2, k) of windows of a log [s], and its angles there [rad].

    Windows last WINDOW and overlap by half of it; angles are interpolated.
    """
    seen = elevator.seen
    begin = np.arange(seen[0], seen[-1] - WINDOW, 0.5 * WINDOW)
    ends = np.stack([begin, begin + WINDOW])
    return ends, np.interp(ends, seen, elevator.angle)


def check_follows(campaign: Campaign, elevators: Sequence[Elevator]) -> None:
    """Refuses an elevator that does not follow its commands, or precedes them.

    One that neither moves nor is commanded to shows nothing, and passes.

    Raises:
        InputError: the elevator or its commands do not move, their changes do not
            correlate at any delay, or only at one at which the elevator moves first.
    """
    moved, commanded = _travels(elevators)
    if max(moved, commanded) < _MOVES:
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


def are_still(elevators: Sequence[Elevator]) -> bool:
    """Whether elevators neither move nor are commanded to, and so show nothing."""
    return max(_travels(elevators)) < _MOVES


def _travels(elevators: Sequence[Elevator]) -> tuple[float, float]:
    """Returns the largest travel of elevators, and of their commanded paths [rad]."""
    if not elevators:
        return 0.0, 0.0
    moved = max(np.ptp(each.angle) for each in elevators if len(each.angle))
    commanded = max(np.ptp(each.follow(each.time)) for each in elevators)
    return float(moved), float(commanded)


def follow_sign(elevators: Sequence[Elevator]) -> int:
    """-1 where elevators clearly turn against their commands, else +1."""
    return -1 if calc_correlation(elevators)[0] < -_FOLLOWS else 1


def calc_correlation(
    elevators: Sequence[Elevator],
    delays: np.ndarray = _DELAYS,
    servo: Servo = NO_LIMITS,
) -> tuple[float, float]:
    """Returns the best correlation of elevators with commands, and its delay.

    With Δφ the changes of the elevators over windows, Δψ those of the path at a delay,
    it is Σ Δφ Δψ / √(Σ Δφ² Σ Δψ²). Where an elevator slows down before a stop of the
    servo, it follows no command.

    Args:
        elevators: of the flights, which share the delay.
        delays: (d,) that are tried [s].
        servo: its stops.

    Returns:
        The correlation of the largest size, -1 to 1, and the delay [s]; both nan where
        too few changes are known to judge: no comparison with them holds.
    """
    if not elevators:
        return math.nan, math.nan
    sums = [_compare(own, delays, servo) for own in elevators]
    turned, together, ordered, count = np.sum(sums, axis=0)
    correlation = together / np.sqrt(np.maximum(turned * ordered, 1e-30))
    is_shown = count >= _MIN_CHANGES
    if not is_shown.any():
        return math.nan, math.nan
    size = np.where(is_shown, np.abs(correlation), -np.inf)
    best = int(np.argmax(size))
    return float(correlation[best]), float(delays[best])


def _compare(elevator: Elevator, delays: np.ndarray, stops: Servo) -> np.ndarray:
    """Compares changes of an elevator with the commanded ones at each delay, (4, d).

    Sums over windows: of the squared changes of the elevator, of their products with
    the commanded ones, of the squares of these, and the number of windows. Those whose
    commands are not known, or that touch a stop, do not count.
    """
    if len(elevator.rows) < 2:
        return np.zeros((4, len(delays)))
    ends, angles = windows_of(elevator)
    change = angles[1] - angles[0]

    # Later commands are those of an earlier path.
    late = ends[:, None] - delays[:, None]  # (2, d, k)
    begin, end = elevator.follow(late)
    ordered = end - begin

    # Windows between known commands, away from the stops.
    time = elevator.time
    is_known = (late[0] >= time[0]) & (late[1] <= time[-1])
    slowing = 0.0
    if math.isfinite(stops.rate):
        slowing = STOPPING_TIME * stops.rate
    is_near = (angles < stops.low + slowing) | (angles > stops.high - slowing)
    counts = is_known & ~is_near.any(axis=0)

    own = counts * change
    ordered = counts * ordered
    return np.stack([own**2, own * ordered, ordered**2, counts]).sum(axis=-1)
