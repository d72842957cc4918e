"""A flight linearized in launch, moving air, per-flight constants and parameters."""

import dataclasses
from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np

from glider.compiled.filter_error import (
    ELEVATOR,
    OWN_STATES,
    PITCH,
    PITCH_RATE,
    PROCESSES,
)
from glider.compiled.replay import (
    OFFSET,
    LogPath,
    advance_nodes,
    log_path,
    measure_nodes,
    slopes_along,
)
from glider.physics.effects import PITCH_MOMENT, PITCH_OFFSET, EffectKind, Gaussians
from glider.physics.effects.free_functions import AIR_TERMS, ROWS, SENSOR_TERMS
from glider.physics.state import NUM_STATES
from glider.sysid.likelihood.directions import Direction, Shapes
from glider.sysid.replay.log_space import sensed
from glider.sysid.replay.record import Record
from glider.sysid.replay.replayed import (
    offset_persists,
    reads_truly,
    signals,
    states_at_rest,
    trimmed,
    true_nodes,
)

FORCES = "c_lift", "c_drag"
"""Terms of errors of C_L and C_D, in place of moving air.

The error of a formula is a force in any direction; moving air barely turns the force on
a plate, which would make drag too certain."""


class Surroundings(NamedTuple):
    """What a flight is linear about, beside its states."""

    #: (4,) per-flight constants: wind in x and z [m/s], trim and pitch zero [rad].
    constants: np.ndarray = np.zeros(OWN_STATES - PROCESSES)
    gusts: np.ndarray = np.zeros((1, 2))  #: (K, 2) in x and z, of intervals [m/s].

    def wind(self, record: Record) -> np.ndarray:
        """Returns the velocity of the air in a flight's intervals, (K, 2)."""
        return self.constants[:2] + self.gusts + record.side_wind


STILL_AIR = Surroundings()


@dataclasses.dataclass(frozen=True, kw_only=True)
class LinearFlight:
    """Arrays of `compiled.filter_error.filter_flight` that depend on no noise.

    The last column is the error of the model itself; column j before it is the
    slope along direction j, so that error = last - Σ δ_j column_j.
    """

    record: Record
    about: Surroundings
    nodes: np.ndarray
    states: list[int]  #: Of the nodes that the other arrays have.
    moves: np.ndarray
    by_term: np.ndarray  #: By a constant of each of `terms`.
    terms: tuple[str, ...]  #: Of FREE_FUNCTIONS, those of the air first.
    inputs: np.ndarray
    shows: np.ndarray
    outputs: np.ndarray
    start: np.ndarray
    #: More columns, which `expanded` has before the last: each block is of an effect of
    #: FREE_FUNCTIONS, with its values (K, q) at the midpoints of intervals; or
    #: (K + 1, q) at the nodes, if sensors show it.
    added: Sequence[tuple[EffectKind, np.ndarray]] = ()

    @np.errstate(over="ignore", invalid="ignore")  # A model may diverge.
    def combined(self, weights: np.ndarray) -> "LinearFlight":
        """Returns the flight with its error at changes δ (m,) alone, light to send."""
        whole = self.expanded()
        mix = np.append(-weights, 1.0)
        return dataclasses.replace(
            whole,
            by_term=np.empty((*self.inputs.shape[:2], 0)),
            inputs=(whole.inputs @ mix)[..., None],
            outputs=(whole.outputs @ mix)[..., None],
            start=(whole.start @ mix)[..., None],
        )

    def error_only(self) -> "LinearFlight":
        """Returns the flight with one column: its error as it is."""
        alone = dataclasses.replace(self, added=())
        return alone.combined(np.zeros(self.inputs.shape[2] - 1))

    def expanded(self) -> "LinearFlight":
        """Makes the flight with all columns, which take ten times the memory."""
        if not self.added:
            return self
        first = self.inputs.shape[2] - 1
        places = [first] * sum(values.shape[1] for _, values in self.added)
        inputs = np.insert(self.inputs, places, 0.0, -1)
        outputs = np.insert(self.outputs, places, 0.0, -1)
        start = np.insert(self.start, places, 0.0, -1)
        for effect, values in self.added:
            last = first + values.shape[1]
            if effect.stage == "sensor":
                channel = SENSOR_TERMS.index(effect.kind)
                outputs[:, channel, first:last] = values
            else:
                by_value = self.by_term[:, :, self.terms.index(effect.kind)]
                inputs[:, :, first:last] = -by_value[:, :, None] * values[:, None]

            first = last

        return dataclasses.replace(
            self, inputs=inputs, outputs=outputs, start=start, added=()
        )


def path_of(
    record: Record, theta: np.ndarray, about: Surroundings
) -> tuple[LogPath, np.ndarray]:
    """Returns a flight's path and dynamics under a model, in its surroundings."""
    elevator, rate, _ = signals(record, theta)
    flown, shift = trimmed(record, theta, about.constants[2])
    wind = about.wind(record)
    path = log_path(record.time, elevator + shift, rate, wind, record.bank)
    return path, flown


@np.errstate(over="ignore", invalid="ignore")  # A model may diverge.
def linearize(
    record: Record,
    theta: np.ndarray,
    gaussians: Gaussians,
    directions: Sequence[Direction] = (),
    about: Surroundings = STILL_AIR,
    terms: Iterable[str] = (),
    air: Sequence[str] = AIR_TERMS,
) -> LinearFlight:
    """Makes a flight linear about its smoothed measurement and its surroundings.

    Free functions may be added to it later only at `terms` of FREE_FUNCTIONS. Gusts and
    winds move it as constants of two terms do: of moving air, or of FORCES.
    """
    space = record.space
    # All nodes show as the first does then: a flight's own zero of the pitch is added.
    is_read_truly = reads_truly(space, theta, gaussians)
    theta = theta.copy()
    constants = about.constants
    theta[list(space.slots_of(PITCH_OFFSET.kind))] += constants[3]  # It reads too much.
    with_states = any(d.kind in space.states for d in directions)
    kinds = space.flown
    nodes = true_nodes(record, theta, gaussians, with_states)
    states = space.acting_states(theta)
    columns = len(directions) + 1
    terms = dict.fromkeys(t for t in (*air, *terms) if t not in SENSOR_TERMS)
    if record.trim_is_moment:
        terms["c_moment"] = None
    shown = tuple(terms)
    path, dynamics = path_of(record, theta, about)
    moving = {
        j: d for j, d in enumerate(directions) if d.slot not in space.sensor_slots
    }
    plain = [  # Those that leave the log's signals and the nodes as they are.
        j
        for j, d in moving.items()
        if d.slot < space.num_flown and not (d.shapes and d.kind in space.states)
    ]
    # Where the flight begins off its measured node, and off its own constants.
    moved = np.empty((len(plain), len(dynamics)))
    sizes = np.empty(len(plain))
    start = np.zeros((len(states) + OWN_STATES, columns))
    start[len(states) + PROCESSES :, -1] = -constants
    if record.seen[:, 3].any():  # Elevators rest at one angle, but for a scale.
        start[OFFSET, -1] = record.usual_rest - record.rest - nodes[0, OFFSET]
    for i, j in enumerate(plain):
        other, sizes[i] = directions[j].moved(theta), directions[j].size
        moved[i] = trimmed(record, other, constants[2])[0]
        if directions[j].kind in space.states:
            begins = nodes[0, NUM_STATES:] - states_at_rest(record, other, nodes[0])
            own = np.array(states[NUM_STATES:], dtype=int) - NUM_STATES
            start[NUM_STATES : len(states), j] = begins[own] / sizes[i]

    # All that is smooth at once: by states, by constants of terms, by plain directions.
    index = [ROWS[name] for name in shown]
    width = states[-1] + 1
    ends, by_x, by_term, by_plain, tangents = slopes_along(
        kinds, path, nodes, dynamics, moved, sizes, gaussians, index, width
    )
    inputs = np.zeros((len(ends), width, columns))
    by_air = by_term[:, :, :2]
    missed = (ends - nodes[1:])[:, :width]
    at_stop = ~offset_persists(record, theta)[1:]
    by_x[at_stop, OFFSET], missed[at_stop, OFFSET] = 0.0, 0.0
    inputs[:, :, plain] = -by_plain  # Gusts count from zero.
    inputs[:, :, -1] = missed - np.sum(by_air * about.gusts[:, None], axis=2)
    beside = {j: d for j, d in moving.items() if j not in plain}
    others = [*beside.values()]
    secants = _secants(record, theta, gaussians, others, about, nodes, tangents)
    for j, secant in zip(beside, secants, strict=True):
        inputs[:, :, j] = -secant[:, :width]

    # The filter's own states move with those of the flight.
    n = len(states)
    step = np.diff(record.time)
    by_term = by_term.take(states, 1)
    moves = np.zeros((len(ends), n, n + OWN_STATES))
    moves[:, :, :n] = by_x.take(states, 1).take(states, 2)
    moves[:, :, n : n + 2] = moves[:, :, n + 4 : n + 6] = by_term[:, :, :2]
    moves[:, PITCH, n + 2] = 0.5 * step**2
    moves[:, PITCH_RATE, n + 2] = step
    moves[:, :, n + 3] = moves[:, :, n + 6] = moves[:, :, OFFSET]
    moves[:, OFFSET, [n + 3, n + 6]] = 0.0
    measured = nodes[:1] if is_read_truly else nodes
    pose_by_x = measure_nodes(kinds, measured, dynamics, gaussians)[1]
    shows = np.zeros((len(measured), record.seen.shape[1], n + OWN_STATES))
    shows[:, :3, :n] = pose_by_x.take(states, 2)
    shows[:, PITCH, -1] = 1.0
    shows[:, ELEVATOR, [ELEVATOR, n + 3]] = 1.0
    if record.trim_is_moment:
        [slot] = space.slots_of(PITCH_MOMENT.kind)
        per_radian = trimmed(record, theta, 1.0)[0][slot] - theta[slot]
        moves[:, :, n + 6] = per_radian * by_term[:, :, shown.index("c_moment")]

    return LinearFlight(
        record=record,
        about=about,
        nodes=nodes,
        states=states,
        moves=moves,
        by_term=by_term,
        terms=shown,
        inputs=inputs.take(states, 1),
        shows=shows,
        outputs=_outputs(record, theta, gaussians, directions, nodes),
        start=start,
    )


def _secants(
    record: Record,
    theta: np.ndarray,
    gaussians: Gaussians,
    directions: Sequence[Direction],
    about: Surroundings,
    usual_nodes: np.ndarray,
    tangents: np.ndarray,
) -> list[np.ndarray]:
    """Returns the slopes (K, n) of intervals' ends where signals or nodes change.

    `usual_nodes` are those where no shapes are set. Those of an absent effect move
    nothing but its own states. In each interval the free functions are their tangents.
    """
    if not directions:
        return []
    space = record.space
    acting = space.acting_states(theta)
    begun = [(theta, usual_nodes)]
    nodes: dict[Shapes, np.ndarray] = {(): usual_nodes}
    base_of: dict[Shapes, int] = {(): 0}
    for d in directions:
        if d.shapes in nodes:
            continue
        base = d.base(theta)
        states = space.states.get(d.kind, ())
        nodes[d.shapes] = true_nodes(record, base, gaussians, with_states=True)
        base_of[d.shapes] = 0
        if not states or not set(states).isdisjoint(acting):
            base_of[d.shapes] = len(begun)
            begun.append((base, nodes[d.shapes]))

    moved = [(d.moved(theta), nodes[d.shapes]) for d in directions]
    pairs = [path_of(record, own, about) for own, _ in begun + moved]
    paths, numbers = zip(*pairs, strict=True)
    begins = [own for _, own in begun + moved]
    ends = advance_nodes(space.flown, paths, begins, numbers, gaussians, tangents)
    found = zip(directions, ends[len(begun) :], strict=True)
    return [(end - ends[base_of[d.shapes]]) / d.size for d, end in found]


def _outputs(
    record: Record,
    theta: np.ndarray,
    gaussians: Gaussians,
    directions: Sequence[Direction],
    nodes: np.ndarray,
) -> np.ndarray:
    """Returns the columns of the measurements, the error last, (K + 1, C, m + 1)."""
    space = record.space

    def shown_by(theta: np.ndarray) -> np.ndarray:
        logged = signals(record, theta).logged + nodes[:, OFFSET]
        return np.column_stack([sensed(space, nodes, theta, gaussians), logged])

    shown = shown_by(theta)
    outputs = np.zeros((*shown.shape, len(directions) + 1))
    for j, d in enumerate(directions):
        if d.slot in space.sensor_slots or d.slot >= space.num_flown:
            outputs[:, :, j] = (shown_by(d.moved(theta)) - shown) / d.size

    outputs[:, :, -1] = np.column_stack([record.pose, record.elevator]) - shown
    return outputs
