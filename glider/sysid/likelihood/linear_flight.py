"""A flight linearized in launch, moving air, per-flight constants and parameters."""

import dataclasses
from collections.abc import Sequence

import numpy as np

from glider.compiled.filter_error import OWN_STATES, PROCESSES
from glider.compiled.replay import (
    LogPath,
    advance_nodes,
    log_path,
    measure_nodes,
    slopes_along,
)
from glider.physics.effects import FIELD_TERMS, FIELD_VARIABLES, Field
from glider.sysid.likelihood.directions import Direction
from glider.sysid.replay.record import Record
from glider.sysid.replay.residual import flow_variables
from glider.sysid.replay.signals import (
    logged_elevator,
    pose_signals,
    sensed,
    trimmed,
    true_nodes,
)
from glider.sysid.replay.theta import OFFSET, Layout


@dataclasses.dataclass(frozen=True, kw_only=True)
class Constants:
    """Per-flight constants, about which a flight is linear."""

    wind: tuple[float, float] = (0.0, 0.0)  # (2,) [m/s].
    trim: float = 0.0  # Of the elevator [rad].
    pitch_zero: float = 0.0  # Of the pitch reading [rad].

    @property
    def values(self) -> np.ndarray:
        """Wind in x and z, trim and pitch zero, as the filter has them (4,)."""
        return np.array([*self.wind, self.trim, self.pitch_zero])

    @classmethod
    def of(cls, values: np.ndarray) -> "Constants":
        """Returns the constants of such values."""
        x, z, trim, pitch_zero = map(float, values)
        return cls(wind=(x, z), trim=trim, pitch_zero=pitch_zero)


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
    constants: Constants

    def combined(self, weights: np.ndarray) -> "LinearFlight":
        """Returns the flight with one column: its error at changes δ (m,).

        It is light, for it goes to workers often, and takes no `with_forces`.
        """
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
        """Returns the flight with its start as columns, before the last.

        They are the deviations at the first node, in the filter's order.
        """
        unit = -np.eye(len(self.start))
        count = len(unit)
        return dataclasses.replace(
            self,
            inputs=_joined(self.inputs, np.zeros((*self.inputs.shape[:2], count))),
            outputs=_joined(self.outputs, np.zeros((*self.outputs.shape[:2], count))),
            start=_joined(self.start, unit),
        )

    def with_force_errors(self) -> "LinearFlight":
        """Returns the flight with errors of C_L and C_D in place of moving air.

        The error of a formula is a force in any direction; moving air barely turns the
        force on a plate, which would make drag too certain.
        """
        terms = [FIELD_TERMS.index(name) for name in ("c_lift", "c_drag")]
        forces = np.ascontiguousarray(self.by_term[:, :, terms])
        return dataclasses.replace(self, by_air=forces)

    def middle_alpha(self, theta: np.ndarray) -> np.ndarray:
        """Returns the angle of attack at the midpoint of each interval [rad]."""
        alpha = flow_variables(self.record, theta)[:, FIELD_VARIABLES.index("alpha")]
        return 0.5 * (alpha[1:] + alpha[:-1])

    def with_forces(
        self, basis: np.ndarray, terms: Sequence[int], mix: np.ndarray
    ) -> "LinearFlight":
        """Returns the flight with more columns, before the last.

        Args:
            basis: (K, M) values of M functions at the midpoints of intervals.
            terms: which of FIELD_TERMS each multiplies.
            mix: (M terms, q) weights of functions (first) and terms in each column.
        """
        product = basis[:, None, :, None] * self.by_term[:, :, None, list(terms)]
        more = -product.reshape(*self.by_term.shape[:2], -1) @ mix
        nothing = np.zeros((*self.outputs.shape[:2], more.shape[2]))
        return dataclasses.replace(
            self,
            inputs=_joined(self.inputs, more),
            outputs=_joined(self.outputs, nothing),
            start=_joined(self.start, np.zeros((len(self.start), more.shape[2]))),
        )


def _joined(old: np.ndarray, more: np.ndarray) -> np.ndarray:
    return np.ascontiguousarray(
        np.concatenate([old[..., :-1], more, old[..., -1:]], axis=-1)
    )


def linearize(
    record: Record,
    theta: np.ndarray,
    field: Field,
    directions: Sequence[Direction] = (),
    constants: Constants = Constants(),
) -> LinearFlight:
    """Makes a flight linear about its smoothed measurement."""
    layout = record.layout
    if constants.pitch_zero:
        theta, directions = _as_read(layout, theta, directions, constants.pitch_zero)
    kinds, intervals = layout.compiled_kinds, len(record.time) - 1
    wind = np.asarray(constants.wind) + record.side_wind

    def own_dynamics(theta: np.ndarray) -> np.ndarray:
        return layout.dynamics(trimmed(record, theta, constants.trim)[0])

    def path_of(theta: np.ndarray) -> LogPath:
        elevator, rate = pose_signals(record, theta)
        shift = trimmed(record, theta, constants.trim)[1]
        return log_path(record.time, elevator + shift, rate, wind, record.bank)

    def ends_from(nodes: np.ndarray, theta: np.ndarray) -> np.ndarray:
        return advance_nodes(kinds, path_of(theta), nodes, own_dynamics(theta), field)

    dynamics = own_dynamics(theta)
    nodes = true_nodes(record, theta, field)
    plain = [d for d in directions if _is_plain(record, d)]
    moved = np.array([own_dynamics(d.moved) for d in plain])
    ends, by_x, by_term, by_plain = slopes_along(
        kinds,
        path_of(theta),
        nodes,
        dynamics,
        moved.reshape(len(plain), len(dynamics)),
        np.array([d.size for d in plain]),
        field,
    )
    n = nodes.shape[1]
    inputs = np.zeros((intervals, n, len(directions) + 1))
    columns = dict(zip(map(id, plain), range(len(plain)), strict=True))
    others: dict[tuple, tuple] = {(): (nodes, ends)}  # Of the model itself.
    for j, direction in enumerate(directions):
        if id(direction) in columns:
            inputs[:, :, j] = -by_plain[:, :, columns[id(direction)]]
        else:
            key = direction.shapes
            if key not in others:
                base_nodes = true_nodes(record, direction.base, field)
                others[key] = base_nodes, ends_from(base_nodes, direction.base)
            base_nodes, base_ends = others[key]
            moved_ends = ends_from(base_nodes, direction.moved)
            inputs[:, :, j] = -(moved_ends - base_ends) / direction.size
    inputs[:, :, -1] = ends - nodes[1:]
    pose, pose_by_x = measure_nodes(kinds, nodes, dynamics)
    own = np.zeros((n + OWN_STATES, len(directions) + 1))
    own[n + PROCESSES :, -1] = -constants.values
    return LinearFlight(
        start=own,
        constants=constants,
        record=record,
        nodes=nodes,
        by_x=by_x,
        by_air=np.ascontiguousarray(by_term[:, :, :2]),
        by_trim=_by_trim(record, theta, by_x, by_term),
        by_term=by_term,
        inputs=inputs,
        pose_by_x=pose_by_x,
        outputs=_outputs(record, theta, directions, nodes, pose),
    )


def _outputs(
    record: Record,
    theta: np.ndarray,
    directions: Sequence[Direction],
    nodes: np.ndarray,
    pose: np.ndarray,
) -> np.ndarray:
    """Returns the columns of the measurements, the error last, (K + 1, 4, m + 1)."""
    layout = record.layout
    outputs = np.zeros((len(nodes), 4, len(directions) + 1))
    path = logged_elevator(record, theta)
    for j, direction in enumerate(directions):
        if direction.slot in layout.sensor_slots:
            shown = sensed(layout, nodes, direction.moved)
            outputs[:, :3, j] = (shown - pose) / direction.size
        if record.has_servo and direction.slot >= layout.num_compiled:
            moved_path = logged_elevator(record, direction.moved)
            outputs[:, 3, j] = (moved_path - path) / direction.size
    outputs[:, :3, -1] = record.pose - pose
    if record.has_servo:
        outputs[:, 3, -1] = record.elevator - path - nodes[:, OFFSET]
    return outputs


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
