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
from collections.abc import Mapping, Sequence

import numpy as np
from scipy.optimize import least_squares

from glider.campaign.checks.masks import Masks
from glider.campaign.checks.servo import Elevator, LateServo, measure_elevators
from glider.campaign.logs import Campaign, Departure
from glider.campaign.smoothing import Smoothing, estimate_noise, smoothing_maps
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
_FREE = ("low",), ("high",), ("rate",), ("low", "high", "rate")
"""Limits that a servo may have of its own: the first that explain the elevators."""
_STARTS = (0.0, 1e-3), (0.02, 0.03)  # Delays and lags [s] that fits begin with.
_SURE = 2.0  # Standard errors of the commands' clock by which it may be late.
_LONGEST = (0.3, 0.5)  # Delay and lag [s].
_STEPS = (0.01, 0.01)  # Of delay and lag, to scale them [s].
_NEAR_STOP = 0.05  # Distance from a stop where a servo may slow down [rad].
_SHORTEST_LAG = 1e-3  # Lag below which nothing lasts [s].
_LEAST_RATE = 0.1  # Of a fitted rate limit [rad/s].
_USUAL_ERROR = 0.01  # Error of an angle above which it weighs less in a fit [rad].
_DIFFERENCE = 1e-3  # Relative step of slopes.


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
    specified = LateServo(campaign.limits)
    if not elevators or _explains(specified, elevators):
        return campaign, ()
    servo = _fit(elevators, specified, log.command_std)
    if _explains(servo, elevators):  # A delay and a lag are effects to be traced.
        return campaign, ()
    for free in _FREE:
        limited = _fit(elevators, servo, log.command_std, free)
        if _explains(limited, elevators):
            return _with_limits(campaign, limited.limits)
    # A few flights may be odd: the others are left as they are.
    odd = [each for each in elevators if not _explains(servo, [each])]
    others = [each for each in elevators if _explains(servo, [each])]
    few = odd if others and _explains(servo, others) else elevators
    return _with_departures(campaign, servo, few)


def measure_elevator_noise(campaign: Campaign, masks: Mapping[str, Masks]) -> float:
    """Returns the noise of the logged elevators [rad], 0 without any."""
    elevators = _measure(campaign, masks)
    if not elevators:
        return 0.0
    return _departures(LateServo(campaign.limits), elevators).noise


def _measure(campaign: Campaign, masks: Mapping[str, Masks]) -> list[Elevator]:
    """Elevators of flights with enough rows, behind commands by their clock."""
    elevators = measure_elevators(campaign, masks, at_rows=False)
    return [each for each in elevators if len(each.rows) >= _FEWEST_ROWS]


def _find_rest(elevator: Elevator, servo: LateServo) -> float:
    """Angle at which an elevator rested [rad]: that logged first, without its noise.

    Noise would shift all angles until a stop.
    """
    rest = elevator.tape.rest
    path = elevator.follow(elevator.seen, servo)
    low, high, _ = servo.limits
    moves_freely = (path > low + _NEAR_STOP) & (path < high - _NEAR_STOP)
    free = np.logical_and.accumulate(moves_freely)
    if free.all() or not free.any():
        return rest
    return rest + float(np.median((elevator.angle - path)[free]))


def _errors(elevator: Elevator, servo: LateServo) -> np.ndarray:
    """Measured minus expected angles (m,) [rad]."""
    rest = _find_rest(elevator, servo)
    return elevator.angle - elevator.follow(elevator.seen, servo, rest)


def _lasting_errors(elevator: Elevator, servo: LateServo) -> np.ndarray:
    """The same without what a lag makes of a late first command (m,) [rad].

    That is a constant and what fades with the lag.
    """
    error = _errors(elevator, servo)
    since = elevator.seen - elevator.tape.switches[0]
    fading = np.exp(-since / max(servo.lag, _SHORTEST_LAG))
    columns = np.stack([np.ones(len(since)), fading], axis=1)
    return error - columns @ np.linalg.lstsq(columns, error, rcond=None)[0]


def _departures(servo: LateServo, elevators: Sequence[Elevator]) -> Smoothing:
    """Returns how elevators depart from a servo."""
    times = [each.seen for each in elevators]
    errors = [_lasting_errors(each, servo)[:, None] for each in elevators]
    return estimate_noise(times, errors, _ORDER)[0]


def _explains(servo: LateServo, elevators: Sequence[Elevator]) -> bool:
    """Whether elevators are off by noise alone."""
    return _departures(servo, elevators).evidence < _LEAST_EVIDENCE


def _fit(
    elevators: Sequence[Elevator],
    start: LateServo,
    clock_std: float,
    free: tuple[str, ...] = (),
) -> LateServo:
    """Fits the delay and lag of a servo, and those of its limits that are free.

    Commands may be late by the error of their clock [s]. Limits begin where elevators
    and commands end.
    """
    angles = np.concatenate([each.angle for each in elevators])
    commands = np.concatenate([each.tape.commands for each in elevators])
    low = float(np.min(angles))
    high = float(np.max(angles))
    middle = 0.5 * (low + high)
    span = high - low
    fastest = float(np.max(np.abs(commands)))
    ranges = {  # Least and most of each limit, where it begins, and its scale.
        "low": (low - span, middle, low, 0.1),
        "high": (middle, high + span, high, 0.1),
        "rate": (_LEAST_RATE, 2.0 * fastest, 0.9 * fastest, 1.0),
    }

    def servo_of(numbers: np.ndarray) -> LateServo:
        delay, lag, *values = map(float, numbers)
        own = dict(zip(free, values, strict=True))
        return LateServo(start.limits._replace(**own), delay, lag)

    def errors(numbers: np.ndarray) -> np.ndarray:
        servo = servo_of(numbers)
        return np.concatenate([_lasting_errors(each, servo) for each in elevators])

    least = [-_SURE * clock_std, 0.0, *(ranges[name][0] for name in free)]
    most = [*_LONGEST, *(ranges[name][1] for name in free)]
    scales = [*_STEPS, *(ranges[name][3] for name in free)]
    fits = []
    for late in (_STARTS[0], start[1:]) if free else _STARTS:
        # Large errors weigh less: a lost command says nothing of the servo.
        fit = least_squares(
            errors,
            [*late, *(ranges[name][2] for name in free)],
            bounds=(least, most),
            x_scale=scales,
            diff_step=_DIFFERENCE,
            loss="soft_l1",
            f_scale=_USUAL_ERROR,
        )
        fits.append(servo_of(fit.x))
    return min(fits, key=lambda servo: _departures(servo, elevators).evidence)


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
    campaign: Campaign, servo: LateServo, elevators: Sequence[Elevator]
) -> tuple[Campaign, tuple[str, ...]]:
    """Returns the campaign with its elevators' departures from a servo."""
    found = _departures(servo, elevators)
    times = {flight.name: flight.time for flight in campaign.flights}
    curves = {}
    shares = []
    for each in elevators:
        query = np.append(times[each.name], each.seen)
        query = np.clip(query, each.seen[0], each.seen[-1])
        smoothed = smoothing_maps(each.seen, query, found.ratio, _ORDER)[0]
        count = len(times[each.name])
        shares.append(np.mean(smoothed[count:].diagonal()))
        curves[each.name] = smoothed[:count] @ _errors(each, servo)
    share = min(_ERROR_SCALE * math.sqrt(np.mean(shares)), 1.0)
    departures = {}
    for each in elevators:
        curve = curves[each.name]
        rest = _find_rest(each, servo)
        departures[each.name] = Departure(curve, rest, share * found.noise)
    flights = [
        dataclasses.replace(flight, departure=departures.get(flight.name))
        for flight in campaign.flights
    ]
    largest = {name: float(np.max(np.abs(curve))) for name, curve in curves.items()}
    worst = max(largest, key=largest.__getitem__)
    when = times[worst][np.argmax(np.abs(curves[worst]))]
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
