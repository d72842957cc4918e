"""Forms of servos, fitted to measured elevators.

Each is judged by the likelihood of the angles, whatever smooth curve they have beside
it (`departures`), less what its freedom costs. The travel of an elevator, over that of
its commands, is one of them.
"""

import dataclasses
import functools
import math
from collections.abc import Mapping, Sequence

import numpy as np
from scipy.optimize import OptimizeResult, least_squares

from glider.campaign.checks.masks import Masks, masks_of
from glider.campaign.checks.rates import claim_scale
from glider.campaign.checks.servo import (
    WINDOW,
    Elevator,
    LateServo,
    calc_correlation,
    windows_of,
)
from glider.campaign.logs import CLOCK_STD, Campaign
from glider.campaign.smoothing import Smoothing, estimate_noise, smoothing_maps
from glider.physics.parameters import GliderParameters
from glider.physics.servo import NO_LIMITS, Servo

LEAST_EVIDENCE = 6.0
"""Evidence above which a departure is no noise [nats]. By chance, half a chi-squared of
one degree is larger in one of 3,700 campaigns; measured: 2.1 at most in 27 campaigns
whose servo is as specified, or lags."""
ORDER = 2
"""Order of the derivative of a departure that is white noise: its rate is a random
walk. Of the orders 1 to 3 its errors are the least or nearly so, and it never takes
noise for departures (bench_departures)."""
_STARTS = (0.0, 1e-3), (0.02, 0.03)  # Delays and lags [s] that fits begin with.
_SURE = 2.0  # Standard errors of the commands' clock by which it may be late.
_LONGEST = (0.3, 0.5)  # Delay and lag [s].
_STEPS = (0.01, 0.01)  # Of delay and lag, to scale them [s].
_LEAST_RATE = 0.1  # Of a fitted rate limit [rad/s].
_NEAR_STOP = 0.05  # Distance from a stop where a servo may slow down [rad].
_SHORTEST_LAG = 1e-3  # Lag below which nothing lasts [s].
_USUAL_ERROR = 0.01  # Error of an angle above which it weighs less in a fit [rad].
_MOST_TRIES = 40  # Of a fit, which may have numbers that show nothing.
_DIFFERENCE = 1e-3  # Relative step of slopes.
_BEFORE = 3  # Periods before a command that show where the elevator was.
_AFTER = 1.5  # ... and after it, before the next, which may be lost too, turns far.
_FINER = 21  # Steps between two that were tried.
_MOST_GAIN = 1e3  # Of an elevator in another unit.
_FEW = 20  # Flights that show a gain, about.
_LONGEST_LAG = 0.36  # Lag above which the gain of a servo is unknown [s].
_TRAVEL = (0.06, 0.2)
"""Share by which the travel may be off; calibrated by bench_travel."""
_SURELY = 5.0  # Standard errors of the gain that must be in it (bench_travel).
_FEWEST_ROWS = 8  # Of a flight that shows a gain.
_SCATTER = 0.065
"""Standard deviation of the gain of one flight, as logs show commands a row late or not
[-]: measured by bench_travel."""
# Noise of measured angles, of which computed ones have none [rad] (c): finer steps are
# not searched for.
_LEAST_NOISE = 5e-4


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class Fit:
    """A form of a servo, fitted to elevators."""

    servo: LateServo
    elevators: Sequence[Elevator]  #: Behind the commands that reached it.
    cost: float = 0.0  #: Of what was chosen beside delay, lag and `free` [nats].
    free: tuple[str, ...] = ()  #: Numbers that were fitted beside delay and lag.
    std: float = 0.0  #: Standard error of the last of them, from flight to flight.
    cause: str = ""  #: Why elevators depart from a plain servo, in words.

    def on(self, places: Sequence[int]) -> "Fit":
        """The same of some of the elevators."""
        few = [self.elevators[place] for place in places]
        return dataclasses.replace(self, elevators=few)

    @functools.cached_property
    def departures(self) -> Smoothing:
        """How elevators depart from it."""
        times = [each.seen for each in self.elevators]
        errors = [_lasting_errors(e, self.servo)[:, None] for e in self.elevators]
        return estimate_noise(times, errors, ORDER)[0]

    @property
    def explains(self) -> bool:
        """Whether elevators are off by noise alone."""
        return self.departures.evidence < LEAST_EVIDENCE

    @property
    def likelihood(self) -> float:
        """Of the elevators, less half the logarithm of their rows a number [nats]."""
        rows = sum(len(each.rows) for each in self.elevators)
        freedom = 0.5 * len(self.free) * math.log(rows)
        return self.departures.log_likelihood - freedom - self.cost


def follow_from_rest(elevator: Elevator, servo: LateServo) -> tuple[float, np.ndarray]:
    """Angle at which an elevator rested, and those that a servo expects (m,) [rad].

    It rested at the angle logged first, without its noise, which would shift all angles
    until a stop.
    """
    rest = elevator.tape.rest
    path = elevator.follow(elevator.seen, servo)
    moves_freely = path > servo.low + _NEAR_STOP
    moves_freely &= path < servo.high - _NEAR_STOP
    free = np.logical_and.accumulate(moves_freely)
    if free.all() or not free.any():
        return rest, path
    rest += float(np.median((elevator.angle - path)[free]))
    return rest, elevator.follow(elevator.seen, servo, rest)


def _lasting_errors(elevator: Elevator, servo: LateServo) -> np.ndarray:
    """Measured minus expected angles (m,) without what passes or never changes [rad].

    That is a constant, and what a lag makes of a late first command: it fades with it.
    """
    _, path = follow_from_rest(elevator, servo)
    error = elevator.angle - path
    since = elevator.seen - elevator.tape.switches[0]
    fading = np.exp(-since / max(servo.lag, _SHORTEST_LAG))
    fading -= np.mean(fading)
    error -= np.mean(error)
    square = fading @ fading
    return error - fading * ((fading @ error) / square) if square > 0.0 else error


def fit_servo(
    elevators: Sequence[Elevator],
    start: LateServo,
    command_std: float,
    free: tuple[str, ...] = (),
    cost: float = 0.0,
    cause: str = "",
) -> Fit:
    """Fits the delay and lag of a servo, and other numbers of it that are free.

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
    rates = _LEAST_RATE, 2.0 * fastest, 0.9 * fastest, 1.0
    ranges = {  # Least and most of each, where it begins, and its scale.
        "low": (low - span, middle, low, 0.1),
        "high": (middle, high + span, high, 0.1),
        "rate": rates,
        "skew": (-1.0, 1.0, 0.0, 0.1),
        "lag_by_load": (0.0, _LONGEST[1], 0.02, _STEPS[1]),
        "rate_by_load": (0.0, 1.0, 0.3, 0.1),
        "play": (0.0, span, 0.01, 0.01),
        "slew": rates,
        "gain": (-_MOST_GAIN, _MOST_GAIN, 1.0, 0.1),
    }

    def servo_of(numbers: np.ndarray) -> LateServo:
        own = zip(("delay", "lag", *free), map(float, numbers), strict=True)
        return LateServo(*start.limits)._replace(**dict(own))

    def errors(numbers: np.ndarray) -> np.ndarray:
        servo = servo_of(numbers)
        return np.concatenate([_lasting_errors(each, servo) for each in elevators])

    least = [-_SURE * command_std, 0.0, *(ranges[name][0] for name in free)]
    most = [*_LONGEST, *(ranges[name][1] for name in free)]
    scales = [*_STEPS, *(ranges[name][3] for name in free)]
    fits = []
    for late in (_STARTS[0], start[3:5]) if free else _STARTS:
        # Large errors weigh less: a lost command says nothing of the servo.
        found = least_squares(
            errors,
            [*late, *(ranges[name][2] for name in free)],
            bounds=(least, most),
            x_scale=scales,
            diff_step=_DIFFERENCE,
            loss="soft_l1",
            max_nfev=_MOST_TRIES,
            f_scale=_USUAL_ERROR,
        )
        fits.append(
            Fit(
                servo=servo_of(found.x),
                elevators=elevators,
                cost=cost,
                free=free,
                std=_std_of(found, elevators),
                cause=cause,
            )
        )
    return max(fits, key=lambda fit: fit.likelihood)


def _std_of(found: OptimizeResult, elevators: Sequence[Elevator]) -> float:
    """Standard error of the last number of a fit, as flights differ."""
    # SciPy's slopes are those of errors that count less where they are large.
    error = found.fun * (1.0 + (found.fun / _USUAL_ERROR) ** 2) ** 0.25
    begins = np.cumsum([0, *(len(each.rows) for each in elevators[:-1])])
    pulls = np.add.reduceat(found.jac * error[:, None], begins)
    gain = np.linalg.pinv(found.jac.T @ found.jac)[-1]
    return float(np.linalg.norm(pulls @ gain))


def restore_lost(plain: Fit, command_std: float) -> Fit:
    """Finds commands that a servo never got: it held the one before."""
    noise = plain.departures.noise
    elevators = plain.elevators
    held = [_held_instead(each, plain.servo, noise) for each in elevators]
    found = [each.given(own) for each, own in zip(elevators, held, strict=True)]
    logged = np.concatenate([each.tape.commands for each in elevators])
    is_lost = np.concatenate(held) != logged
    cost = float(np.sum(is_lost)) * math.log(len(logged) / len(elevators))
    cause = f"loses about {100.0 * np.mean(is_lost):.2g} % of its commands"
    return fit_servo(found, plain.servo, command_std, cost=cost, cause=cause)


def _held_instead(each: Elevator, servo: LateServo, noise: float) -> np.ndarray:
    """Commands (k,) of which the lost ones are those before [rad/s].

    They leave less of the angles after them, from the mean before, than noise of both.
    """
    switches, commands, _ = each.tape
    period = float(np.median(np.diff(switches)))
    for k in range(1, len(commands)):
        since = each.seen - switches[k] - servo.delay
        before = (since <= 0.0) & (since > -_BEFORE * period)
        after = (since > 0.0) & (since < _AFTER * period + servo.lag)
        if not before.any():
            continue
        held = commands.copy()
        held[k] = held[k - 1]
        left = []
        for given in (commands, held):
            error = each.angle - each.given(given).follow(each.seen, servo)
            left.append(np.sum((error[after] - np.mean(error[before])) ** 2))
        least = 2.0 * noise**2 * LEAST_EVIDENCE * (1.0 + np.sum(after) / np.sum(before))
        if left[0] - left[1] > least:
            commands = held
    return commands


def find_step(plain: Fit, command_std: float) -> Fit:
    """Fits elevators behind commands that are rounded by the steps that fit best."""
    commands = np.concatenate([each.tape.commands for each in plain.elevators])

    def behind(step: float) -> list[Elevator]:
        return [
            each.given(step * np.round(each.tape.commands / step))
            for each in plain.elevators
        ]

    # By a step that is wrong by so much, usual commands are off by a tenth of it.
    apart = 0.1 / float(np.sqrt(np.mean(commands**2)))
    least = 1.0 / float(np.max(np.abs(commands)))
    inverse = np.arange(least, 1.0 / least_step(plain), apart)
    cost = math.log(len(inverse) * _FINER**2)
    for _ in range(3):
        fits = [Fit(servo=plain.servo, elevators=behind(1.0 / i)) for i in inverse]
        best = inverse[np.argmax([fit.likelihood for fit in fits])]
        inverse = best + apart * np.linspace(-0.5, 0.5, _FINER)
        apart *= 2.0 / (_FINER - 1)
    found = behind(1.0 / best)
    cause = f"rounds its commands, in steps of {1.0 / best:.3g} rad/s"
    return fit_servo(found, plain.servo, command_std, cost=cost, cause=cause)


def least_step(plain: Fit) -> float:
    """Step of commands whose errors of rounding add up to noise in a flight [rad/s]."""
    tape = plain.elevators[0].tape
    period = float(np.median(np.diff(tape.switches)))
    noise = max(plain.departures.noise, _LEAST_NOISE)
    return noise / (period * math.sqrt(len(tape.commands) / 12.0))


def with_loads(
    campaign: Campaign, masks: Mapping[str, Masks], elevators: Sequence[Elevator]
) -> list[Elevator]:
    """Elevators with the load of the air on them, over the largest one.

    It is as |V| V·n, of the elevator's normal n and its velocity V.
    """
    usual = GliderParameters().hinge_offset
    arm = campaign.vehicle.get("hinge_offset", usual)
    flights = {flight.name: flight for flight in campaign.flights}
    logs = []
    for each in elevators:
        flight = flights[each.name]
        usable = masks_of(flight, masks).usable
        logs.append((flight.time[usable], flight.pose[usable]))
    times, poses = zip(*logs, strict=True)
    ratio = max(channel.ratio for channel in estimate_noise(times, poses))
    loads = []
    for each, (time, pose) in zip(elevators, logs, strict=True):
        curve, rate = smoothing_maps(time, each.time, ratio)[:2] @ pose
        x, z, turning = rate.T
        angle = np.interp(each.time, each.seen, each.angle)
        e = curve[:, 2] + angle
        across = x * np.sin(e) + z * np.cos(e) + arm * turning * np.cos(angle)
        loads.append(np.abs(across) * np.hypot(x, z))
    most = max(float(np.max(load)) for load in loads)
    pairs = zip(elevators, loads, strict=True)
    return [each._replace(load=load / most) for each, load in pairs]


def check_travel(campaign: Campaign, elevators: Sequence[Elevator]) -> tuple[str, ...]:
    """Warns of an elevator that turns farther or less than commanded, or refuses it.

    An elevator in another unit, or behind a gear, turns all commands into other forces.
    """
    if not elevators:
        return ()
    gain, error = _calc_travel(elevators, campaign.limits, campaign.servo.command_std)
    words = (
        f"the elevator turns {gain:.3g} times as far as commanded: expected one scale "
        "of 'elevator' and its command ('units:', or the servo's gearing as a gain)"
    )
    gain = max(gain, 1e-9)
    return claim_scale(campaign, gain, _SURELY * error / gain, _TRAVEL, words)


def _calc_travel(
    elevators: Sequence[Elevator],
    limits: Servo = NO_LIMITS,
    command_std: float = CLOCK_STD,
) -> tuple[float, float]:
    """Measured over commanded travel without its sign, and its standard error.

    It is fitted with a delay and a lag, so that a slow servo keeps it, and without
    limits: those of commands in another unit are others. Specified limits, and those
    that elevators reach, excuse a gain that is not one, if they fit clearly better. The
    error is what flights scatter by; it is infinite if the lag is too long.
    """
    shown = [elevator for elevator in elevators if len(elevator.rows) > _FEWEST_ROWS]
    if not shown:
        return 0.0, math.inf
    few = shown[:: max(1, len(shown) // _FEW)]
    _, delay = calc_correlation(few)
    late = min(max(0.0, delay), _LONGEST[0])  # Not nan.
    fit_gain = functools.partial(
        fit_servo, few, command_std=command_std, free=("gain",)
    )
    free = fit_gain(LateServo(*NO_LIMITS, late))
    off = abs(abs(free.servo.gain) - 1.0)
    excuses = []
    if off >= _TRAVEL[0]:  # Else it needs none.
        excuses = [fit_gain(LateServo(*own, late)) for own in (limits, _reached(few))]
    clearly = [f for f in excuses if f.likelihood > free.likelihood + LEAST_EVIDENCE]
    nearer = [fit for fit in clearly if abs(abs(fit.servo.gain) - 1.0) < off]
    servo = max([free, *nearer], key=lambda fit: fit.likelihood).servo
    gain = abs(servo.gain)
    error = _SCATTER / math.sqrt(len(few))
    return gain, math.inf if servo.lag > _LONGEST_LAG and gain <= 1.0 else error


def _reached(elevators: Sequence[Elevator]) -> Servo:
    """Limits that elevators reach: where they end, and how fast they turn."""
    angles = np.concatenate([each.angle for each in elevators])
    changes = [np.diff(windows_of(each)[1], axis=0) for each in elevators]
    fastest = float(np.max(np.abs(np.concatenate(changes, axis=1)))) / WINDOW
    return Servo(float(np.min(angles)), float(np.max(angles)), fastest)
