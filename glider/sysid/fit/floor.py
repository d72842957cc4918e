"""The floor of predictions: the error that a perfect model would leave on flights.

Sensors are noisy, the launch is estimated from a flight's beginning and its measured
elevator, and no model predicts gusts. Replicas of a flight with such errors are drawn
about it, to which they are linear, and predicted as the flight is (see `prediction`).

Arrays have an axis of the K + 1 nodes, of the C = 4 measured channels or the N
deviations of a flight (its n states and the filter's own), and of the R replicas.
"""

import dataclasses
import functools
from collections.abc import Mapping, Sequence
from itertools import compress
from typing import NamedTuple

import numpy as np
from scipy.special import ndtr

from glider.campaign.smoothing import smoothing_maps
from glider.compiled.filter_error import (
    ELEVATOR,
    OWN_STATES,
    PITCH,
    PITCH_RATE,
    PROCESSES,
)
from glider.compiled.parallel import in_parallel
from glider.physics.state import NUM_STATES
from glider.sysid.constants import LARGEST_ERROR, MANY_FLIGHTS
from glider.sysid.fit.prediction import (
    Prediction,
    RolloutModel,
    errors_from,
    mean_squares,
    near_median,
    predict,
    rows_of,
    which_count,
)
from glider.sysid.likelihood.filtering import start_variances
from glider.sysid.likelihood.linear_flight import LinearFlight, linearize
from glider.sysid.likelihood.scales import Scales
from glider.sysid.replay.record import Record
from glider.sysid.result import PERFECT, EquationErrors, Errors, Residual

_REPLICAS = 100  # Of a flight.
# Relative error of the RMS over them: a square of two coordinates scatters by as much
# as its mean; half of that remains in the root.
_ACCURACY = 0.5 / _REPLICAS**0.5
_GROWTH = 1.0 / np.sqrt(np.finfo(float).eps)
"""Growth of deviations along a flight, in any units, up to which it can be predicted:
beyond, normal equations, where it is squared, keep no digit of a launch."""
_TRANSLATED = [0, 1, 4, 5]  # States that are fitted along the measured pitch,
_TURNED = [PITCH, PITCH_RATE]  # and those that are measured.
_MOMENT = 2  # Place of unmodelled pitch accelerations among the filter's own states.


@dataclasses.dataclass(frozen=True, kw_only=True)
class Floor:
    """Squared errors of a perfect model on flights, replica by replica.

    A replica is the flight with other noise, moving air and constants.

    Attributes:
        rows: (F,) number of rows that were seen of each flight.
        squares: (F, 4, R) mean squares, in the order of `prediction.mean_squares`.
    """

    rows: np.ndarray
    squares: np.ndarray

    @property
    def _is_known(self) -> np.ndarray:
        """Which flights (F,) are linear enough; some pass a model's validity."""
        means = self.squares.mean(axis=2)[:, :2]
        return np.all(means < LARGEST_ERROR**2, axis=1)

    def errors(self, equation: EquationErrors, flights: int) -> Errors:
        """Returns the errors on the first flights; NaN if none of them is known.

        Args:
            equation: the errors of accelerations.
            flights: number of the first.
        """
        known = np.flatnonzero(self._is_known[:flights])
        if not len(known):
            return errors_from(np.full((1, 4, 1), np.nan), np.ones(1), equation)
        return errors_from(self.squares[known], self.rows[known], equation)

    def chance(self, paths: np.ndarray) -> float:
        """Returns the probability that a perfect model leaves as much.

        Logarithms of errors are compared, flight by flight: one that is far off counts
        little. The mean difference is divided by its standard error, of the flights and
        of the number of replicas. Twice the probability of the less likely of the two
        kinds of errors is returned (Bonferroni).

        Args:
            paths: (F, 2) position RMS of the flights, free and along the pitch [m].
        """
        known = self._is_known
        if not known.any():
            return np.nan
        drawn = 0.5 * np.log(self.squares[known, :2])
        errors = np.nan_to_num(paths[known], nan=LARGEST_ERROR, posinf=LARGEST_ERROR)
        errors = np.log(np.clip(errors, 1e-9, LARGEST_ERROR))

        apart = near_median(errors - drawn.mean(axis=2))
        error = np.sqrt(drawn.var(axis=2).sum(axis=0)) / len(apart)
        z = apart.mean(axis=0) / np.hypot(error, _ACCURACY)
        return min(1.0, 2.0 * float(ndtr(-z).min()))


@dataclasses.dataclass(frozen=True, kw_only=True)
class PerfectModel:
    """A perfect model of flights, and the draws of what it leaves on them.

    Attributes:
        truth: scales of what happens in its flights, but their launches.
        pitch_ratio: ratio by which their pitch is smoothed, as `Smoothing.ratio`.
        rng: for the replicas.
    """

    truth: Scales
    pitch_ratio: float
    rng: np.random.Generator


class PredictedFlights(NamedTuple):
    """Flights predicted by models that were not fitted to them.

    Attributes:
        flown: predictions of all flights, by the name of the model.
        errors: of each model, and of a perfect one, on the flights that count.
        left: what the corrected model leaves, compared with a perfect one.
        counted: the flights that count, as some model flies them.
    """

    flown: dict[str, list[Prediction]]
    errors: dict[str, Errors]
    left: Residual
    counted: list[Record]


def compare(
    models: Mapping[str, RolloutModel],
    records: Sequence[Record],
    perfect: PerfectModel,
    equation: Mapping[str, EquationErrors],
    more: Sequence[Record] = (),
    depends_on: tuple[str, ...] = (),
) -> PredictedFlights:
    """Predicts flights by models, and compares the corrected with a perfect one.

    Args:
        models: by name, "corrected" among them.
        records: the flights.
        perfect: the perfect model.
        equation: errors of accelerations, of all models and the perfect one.
        more: flights on which only the corrected and a perfect model are compared.
        depends_on: variables that the rest varies with.
    """
    flown = {}
    squares = {}
    for name, model in models.items():
        flown[name] = in_parallel(functools.partial(predict, model), records)
        squares[name] = mean_squares(records, flown[name])
    counts = which_count(squares.values())
    counted = list(compress(records, counts))
    rows = rows_of(counted)
    errors = {}
    for name, own in squares.items():
        errors[name] = errors_from(own[counts, :, None], rows, equation[name])

    # Whether what is left is chance is judged on more flights than these.
    corrected = models["corrected"]
    others = [record for record in more if record not in counted]
    first = [*counted, *others][:MANY_FLIGHTS]
    floor = find_floor(corrected, first, perfect)
    beside = first[len(counted) :]
    predicted = in_parallel(functools.partial(predict, corrected), beside)
    found = [squares["corrected"][counts], mean_squares(beside, predicted)]
    paths = np.sqrt(np.concatenate(found)[:MANY_FLIGHTS, :2])

    left = errors["corrected"]
    least = floor.errors(equation[PERFECT], len(counted))
    errors[PERFECT] = least
    along = left.rollout_measured_pitch.position_rms_m
    residual = Residual(
        position_m=left.position_rms_m,
        ratio_to_floor=left.position_rms_m / least.position_rms_m,
        ratio_along_pitch=along / least.rollout_measured_pitch.position_rms_m,
        chance=floor.chance(paths),
        depends_on=depends_on,
    )
    return PredictedFlights(flown, errors, residual, counted)


def find_floor(
    model: RolloutModel, records: Sequence[Record], perfect: PerfectModel
) -> Floor:
    """Draws replicas of flights and predicts them by a model, taken as perfect.

    Each flight has random numbers of its own, so that all are drawn in parallel.
    """
    rngs = perfect.rng.spawn(len(records))
    squares = in_parallel(
        lambda own: _squares(model, perfect, *own), zip(records, rngs, strict=True)
    )

    return Floor(rows=rows_of(records), squares=np.array(squares))


@np.errstate(over="ignore", invalid="ignore")  # A model may diverge.
def _squares(
    model: RolloutModel, perfect: PerfectModel, record: Record, rng: np.random.Generator
) -> np.ndarray:
    """Returns mean squares of a flight's replicas (4, R), as in `Floor`.

    They are infinite if the flight diverges.

    Args:
        model: predicts the replicas.
        perfect: the truth, of which they are drawn.
        record: the flight.
        rng: its own random numbers.
    """
    flight = linearize(record, model.theta, model.gaussians)
    moves = _moves_of(flight, perfect.truth)
    measured = _draw_replicas(flight, moves, perfect.truth, rng)
    total = moves.shape[1]
    beginning = model.of_launch(record)
    seen = record.seen[:, 0]
    diverging = np.full((4, _REPLICAS), np.inf)

    # What a unit of each deviation at launch shows, (K + 1, C, N).
    shown = _flown(moves, flight.shows, np.eye(total))
    if not np.abs(shown).max() < _GROWTH:
        return diverging

    # The launches (N, R) that the replicas' beginnings show. Rollouts have next to no
    # process noise: their filter is a regression, with a prior of the launch.
    weights = beginning[..., None] / np.array(model.scales.sensors)[:, None]
    columns = (weights * shown).reshape(-1, total)
    values = (weights * measured).reshape(-1, _REPLICAS)
    prior = 1.0 / np.maximum(start_variances(flight, model.scales), 1e-16)
    hessian = columns.T @ columns + np.diag(prior)
    launches = np.linalg.solve(hessian, columns.T @ values)
    n = len(flight.states)
    launches[n : n + PROCESSES] = 0.0

    error = (measured - shown @ launches)[seen]
    free = np.sum(error[:, :2] ** 2, axis=1)
    pitch = error[:, PITCH] ** 2

    # Along the measured pitch, the rest of the launch is fitted again.
    guided = _guide(flight, moves, launches, measured, perfect.pitch_ratio)
    if not np.abs(guided).max() < _GROWTH:
        return diverging

    left = measured[:, :2] - guided[..., :_REPLICAS]
    columns = guided[..., _REPLICAS:]
    fitted = beginning[:, :2]
    step, *_ = np.linalg.lstsq(columns[fitted], left[fitted], rcond=None)
    error = (left - columns @ step)[seen]
    along = np.sum(error**2, axis=1)

    means = np.mean([free, along, pitch], axis=1)
    return np.vstack([means, free[-1]])


def _moves_of(flight: LinearFlight, scales: Scales) -> np.ndarray:
    """Returns how a flight's deviations, N = n + 8, move in each interval (K, N, N).

    Its states move as in the linear flight; moving air, moments and the elevator off
    its path decay with their correlation times, constants stay.
    """
    n = len(flight.states)
    steps = np.diff(flight.record.time)
    moves = np.tile(np.eye(n + OWN_STATES), (len(steps), 1, 1))
    moves[:, :n] = flight.moves
    processes = range(n, n + PROCESSES)
    moves[:, processes, processes] = np.exp(-steps[:, None] / np.array(scales.times))
    return moves


def _flown(
    moves: np.ndarray,
    shows: np.ndarray,
    first: np.ndarray,
    shocks: np.ndarray | None = None,
) -> np.ndarray:
    """Returns what is measured along a flight of deviations, (K + 1, C, R).

    Args:
        moves: (K, N, N) of `_moves_of`.
        shows: (K + 1, C, N) or (1, C, N) that of the LinearFlight.
        first: (N, R) deviations at the first node.
        shocks: (K, N, R) that are added at each later one.
    """
    states = [first]
    for k, move in enumerate(moves):
        following = move @ states[-1]
        if shocks is not None:
            following += shocks[k]
        states.append(following)

    return shows @ np.array(states)


def _draw_replicas(
    flight: LinearFlight, moves: np.ndarray, truth: Scales, rng: np.random.Generator
) -> np.ndarray:
    """Draws what is measured of a flight's replicas, as deviations (K + 1, C, R).

    Their launches differ by the elevator's rest and memory alone, and accelerations
    that no model has do not happen.

    Args:
        flight: the linear one, about which they are drawn.
        moves: (K, N, N) of `_moves_of`.
        truth: standard deviations of what happens, and of the sensors.
        rng: draws launches and shocks first, then the sensors' noise.
    """
    n = len(flight.states)
    stds = np.sqrt(start_variances(flight, truth))
    stds[[i for i in range(NUM_STATES) if i != ELEVATOR]] = 0.0
    stds[n + _MOMENT] = 0.0
    drawn = rng.normal(size=(len(moves) + 1, len(stds), _REPLICAS)) * stds[:, None]

    # The shocks that leave the variances of decaying processes as they are; constants
    # get none.
    kept = np.diagonal(moves, axis1=1, axis2=2)[:, n:, None]
    shocks = np.zeros_like(drawn[1:])
    shocks[:, n:] = np.sqrt(1.0 - kept**2) * drawn[1:, n:]
    measured = _flown(moves, flight.shows, drawn[0], shocks)
    noise = np.array(truth.sensors)[:, None]
    return measured + rng.normal(size=measured.shape) * noise


def _guide(
    flight: LinearFlight,
    moves: np.ndarray,
    launches: np.ndarray,
    measured: np.ndarray,
    pitch_ratio: float,
) -> np.ndarray:
    """Flies replicas along their measured pitch; returns x and z (K + 1, 2, R + 4) [m].

    The last four columns are what a unit of each of the _TRANSLATED states at launch
    does. Pitch and its rate are imposed: smoothed, less the launch's own zero of the
    pitch.
    """
    record = flight.record
    seen = record.seen[:, PITCH]
    maps = smoothing_maps(record.time[seen], record.time, pitch_ratio)[:2]
    turned = np.moveaxis(maps @ measured[seen, PITCH], 0, 1)  # (K + 1, 2, R)

    start = np.hstack([launches, np.eye(len(launches))[:, _TRANSLATED]])
    start[_TRANSLATED, :_REPLICAS] = 0.0
    imposed = np.zeros((len(record.time), *start.shape))
    imposed[:, _TURNED, :_REPLICAS] = turned
    imposed[:, PITCH, :_REPLICAS] -= launches[-1]
    start[_TURNED] = imposed[0, _TURNED]
    moves = moves.copy()
    moves[:, _TURNED] = 0.0
    return _flown(moves, flight.shows, start, imposed[1:])[:, :2]
