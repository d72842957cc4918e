"""Rollouts from fitted starts: free ones, and forces along the measured pitch.

`fit_start` finds the launch state that suits a flight best under a model; along
that rollout the model's errors are exact, not linearised. `AlongPitch` separates
the forces from the moment, whose errors a free rollout multiplies.
"""

import dataclasses

import numpy as np

from glider.compiled.replay import roll_out, translate
from glider.sysid.replay.nodes import (
    sensed,
    true_nodes,
)
from glider.sysid.replay.problem import Problem
from glider.sysid.replay.record import Record
from glider.sysid.replay.sensitivity import (
    fitted_start,
    linearize,
)
from glider.sysid.replay.signals import pose_signals


def cut(record: Record, first: int, last: int) -> Record:
    """Returns the rows [first, last) of a flight as a flight of its own."""
    flight, rows = record.flight, slice(first, last)
    return dataclasses.replace(
        record,
        flight=dataclasses.replace(
            flight,
            time=flight.time[rows],
            pose=flight.pose[rows],
            elevator=None if flight.elevator is None else flight.elevator[rows],
            command=None if flight.command is None else flight.command[rows],
        ),
        time=record.time[rows],
        nodes=record.nodes[rows],
        pitch=record.pitch[first : last - 1],
        acceleration=record.acceleration[rows],
        acceleration_std=record.acceleration_std[rows],
        replays={},
    )


def fly_record(
    problem: Problem, record: Record, theta: np.ndarray, start: np.ndarray
) -> np.ndarray:
    """Returns the states (n, num_states) of a free rollout along a record's times."""
    return roll_out(
        record.layout.compiled_kinds,
        record.time,
        start,
        *pose_signals(record, theta),
        record.layout.dynamics(theta),
        problem.field,
    )


def fit_start(
    problem: Problem, record: Record, theta: np.ndarray, iterations: int = 4
) -> np.ndarray:
    """Returns the launch state (num_states,) that fits a whole record best."""
    nodes = true_nodes(record, theta)
    start = nodes[0].copy()
    for _ in range(iterations):
        errors = linearize(problem, record, theta, nodes=nodes)
        step = fitted_start(errors)
        start = nodes[0] + step
        if not np.all(np.isfinite(start)):
            return true_nodes(record, theta)[0]
        nodes = fly_record(problem, record, theta, start)
        if not np.all(np.isfinite(nodes)):
            return true_nodes(record, theta)[0]
        if np.max(np.abs(step)) < 1e-6:
            break
    return start


class AlongPitch:
    """The forces of a model integrated along a flight's measured pitch.

    A launch is here (x, z, ẋ, ż, elevator offset).
    """

    def __init__(self, problem: Problem, record: Record, theta: np.ndarray):
        """Prepares the pitch that the model's sensors tell of."""
        nodes = true_nodes(record, theta, problem.field)
        change = (nodes - record.nodes)[:, [2, 6]]
        middle = 0.5 * (change[1:] + change[:-1])
        self._pitch = record.pitch + np.stack([change[:-1], middle, change[1:]], axis=1)
        self._record, self._theta, self._field = record, theta, problem.field
        self._state = nodes[0].copy()
        self.first = np.append(nodes[0, [0, 1, 4, 5]], 0.0)
        self._signals = pose_signals(record, theta)

    def places(self, launch: np.ndarray) -> np.ndarray:
        """Returns x and z, as the sensors would show them, (n, 2)."""
        state = self._state.copy()
        state[[0, 1, 4, 5, 3]] = launch
        layout = self._record.layout
        states = translate(
            layout.compiled_kinds,
            self._record.time,
            state,
            self._pitch,
            *self._signals,
            layout.dynamics(self._theta),
            self._field,
        )
        return sensed(layout, states, self._theta)[:, :2]

    def by_launch(self, launch: np.ndarray, flown: np.ndarray) -> np.ndarray:
        """Returns the places' derivatives by the launch, (n, 2, 5)."""
        step = 1e-5
        moved = [self.places(launch + step * unit) - flown for unit in np.eye(5)]
        return np.stack(moved, axis=2) / step
