"""The elevator's path, replayed through the actuator and the clocks of a model."""

import numpy as np

from glider.physics.actuator_replay import elevator_path
from glider.sysid.replay.record import Record


def pose_signals(record: Record, theta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Returns the elevator's path over each interval and its mean rate there.

    Shapes (n - 1, 3) at start, middle, end [rad], and (n - 1,) [rad/s]. A pose
    latency means that the row of time t shows the flight at t - latency.
    """
    elevator, rate, _ = _signals(record, theta)
    return elevator, rate


def logged_elevator(record: Record, theta: np.ndarray) -> np.ndarray:
    """Returns the elevator's path at the times of the log's rows, (n,)."""
    return _signals(record, theta)[2]


def _signals(record: Record, theta: np.ndarray) -> tuple[np.ndarray, ...]:
    """Replays the actuator; a record keeps what it was asked last."""
    index = record.layout.index
    latency = float(theta[index["pose_latency", "latency"]])
    delay = float(theta[index["command_delay", "delay"]])
    time_constant = float(theta[index["servo_lag", "time_constant"]])
    key = (latency, delay, time_constant)
    if key in record.replays:
        return record.replays[key]
    n = len(record.time)
    if record.has_servo:
        middle = 0.5 * (record.time[1:] + record.time[:-1])
        query = np.concatenate([record.time, middle]) - latency
        path = elevator_path(
            record.switch_times,
            record.commands,
            np.concatenate([query, record.time]),
            delay=delay,
            time_constant=time_constant,
            start=record.rest,
            limits=record.limits,
        )
        here, middle, logged = path[:n], path[n : 2 * n - 1], path[2 * n - 1 :]
        elevator = np.stack([here[:-1], middle, here[1:]], axis=1)
        rate = np.diff(here) / np.diff(record.time)
    else:
        elevator, rate, logged = np.zeros((n - 1, 3)), np.zeros(n - 1), np.zeros(n)
    if len(record.replays) > 32:
        record.replays.clear()
    record.replays[key] = elevator, rate, logged
    return elevator, rate, logged


def node_signals(record: Record, theta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Returns the elevator's path and rate at the rows of the pose, (n,) each."""
    elevator, rate = pose_signals(record, theta)
    path = np.append(elevator[:, 0], elevator[-1, 2])
    return path, np.append(rate, rate[-1:])
