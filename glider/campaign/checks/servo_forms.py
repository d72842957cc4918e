"""Forms of servos, fitted to measured elevators.

`fit_servo` fits the delay and lag of a servo, and the other numbers of a form, to the
angles of all flights by robust least squares. `restore_lost` and `find_step` change the
commands instead: some never reached the servo, or it rounds them. Each returns a `Fit`,
and forms are compared by its `likelihood`: that of the angles, where departures from
the servo may be any smooth curve, less what the freedom of the form costs.
"""

import dataclasses
import functools
import math
from collections.abc import Mapping, Sequence

import numpy as np
from scipy.optimize import OptimizeResult, least_squares

from glider.campaign.checks.masks import Masks, masks_of
from glider.campaign.checks.servo import Elevator, LateServo
from glider.campaign.logs import Campaign
from glider.campaign.smoothing import Smoothing, estimate_noise, smoothing_maps
from glider.physics.parameters import GliderParameters

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
_LONGEST_DELAY = 0.3  # Of a servo that is fitted [s].
_LONGEST_LAG = 0.5  # ... [s].
_STEP = 0.01  # Scale of delays and lags [s].
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
# Noise of measured angles, of which computed ones have none [rad] (c): finer steps are
# not searched for.
_LEAST_NOISE = 5e-4


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class Fit:
    """A form of a servo, fitted to elevators.

    Attributes:
        servo: the fitted one.
        elevators: those of the flights, with the commands that reached the servo.
        cost: of what was chosen beside delay, lag and `free` [nats].
        free: names of the numbers of the servo that were fitted beside delay and lag.
        std: standard error of the last of them, from the scatter over flights.
        cause: why elevators depart from a plain servo, in words.
    """

    servo: LateServo
    elevators: Sequence[Elevator]
    cost: float = 0.0
    free: tuple[str, ...] = ()
    std: float = 0.0
    cause: str = ""

    def on(self, places: Sequence[int]) -> "Fit":
        """Returns the same fit with some of the elevators."""
        few = [self.elevators[place] for place in places]
        return dataclasses.replace(self, elevators=few)

    @functools.cached_property
    def departures(self) -> Smoothing:
        """Smooth departures of the elevators from the servo, and the noise."""
        times = [each.seen for each in self.elevators]
        errors = [_lasting_errors(e, self.servo)[:, None] for e in self.elevators]
        return estimate_noise(times, errors, ORDER)[0]

    @property
    def commands(self) -> np.ndarray:
        """Commands (k,) of all elevators [rad/s]."""
        return np.concatenate([each.tape.commands for each in self.elevators])

    @property
    def explains(self) -> bool:
        """Whether elevators are off by noise alone."""
        return self.departures.evidence < LEAST_EVIDENCE

    @property
    def likelihood(self) -> float:
        """Log-likelihood of the angles less the cost of the form's freedom [nats].

        Each free number costs ½ log n, with n rows in all (BIC).
        """
        rows = sum(len(each.rows) for each in self.elevators)
        freedom = 0.5 * len(self.free) * math.log(rows)
        return self.departures.log_likelihood - freedom - self.cost


def follow_from_rest(elevator: Elevator, servo: LateServo) -> tuple[float, np.ndarray]:
    """Finds where an elevator rested, and the angles that a servo then expects.

    The tape has the angle that was logged first. A path that meets no stop may begin
    there: noise of that angle shifts all of it, as a constant does. Behind a stop the
    shift is lost, so that the rest is corrected by the median error up to the first.

    Returns:
        The angle at rest [rad], and the path (m,) at the times of the angles [rad].
    """
    rest = elevator.tape.rest
    path = elevator.follow(elevator.seen, servo)
    moves_freely = path > servo.low + _NEAR_STOP
    moves_freely &= path < servo.high - _NEAR_STOP
    before_stops = np.logical_and.accumulate(moves_freely)
    if before_stops.all() or not before_stops.any():
        return rest, path

    error = elevator.angle - path
    rest += float(np.median(error[before_stops]))
    return rest, elevator.follow(elevator.seen, servo, rest)


def _lasting_errors(elevator: Elevator, servo: LateServo) -> np.ndarray:
    """Returns measured minus expected angles (m,) that last and change [rad].

    Two things are removed by linear regression: a constant, and what a lag makes of a
    first command that came late, exp(-t / lag).
    """
    _, path = follow_from_rest(elevator, servo)
    since = elevator.seen - elevator.tape.switches[0]
    fading = np.exp(-since / max(servo.lag, _SHORTEST_LAG))
    fading -= fading.mean()
    square = fading @ fading

    error = elevator.angle - path
    error -= error.mean()
    if square > 0.0:
        error -= fading * ((fading @ error) / square)
    return error


def fit_servo(
    elevators: Sequence[Elevator],
    start: LateServo,
    command_std: float,
    free: tuple[str, ...] = (),
    cost: float = 0.0,
    cause: str = "",
) -> Fit:
    """Fits the delay and lag of a servo, and other numbers of it that are free.

    Large errors weigh less (soft L1): a lost command says nothing of the servo. Of the
    fits from several starts the likeliest is returned.

    Args:
        elevators: of the flights, with their commands.
        start: its limits are kept where they are not free; with free numbers, a second
            fit begins with its delay and lag.
        command_std: standard error of the commands' clock [s], by which they may be
            late.
        free: names of the numbers to fit beside delay and lag.
        cost: see `Fit`.
        cause: see `Fit`.
    """
    names = ("delay", "lag", *free)
    ranges = _ranges_of(elevators, command_std)
    least, most, begin, scales = np.transpose([ranges[name] for name in names])

    def servo_of(numbers: np.ndarray) -> LateServo:
        own = dict(zip(names, numbers.tolist(), strict=True))
        return LateServo(*start.limits)._replace(**own)

    def errors(numbers: np.ndarray) -> np.ndarray:
        servo = servo_of(numbers)
        return np.concatenate([_lasting_errors(each, servo) for each in elevators])

    starts = _STARTS
    if free:
        starts = _STARTS[0], (start.delay, start.lag)
    fits = []
    for late in starts:
        begin[:2] = np.clip(late, least[:2], most[:2])
        found = least_squares(
            errors,
            begin,
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


def _ranges_of(
    elevators: Sequence[Elevator], command_std: float
) -> dict[str, tuple[float, ...]]:
    """Returns least, most, start and scale of each number of a servo, by its name.

    Limits start where the measured angles and the commands end.
    """
    angles = np.concatenate([each.angle for each in elevators])
    commands = np.concatenate([each.tape.commands for each in elevators])
    low = angles.min()
    high = angles.max()
    middle = 0.5 * (low + high)
    span = high - low
    fastest = np.abs(commands).max()
    rates = _LEAST_RATE, 2.0 * fastest, 0.9 * fastest, 1.0
    return {
        "delay": (-_SURE * command_std, _LONGEST_DELAY, 0.0, _STEP),
        "lag": (0.0, _LONGEST_LAG, 0.0, _STEP),
        "low": (low - span, middle, low, 0.1),
        "high": (middle, high + span, high, 0.1),
        "rate": rates,
        "skew": (-1.0, 1.0, 0.0, 0.1),
        "lag_by_load": (0.0, _LONGEST_LAG, 0.02, _STEP),
        "rate_by_load": (0.0, 1.0, 0.3, 0.1),
        "play": (0.0, span, 0.01, 0.01),
        "slew": rates,
        "gain": (-_MOST_GAIN, _MOST_GAIN, 1.0, 0.1),
    }


def _std_of(found: OptimizeResult, elevators: Sequence[Elevator]) -> float:
    """Returns the standard error of the last number of a fit, as flights differ.

    The sandwich estimator, clustered by flights: with J the slopes, e the errors and
    p_i = J_i' e_i the pull of flight i, it is the root of Σ ([(J'J)⁻¹ p_i]_last)².

    Args:
        found: what SciPy returns of the fit, its rows those of all elevators in turn.
        elevators: of the flights.
    """
    # SciPy's J has rows scaled for soft L1; these errors give its gradient with them.
    error = found.fun * (1.0 + (found.fun / _USUAL_ERROR) ** 2) ** 0.25
    rows = [len(each.rows) for each in elevators]
    first_rows = np.cumsum([0, *rows[:-1]])
    pulls = np.add.reduceat(found.jac * error[:, None], first_rows)
    gain = np.linalg.pinv(found.jac.T @ found.jac)[-1]
    return float(np.linalg.norm(pulls @ gain))


def restore_lost(plain: Fit, command_std: float) -> Fit:
    """Finds commands that a servo never got, when it held the one before.

    Each of the lost commands costs the logarithm of how many a flight has: which one
    it is might be anything.

    Args:
        plain: the servo, fitted behind the logged commands.
        command_std: see `fit_servo`.
    """
    noise = plain.departures.noise
    elevators = [_hold_lost(each, plain.servo, noise) for each in plain.elevators]
    restored = dataclasses.replace(plain, elevators=elevators)
    is_lost = restored.commands != plain.commands
    cost = is_lost.sum() * math.log(len(is_lost) / len(elevators))
    cause = f"loses about {100.0 * is_lost.mean():.2g} % of its commands"
    return fit_servo(elevators, plain.servo, command_std, cost=cost, cause=cause)


def _hold_lost(elevator: Elevator, servo: LateServo, noise: float) -> Elevator:
    """Returns an elevator behind commands whose lost ones are those before them.

    A command is lost if the path with the one before held leaves clearly smaller errors
    after it: the sum of their squares, from the mean error just before, falls by more
    than noise [rad] of both means explains.
    """
    switches = elevator.tape.switches
    period = np.median(np.diff(switches))
    for k in range(1, len(switches)):
        since = elevator.seen - switches[k] - servo.delay
        before = (since <= 0.0) & (since > -_BEFORE * period)
        after = (since > 0.0) & (since < _AFTER * period + servo.lag)
        if not before.any():
            continue

        commands = elevator.tape.commands.copy()
        commands[k] = commands[k - 1]
        held = elevator.given(commands)
        left = []
        for each in (elevator, held):
            error = each.angle - each.follow(each.seen, servo)
            change = error[after] - error[before].mean()
            left.append(np.sum(change**2))
        of_both = 1.0 + after.sum() / before.sum()
        if left[0] - left[1] > 2.0 * noise**2 * LEAST_EVIDENCE * of_both:
            elevator = held
    return elevator


def find_step(plain: Fit, command_std: float) -> Fit:
    """Finds the step to which a servo rounds its commands.

    A grid of inverse steps, which is made finer about the best one twice, is tried with
    the servo as it is; then it is fitted behind the rounded commands.
    """
    # By a step that is wrong by so much, usual commands are off by a tenth of it.
    apart = 0.1 / np.sqrt((plain.commands**2).mean())
    least = 1.0 / np.abs(plain.commands).max()
    inverse = np.arange(least, 1.0 / least_step(plain), apart)
    cost = math.log(len(inverse) * _FINER**2)
    for _ in range(3):
        fits = [
            Fit(servo=plain.servo, elevators=_rounded(plain.elevators, 1.0 / i))
            for i in inverse
        ]
        best = inverse[np.argmax([fit.likelihood for fit in fits])]
        inverse = best + apart * np.linspace(-0.5, 0.5, _FINER)
        apart *= 2.0 / (_FINER - 1)

    step = 1.0 / best
    found = _rounded(plain.elevators, step)
    cause = f"rounds its commands, in steps of {step:.3g} rad/s"
    return fit_servo(found, plain.servo, command_std, cost=cost, cause=cause)


def _rounded(elevators: Sequence[Elevator], step: float) -> list[Elevator]:
    """Returns elevators behind commands that are multiples of a step [rad/s]."""
    rounded = []
    for each in elevators:
        commands = step * np.round(each.tape.commands / step)
        rounded.append(each.given(commands))
    return rounded


def least_step(plain: Fit) -> float:
    """Returns the finest step of commands that angles can show [rad/s].

    The errors of rounding, uniform and so of variance step² / 12, add up to the noise
    of the angles within a flight.
    """
    tape = plain.elevators[0].tape
    period = np.median(np.diff(tape.switches))
    noise = max(plain.departures.noise, _LEAST_NOISE)
    return noise / (period * math.sqrt(len(tape.commands) / 12.0))


def with_loads(
    campaign: Campaign, masks: Mapping[str, Masks], elevators: Sequence[Elevator]
) -> list[Elevator]:
    """Returns elevators with the load of the air on them, over the largest of all.

    Velocities are those of smoothed poses, all smoothed as the channel that moves most
    against its noise.
    """
    flights = {flight.name: flight for flight in campaign.flights}
    usual = GliderParameters().hinge_offset
    arm = campaign.vehicle.get("hinge_offset", usual)
    times = []
    poses = []
    for each in elevators:
        flight = flights[each.name]
        usable = masks_of(flight, masks).usable
        times.append(flight.time[usable])
        poses.append(flight.pose[usable])

    ratio = max(channel.ratio for channel in estimate_noise(times, poses))
    loads = []
    for each, time, pose in zip(elevators, times, poses, strict=True):
        curve, rate = smoothing_maps(time, each.time, ratio)[:2] @ pose
        loads.append(_calc_load(each, curve[:, 2], rate, arm))
    largest = np.concatenate(loads).max()
    return [
        each._replace(load=load / largest)
        for each, load in zip(elevators, loads, strict=True)
    ]


def _calc_load(
    elevator: Elevator, pitch: np.ndarray, rate: np.ndarray, arm: float
) -> np.ndarray:
    """Returns the load (n,) of the air on an elevator, |V| |V · n| [m²/s²].

    V is the velocity of the glider, in V · n that of the hinge; n is the elevator's
    normal.

    Args:
        elevator: the measured one, at n rows.
        pitch: (n,) [rad].
        rate: (n, 3) of x [m/s], z [m/s] and pitch [rad/s].
        arm: distance of the hinge from the center of mass [m].
    """
    x_rate, z_rate, pitch_rate = rate.T
    angle = np.interp(elevator.time, elevator.seen, elevator.angle)
    attitude = pitch + angle
    across = x_rate * np.sin(attitude) + z_rate * np.cos(attitude)
    across += arm * pitch_rate * np.cos(angle)
    return np.abs(across) * np.hypot(x_rate, z_rate)
