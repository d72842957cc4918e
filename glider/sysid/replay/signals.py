"""Elevator and true states along a log, by the clocks and sensors of a model."""

import numpy as np

from glider.compiled.actuators import turn_elevator
from glider.compiled.replay import log_path, measure_nodes, with_extras
from glider.physics.actuator_replay import elevator_path
from glider.physics.effects import NO_FIELD, SERVO_LAG, Field, Replay
from glider.physics.parameters import NUM_PARAMETERS
from glider.physics.state import NUM_STATES
from glider.sysid.replay.record import Record
from glider.sysid.replay.theta import OFFSET, Layout


def pose_signals(record: Record, theta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Returns the elevator's path over each interval and its mean rate there.

    Shapes (n - 1, 3) at start, middle, end [rad], and (n - 1,) [rad/s]. With a pose
    latency the row of time t shows the flight at t - latency.
    """
    elevator, rate, _ = _signals(record, theta)
    return elevator, rate


def trimmed(record: Record, theta: np.ndarray, trim: float) -> tuple[np.ndarray, float]:
    """Returns a flight's model and the shift of its elevator [rad] for its trim.

    A tail of unknown size at an unknown angle, and ballast, which moves the center of
    mass, are a moment first: their effect on the forces is too small to determine.
    Such a trim is one of the moment alone, that of a tail of the model's size at a
    small angle of attack, 2 S_e (l_h + l_e) / S_w per radian.
    """
    if not record.trim_is_moment:
        return theta, trim
    index = record.layout.index
    area, tail, hinge, offset = (
        theta[index["parameters", name]]
        for name in ("wing_area", "elevator_area", "hinge_offset", "elevator_offset")
    )
    moved = theta.copy()
    slot = index["pitch_moment", "coefficient"]
    moved[slot] -= 2.0 * tail * (hinge + offset) / area * trim  # Up lifts the nose.
    return moved, 0.0


def logged_elevator(record: Record, theta: np.ndarray) -> np.ndarray:
    """Returns the elevator's path at the times of the log's rows, (n,)."""
    return _signals(record, theta)[2]


def _signals(record: Record, theta: np.ndarray) -> tuple[np.ndarray, ...]:
    """Replays the actuator; a record caches the last results."""
    replay = record.layout.replay(theta)
    if replay in record.replays:
        return record.replays[replay]
    n = len(record.time)
    if record.has_servo:
        middle = 0.5 * (record.time[1:] + record.time[:-1])
        query = np.concatenate([record.time, middle]) - replay.latency
        query = np.concatenate([query, record.time])
        tape, rest = (record.switch_times, record.commands), record.rest
        path = replayed_path(replay, *tape, query, start=rest, limits=record.limits)
        here, middle, logged = path[:n], path[n : 2 * n - 1], path[2 * n - 1 :]
        elevator = np.stack([here[:-1], middle, here[1:]], axis=1)
        rate = np.diff(here) / np.diff(record.time)
    else:
        elevator, rate, logged = np.zeros((n - 1, 3)), np.zeros(n - 1), np.zeros(n)
    if len(record.replays) > 32:
        record.replays.clear()
    record.replays[replay] = elevator, rate, logged
    return elevator, rate, logged


def replayed_path(
    replay: Replay,
    switch_times: np.ndarray,
    commands: np.ndarray,
    query: np.ndarray,
    *,
    start: float = 0.0,
    limits: tuple[float, float] | None = None,
) -> np.ndarray:
    """Returns the elevator's angle at the query times [rad], see `elevator_path`.

    Exact for delay and lag; with further actuators, by fine Runge-Kutta steps.
    """
    actuators, delay, lag = replay.actuators, replay.delay, replay.time_constant
    if not actuators:
        return elevator_path(switch_times, commands, query, delay, lag, start, limits)
    if lag > 0.0:
        actuators = ((SERVO_LAG, (lag,)), *actuators)
    stops = (-np.inf, np.inf) if limits is None else limits
    times = switch_times + delay
    return turn_elevator(actuators, times, commands, query, start, stops)


def node_signals(record: Record, theta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Returns the elevator's path and rate at the rows of the pose, (n,) each."""
    elevator, rate = pose_signals(record, theta)
    path = np.append(elevator[:, 0], elevator[-1, 2])
    return path, np.append(rate, rate[-1:])


def sensed(layout: Layout, nodes: np.ndarray, theta: np.ndarray) -> np.ndarray:
    """Returns the pose (n, 3) that the sensors show of states (n, num_states)."""
    return measure_nodes(layout.compiled_kinds, nodes, layout.dynamics(theta))[0]


def true_nodes(
    record: Record, theta: np.ndarray, field: Field = NO_FIELD
) -> np.ndarray:
    """Returns the smoothed states as a model sees them, (n, num_states).

    The model's sensor effects are undone, and the effects' states follow from
    their equations along the flight, at rest where it begins.
    """
    layout = record.layout
    nodes = _without_sensors(record, theta).copy()
    if record.has_servo:
        seen = record.seen[:, 3]
        if seen.any():  # Else the offset is unknown.
            path = logged_elevator(record, theta)
            nodes[:, OFFSET] = np.mean((record.elevator - path)[seen])
    elevator, rate = pose_signals(record, theta)
    start = nodes[0].copy()
    start[OFFSET] += elevator[0, 0]
    first = record.time[0], start, rate[0]
    nodes[0, NUM_STATES:] = layout.steady_states(*first, theta)
    along, dynamics = log_path(record.time, elevator, rate), layout.dynamics(theta)
    return with_extras(layout.compiled_kinds, along, nodes, dynamics, field)


def _without_sensors(record: Record, theta: np.ndarray) -> np.ndarray:
    """Undoes the sensor effects; a record caches the last results."""
    layout = record.layout
    settings = theta[list(layout.sensor_slots)]
    if not np.any(settings):
        return record.nodes
    key = np.concatenate([theta[:NUM_PARAMETERS], settings]).tobytes()
    if key in record.undone:
        return record.undone[key]
    step = 1e-4
    nodes, later = record.nodes.copy(), record.nodes.copy()
    later[:, :3] += step * nodes[:, 4:7]
    for states in (nodes, later):
        shown = states[:, :3].copy()
        for _ in range(6):
            states[:, :3] += shown - sensed(layout, states, theta)
    nodes[:, 4:7] = (later[:, :3] - nodes[:, :3]) / step
    if len(record.undone) > 4:
        record.undone.clear()
    record.undone[key] = nodes
    return nodes
