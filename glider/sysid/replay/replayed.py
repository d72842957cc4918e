"""A log as a model replays it: elevator, true states, flow, and the residual.

The residual is measured minus modelled acceleration, along the wing, normal to it and
in pitch. The coefficients behind it, C_L, C_D, C_M, refer to ½ρV²S_w (the moment
without a chord) and come with the variables that they may depend on: the article's
data set.

A model is a vector theta of a `ParameterSpace`, whose last entries replay a log:
`signals` gives the elevator, `true_nodes` the states behind the measured ones,
`flow_at_nodes` the flow and the modelled accelerations there, and `make_table` the
residual of all flights.
"""

import functools
from collections.abc import Callable, Sequence
from typing import NamedTuple, TypeVar

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

_T = TypeVar("_T")
_EDGE = 3  # Rows at both ends of a flight where an acceleration is not known well.
_PERTURBATION = 1e-6  # Of where an elevator began [rad].
_SHORTLY = 1e-4  # Time over which velocities are differenced [s].
_REPLAYS = 8  # Replays of its elevator that are kept with a record.


class _Signals(NamedTuple):
    """An elevator along a log of n rows.

    Attributes:
        elevator: (n - 1, 3) at start, middle and end of each interval [rad].
        rate: (n - 1,) mean of each interval [rad/s].
        logged: (n,) as the log shows it at its rows [rad].
    """

    elevator: np.ndarray
    rate: np.ndarray
    logged: np.ndarray

    @property
    def at_nodes(self) -> tuple[np.ndarray, np.ndarray]:
        """Angle [rad] and rate [rad/s] at the rows of the pose, (n,) each."""
        path = np.append(self.elevator[:, 0], self.elevator[-1, 2])
        return path, np.append(self.rate, self.rate[-1:])


def _kept(make: Callable[[Record, np.ndarray], _T]) -> Callable[..., _T]:
    """Makes what depends on the last entries of theta, which replay a log, once."""

    @functools.wraps(make)
    def find(record: Record, theta: np.ndarray) -> _T:
        kept = record.replays
        key = make.__name__, theta[record.space.num_flown :].tobytes()
        if key not in kept:
            if len(kept) >= _REPLAYS:
                kept.clear()
            kept[key] = make(record, theta)

        return kept[key]

    return find


@_kept
def signals(record: Record, theta: np.ndarray) -> _Signals:
    """Replays the commands of a log (n rows) by a model's servo.

    With a pose latency the row of time t shows the flight at t - latency. What the
    elevator does beside the commands, `record.departure`, is added.
    """
    # The flown path at the nodes and midpoints, then the logged one.
    n = len(record.time)
    middles = 0.5 * (record.time[1:] + record.time[:-1])
    times = np.concatenate([record.time, middles])
    path = _path_from(record, theta, record.rest, times)
    at_nodes, at_middles, logged = np.split(path, [n, len(times)])
    return _Signals(
        elevator=np.column_stack([at_nodes[:-1], at_middles, at_nodes[1:]]),
        rate=np.diff(at_nodes) / np.diff(record.time),
        logged=logged,
    )


@_kept
def offset_persists(record: Record, theta: np.ndarray) -> np.ndarray:
    """Whether a log's elevator is off by as much as where it began, at its rows (n,).

    It is not after a stop, where it forgets that: two starts are compared.
    """
    usual = _path_from(record, theta, record.rest, record.time)
    other = _path_from(record, theta, record.rest + _PERTURBATION, record.time)
    is_off = other - usual > 0.5 * _PERTURBATION
    return np.logical_and.accumulate(is_off[: len(record.time)])


def _path_from(
    record: Record, theta: np.ndarray, start: float, times: np.ndarray
) -> np.ndarray:
    """Returns an elevator's path from some start [rad].

    That is the path as it is flown at times (m,) [s] of the poses' clock, then as the
    log shows it at the rows (n,). An elevator that is not commanded stands where it
    began, at zero.
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

    Args:
        record: the flight.
        theta: the model.
        trim: of the elevator in this flight [rad].
    """
    if not record.trim_is_moment:
        return theta, trim
    names = "wing_area", "elevator_area", "hinge_offset", "elevator_offset"
    wing, tail, hinge, offset = theta[record.space.places(names)]
    [slot] = record.space.slots_of(PITCH_MOMENT.kind)
    moved = theta.copy()
    moved[slot] -= 2.0 * tail * (hinge + offset) / wing * trim  # Up lifts the nose.
    return moved, 0.0


def true_nodes(
    record: Record,
    theta: np.ndarray,
    gaussians: Gaussians = NO_GAUSSIANS,
    with_states: bool = False,
) -> np.ndarray:
    """Returns the smoothed states as a model sees them, (n, num_states).

    The model's sensor effects are undone. The elevator's state is its offset from the
    replayed path: the mean of the measured one. The effects' states follow from their
    equations along the flight, at rest where it begins.

    Args:
        record: the flight.
        theta: the model.
        gaussians: its free functions.
        with_states: whether to fly effects' states that move nothing, too; else they
            are zero.
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
    return compiled.with_extras(record.space.flown, along, begin, theta, gaussians)


def states_at_rest(record: Record, theta: np.ndarray, first: np.ndarray) -> np.ndarray:
    """Returns the effects' states at rest in a flight's first node (num_states,)."""
    elevator, rate, _ = signals(record, theta)
    start = first.copy()
    start[OFFSET] += elevator[0, 0]
    return resting_states(record.space, record.time[0], start, rate[0], theta)


def reads_truly(space: ParameterSpace, theta: np.ndarray, gaussians: Gaussians) -> bool:
    """Whether a model's sensors show the pose as it is: without effects on them."""
    is_read = gaussians.weights.shape[1] > gaussians.num_flown
    return not is_read and not np.any(theta[list(space.sensor_slots)])


def _without_sensors(
    record: Record, theta: np.ndarray, gaussians: Gaussians
) -> np.ndarray:
    """Returns the states (n, num_states) whose poses the sensors show as measured.

    Solved by fixed-point iteration, also at the nodes a short time later: the
    difference of the two poses is the velocity.
    """
    space = record.space
    if reads_truly(space, theta, gaussians):
        return record.nodes.copy()

    n = len(record.time)
    states = np.tile(record.nodes, (2, 1))
    now = states[:n]
    later = states[n:]
    later[:, :3] += _SHORTLY * later[:, 4:7]
    shown = states[:, :3].copy()
    for _ in range(6):
        missed = shown - sensed(space, states, theta, gaussians)
        states[:, :3] += missed
        if np.abs(missed).max() < 1e-14:  # Most effects are gone at once.
            break

    now[:, 4:7] = (later[:, :3] - now[:, :3]) / _SHORTLY
    return now


def flow_at_nodes(
    record: Record,
    theta: np.ndarray,
    nodes: np.ndarray,
    gaussians: Gaussians = NO_GAUSSIANS,
) -> np.ndarray:
    """Returns the flow in still air at the states of a flight.

    Args:
        record: the flight.
        theta: the model.
        nodes: its states (n, num_states), as of `true_nodes`.
        gaussians: its free functions.

    Returns:
        an array (n, 5 + v): modelled accelerations ẍ, z̈ [m/s²] and θ̈ [rad/s²], velocity
        through the air, (x, z) in the world [m/s], and FLOW_VARIABLES.
    """
    kinds = record.space.flown
    at_nodes = signals(record, theta).at_nodes
    return compiled.flow_at(kinds, record.time, nodes, *at_nodes, theta, gaussians)


def _rows_of(
    record: Record, theta: np.ndarray, trim: float, gaussians: Gaussians
) -> list[np.ndarray]:
    """Collects a flight's rows, but those near its ends, with an elevator trim [rad].

    Returns:
        pitch (n,) [rad], flow (n, 5 + v), see `flow_at_nodes`, angle of attack without
        jumps (n,) [rad], its rate (n,) [rad/s], and measured ẍ, z̈ [m/s²], θ̈ [rad/s²]
        with their standard errors (n, 3).
    """
    moved, shift = trimmed(record, theta, trim)
    nodes = true_nodes(record, moved, gaussians)
    nodes[:, OFFSET] = shift  # Else the elevator follows its commands.
    flow = flow_at_nodes(record, moved, nodes, gaussians)
    alpha = np.unwrap(flow[:, 5 + FLOW_VARIABLES.index("alpha")])
    alphadot = np.gradient(alpha, record.time)
    motion = nodes[:, 2], flow, alpha, alphadot
    measured = record.acceleration, record.acceleration_std
    return [values[_EDGE:-_EDGE] for values in (*motion, *measured)]


def _coefficients_of(
    acceleration: np.ndarray, flow: np.ndarray, space: ParameterSpace, theta: np.ndarray
) -> dict[str, np.ndarray]:
    """Returns C_L, C_D and C_M, (n,) each, behind accelerations (n, 3).

    With the velocity v through the air (of `flow`, see `flow_at_nodes`), the force
    f = m (a + g ẑ) and the pressure force q S = ½ ρ V² S_w they are
    C_L = (f × v)_y / (q S V), C_D = -(f · v) / (q S V) and C_M = I θ̈ / (q S).
    """
    names = "mass", "wing_area", "pitch_inertia", "air_density", "gravity"
    mass, area, inertia, density, gravity = theta[space.places(names)]
    speed = flow[:, 5 + FLOW_VARIABLES.index("V")]
    air_x, air_z = flow[:, 3:5].T
    x, z, angular = acceleration.T
    z = z + gravity

    pressure_force = 0.5 * density * speed**2 * area
    per_velocity = pressure_force * speed / mass
    lift = (z * air_x - x * air_z) / per_velocity
    drag = -(x * air_x + z * air_z) / per_velocity
    moment = inertia * angular / pressure_force
    return dict(zip(COEFFICIENTS, (lift, drag, moment), strict=True))


def make_table(
    records: Sequence[Record],
    theta: np.ndarray,
    trims: Sequence[float],
    gaussians: Gaussians = NO_GAUSSIANS,
) -> ResidualTable:
    """Stacks the residual of flights.

    Args:
        records: the flights.
        theta: the model.
        trims: of each flight's elevator [rad].
        gaussians: the model's free functions.
    """
    flights = [
        _rows_of(record, theta, trim, gaussians)
        for record, trim in zip(records, trims, strict=True)
    ]
    stacked = map(np.concatenate, zip(*flights, strict=True))
    pitch, flow, alpha, alphadot, measured, std = stacked
    modelled = flow[:, :3]
    x, z, angular = (measured - modelled).T
    std_x, std_z, std_angular = std.T

    # Components along the measured wing and normal to it.
    sine = np.sin(pitch)
    cosine = np.cos(pitch)
    along = x * cosine - z * sine
    normal = x * sine + z * cosine
    std_along = np.hypot(std_x * cosine, std_z * sine)
    std_normal = np.hypot(std_x * sine, std_z * cosine)

    variables = dict(zip(FLOW_VARIABLES, flow[:, 5:].T, strict=True))
    space = records[0].space
    return ResidualTable(
        variables={**variables, "alpha": alpha, "alphadot": alphadot},
        residual=np.column_stack([along, normal, angular]),
        coefficients=_coefficients_of(measured, flow, space, theta),
        modelled=_coefficients_of(modelled, flow, space, theta),
        flight=np.repeat(np.arange(len(flights)), [len(own[0]) for own in flights]),
        names=tuple(record.name for record in records),
        noise=np.column_stack([std_along, std_normal, std_angular]),
    )
