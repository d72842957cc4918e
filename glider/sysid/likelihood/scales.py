"""Standard deviations of sensors, moving air and flight-to-flight variation."""

import dataclasses
from collections.abc import Sequence
from typing import Any, NamedTuple, TypeVar

import numpy as np

from glider.compiled.filter_error import (
    OWN_STATES,
    PROCESSES,
    filter_flight,
    score_flight,
    smooth_flight,
)
from glider.compiled.parallel import in_parallel
from glider.compiled.theta import OFFSET
from glider.physics.state import NUM_STATES
from glider.sysid.constants import (
    FEW_FLIGHTS,
    LAUNCH_SPREAD,
    MOMENT_TIME,
    NOISE,
    SERVO_TIME,
    STATE_SPREAD,
)
from glider.sysid.likelihood.information import solve_scaled
from glider.sysid.likelihood.linear_flight import LinearFlight, Surroundings
from glider.sysid.replay.record import Noise

_AT_FLOOR = 2.0  # Over the least scale, which a fit only comes near.
_LEAST_ELEVATOR = 1e-4  # Least noise of an elevator, where there is none [rad].
_MOST_DAMPING = 1e4  # Damping of a step of the scales beyond which none gains.
_FAR = 3.0  # Standard deviations beyond which no constant or gust of a flight is found.
_STEP_OF_LOG = 1e-3  # Step of a scale's logarithm for slopes.
_LARGEST_STEP = 0.7  # Of a logarithm: a scale at most doubles.
_LEAST_FISHER = 1e-3  # Information on a logarithm that there always is.

Flight = TypeVar("Flight")


def _scale(name: str) -> Any:
    """A scale where it starts, and its range."""
    usual, least, most = NOISE[name]
    return dataclasses.field(default=usual, metadata={"range": (least, most)})


@dataclasses.dataclass(frozen=True, kw_only=True)
class Scales:
    """Standard deviations of all noise."""

    position: float = _scale("position")  #: Of measured x and z [m].
    pitch: float = _scale("pitch")  #: Of measured pitch [rad].
    elevator: float = _scale("elevator")  #: Of the measured elevator [rad].
    air: float = _scale("air")  #: Of the moving air, in x and in z [m/s].
    air_time: float = _scale("air_time")  #: Its correlation time [s].
    moment: float = _scale("moment")  #: Of unmodelled accelerations [rad/s²].
    servo: float = _scale("servo")  #: Of the elevator off its path [rad].
    wind: float = _scale("wind")  #: Of flights' steady winds, x and z [m/s].
    trim: float = _scale("trim")  #: Of their elevator trims [rad].
    pitch_zero: float = _scale("pitch_zero")  #: Of their pitch readings [rad].
    rate: float = _scale("rate")  #: Of the pitch rate of a gyro [rad/s].

    @property
    def logs(self) -> np.ndarray:
        """Natural logarithms, in the order of the fields."""
        return np.log(np.array(dataclasses.astuple(self)))

    @property
    def is_still(self) -> bool:
        """Whether the air is."""
        return self.air < _AT_FLOOR * FLOOR.air

    @property
    def of_flights(self) -> np.ndarray:
        """Of flights' constants: wind in x and z, trim and pitch zero."""
        return np.array([self.wind, self.wind, self.trim, self.pitch_zero])

    @property
    def sensors(self) -> tuple[float, float, float, float, float]:
        """Of measured x, z, pitch, elevator and pitch rate."""
        return self.position, self.position, self.pitch, self.elevator, self.rate

    @property
    def times(self) -> tuple[float, float, float, float]:
        """Correlation times of the processes [s], in the filter's order."""
        return self.air_time, self.air_time, MOMENT_TIME, SERVO_TIME

    @classmethod
    def from_logs(cls, logs: np.ndarray) -> "Scales":
        """Returns the scales of such logarithms."""
        return cls(**dict(zip(NAMES, map(float, np.exp(logs)), strict=True)))


NAMES = tuple(field.name for field in dataclasses.fields(Scales))
FLOOR, CEILING = (
    Scales(**{f.name: f.metadata["range"][end] for f in dataclasses.fields(Scales)})
    for end in (0, 1)
)
# Prior of the logarithms. Flights in nearly still air do not determine the gusts' time:
# its range is two standard deviations either way. The others have none.
_USUAL = Scales().logs
_PRECISION = np.where(
    np.array(NAMES) == "air_time", (0.25 * (CEILING.logs - FLOOR.logs)) ** -2.0, 0.0
)


def lifted(scales: Scales) -> Scales:
    """Returns scales at least halfway to their usual ones, in logarithms.

    A fit that begins with little noise keeps to the errors of the model before it.
    """
    least = np.where(_PRECISION == 0.0, 0.5 * (FLOOR.logs + _USUAL), -np.inf)
    return Scales.from_logs(np.maximum(scales.logs, least))


def start_scales(noise: Noise) -> Scales:
    """Start of a fit of the scales: little more than sensor noise."""
    return Scales(
        position=noise.position,
        pitch=noise.pitch,
        elevator=max(noise.elevator, _LEAST_ELEVATOR),
    )


class WhitenedFlight(NamedTuple):
    """A flight whitened."""

    innovations: np.ndarray  #: (K + 1, C, m) over their standard deviations.
    log_variances: np.ndarray  #: (K + 1, C) of them; 0 where nothing was seen.

    @property
    def cost(self) -> float:
        """Negative log-likelihood of a single column [nats]."""
        with np.errstate(over="ignore"):  # A model may diverge.
            squares = float(np.sum(self.innovations**2))
        return 0.5 * (squares + float(self.log_variances.sum()))

    @property
    def gram(self) -> np.ndarray:
        """Squares of the columns: the flight's information, (m, m)."""
        flat = self.innovations.reshape(-1, self.innovations.shape[2])
        with np.errstate(over="ignore", invalid="ignore"):  # A model may diverge.
            return flat.T @ flat


def start_variances(flight: LinearFlight, scales: Scales) -> np.ndarray:
    """Returns those of the deviations at the first node, in the filter's order."""
    s, record = scales, flight.record
    launch, servo = np.array(LAUNCH_SPREAD), s.servo
    if not record.has_servo:
        launch[OFFSET], servo = 1e-6, 0.0
    own = (s.air, s.air, s.moment, servo, s.wind, s.wind, s.trim, s.pitch_zero)
    extra = STATE_SPREAD * record.layout.state_scale[flight.states[NUM_STATES:]]
    return np.square(np.concatenate([launch, extra, own]))


def whiten(
    flight: LinearFlight, scales: Scales, start: np.ndarray | None = None
) -> WhitenedFlight:
    """Filters a flight; the start's variances are given where they are others."""
    if start is None:
        start = start_variances(flight, scales)
    arguments = _filter_arguments(flight.whole(), scales, start, 0)
    filter_flight(*arguments)
    return WhitenedFlight(arguments[13], np.log(arguments[14]))


def _filter_arguments(
    flight: LinearFlight, scales: Scales, start: np.ndarray, smoothed: int
) -> tuple[np.ndarray, ...]:
    """Arguments of `filter_columns`, with so many nodes to be smoothed."""
    record, n = flight.record, flight.by_x.shape[1]
    usual, channels = start_variances(flight, scales), record.seen.shape[1]
    return (
        *(record.time, flight.by_x, flight.by_air, flight.by_trim, flight.inputs),
        *(flight.pose_by_x, flight.outputs, record.seen),
        np.square(scales.sensors[:channels]),
        start,
        flight.start.copy(),
        1.0 / np.array(scales.times),
        usual[n : n + PROCESSES],
        *(np.empty(flight.outputs.shape), np.empty(record.seen.shape)),
        np.empty((smoothed, channels, n + OWN_STATES)),
        np.empty((smoothed, 2, n + OWN_STATES + 1)),
    )


class Smoothed(NamedTuple):
    """What all rows of a flight of one column say of it."""

    start: np.ndarray  #: (n + 8,) deviations at the first node, then the constants.
    gusts: np.ndarray  #: (K, 2) mean velocities of the moving air in intervals [m/s].


def smooth(flight: LinearFlight, scales: Scales) -> Smoothed:
    """Smooths a flight of one column, its error."""
    start = start_variances(flight, scales)
    arguments = _filter_arguments(flight, scales, start, len(flight.record.time))
    adjoint = np.zeros(len(flight.start))
    smooth_flight(adjoint, *arguments)
    gusts = arguments[16][:, :, -1]
    return Smoothed(start * adjoint, 0.5 * (gusts[1:] + gusts[:-1]))


def excludes(scales: Scales, about: Surroundings) -> bool:
    """Whether scales exclude what a flight is linear about, however it was found.

    The flight's likelihood is wrong then: it is linear in what is far away.
    """
    most = 2.0 * _FAR  # Scales may halve before others are found.
    is_far = np.abs(about.constants) > most * scales.of_flights
    return bool(is_far.any()) or bool(np.abs(about.gusts).max() > most * scales.air)


PER_FLIGHT = (
    *(("wind", "x"), ("wind", "z")),
    *(("elevator_trim", "angle"), ("pitch_offset", "angle")),
)
"""Coefficients that may vary from flight to flight, as columns of `flight_values`."""


def flight_values(flights: Sequence[LinearFlight], scales: Scales) -> np.ndarray:
    """Returns flights' winds (x, z) [m/s], trims and pitch offsets [rad], (F, 4)."""
    starts = in_parallel(lambda f: smooth(f, scales).start, flights)
    return np.array(starts)[:, -len(PER_FLIGHT) :]


def surroundings_of(
    flights: Sequence[LinearFlight], scales: Scales
) -> dict[str, Surroundings]:
    """Returns each flight's constants and gusts, given all its rows, by its name."""
    largest = _FAR * scales.of_flights

    def one(flight: LinearFlight) -> Surroundings:
        start, gusts = smooth(flight, scales)
        own = np.clip(start[-len(largest) :], -largest, largest)
        return Surroundings(own, np.clip(gusts, -_FAR * scales.air, _FAR * scales.air))

    found = in_parallel(one, flights)
    return {f.record.name: own for f, own in zip(flights, found, strict=True)}


def negative_log_likelihood(
    flights: Sequence[LinearFlight], scales: Scales
) -> np.ndarray:
    """Returns each flight's, at its single column (flights,) [nats]."""
    return np.array(in_parallel(lambda f: whiten(f, scales).cost, flights))


def typical_flights(flights: Sequence[Flight]) -> Sequence[Flight]:
    """About FEW_FLIGHTS of many, evenly picked."""
    return flights[:: max(1, len(flights) // FEW_FLIGHTS)]


class FittedScales(NamedTuple):
    """Scales of the greatest likelihood."""

    scales: Scales
    cost: float  #: Negative log-likelihood there [nats].
    #: Second derivatives by the logarithms of all scales, for another fit.
    curvature: np.ndarray | None


def fit_scales(
    flights: Sequence[LinearFlight],
    scales: Scales,
    free: Sequence[str] = NAMES,
    iterations: int = 8,
    tolerance: float = 0.05,
    curvature: np.ndarray | None = None,
) -> FittedScales:
    """Maximises the likelihood of the scales by Fisher scoring, damped.

    Those in `free` are fitted to flights with one column, their error, until less than
    `tolerance` would be gained [nats]. The slopes are exact; the information is that of
    a few flights, at scales nearby, which suffices.
    """
    has_gyro = any(flight.record.seen.shape[1] > 4 for flight in flights)
    shown = [name for name in free if has_gyro or name != "rate"]
    index = np.array([NAMES.index(name) for name in shown], dtype=int)
    low, high = FLOOR.logs, CEILING.logs
    logs, damping = np.clip(scales.logs, low, high), 0.0
    value, slopes = _score(flights, logs)
    begins = bool(flights) and np.isfinite(value)  # Else there is none, or it diverges.
    for _ in range(iterations if begins else 0):
        gradient = slopes[index]
        has_room = np.where(gradient > 0.0, (logs > low)[index], (logs < high)[index])
        if not has_room.any():
            break
        own, gradient = index[has_room], gradient[has_room]
        if curvature is None:
            curvature = _information(flights, logs, index)
        fisher = curvature[np.ix_(own, own)]
        if not np.all(np.isfinite(fisher)):
            curvature = None
            break
        fisher += np.diag(_PRECISION[own] + _LEAST_FISHER)
        gained = 0.0
        while damping <= _MOST_DAMPING:
            step, moved = solve_scaled(fisher, gradient, damping + 1e-6), logs.copy()
            moved[own] -= np.clip(step, -_LARGEST_STEP, _LARGEST_STEP)
            moved = np.clip(moved, low, high)
            promised = float(gradient @ (logs - moved)[own])
            if promised < tolerance:
                break
            lower, there = _score(flights, moved)
            if lower < value:
                step = moved - logs
                change = there - slopes - _PRECISION * step
                is_far = np.abs(step).max() >= _LARGEST_STEP
                curvature = None if is_far else _updated(curvature, step, change)
                gained, slopes, logs, value = value - lower, there, moved, lower
                damping = 0.1 * damping if damping > 1e-2 else 0.0
                break
            damping = max(10.0 * damping, 0.1)
        if gained < tolerance:
            break
    return FittedScales(Scales.from_logs(logs), value, curvature)


def _score(
    flights: Sequence[LinearFlight], logs: np.ndarray
) -> tuple[float, np.ndarray]:
    """Returns the cost of such scales with their prior [nats], and its slopes."""
    scales = Scales.from_logs(logs)
    found = in_parallel(lambda f: score(f, scales), flights)
    apart = logs - _USUAL
    return (
        0.5 * float(_PRECISION @ apart**2) + sum(cost for cost, _ in found),
        _PRECISION * apart + sum(slopes for _, slopes in found),
    )


def score(flight: LinearFlight, scales: Scales) -> tuple[float, np.ndarray]:
    """Returns the cost of a flight of one column [nats], and its slopes by `logs`."""
    start, n = start_variances(flight, scales), flight.by_x.shape[1]
    arguments = _filter_arguments(flight, scales, start, len(flight.record.time))
    by_sensor, by_start = np.empty_like(arguments[8]), np.empty_like(start)
    by_power, by_time = np.empty(PROCESSES), np.empty(2)
    with np.errstate(over="ignore", invalid="ignore"):  # A model may diverge.
        score_flight(by_sensor, by_start, by_power, by_time, *arguments)
        sensors = np.zeros(5)
        sensors[: len(by_sensor)] = 2.0 * arguments[8] * by_sensor
        by_start[n : n + PROCESSES] += by_power
        air, air_z, moment, servo, *constants = 2.0 * (start * by_start)[n:]
    by_name = {
        "position": sensors[0] + sensors[1],
        "pitch": sensors[2],
        "elevator": sensors[3],
        "air": air + air_z,
        "air_time": by_time.sum(),
        "moment": moment,
        "servo": servo,
        "wind": constants[0] + constants[1],
        "trim": constants[2],
        "pitch_zero": constants[3],
        "rate": sensors[4],
    }
    cost = WhitenedFlight(arguments[13], np.log(arguments[14])).cost
    return cost, np.array([by_name[name] for name in NAMES])


def _information(
    flights: Sequence[LinearFlight], logs: np.ndarray, index: np.ndarray
) -> np.ndarray:
    """Returns the information of flights on logarithms of some scales, of a few."""
    steps = _STEP_OF_LOG * np.eye(len(logs))[index]
    moved, scales = [Scales.from_logs(logs + s) for s in steps], Scales.from_logs(logs)
    few = typical_flights(flights)

    def one(flight: LinearFlight) -> np.ndarray:
        base = whiten(flight, scales)
        others = [whiten(flight, own) for own in moved]
        w = base.innovations.ravel()
        with np.errstate(over="ignore", invalid="ignore"):  # A model may diverge.
            by_w = np.array([f.innovations.ravel() - w for f in others]) / _STEP_OF_LOG
            by_v = [(f.log_variances - base.log_variances).ravel() for f in others]
            half = 0.5 * np.array(by_v) / _STEP_OF_LOG
            mean = by_w + half * w
            return mean @ mean.T + 2.0 * half @ half.T

    matrix = np.zeros((len(logs), len(logs)))
    total = np.sum(in_parallel(one, few), axis=0)
    matrix[np.ix_(index, index)] = total * (len(flights) / len(few))
    return matrix


def _updated(matrix: np.ndarray, step: np.ndarray, change: np.ndarray) -> np.ndarray:
    """Returns second derivatives that explain the change of a gradient (BFGS)."""
    expected = matrix @ step
    along, before = float(step @ change), float(step @ expected)
    if not (along > 1e-9 and before > 1e-9):
        return matrix
    return (
        matrix
        - np.outer(expected, expected) / before
        + np.outer(change, change) / along
    )
