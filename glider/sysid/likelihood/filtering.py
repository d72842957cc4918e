"""Flights filtered and smoothed: their likelihood, and what they say of themselves.

`whiten` filters a linear flight under some scales of the noise; the squares of what
comes out are its likelihood, or its information on coefficients. Flights of one column,
their error, can be smoothed too: `smooth` estimates their constants and gusts, `score`
the slopes of their likelihood by the scales.
"""

import itertools
import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from glider.compiled.filter_error import (
    OWN_STATES,
    PROCESSES,
    FilterArrays,
    filter_flight,
    smooth_flight,
)
from glider.compiled.parallel import in_parallel
from glider.compiled.replay import OFFSET
from glider.physics.effects import LIBRARY
from glider.physics.state import NUM_STATES
from glider.sysid.constants import LAUNCH_SPREAD, Z
from glider.sysid.likelihood.linear_flight import LinearFlight, Surroundings
from glider.sysid.likelihood.scales import NAMES, Scales
from glider.sysid.replay.record import Record

_FAR = 3.0  # Standard deviations beyond which no constant or gust of a flight is found.


class _WhitenedFlight(NamedTuple):
    """The innovations of a flight of m columns.

    Attributes:
        innovations: (K + 1, C, m) over their standard deviations.
        log_variances: (K + 1, C) logarithms of their variances; 0 where nothing was
            seen.
    """

    innovations: np.ndarray
    log_variances: np.ndarray

    @property
    def cost(self) -> float:
        """Negative log-likelihood of a single column [nats], but for a constant.

        ½ Σ (e² + log s) of innovations e and their variances s.
        """
        with np.errstate(over="ignore"):  # A model may diverge.
            squares = float(np.sum(self.innovations**2))
        return 0.5 * (squares + float(self.log_variances.sum()))

    @property
    def gram(self) -> np.ndarray:
        """Squares of the columns: the flight's information, (m, m)."""
        flat = self.innovations.reshape(-1, self.innovations.shape[2])
        with np.errstate(over="ignore", invalid="ignore"):  # A model may diverge.
            return flat.T @ flat


def _rests(record: Record, scales: Scales) -> bool:
    """Whether a flight's elevator began where those of the others rest.

    One that was logged far from there was moving; so may one whose log is cut.
    """
    if record.is_cut or not record.has_servo:
        return False
    most = Z * (scales.elevator**2 + scales.rest**2) ** 0.5
    return abs(record.rest - record.usual_rest) < most


def start_variances(flight: LinearFlight, scales: Scales) -> np.ndarray:
    """Returns the prior variances of the deviations at the first node, (n + 8,).

    They are in the order of the filter, see `linear_flight`.
    """
    s = scales
    record = flight.record

    # An elevator that began elsewhere than others rest may be as far from its reading.
    rest = s.rest
    if not _rests(record, s):
        rest = abs(record.rest - record.usual_rest)
        if record.is_cut:  # It was logged with noise.
            rest = max(rest, Z * Scales.elevator)

    servo = math.hypot(s.servo, record.departure_std)
    if not record.has_servo:
        rest = 1e-6
        servo = 0.0

    launch = [*LAUNCH_SPREAD]
    launch[OFFSET] = rest
    extra = s.memory * record.space.state_scale[flight.states[NUM_STATES:]]
    own = (s.air, s.air, s.moment, servo, s.wind, s.wind, s.trim, s.pitch_zero)
    return np.square([*launch, *extra, *own])


def whiten(
    flight: LinearFlight, scales: Scales, start: np.ndarray | None = None
) -> _WhitenedFlight:
    """Filters a flight: its errors less what the rows before predict of them.

    Args:
        flight: of any number of columns.
        scales: of the noise.
        start: variances of the deviations at the first node, (n + 8,); by default
            those of `start_variances`.
    """
    arrays = _filter(flight, scales, start)
    return _WhitenedFlight(arrays.innovations, np.log(arrays.variances))


def _filter(
    flight: LinearFlight,
    scales: Scales,
    start: np.ndarray | None = None,
    smoothed: int = 0,
) -> FilterArrays:
    """Filters a flight.

    Args:
        flight, scales, start: those of `whiten`.
        smoothed: number of nodes to be smoothed: all, or none.
    """
    flight = flight.expanded()
    record = flight.record
    n = len(flight.states)
    usual = start_variances(flight, scales)
    arrays = FilterArrays(
        times=record.time,
        moves=flight.moves,
        inputs=flight.inputs,
        shows=flight.shows,
        outputs=flight.outputs,
        seen=record.seen,
        variance=np.square(scales.sensors),
        start=usual if start is None else start,
        mean=flight.start.copy(),
        rates=1.0 / np.array(scales.times),
        powers=usual[n : n + PROCESSES],
        innovations=np.empty(flight.outputs.shape),
        variances=np.empty(record.seen.shape),
        gains=np.empty((smoothed, len(scales.sensors), n + OWN_STATES)),
        airs=np.empty((smoothed, 2, n + OWN_STATES + 1)),
    )
    filter_flight(*arrays)
    return arrays


class _Smoothed(NamedTuple):
    """What all rows of a flight of one column say of it.

    Attributes:
        start: (n + 8,) expected deviations at the first node; the last four are the
            constants of the flight.
        gusts: (K, 2) mean velocities of the moving air in intervals [m/s].
    """

    start: np.ndarray
    gusts: np.ndarray


def smooth(flight: LinearFlight, scales: Scales) -> _Smoothed:
    """Smooths a flight of one column, its error."""
    arrays, *_, adjoint = _traced_back(flight, scales)
    gusts = arrays.airs[:, :, -1]
    return _Smoothed(arrays.start * adjoint, 0.5 * (gusts[1:] + gusts[:-1]))


def _traced_back(flight, scales):
    """Returns a flight's arrays, smoothed, and what `smooth_flight` writes beside them.

    That is, in its order: slopes of the cost by the variances of sensors (C,), of the
    start (n + 8,) and of the processes (4,), by the gusts' times (2,); the adjoint of
    the first node (n + 8,).
    """
    arrays = _filter(flight, scales, smoothed=len(flight.record.time))
    found = (
        np.empty_like(arrays.variance),
        np.empty_like(arrays.start),
        np.empty(PROCESSES),
        np.empty(2),
        np.empty_like(arrays.start),
    )
    smooth_flight(*found, *arrays)
    return arrays, *found


def excludes(scales: Scales, about: Surroundings) -> bool:
    """Whether scales exclude what a flight is linear about, however it was found.

    The flight's likelihood is wrong then: it is linear in what is far away.
    """
    most = 2.0 * _FAR  # Scales may halve before others are found.
    is_far = np.abs(about.constants) > most * scales.of_flights
    return bool(is_far.any()) or bool(np.abs(about.gusts).max() > most * scales.air)


_COLUMNS = itertools.count()
PER_FLIGHT = {
    kind.kind: [next(_COLUMNS) for _ in kind.coefficients]
    for kind in LIBRARY
    if kind.varies_by
}
"""Effects that may vary from flight to flight, and their columns of `flight_values`."""


def flight_values(flights: Sequence[LinearFlight], scales: Scales) -> np.ndarray:
    """Returns the flights' constants, given all rows of each, (flights, 4).

    Those are the wind in x and z [m/s], the trim and the pitch offset [rad].
    """
    starts = in_parallel(lambda f: smooth(f, scales).start, flights)
    return np.array(starts)[:, -len(scales.of_flights) :]


def surroundings_of(
    flights: Sequence[LinearFlight], scales: Scales
) -> dict[str, Surroundings]:
    """Returns each flight's constants and gusts, given all its rows, by its name.

    They are at most `_FAR` of their standard deviations.
    """
    largest = _FAR * scales.of_flights
    most = _FAR * scales.air

    smoothed = in_parallel(lambda f: smooth(f, scales), flights)
    found = {}
    for flight, (start, gusts) in zip(flights, smoothed, strict=True):
        constants = np.clip(start[-len(largest) :], -largest, largest)
        found[flight.record.name] = Surroundings(constants, np.clip(gusts, -most, most))

    return found


def negative_log_likelihood(
    flights: Sequence[LinearFlight], scales: Scales
) -> np.ndarray:
    """Returns that of each flight of one column, its error, (flights,) [nats]."""
    return np.array(in_parallel(lambda f: whiten(f, scales).cost, flights))


def score(flight: LinearFlight, scales: Scales) -> tuple[float, np.ndarray]:
    """Returns the cost of a flight of one column and its slopes by the scales.

    Returns:
        the negative log-likelihood [nats], and its derivatives by `scales.logs`.
    """
    n = len(flight.states)
    with np.errstate(over="ignore", invalid="ignore"):  # A model may diverge.
        arrays, *slopes, _ = _traced_back(flight, scales)
        by_sensor, by_start, by_power, by_time = slopes

        # By the logarithm of a deviation: twice the variance times the slope by it.
        sensors = 2.0 * arrays.variance * by_sensor
        start = arrays.start
        by_start[n : n + PROCESSES] += by_power  # The processes start as they go on.
        by_start *= 2.0 * start
        air, air_z, moment, servo, *constants = by_start[n:]
        if start[n + 3] > 0.0:  # Of it, the departure's error is no scale.
            servo *= scales.servo**2 / start[n + 3]

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
        "rest": by_start[OFFSET] if _rests(flight.record, scales) else 0.0,
        "memory": by_start[NUM_STATES:n].sum(),
    }
    whitened = _WhitenedFlight(arrays.innovations, np.log(arrays.variances))
    return whitened.cost, np.array([by_name[name] for name in NAMES])
