"""A log as a model replays it: elevator, true states, flow, and the residual.

The residual is measured minus modelled acceleration, along the wing, normal to it and
in pitch. The coefficients behind it, C_L, C_D, C_M, refer to ½ρV²S_w (the moment
without a chord) and come with the variables that they may depend on: the article's
data set.
"""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np

from glider.compiled import replay as compiled
from glider.compiled.actuators import replayed_path
from glider.compiled.replay import OFFSET
from glider.physics.effects import FLOW_VARIABLES, NO_GAUSSIANS, PITCH_MOMENT, Gaussians
from glider.physics.effects.free_functions import COEFFICIENTS
from glider.physics.parameter_space import ParameterSpace
from glider.physics.state import NUM_STATES
from glider.sysid.replay.log_space import resting_states, sensed
from glider.sysid.replay.record import Record
from glider.sysid.result import ResidualTable

_EDGE = 3  # Rows at both ends of a flight where an acceleration is not known well.
_PERTURBATION = 1e-6  # Of where an elevator began [rad].
_REPLAYS = 8  # Replays of its elevator that are kept with a record.


class _Signals(NamedTuple):
    """An elevator along a log."""

    elevator: np.ndarray  #: (n - 1, 3) at start, middle, end of intervals [rad].
    rate: np.ndarray  #: (n - 1,) mean of each interval [rad/s].
    logged: np.ndarray  #: (n,) at the times of the log's rows [rad].

    @property
    def at_nodes(self) -> tuple[np.ndarray, np.ndarray]:
        """Angle and rate at the rows of the pose, (n,) each."""
        path = np.append(self.elevator[:, 0], self.elevator[-1, 2])
        return path, np.append(self.rate, self.rate[-1:])


def signals(record: Record, theta: np.ndarray) -> _Signals:
    """Replays a log's elevator.

    With a pose latency the row of time t shows the flight at t - latency.
    """
    return _kept(_replayed, record, theta)


def offset_persists(record: Record, theta: np.ndarray) -> np.ndarray:
    """Whether a log's elevator is off by as much as where it began, (n,).

    It is not after a stop, where it forgets that.
    """
    return _kept(_persisting, record, theta)


def _kept(make: Callable, record: Record, theta: np.ndarray) -> Any:
    """Makes what depends on the last entries of theta, which replay a log, once."""
    kept = record.replays
    key = make, theta[record.space.num_flown :].tobytes()
    if key not in kept:
        if len(kept) >= _REPLAYS:
            kept.clear()
        kept[key] = make(record, theta)
    return kept[key]


def _replayed(record: Record, theta: np.ndarray) -> _Signals:
    middle = 0.5 * (record.time[1:] + record.time[:-1])
    times = np.concatenate([record.time, middle])
    path = _path_from(record, theta, record.rest, times)
    n = len(record.time)
    elevator = np.empty((n - 1, 3))
    elevator[:, 0] = path[: n - 1]
    elevator[:, 1] = path[n : len(times)]
    elevator[:, 2] = path[1:n]
    rate = (path[1:n] - path[: n - 1]) / np.diff(record.time)
    return _Signals(elevator, rate, path[len(times) :])


def _persisting(record: Record, theta: np.ndarray) -> np.ndarray:
    usual, other = (
        _path_from(record, theta, record.rest + change, record.time)
        for change in (0.0, _PERTURBATION)
    )
    is_off = other - usual > 0.5 * _PERTURBATION
    return np.logical_and.accumulate(is_off[: len(record.time)])


def _path_from(
    record: Record, theta: np.ndarray, start: float, times: np.ndarray
) -> np.ndarray:
    """Returns an elevator's path from some start [rad]: flown, then logged.

    That is at the times (m,), and as the log shows it at the rows (n,). One that is not
    commanded stands where it began, at zero.
    """
    if not record.has_servo:
        return np.full(len(times) + len(record.time), start - record.rest)
    replay = record.space.replay(theta)
    latency = replay.latency + replay.drift * record.place
    query = np.concatenate([times - latency, record.time])
    tape = record.switch_times, record.commands
    path = replayed_path(replay, *tape, query, record.servo, start=start)
    return path + np.interp(query, record.time, record.departure)


def trimmed(record: Record, theta: np.ndarray, trim: float) -> tuple[np.ndarray, float]:
    """Returns a flight's model and the shift of its elevator [rad] for its trim.

    A tail of unknown size at an unknown angle, and ballast, which moves the center of
    mass, are a moment first: their effect on the forces is too small to determine.
    Such a trim is one of the moment alone, that of a tail of the model's size at a
    small angle of attack, 2 S_e (l_h + l_e) / S_w per radian.
    """
    if not record.trim_is_moment:
        return theta, trim
    index = record.space.index
    moved = theta.copy()
    area, tail, hinge, offset = (
        theta[index[name]]
        for name in ("wing_area", "elevator_area", "hinge_offset", "elevator_offset")
    )
    [slot] = record.space.slots_of(PITCH_MOMENT.kind)
    moved[slot] -= 2.0 * tail * (hinge + offset) / area * trim  # Up lifts the nose.
    return moved, 0.0


def true_nodes(
    record: Record,
    theta: np.ndarray,
    gaussians: Gaussians = NO_GAUSSIANS,
    with_states: bool = False,
) -> np.ndarray:
    """Returns the smoothed states as a model sees them, (n, num_states).

    The model's sensor effects are undone. The effects' states follow from their
    equations along the flight, at rest where it begins; those that move nothing are
    zero unless they are asked for.
    """
    nodes = _without_sensors(record, theta, gaussians)
    elevator, rate, logged = signals(record, theta)
    persists = offset_persists(record, theta)
    shown = record.seen[:, 3] & persists
    if shown.any():  # Else the offset is unknown.
        nodes[persists, OFFSET] = np.mean((record.elevator - logged)[shown])
    if not with_states and record.space.acting_states(theta)[-1] < NUM_STATES:
        return nodes
    along = compiled.log_path(record.time, elevator, rate)
    begin = nodes.copy()
    begin[0, NUM_STATES:] = states_at_rest(record, theta, nodes[0])
    kinds = record.space.flown
    return compiled.with_extras(kinds, along, begin, theta, gaussians)


def states_at_rest(record: Record, theta: np.ndarray, first: np.ndarray) -> np.ndarray:
    """Returns the effects' states at rest in a flight's first node (num_states,)."""
    elevator, rate, _ = signals(record, theta)
    start = first.copy()
    start[OFFSET] += elevator[0, 0]
    return resting_states(record.space, record.time[0], start, rate[0], theta)


def reads_truly(space: ParameterSpace, theta: np.ndarray, gaussians: Gaussians) -> bool:
    """Whether a model's sensors show the pose as it is."""
    is_read = gaussians.weights.shape[1] > gaussians.num_flown
    return not is_read and not np.any(theta[list(space.sensor_slots)])


def _without_sensors(
    record: Record, theta: np.ndarray, gaussians: Gaussians
) -> np.ndarray:
    """Undoes the sensor effects, also of the nodes a short time later."""
    space = record.space
    n = len(record.time)
    step = 1e-4
    if reads_truly(space, theta, gaussians):
        return record.nodes.copy()
    states = np.tile(record.nodes, (2, 1))
    states[n:, :3] += step * states[n:, 4:7]
    shown = states[:, :3].copy()
    for _ in range(6):
        missed = shown - sensed(space, states, theta, gaussians)
        states[:, :3] += missed
        if np.abs(missed).max() < 1e-14:  # Most effects are gone at once.
            break

    nodes = states[:n]
    later = states[n:]
    nodes[:, 4:7] = (later[:, :3] - nodes[:, :3]) / step
    return nodes


def flow_at_nodes(
    record: Record,
    theta: np.ndarray,
    nodes: np.ndarray,
    gaussians: Gaussians = NO_GAUSSIANS,
) -> np.ndarray:
    """Returns the flow (n, 5 + v) in still air at a flight's states (n, num_states).

    Its columns are those of `compiled.replay.log_flow`, FLOW_VARIABLES last.
    """
    kinds = record.space.flown
    at_nodes = signals(record, theta).at_nodes
    return compiled.flow_at(kinds, record.time, nodes, *at_nodes, theta, gaussians)


def make_table(
    records: Sequence[Record],
    theta: np.ndarray,
    trims: Sequence[float],
    gaussians: Gaussians = NO_GAUSSIANS,
) -> ResidualTable:
    """Stacks the residual of flights, each with its elevator trim [rad]."""
    flights = []
    for record, trim in zip(records, trims, strict=True):
        moved, shift = trimmed(record, theta, trim)
        nodes = true_nodes(record, moved, gaussians)
        nodes[:, OFFSET] = shift
        flow = flow_at_nodes(record, moved, nodes, gaussians)
        alpha = np.unwrap(flow[:, 5 + FLOW_VARIABLES.index("alpha")])
        turning = np.gradient(alpha, record.time)
        own = nodes[:, 2], flow, alpha, turning
        accelerations = record.acceleration, record.acceleration_std
        flights.append([values[_EDGE:-_EDGE] for values in (*own, *accelerations)])

    stacked = map(np.concatenate, zip(*flights, strict=True))
    pitch, flow, alpha, turning, measured, std = stacked
    modelled, (air_x, air_z), variables = flow[:, :3], flow[:, 3:5].T, flow[:, 5:].T
    of_flow = dict(zip(FLOW_VARIABLES, variables, strict=True))
    mass, area, inertia, density, gravity = (
        theta[records[0].space.index[name]]
        for name in ("mass", "wing_area", "pitch_inertia", "air_density", "gravity")
    )
    pressure = 0.5 * density * of_flow["V"] ** 2 * area
    sine = np.sin(pitch)
    cosine = np.cos(pitch)

    def coefficients(accelerations: np.ndarray) -> dict[str, np.ndarray]:
        x, z, angular = accelerations.T
        along = pressure * of_flow["V"] / mass
        z = z + gravity
        lift = (z * air_x - x * air_z) / along
        drag = -(x * air_x + z * air_z) / along
        moment = inertia * angular / pressure
        return dict(zip(COEFFICIENTS, (lift, drag, moment), strict=True))

    (x, z, angular), (std_x, std_z, std_angular) = (measured - modelled).T, std.T
    along = x * cosine - z * sine
    normal = x * sine + z * cosine
    noise = (
        np.hypot(std_x * cosine, std_z * sine),
        np.hypot(std_x * sine, std_z * cosine),
    )
    return ResidualTable(
        variables={**of_flow, "alpha": alpha, "alphadot": turning},
        residual=np.column_stack([along, normal, angular]),
        coefficients=coefficients(measured),
        modelled=coefficients(modelled),
        flight=np.repeat(np.arange(len(flights)), [len(own[0]) for own in flights]),
        names=tuple(record.name for record in records),
        noise=np.column_stack([*noise, std_angular]),
    )
