"""Columns of a linear flight held against differences of its error."""

import dataclasses

import numpy as np

from glider.physics.effects import NO_GAUSSIANS
from glider.physics.state import NUM_STATES
from glider.sysid.likelihood.directions import Direction
from glider.sysid.likelihood.filtering import whiten
from glider.sysid.likelihood.linear_flight import LinearFlight, linearize
from glider.sysid.likelihood.scales import Scales
from glider.sysid.replay.record import Record

SCALES = Scales(position=4e-4, pitch=2.5e-3, elevator=5e-3)

FARTHER = 10.0
"""Steps of these differences, over those of the columns."""

NOTHING = 1e-3
"""Whitened error that a coefficient of its usual scale makes where it does not act."""


def column_error(record: Record, theta: np.ndarray, direction: Direction) -> float:
    """Returns the largest error of a whitened column, over its largest entry."""

    def error_at(numbers: np.ndarray) -> np.ndarray:
        return whitened(linearize(record, numbers, NO_GAUSSIANS))[:, -1]

    flight = linearize(record, theta, NO_GAUSSIANS, [direction])
    column = whitened(flight)[:, 0]
    size = FARTHER * direction.size
    ahead, behind = direction.base(theta), direction.base(theta)
    ahead[direction.slot] += size
    behind[direction.slot] -= size
    numeric = (error_at(behind) - error_at(ahead)) / (2.0 * size)
    if direction.slot in record.space.sensor_slots:
        # The nodes move with what the sensors show, and the launch with them.
        basis, _ = np.linalg.qr(whitened(of_launch(flight)))
        column = column - basis @ (basis.T @ column)
        numeric = numeric - basis @ (basis.T @ numeric)
    nothing = NOTHING / record.space.scale[direction.slot]
    largest = max(np.abs(numeric).max(), nothing)
    return float(np.abs(column - numeric).max() / largest)


def whitened(flight: LinearFlight) -> np.ndarray:
    found = whiten(flight, SCALES).innovations
    return found.reshape(-1, found.shape[2])


def of_launch(flight: LinearFlight) -> LinearFlight:
    """Returns the flight with one column for each number of its launch."""
    unit = np.eye(len(flight.start))[:, :NUM_STATES]
    return dataclasses.replace(
        flight,
        start=unit,
        inputs=np.zeros((*flight.inputs.shape[:2], NUM_STATES)),
        outputs=np.zeros((*flight.outputs.shape[:2], NUM_STATES)),
    )
