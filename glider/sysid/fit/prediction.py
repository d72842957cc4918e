"""Prediction of flights that a model has not seen, and its errors.

The launch state of each flight is estimated from its beginning, and from the measured
elevator of the whole flight (`find_launch`); then the model flies on alone to the end,
once freely, and once along the measured pitch with its forces alone (`predict`). Errors
are over the rows that were seen (`mean_squares`, `errors_from`).
"""

import dataclasses
import functools
from collections.abc import Iterable, Sequence
from itertools import compress

import numpy as np
from scipy.optimize import leastsq

from glider.campaign.checks.motion import robust_std
from glider.compiled.filter_error import ELEVATOR, PROCESSES
from glider.compiled.replay import OFFSET, LogPath, roll_out
from glider.physics.effects import Gaussians
from glider.physics.state import NUM_STATES
from glider.sysid.constants import BEGINNING, LARGEST_ERROR, MANY_FLIGHTS, Z
from glider.sysid.likelihood.filtering import negative_log_likelihood, smooth
from glider.sysid.likelihood.linear_flight import (
    STILL_AIR,
    Surroundings,
    linearize,
    path_of,
)
from glider.sysid.likelihood.scale_fit import fit_scales
from glider.sysid.likelihood.scales import Scales
from glider.sysid.likelihood.task import FitResult, Task
from glider.sysid.replay.log_space import sensed
from glider.sysid.replay.record import Record, evenly
from glider.sysid.replay.replayed import true_nodes
from glider.sysid.result import EquationErrors, Errors, PathErrors, RolloutErrors

_LAUNCHES = 1024  # Launches that are kept: two models' of 500 flights.
_OF_ROLLOUTS = ("position", "pitch")  # Scales that rollouts have errors in.
_SMALL = 1e-5  # Step of a derivative by a launch's place and velocity, relative.


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class RolloutModel:
    """A model that flies logs again.

    Attributes:
        theta: its parameters and coefficients.
        gaussians: of its free functions.
        scales: of errors over flights and, see `on`, along rollouts.
        per_flight_trims: whether the elevator's angle is another in each flight.
    """

    theta: np.ndarray
    gaussians: Gaussians
    scales: Scales
    per_flight_trims: bool

    def of_launch(self, record: Record) -> np.ndarray:
        """Returns which measurements (n, 4) a launch is fitted to.

        They are the pose of the first rows and, as an input, the elevator of all.
        """
        seen = record.seen.copy()
        rows = beginning_rows(record.time, self.per_flight_trims)
        seen[rows:, np.arange(seen.shape[1]) != ELEVATOR] = False
        return seen

    def on(self, records: Sequence[Record]) -> "RolloutModel":
        """Returns the model with the errors of its rollouts over flights' beginnings.

        A rollout has no gusts: a launch must fit all rows of the beginning, not only
        the first. Flights on which the model diverges do not count.
        """
        scales = self.scales.without("air", "moment", "servo")
        flights = []
        for record in evenly(records, MANY_FLIGHTS):
            begun = dataclasses.replace(record, seen=self.of_launch(record))
            flights.append(linearize(begun, self.theta, self.gaussians))

        costs = negative_log_likelihood(flights, scales)
        flown = list(compress(flights, np.isfinite(costs)))
        scales, _ = fit_scales(flown, scales, _OF_ROLLOUTS, iterations=20)
        return dataclasses.replace(self, scales=scales)


@dataclasses.dataclass(frozen=True, kw_only=True)
class Prediction:
    """Flight of a model, predicted from the beginning of a logged one.

    Attributes:
        pose: (n, 3) of the free rollout, as the sensors would show it.
        translated: (n, 2) x and z by the forces along the measured pitch [m].
        trim: elevator trim of the flight, found on the beginning [rad].
    """

    pose: np.ndarray
    translated: np.ndarray
    trim: float


def flown_by(task: Task, model: FitResult, scales: Scales) -> RolloutModel:
    """Returns a fitted model as one that flies logs again."""
    return RolloutModel(
        theta=model.theta,
        gaussians=model.gaussians,
        scales=scales,
        per_flight_trims=task.vehicle.per_flight_trims,
    ).on(task.records)


def near_median(values: np.ndarray) -> np.ndarray:
    """Returns values (n, ...), each within Z robust standard deviations of the median.

    One flight may not decide what holds on average.
    """
    median = np.median(values, axis=0)
    most = Z * (robust_std(values - median) + 1e-12)
    return np.clip(values, median - most, median + most)


def beginning_rows(time: np.ndarray, per_flight_trims: bool) -> int:
    """Returns the number of rows that a launch is fitted on.

    They are a share of the flight, twice as large if a trim is fitted too, and at least
    as many as a launch has states.

    Args:
        time: (n,) of the rows, from zero [s].
        per_flight_trims: whether a trim is fitted too.
    """
    share = BEGINNING * (1 + per_flight_trims)
    rows = int(np.searchsorted(time, share * time[-1]))
    return min(max(rows, NUM_STATES), len(time))


@functools.lru_cache(_LAUNCHES)
def find_launch(model: RolloutModel, record: Record) -> tuple[np.ndarray, Surroundings]:
    """Returns the likeliest launch state (num_states,), and the flight's constants.

    They are those of a Kalman smoother over the flight's beginning. An elevator that
    began elsewhere than its first row shows is moved there before its path is replayed,
    once: at a stop it forgets where it began.
    """
    beginning = dataclasses.replace(record, seen=model.of_launch(record))
    about = STILL_AIR
    for _ in range(2):
        flight = linearize(beginning, model.theta, model.gaussians, (), about)
        launch = flight.nodes[0].copy()
        n = len(flight.states)
        own = smooth(flight, model.scales).start
        if not np.isfinite(own).all():  # It diverges: it starts as measured.
            return launch, about
        launch[flight.states] += flight.start[:n, -1] + own[:n]

        # The elevator's offset at launch is where its path begins.
        rest = beginning.rest + launch[OFFSET]
        beginning = dataclasses.replace(beginning, rest=rest)
        launch[OFFSET] = rest - record.rest
        about = Surroundings(own[n + PROCESSES :])

    return launch, about


def predict(model: RolloutModel, record: Record) -> Prediction:
    """Predicts one flight from its beginning.

    The second prediction, along the measured pitch, has the measured launch, whose
    place and velocity are fitted to the beginning again.
    """
    found, about = find_launch(model, record)
    launch = found.copy()
    record = dataclasses.replace(record, rest=record.rest + launch[OFFSET])
    launch[OFFSET] = 0.0
    *_, trim, pitch_zero = about.constants
    path, dynamics = path_of(record, model.theta, about)
    space = record.space

    def fly(start: np.ndarray, along: LogPath) -> np.ndarray:
        """Returns the poses (n, 3) of a rollout, as the sensors would show them."""
        states = roll_out(space.flown, along, start, dynamics, model.gaussians)
        return sensed(space, states, model.theta, model.gaussians)

    pose = fly(launch, path)
    pose[:, 2] += pitch_zero

    # The true pitch and rate are those that the sensors would show as measured.
    nodes = true_nodes(record, model.theta, model.gaussians)
    apart = (nodes - record.nodes)[:, [2, 6]] - [pitch_zero, 0.0]
    begin = apart[:-1]
    end = apart[1:]
    turned = record.pitch + np.stack([begin, 0.5 * (end + begin), end], axis=1)
    guided = path._replace(pitch=np.ascontiguousarray(turned))
    start = nodes[0].copy()
    start[OFFSET] = 0.0
    start[NUM_STATES:] = launch[NUM_STATES:]

    def places(change: np.ndarray, along: LogPath) -> np.ndarray:
        state = start.copy()
        state[[0, 1, 4, 5]] += change
        return fly(state, along)[:, :2]

    rows = beginning_rows(record.time, model.per_flight_trims)
    seen = record.seen[:rows, :2]
    beginning = guided.first(rows)

    def missed(change: np.ndarray) -> np.ndarray:
        return (record.pose[:rows, :2] - places(change, beginning))[seen]

    change = np.zeros(4)
    if np.isfinite(missed(change)).all():
        change, _ = leastsq(missed, change, epsfcn=_SMALL**2)
    along = places(change, guided)
    return Prediction(pose=pose, translated=along, trim=float(trim))


def which_count(squares: Iterable[np.ndarray]) -> np.ndarray:
    """Returns which flights (F,) count, by `mean_squares` (F, 4) of several models.

    One on which every model diverges compares none with another: it counts only if all
    are such.
    """
    is_flown = np.any([own[:, 0] < LARGEST_ERROR**2 for own in squares], axis=0)
    return is_flown if is_flown.any() else ~is_flown


def rows_of(records: Sequence[Record]) -> np.ndarray:
    """Returns the number of rows that were seen of each flight, (F,)."""
    return np.array([np.count_nonzero(record.seen[:, 0]) for record in records])


def rms(accelerations: np.ndarray) -> EquationErrors:
    """Returns the root mean squares of errors (N, 3) of accelerations.

    The columns are those of `ResidualTable.residual`.
    """
    return EquationErrors(*np.sqrt((accelerations**2).mean(axis=0)).tolist())


def errors_from(
    squares: np.ndarray, rows: np.ndarray, equation: EquationErrors
) -> Errors:
    """Returns the errors on flights: RMS over all rows, at the end mean over flights.

    Args:
        squares: (F, 4, R) `mean_squares` of the flights, each drawn R times.
        rows: (F,) number of rows that were seen of each.
        equation: errors of accelerations.
    """
    means = np.average(squares.mean(axis=2), axis=0, weights=rows)
    free, along, pitch, _ = np.sqrt(means).tolist()
    end = float(np.sqrt(squares[:, 3]).mean())
    return Errors(equation, RolloutErrors(free, end, pitch), PathErrors(along))


@np.errstate(over="ignore", invalid="ignore")  # A model may diverge.
def mean_squares(records: Sequence[Record], flown: Sequence[Prediction]) -> np.ndarray:
    """Returns mean squared errors of predictions over the rows that were seen, (F, 4).

    They are of the position, free and along the measured pitch [m²], of the pitch
    [rad²], and of the position at the end [m²].

    Args:
        records: the flights.
        flown: their predictions.
    """
    found = []
    for record, predicted in zip(records, flown, strict=True):
        seen = record.seen[:, 0]
        error = (record.pose - predicted.pose)[seen]
        free = np.sum(error[:, :2] ** 2, axis=1)
        pitch = error[:, 2] ** 2
        error = (record.pose[:, :2] - predicted.translated)[seen]
        along = np.sum(error**2, axis=1)
        found.append([free.mean(), along.mean(), pitch.mean(), free[-1]])

    return np.reshape(found, (-1, 4))
