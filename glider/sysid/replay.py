"""A log made ready to be flown again: clean signals, smoothed states, a model's errors.

A model is here one vector theta of numbers, in the order of SLOTS; `prepare`
smooths the flights of a campaign once; `linearize` compares a flight with a
model by flying each interval between two rows from the smoothed state (multiple
shooting), so that what comes out is the output-error problem of the whole
flight, linearised about the measurement instead of about a wrong model. In that
form a model's error, and each coefficient's signature in it, stay linear even
where free rollouts have long parted from the flight.
"""

import dataclasses
import functools
import types

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from glider.actuator import command_steps, elevator_path
from glider.effects import KINDS, LIBRARY, NO_FIELD, Field
from glider.kernel import compiled
from glider.parameters import PARAMETER_NAMES, GliderParameters, parameter_vector
from glider.state import NUM_STATES
from glider.sysid.flight_log import Campaign, Flight
from glider.sysid.smoothing import Smoothing, estimate_noise, smoothing_maps

SIGNAL_KINDS = ("servo_lag", "command_delay", "pose_latency")
"""Effects on the clocks and paths of the log's signals, replayed exactly."""

KERNEL_EFFECTS = tuple(
    e for e in LIBRARY if e.kind not in (*SIGNAL_KINDS, "angle_sign")
)
"""The effects that the compiled dynamics hold."""

NUM_KERNEL_STATES = NUM_STATES + sum(len(e.states) for e in KERNEL_EFFECTS)
"""x[3] is there the elevator's constant offset from its replayed path."""

OFFSET = 3

SLOTS: tuple[tuple[str, str], ...] = (
    *(("parameters", name) for name in PARAMETER_NAMES),
    *((e.kind, c.name) for e in KERNEL_EFFECTS for c in e.coefficients),
    *((k, c.name) for k in SIGNAL_KINDS for c in KINDS[k].coefficients),
)
"""What each entry of theta is: (kind, coefficient)."""

INDEX = {slot: i for i, slot in enumerate(SLOTS)}
NUM_KERNEL_THETA = len(PARAMETER_NAMES) + sum(
    len(e.coefficients) for e in KERNEL_EFFECTS
)


@functools.cache
def kernel() -> types.SimpleNamespace:
    """Returns the compiled loops that hold the whole library."""
    return compiled(KERNEL_EFFECTS, True)


def slots_of(kind: str) -> tuple[int, ...]:
    """Returns where a kind's coefficients lie in theta."""
    return tuple(i for i, (k, _) in enumerate(SLOTS) if k == kind)


def default_theta(parameters: GliderParameters) -> np.ndarray:
    """Returns theta of the drawing: its parameters and effects that do nothing."""
    coefficients = [
        c.default
        for e in (*KERNEL_EFFECTS, *(KINDS[k] for k in SIGNAL_KINDS))
        for c in e.coefficients
    ]
    return np.concatenate([parameter_vector(parameters), coefficients])


@functools.cache
def _bounds() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    lower, upper, scale = [], [], []
    for kind, name in SLOTS:
        if kind == "parameters":
            is_offset = name == "wing_offset"
            lower.append(-0.1 if is_offset else 1e-6)
            upper.append(0.1 if is_offset else 1e4)
            scale.append(0.01)
        else:
            c = next(c for c in KINDS[kind].coefficients if c.name == name)
            lower.append(c.lower)
            upper.append(c.upper)
            scale.append(c.scale)
    return np.array(lower), np.array(upper), np.array(scale)


def theta_lower() -> np.ndarray:
    """Returns the smallest physical theta."""
    return _bounds()[0]


def theta_upper() -> np.ndarray:
    """Returns the largest physical theta."""
    return _bounds()[1]


def theta_scale() -> np.ndarray:
    """Returns typical sizes of theta's entries."""
    return _bounds()[2]


@dataclasses.dataclass(frozen=True, kw_only=True)
class Noise:
    """Standard deviation of the measurements, and what smooths them.

    Attributes:
        position: of x and z [m].
        pitch: [rad].
        elevator: [rad]; 0 without a servo.
        smoothing: of the channels x, z, pitch.
    """

    position: float
    pitch: float
    elevator: float
    smoothing: tuple[Smoothing, ...]


@dataclasses.dataclass(frozen=True, kw_only=True)
class Record:
    """A flight, cleaned and smoothed.

    Attributes:
        flight: as logged, with the signs of `angle_sign` undone.
        time: (n,) from the first row [s].
        nodes: (n, 8) smoothed states, the linearisation points.
        pitch: (n - 1, 3, 2) smoothed pitch and its rate at the start, middle and
            end of each interval.
        acceleration: (n, 3) smoothed ẍ, z̈, θ̈.
        acceleration_std: (n, 3) of them, from the measurement noise alone.
        switch_times: (k,) of the commands, on the same clock [s].
        commands: (k,) [rad/s].
        limits: travel of the elevator [rad], or None.
        rest: where the elevator stood before the first command [rad].
    """

    flight: Flight
    time: np.ndarray
    nodes: np.ndarray
    pitch: np.ndarray
    acceleration: np.ndarray
    acceleration_std: np.ndarray
    switch_times: np.ndarray
    commands: np.ndarray
    limits: tuple[float, float] | None
    rest: float
    _signals: dict[tuple[float, ...], tuple[np.ndarray, ...]] = dataclasses.field(
        default_factory=dict, repr=False, compare=False
    )

    @property
    def has_servo(self) -> bool:
        """Whether the elevator was commanded and measured."""
        return self.flight.elevator is not None


def measure_noise(campaign: Campaign) -> Noise:
    """Finds the noise of a campaign's channels from all its flights."""
    times = [f.time for f in campaign.flights]
    smoothing = estimate_noise(times, [f.pose for f in campaign.flights])
    position = float(np.sqrt(np.mean([s.noise**2 for s in smoothing[:2]])))
    elevator = 0.0
    if campaign.elevator == "servo":
        errors = [_elevator_error(f, campaign.command_rate) for f in campaign.flights]
        elevator = estimate_noise(times, [e[:, None] for e in errors])[0].noise
    return Noise(
        position=max(position, _LEAST_POSITION),
        pitch=max(smoothing[2].noise, _LEAST_ANGLE),
        elevator=max(elevator, _LEAST_ANGLE),
        smoothing=smoothing,
    )


_LEAST_POSITION = 1e-6
_LEAST_ANGLE = 1e-5
"""No log is better than this [m, rad]; a computed column has no noise at all."""


def _elevator_error(flight: Flight, command_rate: float | None) -> np.ndarray:
    """Logged elevator minus the integrated commands [rad]."""
    assert flight.command is not None and flight.elevator is not None
    switches, commands = command_steps(flight.time, flight.command, command_rate)
    return flight.elevator - elevator_path(switches, commands, flight.time)


def prepare(
    flights: tuple[Flight, ...], campaign: Campaign, noise: Noise
) -> list[Record]:
    """Smooths flights; the maps of equal time grids are shared."""
    maps: dict[bytes, list[np.ndarray]] = {}
    records = []
    for flight in flights:
        time = flight.time - flight.time[0]
        key = np.round(time, 7).tobytes()
        if key not in maps:
            query = np.concatenate([time, 0.5 * (time[1:] + time[:-1])])
            maps[key] = [smoothing_maps(time, query, s.ratio) for s in noise.smoothing]
        records.append(_record(flight, time, maps[key], campaign, noise))
    return records


def _record(
    flight: Flight,
    time: np.ndarray,
    maps: list[np.ndarray],
    campaign: Campaign,
    noise: Noise,
) -> Record:
    n = len(time)
    curves = np.stack([maps[j] @ flight.pose[:, j] for j in range(3)], axis=2)
    nodes = np.zeros((n, NUM_KERNEL_STATES))
    nodes[:, 0:3] = curves[0, :n]
    nodes[:, 4:7] = curves[1, :n]
    nodes[:, NUM_STATES:] = _sin_alpha(nodes)[:, None]
    pitch = np.stack([curves[0, :, 2], curves[1, :, 2]], axis=1)
    pitch = np.stack([pitch[: n - 1], pitch[n:], pitch[1:n]], axis=1)
    levels = (noise.smoothing[0].noise, noise.smoothing[1].noise, noise.pitch)
    deviation = [
        level * np.linalg.norm(m[2, :n], axis=1)
        for level, m in zip(levels, maps, strict=True)
    ]
    switches, commands, rest = np.zeros(1), np.zeros(1), 0.0
    if flight.command is not None and flight.elevator is not None:
        switches, commands = command_steps(time, flight.command, campaign.command_rate)
        rest = float(flight.elevator[0])  # Its noise is what x[3] is for.
    return Record(
        flight=flight,
        time=time,
        nodes=nodes,
        pitch=pitch,
        acceleration=curves[2, :n],
        acceleration_std=np.stack(deviation, axis=1),
        switch_times=switches,
        commands=commands,
        limits=campaign.elevator_limits if flight.command is not None else None,
        rest=rest,
    )


def _sin_alpha(nodes: np.ndarray) -> np.ndarray:
    pitch, xdot, zdot = nodes[:, 2], nodes[:, 4], nodes[:, 5]
    speed = np.hypot(xdot, zdot) + 1e-9
    return -(xdot * np.sin(pitch) + zdot * np.cos(pitch)) / speed


# ------------------------------------------------------------------- signals


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
    latency = float(theta[INDEX["pose_latency", "latency"]])
    delay = float(theta[INDEX["command_delay", "delay"]])
    time_constant = float(theta[INDEX["servo_lag", "time_constant"]])
    key = (latency, delay, time_constant)
    if key in record._signals:
        return record._signals[key]
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
    if len(record._signals) > 32:
        record._signals.clear()
    record._signals[key] = elevator, rate, logged
    return elevator, rate, logged


def node_signals(record: Record, theta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Returns the elevator's path and rate at the rows of the pose, (n,) each."""
    elevator, rate = pose_signals(record, theta)
    path = np.append(elevator[:, 0], elevator[-1, 2])
    return path, np.append(rate, rate[-1:])


# -------------------------------------------------------------------- sensors

_SENSOR_SLOTS = [
    i for i, (kind, _) in enumerate(SLOTS)
    if kind in KINDS and KINDS[kind].stage == "sensor" and kind not in SIGNAL_KINDS
]  # fmt: skip


def sensed(nodes: np.ndarray, theta: np.ndarray) -> np.ndarray:
    """Returns the pose (n, 3) that the sensors show of states (n, 8)."""
    nothing = np.zeros(0, dtype=np.int64)
    pose = np.empty((len(nodes), 3))
    kernel().log_measure(
        nodes,
        theta[:NUM_KERNEL_THETA],
        nothing,
        theta_scale(),
        pose,
        np.empty((len(nodes), 3, nodes.shape[1])),
        np.empty((len(nodes), 3, 0)),
    )
    return pose


def true_nodes(
    record: Record, theta: np.ndarray, field: Field = NO_FIELD
) -> np.ndarray:
    """Returns the smoothed states as a model sees them, (n, 8).

    The model's sensor effects are undone, and the effects' own states follow from
    their equations along the flight.
    """
    nodes = record.nodes.copy()
    if np.any(theta[_SENSOR_SLOTS]):
        step = 1e-4
        later = nodes.copy()
        later[:, :3] += step * nodes[:, 4:7]
        for states in (nodes, later):
            shown = states[:, :3].copy()
            for _ in range(6):
                states[:, :3] += shown - sensed(states, theta)
        nodes[:, 4:7] = (later[:, :3] - nodes[:, :3]) / step
    nodes[:, NUM_STATES:] = _sin_alpha(nodes)[:, None]
    if record.flight.elevator is not None:
        path = logged_elevator(record, theta)
        nodes[:, OFFSET] = np.mean(record.flight.elevator - path)
    kernel().log_extras(
        record.time,
        nodes,
        *pose_signals(record, theta),
        theta[:NUM_KERNEL_THETA],
        field,
    )
    return nodes


# ------------------------------------------------------------- linearisation


@dataclasses.dataclass(frozen=True, kw_only=True)
class Linearized:
    """A flight's errors against a model, linear in launch state and theta.

    error = residual - by_start δstart - by_theta δtheta, all divided by the
    noise's standard deviation, so that under the true model the errors are
    independent with variance one.

    Attributes:
        residual: (rows,): x, z, pitch row by row, then the elevator, then the
            prior of the launch state.
        by_start: (rows, 8).
        by_theta: (rows, m).
        start: (8,) launch state that δstart is counted from.
    """

    residual: np.ndarray
    by_start: np.ndarray
    by_theta: np.ndarray
    start: np.ndarray


def linearize(
    record: Record,
    theta: np.ndarray,
    free: tuple[int, ...],
    noise: Noise,
    *,
    field: Field = NO_FIELD,
    nodes: np.ndarray | None = None,
    forcing: np.ndarray | None = None,
    trim_is_known: bool = True,
) -> Linearized:
    """Compares a flight with a model; see the module's docstring.

    Args:
        record: the flight.
        theta: the model, in the order of SLOTS.
        free: indices into theta of the columns wanted.
        noise: of the campaign.
        field: a residual field.
        nodes: (n, 8) other linearisation points than the smoothed states.
        forcing: (n - 1, 8, k) further columns: how each of k unnamed
            coefficients moves the end of each interval.
        trim_is_known: whether an elevator without a servo stands at zero in every
            flight (its angle is then `elevator_trim`), not at an own unknown angle.
    """
    points = true_nodes(record, theta, field) if nodes is None else nodes
    if nodes is None and not (record.has_servo or trim_is_known):
        points = points.copy()
        points[:, OFFSET] = own_trim(record, theta, noise, field, points)
    n, dim = points.shape
    loops = kernel()
    in_kernel = np.array([i for i in free if i < NUM_KERNEL_THETA], dtype=np.int64)
    in_signal = [i for i in free if i >= NUM_KERNEL_THETA]
    if [*in_kernel, *in_signal] != list(free):
        raise ValueError(f"free must name the signals' slots last: {free}")
    dynamics = theta[:NUM_KERNEL_THETA].copy()
    scale = theta_scale()

    ends = np.empty((n - 1, dim))
    by_x = np.empty((n - 1, dim, dim))
    by_kernel = np.empty((n - 1, dim, len(in_kernel)))
    loops.log_shoot(
        record.time, points, *pose_signals(record, theta), dynamics, in_kernel,
        scale, field, ends, by_x, by_kernel,
    )  # fmt: skip
    columns = [by_kernel]
    for i in in_signal:
        moved = theta.copy()
        moved[i] += _SIGNAL_STEP
        others = np.empty((n - 1, dim))
        loops.log_advance(
            record.time, points, *pose_signals(record, moved), dynamics, field, others
        )
        columns.append(((others - ends) / _SIGNAL_STEP)[:, :, None])
    if forcing is not None:
        columns.append(forcing)
    inputs = np.concatenate([*columns, (ends - points[1:])[:, :, None]], axis=2)
    states = np.empty((n, dim, dim + inputs.shape[2]))
    loops.log_propagate(by_x, inputs, states)

    pose = np.empty((n, 3))
    pose_by_x = np.empty((n, 3, dim))
    pose_by_kernel = np.empty((n, 3, len(in_kernel)))
    loops.log_measure(
        points, dynamics, in_kernel, scale, pose, pose_by_x, pose_by_kernel
    )
    with np.errstate(over="ignore", invalid="ignore"):  # A model may blow up.
        rows = pose_by_x @ states
    rows[:, :, dim : dim + len(in_kernel)] += pose_by_kernel
    rows[:, :, -1] = record.flight.pose - pose - rows[:, :, -1]
    rows /= np.array([noise.position, noise.position, noise.pitch])[:, None]
    blocks = [rows.reshape(3 * n, -1)]
    if record.has_servo:
        table = np.zeros((n, rows.shape[2]))
        path = logged_elevator(record, theta)
        for j, i in enumerate(in_signal, start=dim + len(in_kernel)):
            moved = theta.copy()
            moved[i] += _SIGNAL_STEP
            table[:, j] = (logged_elevator(record, moved) - path) / _SIGNAL_STEP
        table[:, OFFSET] = 1.0
        table[:, -1] = record.flight.elevator - path - points[:, OFFSET]
        blocks.append(table / noise.elevator)
    prior = np.zeros((dim - OFFSET, rows.shape[2]))
    for row, i in enumerate((OFFSET, *range(NUM_STATES, dim))):
        spread = _PRIOR_EXTRA
        if i == OFFSET:
            spread = _PRIOR_KNOWN if trim_is_known and not record.has_servo else 1.0
        prior[row, i] = 1.0 / spread
        prior[row, -1] = (
            (0.0 if i == OFFSET else _sin_alpha(points[:1])[0]) - points[0, i]
        ) / spread
    blocks.append(prior)
    table = np.vstack(blocks)
    return Linearized(
        residual=table[:, -1],
        by_start=table[:, :dim],
        by_theta=table[:, dim:-1],
        start=points[0].copy(),
    )


DIVERGED = 1e12
"""Errors beyond this, in standard deviations, mean that the model blew up."""


def fitted_start(errors: Linearized) -> np.ndarray:
    """Returns the change of the launch state that makes the errors least.

    A model that blew up gives no change.
    """
    largest = max(np.abs(errors.by_start).max(), np.abs(errors.residual).max())
    if not largest < DIVERGED:
        return np.zeros(errors.by_start.shape[1])
    scale = 1.0 / np.linalg.norm(errors.by_start, axis=0)
    scaled = errors.by_start * scale
    gram = scaled.T @ scaled + 1e-13 * np.eye(len(scale))
    return scale * cho_solve(cho_factor(gram), scaled.T @ errors.residual)


def own_trim(
    record: Record, theta: np.ndarray, noise: Noise, field: Field, nodes: np.ndarray
) -> float:
    """Returns the elevator angle of a flight without a servo [rad].

    It can be large, so the flight is linearised about it, not about zero.
    """
    trim = 0.0
    for _ in range(3):
        points = nodes.copy()
        points[:, OFFSET] = trim
        errors = linearize(
            record, theta, (), noise, field=field, nodes=points, trim_is_known=False
        )
        change = float(np.clip(fitted_start(errors)[OFFSET], -0.3, 0.3))
        trim = float(np.clip(trim + change, -1.2, 1.2))
        if not np.isfinite(trim):
            return 0.0
        if abs(change) < 1e-3:
            break
    return trim


_SIGNAL_STEP = 1e-5
"""Finite-difference step of delays and time constants [s]."""

_PRIOR_EXTRA = 0.05
"""Spread of effects' own states at launch about their steady values."""

_PRIOR_KNOWN = 1e-6
"""Spread of an elevator that stands where it is known to stand [rad]."""


def warm_up() -> None:
    """Compiles the loops, or loads them where they have been compiled before."""
    loops, theta = kernel(), default_theta(GliderParameters())[:NUM_KERNEL_THETA]
    times, free = np.array([0.0, 0.01, 0.02]), np.zeros(0, dtype=np.int64)
    nodes = np.zeros((3, NUM_KERNEL_STATES))
    nodes[:, 4] = 7.0
    path, rate, pitch = np.zeros((2, 3)), np.zeros(2), np.zeros((2, 3, 2))
    states, ends = np.empty_like(nodes), np.empty_like(nodes[1:])
    by_x, none = np.empty((3, *nodes.shape[1:] * 2)), np.empty((3, 8, 0))
    field, scale = NO_FIELD, theta_scale()
    loops.log_extras(times, nodes, path, rate, theta, field)
    loops.log_advance(times, nodes, path, rate, theta, field, ends)
    loops.log_shoot(
        times, nodes, path, rate, theta, free, scale, field, ends, by_x[:2], none[:2]
    )
    loops.log_propagate(by_x[:2], none[:2], np.empty((3, 8, 8)))
    loops.log_measure(
        nodes,
        theta,
        free,
        scale,
        states[:, :3].copy(),
        by_x[:, :3].copy(),
        none[:, :3].copy(),
    )
    loops.log_rollout(times, nodes[0], path, rate, theta, field, states)
    loops.log_translation(times, nodes[0], pitch, path, rate, theta, field, states)
    loops.log_flow(
        times, nodes, np.zeros(3), np.zeros(3), theta, field, np.empty((3, 9))
    )
