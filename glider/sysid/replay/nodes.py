"""States along a flight as a model sees them: what its sensors tell apart undone."""

import numpy as np

from glider.compiled.replay import measure_nodes, with_extras
from glider.physics.effects import NO_FIELD, Field
from glider.physics.parameters import NUM_PARAMETERS
from glider.physics.state import NUM_STATES
from glider.sysid.replay.record import Record
from glider.sysid.replay.signals import logged_elevator, pose_signals
from glider.sysid.replay.theta import OFFSET, Layout


def sensed(layout: Layout, nodes: np.ndarray, theta: np.ndarray) -> np.ndarray:
    """Returns the pose (n, 3) that the sensors show of states (n, num_states)."""
    nothing, kinds = np.zeros(0, dtype=np.int64), layout.compiled_kinds
    return measure_nodes(kinds, nodes, layout.dynamics(theta), nothing, layout.scale)[0]


def true_nodes(
    record: Record, theta: np.ndarray, field: Field = NO_FIELD
) -> np.ndarray:
    """Returns the smoothed states as a model sees them, (n, num_states).

    The model's sensor effects are undone, and the effects' own states follow from
    their equations along the flight, at rest where it begins.
    """
    layout = record.layout
    nodes = _without_sensors(record, theta).copy()
    if record.has_servo:
        seen = record.seen[:, 3]
        if seen.any():  # Else it has no offset that is known of.
            path = logged_elevator(record, theta)
            nodes[:, OFFSET] = np.mean((record.elevator - path)[seen])
    nodes[0, NUM_STATES:] = launch_steady_states(record, theta, nodes[0])
    return with_extras(
        layout.compiled_kinds,
        record.time,
        nodes,
        *pose_signals(record, theta),
        layout.dynamics(theta),
        field,
    )


def _without_sensors(record: Record, theta: np.ndarray) -> np.ndarray:
    """Undoes the sensor effects; a record keeps what it was asked last."""
    layout = record.layout
    numbers = theta[list(layout.sensor_slots)]
    if not np.any(numbers):
        return record.nodes
    key = np.concatenate([theta[:NUM_PARAMETERS], numbers]).tobytes()
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


def launch_steady_states(
    record: Record, theta: np.ndarray, start: np.ndarray
) -> np.ndarray:
    """Returns the effects' own states at rest at a flight's first row."""
    elevator, rate = pose_signals(record, theta)
    state = start.copy()
    state[OFFSET] += elevator[0, 0]
    return record.layout.steady_states(record.time[0], state, rate[0], theta)
