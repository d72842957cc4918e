"""The floor of predictions: the error that a perfect model would leave on flights.

Sensors are noisy, the launch is estimated from a flight's beginning and its measured
elevator, and no model predicts gusts. Replicas of a flight with such errors are drawn
about it, to which they are linear, and predicted as the flight is (see `prediction`).
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


@dataclasses.dataclass(frozen=True, kw_only=True)
class Floor:
    """Squared errors of a perfect model on flights, replica by replica.

    A replica is the flight with other noise, moving air and constants.
    """

    rows: np.ndarray  #: (F,) seen of each flight.
    squares: np.ndarray  #: (F, 4, R) as of `prediction.mean_squares`.

    @property
    def _is_known(self) -> np.ndarray:
        """(F,) whether flights are linear enough; some pass a model's validity."""
        means = self.squares.mean(axis=2)[:, :2]
        return np.all(means < LARGEST_ERROR**2, axis=1)

    def errors(self, equation: EquationErrors, flights: int) -> Errors:
        """Errors on the first flights, those of accelerations given."""
        known = np.flatnonzero(self._is_known[:flights])
        if not len(known):
            return errors_from(np.full((1, 4, 1), np.nan), np.ones(1), equation)
        return errors_from(self.squares[known], self.rows[known], equation)

    def chance(self, paths: np.ndarray) -> float:
        """Probability that a perfect model leaves as much, of paths (F, 2).

        Those are the flights' position RMS, free and along the pitch [m]. Logarithms
        are compared, flight by flight: one that is far off counts little.
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
    """A perfect model of flights, and the draws of what it leaves on them."""

    truth: Scales  #: Of what happens in its flights, but their launches.
    pitch_ratio: float  #: By which their pitch is smoothed, as `Smoothing.ratio`.
    rng: np.random.Generator


class PredictedFlights(NamedTuple):
    """Flights predicted by models that were not fitted to them.

    The corrected model is compared with a perfect one too.
    """

    flown: dict[str, list[Prediction]]  #: By each model.
    errors: dict[str, Errors]  #: Of each, and of a perfect one.
    left: Residual  #: By the corrected model.
    counted: list[Record]  #: Flights of which these are: some model flies them.


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
    flown = {
        name: in_parallel(functools.partial(predict, model), records)
        for name, model in models.items()
    }
    squares = {name: mean_squares(records, own) for name, own in flown.items()}
    # Errors are of the flights that count.
    counts = which_count(squares.values())
    counted = list(compress(records, counts))
    errors = {
        name: errors_from(own[counts, :, None], rows_of(counted), equation[name])
        for name, own in squares.items()
    }
    # What is left is put to chance, or not, on more flights than these.
    own = models["corrected"]
    beside = [record for record in more if record not in counted]
    beside = beside[: max(0, MANY_FLIGHTS - len(counted))]
    first = [*counted, *beside][:MANY_FLIGHTS]
    floor = find_floor(own, first, perfect)
    seen = mean_squares(beside, in_parallel(functools.partial(predict, own), beside))
    paths = np.sqrt([*squares["corrected"][counts, :2], *seen[:, :2]][:MANY_FLIGHTS])
    left = errors["corrected"]
    errors[PERFECT] = least = floor.errors(equation[PERFECT], len(counted))
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
    """Draws replicas of flights and predicts them by a model, taken as perfect."""
    rngs = perfect.rng.spawn(len(records))
    squares = in_parallel(
        lambda own: _squares(model, perfect, *own), zip(records, rngs, strict=True)
    )

    return Floor(rows=rows_of(records), squares=np.array(squares))


def _moves_of(flight: LinearFlight, scales: Scales) -> np.ndarray:
    """Returns how a flight's deviations, N = n + 8, move in each interval (K, N, N)."""
    n = len(flight.states)
    # Moving air and moments decay, constants stay.
    steps = np.diff(flight.record.time)[:, None]
    processes = range(n, n + PROCESSES)
    moves = np.tile(np.eye(n + OWN_STATES), (len(steps), 1, 1))
    moves[:, :n] = flight.moves
    moves[:, processes, processes] = np.exp(-steps / np.array(scales.times))
    return moves


def _flown(
    moves: np.ndarray,
    shows: np.ndarray,
    first: np.ndarray,
    shocks: np.ndarray | None = None,
) -> np.ndarray:
    """Returns what is measured (K + 1, C, R) of deviations at the first node (N, R).

    Shocks (K, N, R) are added at each later one. `shows` is that of a LinearFlight.
    """
    states = [first]
    for k, move in enumerate(moves):
        following = move @ states[-1]
        if shocks is not None:
            following += shocks[k]
        states.append(following)

    return shows @ np.array(states)


@np.errstate(over="ignore", invalid="ignore")  # A model may diverge.
def _squares(
    model: RolloutModel, perfect: PerfectModel, record: Record, rng: np.random.Generator
) -> np.ndarray:
    """Mean squares of a flight's replicas (4, R), as in `Floor`; inf if it diverges."""
    truth = perfect.truth
    flight = linearize(record, model.theta, model.gaussians)
    moves, shows = _moves_of(flight, truth), flight.shows
    nodes, (channels, total) = len(record.time), shows.shape[1:]
    n = len(flight.states)
    seen = record.seen
    beginning = model.of_launch(record)
    diverging = np.full((4, _REPLICAS), np.inf)

    # Replicas, whose launches differ by the elevator's rest and memory alone.
    # Accelerations that no model has do not happen.
    stds = np.sqrt(start_variances(flight, truth))
    stds[[i for i in range(NUM_STATES) if i != ELEVATOR]] = 0.0
    stds[n + 2] = 0.0
    drawn = rng.normal(size=(nodes, total, _REPLICAS)) * stds[:, None]
    kept = np.diagonal(moves, axis1=1, axis2=2)[:, n:, None]
    shocks = np.zeros_like(drawn[1:])
    shocks[:, n:] = np.sqrt(1.0 - kept**2) * drawn[1:, n:]
    measured = _flown(moves, shows, drawn[0], shocks)
    noise = np.array(truth.sensors[:channels])[:, None]
    measured += rng.normal(size=measured.shape) * noise

    # Each is predicted from the launch that its beginning shows. Rollouts have next
    # to no process noise: their filter is a regression.
    shown = _flown(moves, shows, np.eye(total))
    if not np.max(np.abs(shown)) < _GROWTH:
        return diverging
    sensors = np.array(model.scales.sensors[:channels])
    weights = beginning[..., None] / sensors[:, None]
    columns = (weights * shown).reshape(-1, total)
    values = (weights * measured).reshape(-1, _REPLICAS)
    prior = 1.0 / np.maximum(start_variances(flight, model.scales), 1e-16)
    known = np.linalg.solve(columns.T @ columns + np.diag(prior), columns.T @ values)
    known[n : n + PROCESSES] = 0.0
    error = (measured - shown @ known)[seen[:, 0]]
    free = np.sum(error[:, :2] ** 2, axis=1)
    pitch = error[:, PITCH] ** 2

    # Along the measured pitch it is imposed, and the rest of the launch fitted again.
    maps = smoothing_maps(record.time[seen[:, 2]], record.time, perfect.pitch_ratio)[:2]
    turned = np.moveaxis(maps @ measured[seen[:, 2], PITCH], 0, 1)
    known[_TRANSLATED] = 0.0
    start = np.hstack([known, np.eye(total)[:, _TRANSLATED]])
    imposed = np.zeros((nodes, *start.shape))
    imposed[:, _TURNED, :_REPLICAS] = turned
    imposed[:, PITCH, :_REPLICAS] -= known[-1]
    start[_TURNED] = imposed[0, _TURNED]
    moves[:, _TURNED] = 0.0
    guided = _flown(moves, shows, start, imposed[1:])[:, :2]
    if not np.max(np.abs(guided)) < _GROWTH:
        return diverging
    left = measured[:, :2] - guided[..., :_REPLICAS]
    columns = guided[..., _REPLICAS:]
    fitted = beginning[:, :2]
    step = np.linalg.lstsq(columns[fitted], left[fitted], rcond=None)[0]
    along = np.sum((left - columns @ step)[seen[:, 0]] ** 2, axis=1)
    return np.stack(
        [free.mean(axis=0), along.mean(axis=0), pitch.mean(axis=0), free[-1]]
    )
