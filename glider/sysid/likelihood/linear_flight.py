"""A flight linearized in launch, moving air, per-flight constants and parameters.

A direction is one way in which a model may be wrong: a column of the flight's errors.
"""

import dataclasses
import itertools
from collections.abc import Sequence
from typing import Any

import numpy as np
from scipy.interpolate import CubicSpline

from glider.compiled.filter_error import OWN_STATES, PITCH_RATE, PROCESSES
from glider.compiled.replay import (
    LogPath,
    advance_nodes,
    log_path,
    measure_nodes,
    slopes_along,
)
from glider.physics.effects import FIELD_TERMS, EffectKind, Field
from glider.physics.state import NUM_STATES
from glider.sysid.replay.record import Record
from glider.sysid.replay.replayed import (
    logged_elevator,
    pose_signals,
    sensed,
    trimmed,
    true_nodes,
)
from glider.sysid.replay.theta import OFFSET, SERVO_LOG, Layout

# Per-flight constants: wind in x and z [m/s], trim and pitch zero [rad].
NO_CONSTANTS = np.zeros(OWN_STATES - PROCESSES)
SMALL = 1e-6  # Step of a derivative, in the coefficient's scale: good to 1e-6 of it.
SMALL_SIGNAL = 5e-4  # The same on the log's clocks: about 1e-5 s of a delay.
Shapes = tuple[tuple[int, float], ...]  # Slots of an effect's shapes, and values.


@dataclasses.dataclass(frozen=True, kw_only=True)
class Direction:
    """One coefficient moved, the shapes of its effect set to some start."""

    kind: str  #: Of the effect, or "parameters".
    slot: int  #: Of the coefficient in theta.
    base: np.ndarray  #: Theta with the effect's shapes set.
    moved: np.ndarray  #: Base with the coefficient moved.
    size: float  #: By how much.
    shapes: Shapes = ()  #: Starting ones; empty where the effect acts already.


def slopes(
    layout: Layout, theta: np.ndarray, free: Sequence[int], shapes: Shapes = ()
) -> list[Direction]:
    """Returns the directions of slots as they are, for a fit."""
    small = np.where(np.array(free) < layout.num_compiled, SMALL, SMALL_SIGNAL)
    sizes = small * layout.scale[list(free)]
    moves = zip(free, sizes.tolist(), strict=True)
    return [_direction(layout, theta, slot, size, shapes) for slot, size in moves]


def starts_of(
    layout: Layout, kind: EffectKind, theta: np.ndarray
) -> list[list[Direction]]:
    """Returns an absent effect's directions, for each combination of its shapes.

    An effect whose every coefficient is a shape (a lag, a delay) is tried by secants to
    its starting values, for it is not linear there.
    """
    slots = dict(zip(layout.slots_of(kind.kind), kind.coefficients, strict=True))
    sizes = [i for i, c in slots.items() if not c.is_shape]
    grids = {i: c.grid for i, c in slots.items() if c.is_shape}
    if not sizes:
        starts = [(i, value) for i, grid in grids.items() for value in grid]
        return [[_direction(layout, theta, i, v - theta[i])] for i, v in starts]
    found = []
    for values in itertools.product(*grids.values()):
        base = theta.copy()
        base[list(grids)] = values
        shapes = tuple(zip(grids, values, strict=True))
        found.append(slopes(layout, base, sizes, shapes))
    return found


def _direction(
    layout: Layout, theta: np.ndarray, slot: int, size: float, shapes: Shapes = ()
) -> Direction:
    moved, (kind, _) = theta.copy(), layout.slots[slot]
    moved[slot] += size
    return Direction(
        kind=kind, slot=slot, base=theta, moved=moved, size=size, shapes=shapes
    )


def nearest_start(
    layout: Layout, starts: Sequence[Sequence[Direction]], theta: np.ndarray
) -> int:
    """Index of the start whose shapes are nearest to those of theta."""
    apart = [
        sum(abs(v - theta[i]) / layout.scale[i] for i, v in columns[0].shapes)
        for columns in starts
    ]
    return int(np.argmin(apart))


@dataclasses.dataclass(frozen=True, kw_only=True)
class LinearFlight:
    """Arrays of `compiled.filter_error.filter_flight` that depend on no noise.

    The last column is the error of the model itself; column j before it is the
    slope along direction j, so that error = last - Σ δ_j column_j.
    """

    record: Record
    nodes: np.ndarray
    by_x: np.ndarray
    by_air: np.ndarray
    by_trim: np.ndarray
    by_term: np.ndarray
    inputs: np.ndarray
    pose_by_x: np.ndarray
    outputs: np.ndarray
    start: np.ndarray

    def combined(self, weights: np.ndarray) -> "LinearFlight":
        """Returns the flight with its error at changes δ (m,) alone, light to send."""
        mix = np.append(-weights, 1.0)
        return dataclasses.replace(
            self,
            by_term=self.by_term[..., :0],
            inputs=np.ascontiguousarray((self.inputs @ mix)[..., None]),
            outputs=np.ascontiguousarray((self.outputs @ mix)[..., None]),
            start=(self.start @ mix)[:, None],
        )

    def error_only(self) -> "LinearFlight":
        """Returns the flight with one column: its error as it is."""
        return self.combined(np.zeros(self.inputs.shape[2] - 1))

    def with_launch(self) -> "LinearFlight":
        """Returns the flight with columns for its start, in the filter's order."""
        return self._with_columns("start", -np.eye(len(self.start)))

    def with_force_errors(self) -> "LinearFlight":
        """Returns the flight with errors of C_L and C_D in place of moving air.

        The error of a formula is a force in any direction; moving air barely turns the
        force on a plate, which would make drag too certain.
        """
        terms = [FIELD_TERMS.index(name) for name in ("c_lift", "c_drag")]
        forces = np.ascontiguousarray(self.by_term[:, :, terms])
        return dataclasses.replace(self, by_air=forces)

    def with_forces(
        self, basis: np.ndarray, terms: Sequence[int], mix: np.ndarray
    ) -> "LinearFlight":
        """Returns the flight with more columns, before the last.

        Each mixes (M terms, q), functions first, M functions with values (K, M) at the
        midpoints of intervals times terms, indices of FIELD_TERMS.
        """
        product = basis[:, None, :, None] * self.by_term[:, :, None, list(terms)]
        more = -product.reshape(*self.by_term.shape[:2], -1) @ mix
        return self._with_columns("inputs", more)

    def _with_columns(self, name: str, columns: np.ndarray) -> "LinearFlight":
        """Returns the flight with more columns of one array, zero in the others."""
        wider: dict[str, Any] = {}
        for other in ("inputs", "outputs", "start"):
            old = getattr(self, other)
            more = np.zeros((*old.shape[:-1], columns.shape[-1]))
            parts = [old[..., :-1], columns if other == name else more, old[..., -1:]]
            wider[other] = np.ascontiguousarray(np.concatenate(parts, axis=-1))
        return dataclasses.replace(self, **wider)


def path_of(
    record: Record, theta: np.ndarray, constants: np.ndarray
) -> tuple[LogPath, np.ndarray]:
    """Returns a flight's path and dynamics under a model, with its constants."""
    elevator, rate = pose_signals(record, theta)
    flown, shift = trimmed(record, theta, constants[2])
    wind = constants[:2] + record.side_wind
    path = log_path(record.time, elevator + shift, rate, wind, record.bank)
    return path, record.layout.dynamics(flown)


def linearize(
    record: Record,
    theta: np.ndarray,
    field: Field,
    directions: Sequence[Direction] = (),
    constants: np.ndarray = NO_CONSTANTS,
) -> LinearFlight:
    """Makes a flight linear about its smoothed measurement and its constants (4,)."""
    layout = record.layout
    if constants[3]:
        theta, directions = _as_read(layout, theta, directions, constants[3])
    kinds, intervals = layout.compiled_kinds, len(record.time) - 1

    def ends_from(nodes: np.ndarray, theta: np.ndarray) -> np.ndarray:
        path, dynamics = path_of(record, theta, constants)
        return advance_nodes(kinds, path, nodes, dynamics, field)

    path, dynamics = path_of(record, theta, constants)
    nodes = true_nodes(record, theta, field)
    plain = [j for j, d in enumerate(directions) if _is_plain(record, d)]
    flown = [trimmed(record, directions[j].moved, constants[2])[0] for j in plain]
    moved = np.array([layout.dynamics(own) for own in flown])
    ends, by_x, by_term, by_plain = slopes_along(
        kinds,
        path,
        nodes,
        dynamics,
        moved.reshape(len(plain), len(dynamics)),
        np.array([directions[j].size for j in plain]),
        field,
    )
    n = nodes.shape[1]
    inputs = np.zeros((intervals, n, len(directions) + 1))
    inputs[:, :, plain] = -by_plain
    others: dict[tuple, tuple] = {(): (nodes, ends)}  # Of the model itself.
    for j, direction in enumerate(directions):
        if j in plain:
            continue
        if direction.shapes not in others:
            base_nodes = true_nodes(record, direction.base, field)
            base_ends = ends_from(base_nodes, direction.base)
            others[direction.shapes] = base_nodes, base_ends
        base_nodes, base_ends = others[direction.shapes]
        moved_ends = ends_from(base_nodes, direction.moved)
        inputs[:, :, j] = -(moved_ends - base_ends) / direction.size
    inputs[:, :, -1] = ends - nodes[1:]
    pose, pose_by_x = measure_nodes(kinds, nodes, dynamics)
    start = np.zeros((n + OWN_STATES, len(directions) + 1))
    start[n + PROCESSES :, -1] = -constants
    for j in plain:
        if (
            directions[j].kind in layout.kinds
            and layout.kinds[directions[j].kind].states
        ):
            rest = true_nodes(record, directions[j].moved, field)[0, NUM_STATES:]
            start[NUM_STATES:n, j] = (nodes[0, NUM_STATES:] - rest) / directions[j].size
    return LinearFlight(
        record=record,
        nodes=nodes,
        by_x=by_x,
        by_air=np.ascontiguousarray(by_term[:, :, :2]),
        by_trim=_by_trim(record, theta, by_x, by_term),
        by_term=by_term,
        inputs=inputs,
        pose_by_x=pose_by_x,
        outputs=_outputs(record, theta, directions, nodes, pose),
        start=start,
    )


def _outputs(
    record: Record,
    theta: np.ndarray,
    directions: Sequence[Direction],
    nodes: np.ndarray,
    pose: np.ndarray,
) -> np.ndarray:
    """Returns the columns of the measurements, the error last, (K + 1, C, m + 1)."""
    layout, has_gyro = record.layout, record.seen.shape[1] > 4
    outputs = np.zeros((*record.seen.shape, len(directions) + 1))
    rate = _unbiased_rate(record, theta) if has_gyro else nodes[:, PITCH_RATE]
    path = logged_elevator(record, theta)
    for j, direction in enumerate(directions):
        if direction.slot in layout.sensor_slots:
            shown = sensed(layout, nodes, direction.moved)
            outputs[:, :3, j] = (shown - pose) / direction.size
        if record.has_servo and direction.slot >= layout.num_compiled:
            moved_path = logged_elevator(record, direction.moved)
            outputs[:, 3, j] = (moved_path - path) / direction.size
        if has_gyro and direction.slot >= layout.num_compiled:
            moved_rate = _unbiased_rate(record, direction.moved)
            outputs[:, 4, j] = (rate - moved_rate) / direction.size
    outputs[:, :3, -1] = record.pose - pose
    if record.has_servo:
        outputs[:, 3, -1] = record.elevator - path - nodes[:, OFFSET]
    outputs[:, 4:, -1] = (rate - nodes[:, PITCH_RATE])[:, None]
    return outputs


def _unbiased_rate(record: Record, theta: np.ndarray) -> np.ndarray:
    """Pitch rates that a gyro measured when the poses were those of nodes, (K + 1,)."""
    late = record.time - record.layout.replay(theta).latency
    late = np.clip(late, 0.0, record.time[-1])
    rate = CubicSpline(record.time, record.pitch_rate)(late)
    return rate - theta[record.layout.index[SERVO_LOG.kind, "pitch_rate"]]


def _as_read(
    layout: Layout, theta: np.ndarray, directions: Sequence[Direction], zero: float
) -> tuple[np.ndarray, list[Direction]]:
    """Returns model and directions of a flight whose pitch reads too much [rad]."""
    own = np.zeros_like(theta)
    own[layout.index["pitch_offset", "angle"]] = zero
    return theta + own, [
        dataclasses.replace(d, base=d.base + own, moved=d.moved + own)
        for d in directions
    ]


def _by_trim(
    record: Record, theta: np.ndarray, by_x: np.ndarray, by_term: np.ndarray
) -> np.ndarray:
    """Returns the derivative of each interval's end over the flight's trim, (K, n)."""
    if not record.trim_is_moment:
        by_trim = by_x[:, :, OFFSET].copy()
        by_trim[:, OFFSET] = 0.0
        return by_trim
    slot = record.layout.index["pitch_moment", "coefficient"]
    per_radian = trimmed(record, theta, 1.0)[0][slot] - theta[slot]
    return per_radian * by_term[:, :, FIELD_TERMS.index("c_moment")]


def _is_plain(record: Record, direction: Direction) -> bool:
    """Whether the direction leaves the log's signals and the nodes as they are."""
    layout = record.layout
    if direction.slot >= layout.num_compiled:
        return False
    kind = layout.kinds.get(direction.kind)
    return kind is None or not (kind.states and direction.shapes)
