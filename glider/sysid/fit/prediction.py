"""Prediction of flights that a model has not seen, and its errors.

The launch state of each flight is fitted on its beginning only; then the model
flies on alone to the end.
"""

import dataclasses

import numpy as np

from glider.sysid.fit.output_error import in_parallel
from glider.sysid.replay.nodes import sensed
from glider.sysid.replay.problem import Problem
from glider.sysid.replay.record import Record
from glider.sysid.replay.residual import make_table
from glider.sysid.replay.shooting import (
    AlongPitch,
    cut,
    fit_start,
    fly_record,
)
from glider.sysid.replay.theta import OFFSET
from glider.sysid.result import Errors

BEGINNING = 0.2
"""Share of a flight on which its launch state is fitted."""

BEGINNING_WITH_TRIM = 0.4
"""The same where an elevator angle of the flight's own is fitted too."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Prediction:
    """Flight of a model, predicted from the beginning of a logged one.

    Attributes:
        pose: (n, 3) of the free rollout, as the sensors would show it.
        translated: (n, 2) x and z of the forces alone along the measured pitch.
        trim: elevator offset found on the beginning [rad].
    """

    pose: np.ndarray
    translated: np.ndarray
    trim: float


def beginning_rows(problem: Problem, record: Record) -> int:
    """Returns how many rows the launch state is fitted on."""
    own_trim = not problem.trim_is_known and not record.has_servo
    share = BEGINNING_WITH_TRIM if own_trim else BEGINNING
    until = share * record.time[-1]
    return max(int(np.searchsorted(record.time, until)), 10)


def predict(
    problem: Problem, theta: np.ndarray, record: Record, whole: bool = False
) -> Prediction:
    """Predicts one flight from its beginning, or fits the whole of it."""
    rows = len(record.time)
    if not whole:
        rows = beginning_rows(problem, record)
    start = fit_start(problem, cut(record, 0, rows), theta)
    states = fly_record(problem, record, theta, start)
    return Prediction(
        pose=sensed(record.layout, states, theta),
        translated=_translate(problem, record, theta, start, rows),
        trim=float(start[OFFSET]),
    )


def _translate(
    problem: Problem, record: Record, theta: np.ndarray, start: np.ndarray, rows: int
) -> np.ndarray:
    """Integrates the forces along the measured pitch; x, z, rates fitted on rows."""
    along = AlongPitch(problem, record, theta)
    launch = along.first.copy()
    launch[-1] = start[OFFSET]
    for _ in range(3):
        flown = along.places(launch)
        if not np.all(np.isfinite(flown[:rows])):
            break
        columns = along.by_launch(launch, flown)[:rows, :, :-1]
        error = (record.flight.pose[:, :2] - flown)[:rows].ravel()
        matrix = columns.reshape(2 * rows, -1)
        launch[:-1] += np.linalg.lstsq(matrix, error, rcond=None)[0]
    return along.places(launch)


def measure_errors(
    problem: Problem, theta: np.ndarray
) -> tuple[Errors, list[Prediction]]:
    """Returns a model's errors on the problem's flights, and their predictions."""
    predictions = in_parallel(
        lambda record: predict(problem, theta, record), problem.records
    )
    table = make_table(
        problem.records, theta, [f.trim for f in predictions], problem.field
    )
    position, end, pitch, translated = [], [], [], []
    for record, predicted in zip(problem.records, predictions, strict=True):
        error = record.flight.pose - predicted.pose
        distance = np.hypot(error[:, 0], error[:, 1])
        position.append(distance**2)
        end.append(distance[-1])
        pitch.append(error[:, 2] ** 2)
        along = record.flight.pose[:, :2] - predicted.translated
        translated.append(np.sum(along**2, axis=1))
    with np.errstate(over="ignore", invalid="ignore"):  # A model may blow up.
        rms = np.sqrt(np.mean(table.residual**2, axis=0))
    errors = Errors(
        tangential=float(rms[0]),
        normal=float(rms[1]),
        pitch=float(rms[2]),
        position_rms_m=_rms(position),
        position_end_m=float(np.mean(end)),
        pitch_rms_rad=_rms(pitch),
        measured_pitch_position_rms_m=_rms(translated),
    )
    return errors, predictions


def _rms(squares: list[np.ndarray]) -> float:
    return float(np.sqrt(np.mean(np.concatenate(squares))))
