"""The floor of predictions: the error that a perfect model would leave on flights.

Sensors are noisy, the launch is estimated from the beginning of a flight, and no model
predicts gusts. Replicas of a flight with such errors are drawn about it, to which they
are linear, and predicted as the flight is (see `prediction`).
"""

import dataclasses
from collections.abc import Sequence

import numpy as np
from scipy.special import ndtr, stdtr

from glider.compiled.filter_error import ELEVATOR, PITCH, PITCH_RATE, PROCESSES
from glider.compiled.parallel import in_parallel
from glider.physics.effects import FIELD_VARIABLES
from glider.sysid.constants import (
    FLOOR_ACCURACY,
    FLOOR_CLIP,
    LARGEST_FLOOR,
    REPLICAS,
    UNLIKELY,
)
from glider.sysid.fit.prediction import RolloutModel, beginning_rows
from glider.sysid.likelihood.blocks import midpoints
from glider.sysid.likelihood.linear_flight import LinearFlight, linearize
from glider.sysid.likelihood.model_fit import FitResult, error_flights
from glider.sysid.likelihood.scales import (
    Scales,
    negative_log_likelihood,
    start_variances,
)
from glider.sysid.likelihood.task import Task
from glider.sysid.replay.record import Record
from glider.sysid.replay.smoothing import smoothing_maps
from glider.sysid.result import EquationErrors, Errors, PathErrors, RolloutErrors

STATES = "alpha", "V", "pitchdot", "elevator_rate"  # That turbulence does not know.
_STEP = 0.1  # Of the logarithm of gusts, for slopes of the likelihood.
_TRANSLATED = [0, 1, 4, 5]  # States that are fitted along the measured pitch,
_TURNED = [PITCH, PITCH_RATE]  # and those that are measured.


@dataclasses.dataclass(frozen=True, kw_only=True)
class Floor:
    """Squared errors of a perfect model on flights, replica by replica."""

    rows: np.ndarray  #: (F,) seen of each flight.
    #: (F, 4, R) of position, free and along the measured pitch [m²], and pitch [rad²],
    #: means over these rows; of the position at the end [m²].
    squares: np.ndarray

    @property
    def _is_known(self) -> np.ndarray:
        """(F,) whether flights are linear enough; some pass a model's validity."""
        return np.all(self.squares.mean(axis=2)[:, :2] < LARGEST_FLOOR**2, axis=1)

    def errors(self, equation: EquationErrors, flights: int) -> Errors:
        """Errors on the first flights, those of accelerations given."""
        known = np.flatnonzero(self._is_known[:flights])
        squares = self.squares[known] if len(known) else np.full((1, 4, 1), np.nan)
        rows = self.rows[known] if len(known) else None
        means = np.average(squares.mean(axis=2), axis=0, weights=rows)
        free, along, pitch, _ = np.sqrt(means).tolist()
        end = float(np.mean(np.sqrt(squares[:, 3])))
        return Errors(
            equation=equation,
            rollout=RolloutErrors(
                position_rms_m=free, position_end_m=end, pitch_rms_rad=pitch
            ),
            rollout_measured_pitch=PathErrors(position_rms_m=along),
        )

    def chance(self, paths: np.ndarray) -> float:
        """Probability that a perfect model leaves such errors, or larger ones.

        Logarithms are compared, flight by flight: one that is far off counts little.

        Args:
            paths: (F, 2) position RMS of the flights, free and along the pitch [m].
        """
        known = self._is_known
        if not known.any():
            return np.nan
        drawn = 0.5 * np.log(self.squares[known, :2])
        errors = np.nan_to_num(np.log(np.maximum(paths[known], 1e-9)), nan=np.inf)
        apart = np.clip(errors - drawn.mean(axis=2), -FLOOR_CLIP, FLOOR_CLIP)
        error = np.sqrt(drawn.var(axis=2).sum(axis=0)) / len(apart)
        z = apart.mean(axis=0) / np.hypot(error, FLOOR_ACCURACY)
        return min(1.0, 2.0 * float(ndtr(-z).min()))


def find_floor(
    model: RolloutModel,
    records: Sequence[Record],
    truth: Scales,
    pitch_ratio: float,
    rng: np.random.Generator,
) -> Floor:
    """Draws replicas of flights and predicts them.

    Args:
        model: that flies, taken as perfect.
        records: the flights.
        truth: standard deviations of what happens in a flight but its launch.
        pitch_ratio: smoothness of the measured pitch, see `smoothing.Smoothing`.
        rng: of the replicas.
    """
    squares = in_parallel(
        lambda own: _squares(model, own[0], own[1], truth, pitch_ratio),
        zip(records, rng.spawn(len(records)), strict=True),
    )
    rows = np.array([np.count_nonzero(r.seen[:, 0]) for r in records])
    return Floor(rows=rows, squares=np.array(squares))


def _squares(
    model: RolloutModel,
    record: Record,
    rng: np.random.Generator,
    truth: Scales,
    pitch_ratio: float,
) -> np.ndarray:
    """Mean squares of a flight's replicas (4, R), as in `Floor`."""
    flight = linearize(record, model.theta, model.field)
    moves, shows = _transitions(flight, truth)
    n, total = flight.by_x.shape[1], shows.shape[2]
    rows, seen = beginning_rows(record, model.per_flight_trims), record.seen
    stds = np.sqrt(start_variances(flight, truth))
    stds[[*range(n), n + 2]] = 0.0  # The launch; unmodelled pitch accelerations.
    shocks = rng.normal(size=(len(record.time), total, REPLICAS)) * stds[:, None]
    keep = np.diagonal(moves, axis1=1, axis2=2)[:, n:, None]
    shocks[1:, :n], shocks[1:, n:] = 0.0, np.sqrt(1.0 - keep**2) * shocks[1:, n:]
    measured = shows @ _flown(moves, shocks)
    channels = seen.shape[1]
    noise = np.array(truth.sensors[:channels])[:, None]
    measured += rng.normal(size=measured.shape) * noise

    # Rollouts have next to no process noise: their filter is a regression.
    start = np.zeros((len(record.time), total, total))
    start[0] = np.eye(total)
    shown = shows @ _flown(moves, start)
    weights = (seen[:rows] / np.array(model.scales.sensors[:channels]))[..., None]
    columns = (weights * shown[:rows]).reshape(-1, total)
    values = (weights * measured[:rows]).reshape(-1, REPLICAS)
    prior = np.diag(1.0 / np.maximum(start_variances(flight, model.scales), 1e-16))
    known = np.linalg.solve(columns.T @ columns + prior, columns.T @ values)
    known[n : n + PROCESSES] = 0.0
    error = (measured - shown @ known)[seen[:, 0]]
    free = np.sum(error[:, :2] ** 2, axis=1)

    maps = smoothing_maps(record.time[seen[:, 2]], record.time, pitch_ratio)[:2]
    known[_TRANSLATED] = 0.0
    start = np.zeros((len(record.time), total, REPLICAS + len(_TRANSLATED)))
    start[0] = np.hstack([known, np.eye(total)[:, _TRANSLATED]])
    moves[:, _TURNED] = 0.0  # They are imposed.
    start[:, _TURNED, :REPLICAS] = np.moveaxis(maps @ measured[seen[:, 2], PITCH], 0, 1)
    start[:, PITCH, :REPLICAS] -= known[-1]
    guided = (shows @ _flown(moves, start))[:, :2]
    left, columns = measured[:, :2] - guided[..., :REPLICAS], guided[..., REPLICAS:]
    first = seen[:rows, :2]
    step = np.linalg.lstsq(columns[:rows][first], left[:rows][first], rcond=None)[0]
    along = np.sum((left - columns @ step)[seen[:, 0]] ** 2, axis=1)
    pitch = error[:, PITCH] ** 2
    return np.stack([*(v.mean(axis=0) for v in (free, along, pitch)), free[-1]])


def _transitions(flight: LinearFlight, scales: Scales) -> tuple[np.ndarray, np.ndarray]:
    """How deviations move, (K, n + 8, n + 8), and show, (K + 1, C, n + 8)."""
    n, total = flight.by_x.shape[1], len(flight.start)
    steps = np.diff(flight.record.time)[:, None]
    moves = np.tile(np.eye(total), (len(steps), 1, 1))
    moves[:, :n, :n] = flight.by_x
    moves[:, :n, n : n + 2] = moves[:, :n, n + 4 : n + 6] = flight.by_air
    moves[:, :n, n + 3] = flight.by_x[:, :, ELEVATOR]
    moves[:, ELEVATOR, n + 3] = 0.0
    moves[:, :n, n + 6] = flight.by_trim
    processes = range(n, n + PROCESSES)
    moves[:, processes, processes] = np.exp(-steps / np.array(scales.times))
    shows = np.zeros((*flight.record.seen.shape, total))
    shows[:, :3, :n] = flight.pose_by_x
    shows[:, PITCH, -1] = shows[:, ELEVATOR, ELEVATOR] = shows[:, ELEVATOR, n + 3] = 1.0
    shows[:, 4:, PITCH_RATE] = 1.0  # With a gyro.
    return moves, shows


def _flown(moves: np.ndarray, shocks: np.ndarray) -> np.ndarray:
    """Deviations at the nodes (K + 1, n + 8, R) by shocks there; they are changed."""
    for k, move in enumerate(moves):
        shocks[k + 1] += move @ shocks[k]
    return shocks


def air_depends_on(task: Task, model: FitResult) -> tuple[str, ...]:
    """Finds states of the glider that the gusts of a model depend on.

    Turbulence depends on none; errors of a model do. Gusts vary as exp(b φ) with the
    ranks φ of a state's size, from -1 to 1: flights are independent, and Student's t
    compares the slopes of their likelihoods over b at zero, the overall strength
    eliminated.
    """
    count = len(task.records)
    if model.scales.is_still or count < 3:
        return ()
    # The flights' constants, about which they are linear, count as known.
    scales = dataclasses.replace(model.scales, wind=1e-9, trim=1e-9, pitch_zero=1e-9)
    flights = [
        dataclasses.replace(flight, start=np.zeros_like(flight.start))
        for flight in error_flights(task, model)
    ]

    def slopes(logs: Sequence[np.ndarray]) -> np.ndarray:
        less, more = (
            [
                dataclasses.replace(
                    f, by_air=f.by_air * np.exp(step * own)[:, None, None]
                )
                for f, own in zip(flights, logs, strict=True)
            ]
            for step in (-_STEP, _STEP)
        )
        costs = [negative_log_likelihood(moved, scales) for moved in (less, more)]
        return (costs[0] - costs[1]) / (2.0 * _STEP)

    ones = [np.ones(len(flight.by_air)) for flight in flights]
    overall, found = slopes(ones), {}
    variables = [np.abs(midpoints(r, model.theta)) for r in task.records]
    for variable in STATES:
        column = FIELD_VARIABLES.index(variable)
        sizes = [values[:, column] for values in variables]
        every = np.concatenate(sizes)
        if np.ptp(every) > 0.0:
            ranks = np.argsort(np.argsort(every)) * (2.0 / len(every)) - 1.0
            own = slopes(np.split(ranks, np.cumsum([*map(len, sizes)])[:-1]))
            own -= (own @ overall) / (overall @ overall) * overall
            found[variable] = abs(own.mean()) / own.std(ddof=1) * np.sqrt(count)
    return tuple(
        variable
        for variable in sorted(found, key=lambda name: -found[name])
        if 2.0 * len(found) * stdtr(count - 1, -found[variable]) < UNLIKELY
    )
