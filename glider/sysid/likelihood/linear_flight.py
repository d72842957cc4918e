"""A flight linearized in launch, moving air, per-flight constants and parameters.

Each interval between two rows of a log is flown from its own smoothed node. Where it
ends off the next node is an error of the model, and how that end moves with the node,
the air and each coefficient are the matrices of a linear system, which
`compiled.filter_error` filters under any scales of the noise.

The deviations of the system are n states of the motion and of effects, and after them
the OWN_STATES: gusts x and z, pitch acceleration, departure of the elevator, wind x and
z, trim, pitch zero.
"""

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
    MovedModels,
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


_MEAN_OF_INTERVAL = np.array([1.0, 4.0, 1.0]) / 6.0
"""Weights of an elevator's angle at start, middle and end of an interval (Simpson)."""


class Surroundings(NamedTuple):
    """What a flight is linear about, beside its states.

    Attributes:
        constants: (4,) of the flight: wind in x and z [m/s], trim and pitch zero [rad].
        gusts: (K, 2) velocities of the moving air in intervals, in x and z [m/s].
    """

    constants: np.ndarray = np.zeros(OWN_STATES - PROCESSES)
    gusts: np.ndarray = np.zeros((1, 2))

    def wind(self, record: Record) -> np.ndarray:
        """Returns the velocity of the air in a flight's intervals, (K, 2) [m/s]."""
        return self.constants[:2] + self.gusts + record.side_wind


STILL_AIR = Surroundings()


@dataclasses.dataclass(frozen=True, kw_only=True)
class LinearFlight:
    """Arrays of `compiled.filter_error.filter_flight` that depend on no noise.

    The last of m + 1 columns is the error of the model itself; column j before it is
    the slope along direction j, so that error = last - Σ δ_j column_j.

    Attributes:
        record: the flight, with K intervals.
        about: its surroundings, about which it is linear.
        nodes: (K + 1, num_states) the states about which it is linear.
        states: places in the nodes of the n states that the other arrays have.
        moves: (K, n, n + 8) how deviations move the end of an interval.
        by_term: (K, n, T) how a constant of each of `terms` moves it.
        terms: T of FREE_FUNCTIONS, those of the air first.
        inputs: (K, n, m + 1) how each column moves it.
        shows: (K + 1, C, n + 8) how deviations show in what is measured; one row where
            that is the same at all nodes.
        outputs: (K + 1, C, m + 1) how each column shows there.
        start: (n + 8, m + 1) how each column moves the deviations at the first node.
        added: more columns, which `expanded` has before the last: each block is of an
            effect of FREE_FUNCTIONS, with its values (K, q) at the midpoints of
            intervals; or (K + 1, q) at the nodes, if sensors show it.
    """

    record: Record
    about: Surroundings
    nodes: np.ndarray
    states: list[int]
    moves: np.ndarray
    by_term: np.ndarray
    terms: tuple[str, ...]
    inputs: np.ndarray
    shows: np.ndarray
    outputs: np.ndarray
    start: np.ndarray
    added: Sequence[tuple[EffectKind, np.ndarray]] = ()

    @np.errstate(over="ignore", invalid="ignore")  # A model may diverge.
    def combined(self, weights: np.ndarray) -> "LinearFlight":
        """Returns the flight with one column, its error at other coefficients.

        Without the other columns it is a fraction of the memory.

        Args:
            weights: δ, (m,) changes of the coefficients; those of `added` too.
        """
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

        # Room for the new columns, before the error.
        first = self.inputs.shape[2] - 1
        places = [first] * sum(values.shape[1] for _, values in self.added)
        inputs = np.insert(self.inputs, places, 0.0, -1)
        outputs = np.insert(self.outputs, places, 0.0, -1)
        start = np.insert(self.start, places, 0.0, -1)

        # Each function enters as its term does, times its values along the flight.
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
    """Returns what flies a log under a model, in its surroundings.

    The trim of a flight turns its elevator, or pitches it, see `replayed.trimmed`.

    Args:
        record: the flight.
        theta: the model, a vector of the record's space.
        about: the flight's constants and gusts.

    Returns:
        the elevator, the air and the bank along the flight; and the numbers of the
        dynamics, theta with the flight's trim.
    """
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

    Gusts and winds move it as constants of two terms do: of moving air, or of FORCES.

    Args:
        record: the flight.
        theta: the model, a vector of the record's space.
        gaussians: the model's free functions.
        directions: the columns before the error.
        about: the flight's constants and gusts.
        terms: of FREE_FUNCTIONS; only at these can functions be added later.
        air: the two terms that stand for gusts and winds.
    """
    space = record.space
    # Sensors that read truly show all nodes alike. That does not depend on the
    # flight's own zero of the pitch, which is added to their readings.
    is_read_truly = reads_truly(space, theta, gaussians)
    theta = theta.copy()
    theta[list(space.slots_of(PITCH_OFFSET.kind))] += about.constants[3]
    with_states = any(d.kind in space.states for d in directions)
    nodes = true_nodes(record, theta, gaussians, with_states)
    states = space.acting_states(theta)
    path, dynamics = path_of(record, theta, about)
    names = [*air, *terms]
    if record.trim_is_moment:
        names.append("c_moment")
    shown = tuple(dict.fromkeys(name for name in names if name not in SENSOR_TERMS))

    # Slopes of all that moves the flight at once: the states, constants of terms, and
    # the directions.
    moving = [j for j, d in enumerate(directions) if d.slot not in space.sensor_slots]
    moved = _moved_models(
        record, theta, gaussians, [directions[j] for j in moving], about
    )
    index = [ROWS[name] for name in shown]
    width = states[-1] + 1
    ends, by_x, by_term, along = slopes_along(
        space.flown, path, nodes, dynamics, moved, gaussians, index, width
    )

    # At a stop an elevator forgets where it began.
    missed = (ends - nodes[1:])[:, :width]
    at_stop = ~offset_persists(record, theta)[1:]
    by_x[at_stop, OFFSET] = 0.0
    missed[at_stop, OFFSET] = 0.0

    # How each column moves the end of an interval: minus the slope along a direction,
    # and the error, without what the gusts do since they count from zero.
    inputs = np.zeros((len(ends), width, len(directions) + 1))
    inputs[:, :, moving] = -along
    by_gusts = np.sum(by_term[:, :, :2] * about.gusts[:, None], axis=2)
    inputs[:, :, -1] = missed - by_gusts

    by_term = by_term.take(states, 1)
    moves = _moves(by_x.take(states, 1).take(states, 2), by_term, record.time)
    if record.trim_is_moment:
        [slot] = space.slots_of(PITCH_MOMENT.kind)
        per_radian = trimmed(record, theta, 1.0)[0][slot] - theta[slot]
        moves[:, :, -2] = per_radian * by_term[:, :, shown.index("c_moment")]

    # What is measured: the pose, and the elevator with its departure.
    n = len(states)
    measured = nodes[:1] if is_read_truly else nodes
    _, pose_by_x = measure_nodes(space.flown, measured, dynamics, gaussians)
    shows = np.zeros((len(measured), record.seen.shape[1], n + OWN_STATES))
    shows[:, :3, :n] = pose_by_x.take(states, 2)
    shows[:, PITCH, -1] = 1.0
    shows[:, ELEVATOR, [ELEVATOR, n + 3]] = 1.0

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
        start=_starts(record, theta, directions, about, nodes, states),
    )


def _moves(by_x: np.ndarray, by_term: np.ndarray, time: np.ndarray) -> np.ndarray:
    """Returns how deviations move the ends of intervals, (K, n, n + 8).

    Args:
        by_x: (K, n, n) slopes by the states at the beginning.
        by_term: (K, n, T) by constants of terms, the first two of the air.
        time: (K + 1,) of the nodes [s].
    """
    count, n, _ = by_x.shape
    step = np.diff(time)
    moves = np.zeros((count, n, n + OWN_STATES))
    moves[:, :, :n] = by_x

    # Gusts and the steady wind; an unmodelled pitch acceleration.
    moves[:, :, n : n + 2] = moves[:, :, n + 4 : n + 6] = by_term[:, :, :2]
    moves[:, PITCH, n + 2] = 0.5 * step**2
    moves[:, PITCH_RATE, n + 2] = step

    # The elevator's departure and trim act as its offset does, and leave that as it is.
    moves[:, :, n + 3] = moves[:, :, n + 6] = moves[:, :, OFFSET]
    moves[:, OFFSET, [n + 3, n + 6]] = 0.0
    return moves


def _starts(
    record: Record,
    theta: np.ndarray,
    directions: Sequence[Direction],
    about: Surroundings,
    nodes: np.ndarray,
    states: Sequence[int],
) -> np.ndarray:
    """Returns the columns of the deviations at the first node, (n + 8, m + 1).

    They are where a flight begins off that node, and off its constants.
    """
    n = len(states)
    start = np.zeros((n + OWN_STATES, len(directions) + 1))
    start[n + PROCESSES :, -1] = -about.constants
    if record.seen[:, 3].any():  # Elevators rest at one angle, but for a scale.
        start[OFFSET, -1] = record.usual_rest - record.rest - nodes[0, OFFSET]

    # Directions of effects that act move their states at rest.
    places = [i - NUM_STATES for i in states[NUM_STATES:]]
    for j, d in enumerate(directions):
        if d.kind in record.space.states and not d.shapes:
            at_rest = states_at_rest(record, d.moved(theta), nodes[0])
            apart = nodes[0, NUM_STATES:] - at_rest
            start[NUM_STATES:n, j] = apart[places] / d.size

    return start


def _moved_models(
    record: Record,
    theta: np.ndarray,
    gaussians: Gaussians,
    directions: Sequence[Direction],
    about: Surroundings,
) -> MovedModels:
    """Returns a model moved along directions, and what of the log that changes.

    Directions of an effect's states with its shapes set move from a model with these
    shapes, whose states are other ones.
    """
    space = record.space
    trim = about.constants[2]
    usual = signals(record, theta)
    numbers = np.empty((len(directions), len(theta)))
    elevator = np.zeros((len(directions), len(usual.rate)))
    rate = np.zeros_like(elevator)
    place = np.full(len(directions), -1)
    places: dict[Shapes, int] = {}
    bases: list[np.ndarray] = []
    states: list[np.ndarray] = []
    for i, d in enumerate(directions):
        moved = d.moved(theta)
        numbers[i], _ = trimmed(record, moved, trim)
        if d.slot >= space.num_flown:
            own = signals(record, moved)
            elevator[i] = (own.elevator - usual.elevator) @ _MEAN_OF_INTERVAL
            rate[i] = own.rate - usual.rate
        if not (d.shapes and d.kind in space.states):
            continue
        if d.shapes not in places:
            places[d.shapes] = len(bases)
            base = d.base(theta)
            nodes = true_nodes(record, base, gaussians, with_states=True)
            bases.append(trimmed(record, base, trim)[0])
            states.append(0.5 * (nodes[1:, NUM_STATES:] + nodes[:-1, NUM_STATES:]))
        place[i] = places[d.shapes]

    return MovedModels(
        numbers=numbers,
        sizes=np.array([d.size for d in directions], dtype=float),
        elevator=elevator,
        rate=rate,
        place=place,
        bases=np.reshape(bases, (-1, len(theta))),
        states=np.reshape(
            states, (len(states), len(usual.rate), space.num_states - NUM_STATES)
        ),
    )


def _outputs(
    record: Record,
    theta: np.ndarray,
    gaussians: Gaussians,
    directions: Sequence[Direction],
    nodes: np.ndarray,
) -> np.ndarray:
    """Returns the columns of the measurements, the error last, (K + 1, C, m + 1).

    Only sensors and the clocks of the log show in other ways than by the states.
    """
    space = record.space

    def shown_by(theta: np.ndarray) -> np.ndarray:
        pose = sensed(space, nodes, theta, gaussians)
        logged = signals(record, theta).logged + nodes[:, OFFSET]
        return np.column_stack([pose, logged])

    shown = shown_by(theta)
    outputs = np.zeros((*shown.shape, len(directions) + 1))
    for j, d in enumerate(directions):
        if d.slot in space.sensor_slots or d.slot >= space.num_flown:
            outputs[:, :, j] = (shown_by(d.moved(theta)) - shown) / d.size

    outputs[:, :, -1] = np.column_stack([record.pose, record.elevator]) - shown
    return outputs
