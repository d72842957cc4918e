"""Prediction of flights that a model has not seen, and its errors.

The launch state of each flight is estimated from its beginning only; then the model
flies on alone to the end.
"""

import dataclasses
import functools
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from glider.compiled.filter_error import PROCESSES
from glider.compiled.parallel import in_parallel
from glider.compiled.replay import roll_out
from glider.physics.effects import Field
from glider.sysid.constants import BEGINNING, BEGINNING_ROWS, BEGINNING_WITH_TRIM
from glider.sysid.likelihood.linear_flight import NO_CONSTANTS, linearize, path_of
from glider.sysid.likelihood.model_fit import FitResult, field_of
from glider.sysid.likelihood.scales import (
    FLOOR,
    Scales,
    fit_scales,
    negative_log_likelihood,
    smoothed_start,
    typical_flights,
)
from glider.sysid.likelihood.task import Task
from glider.sysid.replay.record import Record
from glider.sysid.replay.replayed import make_table, sensed, true_nodes
from glider.sysid.replay.theta import OFFSET
from glider.sysid.result import EquationErrors, Errors, Fit, PathErrors, RolloutErrors

_OF_ROLLOUTS = ("position", "pitch")  # Scales that rollouts have errors in.


@dataclasses.dataclass(frozen=True, kw_only=True)
class RolloutModel:
    """A model that flies logs again."""

    theta: np.ndarray  #: Its parameters and coefficients.
    field: Field  #: Its residual field.
    scales: Scales  #: Of errors along rollouts and over flights, see `rollout_scales`.
    per_flight_trims: bool  #: Whether the elevator's angle is another in each flight.


@dataclasses.dataclass(frozen=True, kw_only=True)
class Prediction:
    """Flight of a model, predicted from the beginning of a logged one."""

    pose: np.ndarray  #: (n, 3) of the free rollout, as the sensors would show it.
    translated: np.ndarray  #: (n, 2) x and z by forces along the measured pitch.
    trim: float  #: Elevator trim of the flight, found on the beginning [rad].

    @property
    def is_finite(self) -> bool:
        """Whether the model flew to the end; else it diverged."""
        return bool(np.isfinite(self.pose).all() and np.isfinite(self.translated).all())


def flown_by(task: Task, model: FitResult, scales: Scales) -> RolloutModel:
    """Returns a fitted model as one that flies logs again."""
    flown = RolloutModel(
        theta=model.theta,
        field=field_of(model),
        scales=scales,
        per_flight_trims=task.per_flight_trims,
    )
    scales = rollout_scales(flown, task.records, scales)
    return dataclasses.replace(flown, scales=scales)


def beginning_rows(record: Record, per_flight_trims: bool) -> int:
    """Number of nodes that the launch state is fitted on."""
    share = BEGINNING_WITH_TRIM if per_flight_trims else BEGINNING
    rows = int(np.searchsorted(record.time, share * record.time[-1]))
    return min(max(rows, BEGINNING_ROWS), len(record.time))


def rollout_scales(
    model: RolloutModel, records: Sequence[Record], scales: Scales
) -> Scales:
    """Returns the errors of a model's rollouts over the beginnings of flights.

    A rollout has no gusts: a launch must fit all rows of the beginning, not only the
    first. Flights on which the model diverges do not count.
    """
    still = dataclasses.replace(
        scales, air=FLOOR.air, moment=FLOOR.moment, servo=FLOOR.servo
    )
    flights = []
    for record in typical_flights(records):
        rows = beginning_rows(record, model.per_flight_trims)
        flights.append(linearize(record.first(rows), model.theta, model.field))
    costs = negative_log_likelihood([f.error_only() for f in flights], still)
    flown = [f for f, cost in zip(flights, costs, strict=True) if np.isfinite(cost)]
    return fit_scales(flown, still, _OF_ROLLOUTS, iterations=20)[0]


def find_launch(
    model: RolloutModel, record: Record, rows: int
) -> tuple[np.ndarray, np.ndarray]:
    """Returns the likeliest state (n,) and constants (4,), by a flight's first rows."""
    beginning, constants = record.first(rows), NO_CONSTANTS
    for _ in range(2):
        flight = linearize(beginning, model.theta, model.field, (), constants)
        launch, n = flight.nodes[0].copy(), len(flight.states)
        own = smoothed_start(flight, model.scales)
        if not np.all(np.isfinite(own)):  # It diverges: it starts as measured.
            return launch, constants
        launch[flight.states] += own[:n]
        constants = own[n + PROCESSES :]
    return launch, constants


def predict(model: RolloutModel, record: Record) -> Prediction:
    """Predicts one flight from its beginning."""
    rows = beginning_rows(record, model.per_flight_trims)
    launch, constants = find_launch(model, record, rows)
    layout, (*_, trim, pitch_zero) = record.layout, constants
    path, dynamics = path_of(record, model.theta, constants)
    kinds = layout.compiled_kinds
    states = roll_out(kinds, path, launch, dynamics, model.field)
    zero = np.array([0.0, 0.0, pitch_zero])

    nodes = true_nodes(record, model.theta, model.field)
    turned = (nodes - record.nodes)[:, [2, 6]]
    turned[:, 0] -= pitch_zero
    middle = 0.5 * (turned[1:] + turned[:-1])
    pitch = record.pitch + np.stack([turned[:-1], middle, turned[1:]], axis=1)
    guided = path._replace(pitch=np.ascontiguousarray(pitch))
    start = nodes[0].copy()
    start[OFFSET] = launch[OFFSET]

    def places(change: np.ndarray) -> np.ndarray:
        state = start.copy()
        state[[0, 1, 4, 5]] += change
        moved = roll_out(kinds, guided, state, dynamics, model.field)
        return sensed(layout, moved, model.theta)[:, :2]

    change, step = np.zeros(4), 1e-5
    for _ in range(3):
        flown = places(change)
        if not np.all(np.isfinite(flown[:rows])):
            break
        columns = [(places(change + step * unit) - flown) / step for unit in np.eye(4)]
        seen = record.seen[:rows, :2]
        matrix = np.stack(columns, axis=2)[:rows][seen]
        if not np.all(np.isfinite(matrix)):
            break
        error = (record.pose[:rows, :2] - flown[:rows])[seen]
        change += np.linalg.lstsq(matrix, error, rcond=None)[0]
    return Prediction(
        pose=sensed(layout, states, model.theta) + zero,
        translated=places(change),
        trim=float(trim),
    )


def predict_all(model: RolloutModel, records: Sequence[Record]) -> list[Prediction]:
    """Predicts flights from their beginnings."""
    return in_parallel(functools.partial(predict, model), records)


class Compared(NamedTuple):
    """Predictions of the same flights by several models."""

    predictions: list[list[Prediction]]  #: Of each model.
    kept: list[int]  #: Flights that at least one model flies to the end, or all.
    errors: list[Errors]  #: Of each model on these.


def compare(
    models: Sequence[RolloutModel], records: Sequence[Sequence[Record]]
) -> Compared:
    """Predicts flights by models, each with its records of them."""
    found = [predict_all(m, own) for m, own in zip(models, records, strict=True)]
    finite = [any(p.is_finite for p in own) for own in zip(*found, strict=True)]
    kept = [i for i, is_flown in enumerate(finite) if is_flown or not any(finite)]
    errors = [
        errors_of(model, [own[i] for i in kept], [flown[i] for i in kept])
        for model, own, flown in zip(models, records, found, strict=True)
    ]
    return Compared(found, kept, errors)


def measure_errors(model: RolloutModel, records: Sequence[Record]) -> Errors:
    """Returns a model's errors on flights, each predicted from its beginning."""
    return compare([model], [records]).errors[0]


def errors_of(
    model: RolloutModel, records: Sequence[Record], predictions: Sequence[Prediction]
) -> Errors:
    """Returns the errors of predictions of flights."""
    table = make_table(records, model.theta, [p.trim for p in predictions], model.field)
    pairs = zip(records, predictions, strict=True)
    free, pitch, along = map(list, zip(*(_squares(*p) for p in pairs), strict=True))
    with np.errstate(over="ignore", invalid="ignore"):  # A model may diverge.
        rms = np.sqrt(np.mean(table.residual**2, axis=0))
    tangential, normal, in_pitch = map(float, rms)
    return Errors(
        equation=EquationErrors(tangential=tangential, normal=normal, pitch=in_pitch),
        rollout=RolloutErrors(
            position_rms_m=_rms(free),
            position_end_m=float(np.mean([np.sqrt(own[-1]) for own in free])),
            pitch_rms_rad=_rms(pitch),
        ),
        rollout_measured_pitch=PathErrors(position_rms_m=_rms(along)),
        fit_percent=_fit(records, predictions),
    )


def _fit(records: Sequence[Record], predictions: Sequence[Prediction]) -> Fit:
    """Returns how much of the flights' motion predictions explain."""
    rows = [(r.seen[:, 0], r, p) for r, p in zip(records, predictions, strict=True)]
    missed = np.concatenate([(r.pose - p.pose)[seen] for seen, r, p in rows])
    moved = np.concatenate([r.pose[s] - r.pose[s].mean(axis=0) for s, r, _ in rows])
    with np.errstate(over="ignore", invalid="ignore"):  # A model may diverge.
        rest = np.linalg.norm(missed, axis=0) / np.linalg.norm(moved, axis=0)
    return Fit(*(100.0 * (1.0 - rest)).tolist())


def flight_errors(record: Record, predicted: Prediction) -> tuple[float, float]:
    """Returns a flight's position RMS, free and along the measured pitch [m]."""
    free, _, along = _squares(record, predicted)
    return _rms([free]), _rms([along])


def _squares(record: Record, predicted: Prediction) -> tuple[np.ndarray, ...]:
    """Returns squared errors over the seen rows (n,): free, pitch, measured pitch."""
    seen = record.seen[:, 0]
    error = (record.pose - predicted.pose)[seen]
    along = (record.pose[:, :2] - predicted.translated)[seen]
    free = np.sum(error[:, :2] ** 2, axis=1)
    return free, error[:, 2] ** 2, np.sum(along**2, axis=1)


def _rms(squares: list[np.ndarray]) -> float:
    return float(np.sqrt(np.mean(np.concatenate(squares))))
