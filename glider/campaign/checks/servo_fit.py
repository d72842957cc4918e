"""The servo that a campaign's elevators follow, and what they do beside it.

The measured angles of all flights are compared with the exact path of a servo behind
the logged commands. Where what is left of them is noise, the servo is as specified;
else its delay and lag are fitted, and then its limits. What these leave is a
departure, if the angles are more likely with a smooth curve than with noise alone: lost
or rounded commands, play, a lag that depends on the load. Flights are replayed with it,
so that the aerodynamics are traced along the measured elevator.
"""

import dataclasses
import math
from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from scipy.optimize import least_squares

from glider.campaign.checks.masks import Masks, masks_of
from glider.campaign.logs import Campaign, Departure, Flight
from glider.campaign.smoothing import Smoothing, estimate_noise, smoothing_maps
from glider.compiled.actuators import elevator_path
from glider.physics.held_commands import command_steps
from glider.physics.parameters import MAX_ANGLE
from glider.physics.servo import Servo

_LEAST_EVIDENCE = 6.0
"""Evidence above which a departure is no noise [nats]. By chance, half a chi-squared of
one degree is larger in one of 3,700 campaigns; measured: 2.1 at most in 27 campaigns
whose servo is as specified, or lags."""
_ORDER = 2
"""Order of the derivative of a departure that is white noise: its rate is a random
walk. Of the orders 1 to 3 its errors are the least or nearly so, and it never takes
noise for departures (bench_departures)."""
_ERROR_SCALE = 1.5
"""Ratio of a departure's error to its standard error as a Gaussian process: 0.6 to 1.4,
as departures are uneven (bench_departures)."""
_FEWEST_ROWS = 10  # Of a flight whose departure can be smoothed.
_STARTS = (0.0, 1e-3), (0.02, 0.03)  # Delays and lags [s] that fits begin with.
_SURE = 2.0  # Standard errors of the commands' clock by which it may be late.
_LONGEST = (0.3, 0.5)  # Delay and lag [s].
_STEPS = (0.01, 0.01)  # Of delay and lag, to scale them [s].
_NEAR_STOP = 0.05  # Distance from a stop where a servo may slow down [rad].
_SHORTEST_LAG = 1e-3  # Lag below which nothing lasts [s].
_LEAST_RATE = 0.1  # Of a fitted rate limit [rad/s].
_USUAL_ERROR = 0.01  # Error of an angle above which it weighs less in a fit [rad].
_DIFFERENCE = 1e-3  # Relative step of slopes.


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


class _Elevator(NamedTuple):
    """The measured elevator of a flight behind its commands."""

    name: str  #: Name of the flight.
    time: np.ndarray  #: (n,) of all rows [s].
    rows: np.ndarray  #: (m,) rows that count.
    angle: np.ndarray  #: (m,) measured there [rad].
    tape: CommandTape

    def rest(self, servo: "_ServoFit") -> float:
        """Angle at which it rested [rad]: that logged first, without its noise.

        Noise would shift all angles until a stop.
        """
        path = self._follow(servo, self.tape.rest)
        low, high, _ = servo.limits
        moves_freely = (path > low + _NEAR_STOP) & (path < high - _NEAR_STOP)
        free = np.logical_and.accumulate(moves_freely)
        if free.all() or not free.any():
            return self.tape.rest
        return self.tape.rest + float(np.median((self.angle - path)[free]))

    def errors(self, servo: "_ServoFit") -> np.ndarray:
        """Measured minus expected angles (m,) [rad]."""
        return self.angle - self._follow(servo, self.rest(servo))

    def _follow(self, servo: "_ServoFit", rest: float) -> np.ndarray:
        """Angles (m,) of a servo that began at rest [rad]."""
        return elevator_path(
            self.tape.switches,
            self.tape.commands,
            self.time[self.rows],
            servo.limits,
            delay=servo.delay,
            time_constant=servo.lag,
            start=rest,
        )

    def lasting_errors(self, servo: "_ServoFit") -> np.ndarray:
        """The same without what a lag makes of a late first command (m,) [rad].

        That is a constant and what fades with the lag.
        """
        error = self.errors(servo)
        since = self.time[self.rows] - self.tape.switches[0]
        fading = np.exp(-since / max(servo.lag, _SHORTEST_LAG))
        columns = np.stack([np.ones(len(since)), fading], axis=1)
        return error - columns @ np.linalg.lstsq(columns, error, rcond=None)[0]


class _ServoFit(NamedTuple):
    """A servo that elevators follow."""

    limits: Servo
    delay: float = 0.0  #: [s]
    lag: float = 0.0  #: [s]

    def departures(self, elevators: Sequence[_Elevator]) -> Smoothing:
        """Returns how elevators depart from the servo."""
        times = [each.time[each.rows] for each in elevators]
        errors = [each.lasting_errors(self)[:, None] for each in elevators]
        return estimate_noise(times, errors, _ORDER)[0]

    def explains(self, elevators: Sequence[_Elevator]) -> bool:
        """Whether elevators are off by noise alone."""
        return self.departures(elevators).evidence < _LEAST_EVIDENCE


def identify_servo(
    campaign: Campaign, masks: Mapping[str, Masks]
) -> tuple[Campaign, tuple[str, ...]]:
    """Compares the measured elevators of a campaign with its servo.

    Signs must be right. Returns the campaign with the limits that the servo shows and
    with the departures of elevators from it, and a sentence for each.
    """
    log = campaign.servo
    if log.angle != "measured" or log.command == "reconstructed":
        return campaign, ()
    elevators = _measure(campaign, masks)
    specified = _ServoFit(campaign.limits)
    if not elevators or specified.explains(elevators):
        return campaign, ()
    earliest = -_SURE * campaign.servo.command_std
    servo = _fit(elevators, specified, earliest)
    if servo.explains(elevators):  # A delay and a lag are effects to be traced.
        return campaign, ()
    limited = _fit_limits(elevators, servo, earliest)
    if limited:
        return _with_limits(campaign, limited.limits)
    # A few flights may be odd: the others are left as they are.
    odd: list[_Elevator] = []
    others: list[_Elevator] = []
    for each in elevators:
        (others if servo.explains([each]) else odd).append(each)
    few = odd if others and servo.explains(others) else elevators
    return _with_departures(campaign, servo, few)


def measure_elevator_noise(campaign: Campaign, masks: Mapping[str, Masks]) -> float:
    """Returns the noise of the logged elevators [rad], 0 without any."""
    elevators = _measure(campaign, masks)
    if not elevators:
        return 0.0
    return _ServoFit(campaign.limits).departures(elevators).noise


def _measure(campaign: Campaign, masks: Mapping[str, Masks]) -> list[_Elevator]:
    """Elevators behind their commands, of flights with enough rows of both."""
    elevators = []
    for flight in campaign.flights if campaign.elevator == "servo" else ():
        assert flight.elevator is not None
        mask = masks_of(flight, masks)
        rows = np.flatnonzero(~(mask.elevator | mask.beyond))
        if len(rows) >= _FEWEST_ROWS:
            tape = command_tape(flight, mask, campaign.switch_rate)
            angle = flight.elevator[rows]
            elevators.append(_Elevator(flight.name, flight.time, rows, angle, tape))
    return elevators


def _fit(
    elevators: Sequence[_Elevator], start: _ServoFit, earliest: float
) -> _ServoFit:
    """Fits delay and lag of a servo that keeps its limits.

    Its delay is `earliest` at least [s].
    """

    def servo_of(numbers: np.ndarray) -> _ServoFit:
        return _ServoFit(start.limits, *map(float, numbers))

    bounds = ((earliest, 0.0), _LONGEST)
    fits = [_minimize(elevators, servo_of, d, bounds, _STEPS) for d in _STARTS]
    return min(fits, key=lambda fit: fit.departures(elevators).evidence)


def _fit_limits(
    elevators: Sequence[_Elevator], start: _ServoFit, earliest: float
) -> _ServoFit | None:
    """Fits a servo with one limit of its own, or with three: the first that explains.

    Limits begin where elevators and commands end. None where none explains.
    """
    angles = np.concatenate([each.angle for each in elevators])
    commands = np.concatenate([each.tape.commands for each in elevators])
    low = float(np.min(angles))
    high = float(np.max(angles))
    middle = 0.5 * (low + high)
    span = high - low
    fastest = float(np.max(np.abs(commands)))
    ranges = {  # First, least and most of each, and its scale.
        "low": (low, low - span, middle, 0.1),
        "high": (high, middle, high + span, 0.1),
        "rate": (0.9 * fastest, _LEAST_RATE, 2.0 * fastest, 1.0),
    }
    for free in (("low",), ("high",), ("rate",), ("low", "high", "rate")):

        def servo_of(numbers: np.ndarray, free: tuple[str, ...] = free) -> _ServoFit:
            delay, lag, *values = map(float, numbers)
            own = dict(zip(free, values, strict=True))
            return _ServoFit(start.limits._replace(**own), delay, lag)

        firsts, leasts, mosts, scales = zip(*(ranges[n] for n in free), strict=True)
        bounds = ((earliest, 0.0, *leasts), (*_LONGEST, *mosts))
        for late in (_STARTS[0], (start.delay, start.lag)):
            first = (*late, *firsts)
            fit = _minimize(elevators, servo_of, first, bounds, (*_STEPS, *scales))
            if fit.explains(elevators):
                return fit
    return None


def _minimize(
    elevators: Sequence[_Elevator],
    servo_of: Callable[[np.ndarray], _ServoFit],
    first: Sequence[float],
    bounds: tuple[Sequence[float], Sequence[float]],
    steps: Sequence[float],
) -> _ServoFit:
    """Returns the servo of least errors.

    Large ones weigh less: a lost command says nothing of the servo. `steps` scale the
    numbers that `servo_of` makes a servo of.
    """

    def errors(numbers: np.ndarray) -> np.ndarray:
        servo = servo_of(numbers)
        return np.concatenate([each.lasting_errors(servo) for each in elevators])

    fit = least_squares(
        errors,
        first,
        bounds=bounds,
        x_scale=steps,
        diff_step=_DIFFERENCE,
        loss="soft_l1",
        f_scale=_USUAL_ERROR,
    )
    return servo_of(fit.x)


def _with_limits(campaign: Campaign, servo: Servo) -> tuple[Campaign, tuple[str, ...]]:
    """Returns the campaign with other limits of the servo, and how they differ."""
    known = campaign.limits
    words = (
        f"The servo stops at {servo.low:.3g} and {servo.high:.3g} rad and turns by "
        f"{servo.rate:.3g} rad/s at most, where 'elevator_limits' and "
        f"'elevator_rate_limit' say {known.low:.3g}, {known.high:.3g} and "
        f"{known.rate:.3g}: its own limits are used."
    )
    stops = None
    if math.isfinite(servo.low) or math.isfinite(servo.high):
        stops = (max(servo.low, -MAX_ANGLE), min(servo.high, MAX_ANGLE))
    changed = dataclasses.replace(
        campaign,
        elevator_limits=stops,
        elevator_rate_limit=servo.rate if math.isfinite(servo.rate) else None,
    )
    return changed, (words,)


def _with_departures(
    campaign: Campaign, servo: _ServoFit, elevators: Sequence[_Elevator]
) -> tuple[Campaign, tuple[str, ...]]:
    """Returns the campaign with its elevators' departures from a servo."""
    found = servo.departures(elevators)
    curves = {}
    rests = {}
    shares = []
    for each in elevators:
        seen = each.time[each.rows]
        query = np.clip(each.time, seen[0], seen[-1])
        smoothed = smoothing_maps(seen, query, found.ratio, _ORDER)[0]
        curves[each.name] = smoothed @ each.errors(servo)
        rests[each.name] = each.rest(servo)
        at_rows = smoothed[each.rows].diagonal()
        shares.append(np.mean(at_rows))
    share = min(_ERROR_SCALE * math.sqrt(np.mean(shares)), 1.0)
    std = share * found.noise
    flights = []
    for flight in campaign.flights:
        curve = curves.get(flight.name)
        own = None
        if curve is not None:
            own = Departure(curve, rests[flight.name], std)
        flights.append(dataclasses.replace(flight, departure=own))
    largest = {name: float(np.max(np.abs(curve))) for name, curve in curves.items()}
    worst = max(largest, key=largest.__getitem__)
    time = next(each.time for each in elevators if each.name == worst)
    when = time[np.argmax(np.abs(curves[worst]))]
    rms = math.sqrt(np.mean([np.var(curve) for curve in curves.values()]))
    sentence = (
        f"The elevator departs from its commands by {1e3 * rms:.2g} mrad (RMS; its "
        f"noise is {1e3 * found.noise:.2g}), in {worst} by {largest[worst]:.2g} rad at "
        f"{when:.3g} s, whatever its delay, lag and limits: are commands lost or "
        "rounded, has it play, or another lag under load? Flights are replayed along "
        "the measured elevator."
    )
    changed = dataclasses.replace(campaign, flights=tuple(flights))
    return changed, (sentence,)
