"""Flights along a log: its times, its elevator, its nodes.

Here a model is one vector theta, parameters and coefficients, as a fit changes it.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from glider.compiled.kernel import Family
from glider.compiled.runge_kutta import DIFFERENCE, put
from glider.physics.chain import (
    accelerations,
    actuator_terms,
    derivatives,
    flow_in_air,
    measure,
    meet_air,
    theta_of,
)
from glider.physics.effects import (
    FLOW_VARIABLES,
    FREE_FUNCTIONS,
    NO_GAUSSIANS,
    EffectKind,
    Gaussians,
)
from glider.physics.effects.free_functions import basis_function, flow_variables
from glider.physics.parameters import Parameters, Theta
from glider.physics.state import NUM_STATES

OFFSET = 3
"""Index of the elevator's state: where a log is flown, x[OFFSET] is its constant offset
from its replayed path [rad]."""


class LogPath(NamedTuple):
    """What a log prescribes in the K intervals between its times; see `log_path`.

    Attributes:
        times: (K + 1,) [s].
        elevator: (K, 3) the elevator's path at start, middle and end [rad].
        rate: (K,) its mean rate [rad/s].
        wind: (K, 2) velocity of the air [m/s].
        bank: (K,) factor of the wing's area, see `glider.sysid.replay.record`.
        pitch: (K, 3, 2) pitch and its rate at start, middle and end; (K, 0, 2) where
            they are flown.
    """

    times: np.ndarray
    elevator: np.ndarray
    rate: np.ndarray
    wind: np.ndarray
    bank: np.ndarray
    pitch: np.ndarray

    def first(self, rows: int) -> "LogPath":
        """Returns the beginning of the path, up to so many of its times."""
        return LogPath(self.times[:rows], *(own[: rows - 1] for own in self[1:]))


def log_step(path, k, x, theta, work):
    """Advances x by one interval of a log with the elevator's path prescribed.

    Here x[3] is the elevator's constant offset from that path. The step is that of
    `runge_kutta.advance`, which takes a fifth more time here: its data are counted as
    references in each of the many short calls.

    Args:
        path: the LogPath.
        k: counts the intervals.
        x: (n,), written.
        theta: the glider's numbers, the wing's area banked.
        work: (6, n) scratch; rows 1 to 4 are the stages' states, written.
    """
    total = work[0]
    total[:] = 0.0
    put(x, work[1])
    t = path.times[k]
    step = path.times[k + 1] - path.times[k]
    is_turned = path.pitch.shape[1] > 0
    for stage in range(4):
        node = (stage + 1) // 2
        weight = 1.0 / 6.0 if stage in (0, 3) else 1.0 / 3.0
        ahead = 0.5 * step if stage < 2 else step
        y = work[stage + 1]
        y[3] = x[3] + path.elevator[k, node]
        if is_turned:
            y[2] = path.pitch[k, node, 0]
            y[6] = path.pitch[k, node, 1]
        now = t + 0.5 * step * node
        wind_x = path.wind[k, 0]
        wind_z = path.wind[k, 1]
        d = derivatives(now, y, path.rate[k], wind_x, wind_z, theta)
        for i in range(x.shape[0]):
            total[i] += weight * d[i]
            work[stage + 2, i] = x[i] + ahead * d[i]
    total[3] = 0.0
    for i in range(x.shape[0]):
        x[i] += step * total[i]
    if is_turned:
        x[2] = path.pitch[k, 2, 0]
        x[6] = path.pitch[k, 2, 1]


def _banked(theta, factor):
    """Returns the numbers with the wing's area times a factor."""
    p = theta.p
    tilted = Parameters(
        p.mass,
        p.pitch_inertia,
        p.wing_area * factor,
        p.elevator_area,
        p.wing_offset,
        p.hinge_offset,
        p.elevator_offset,
        p.air_density,
        p.gravity,
    )
    return Theta(tilted, theta.c, theta.gaussians)


def _set_tangent(now, y, rate, wind_x, wind_z, theta, acting, basis, tangent):
    """Writes the tangent (v + 1, 18) of theta's free functions at a state.

    Functions and variables that do not act are left out; `basis` (M,) is written.
    """
    servo_rate = actuator_terms(rate, y, theta.c)
    flow = flow_in_air(now, y, servo_rate, wind_x, wind_z, theta)
    variables = flow_variables(flow)
    gaussians = theta.gaussians
    is_function, is_variable = acting
    tangent[:] = 0.0
    last = len(variables)
    for d in range(last):
        tangent[d, 0] = variables[d]
    for m in range(basis.shape[0]):
        basis[m] = basis_function(variables, gaussians, m)
    for i in range(is_function.shape[0]):
        if not is_function[i]:
            continue
        for m in range(basis.shape[0]):
            tangent[last, 1 + i] += basis[m] * gaussians.weights[i, m]
        for d in range(last):
            if not is_variable[d]:
                continue
            slope = 0.0
            here = variables[d]
            for m in range(basis.shape[0]):
                per = gaussians.inverse_widths[d, m]
                apart = (gaussians.centers[d, m] - here) * per * per
                slope += basis[m] * gaussians.weights[i, m] * apart
            tangent[d, 1 + i] += slope


def log_flown(path, nodes, numbers, gaussians, first):
    """Flies each interval of a log from its own node.

    Args:
        path: the LogPath.
        nodes: (K + 1, n); from the first interval's end on, the states from `first` on
            are written: they go on from interval to interval.
        numbers: parameters and coefficients.
        gaussians: of the free functions.
        first: the first state that goes on.
    """
    n = nodes.shape[1]
    x = np.empty(n)
    work = np.empty((6, n))
    theta = theta_of(numbers, gaussians)
    for k in range(path.rate.shape[0]):
        put(nodes[k], x)
        log_step(path, k, x, _banked(theta, path.bank[k]), work)
        for i in range(first, n):
            nodes[k + 1, i] = x[i]


def _carry(step, rates, power, carried):
    """Writes how what moves an interval's rates moves its end, (w, w).

    With rates A constant it is Σ stepʲ⁺¹ Aʲ / (j + 1)! to j = 3, as in `log_step`.
    """
    width = rates.shape[0]
    carried[:] = 0.0
    for i in range(width):
        carried[i, i] = step
    for order in range(4, 1, -1):
        for i in range(width):
            for j in range(width):
                power[i, j] = 0.0
            power[i, i] = step
            for m in range(width):
                factor = step / order * rates[i, m]
                if factor != 0.0:
                    for j in range(width):
                        power[i, j] += factor * carried[m, j]
        for i in range(width):
            for j in range(width):
                carried[i, j] = power[i, j]


def log_slopes(
    path,
    nodes,
    numbers,
    moved,
    gaussians,
    acting,
    linear,
    terms,
    ends,
    by_x,
    by_term,
    by_theta,
):
    """Flies each interval of a log from its own node, with slopes.

    The dynamics are made linear once an interval, about its middle, and with them its
    end: slopes are good to a thousandth at 120 rows a second. Forward differences in
    floats are half the cost of a complex step.

    Args:
        path: the LogPath, whose pitch is flown.
        nodes: (K + 1, n) states at the times.
        numbers: parameters and coefficients.
        moved: the MovedModels of m directions.
        gaussians: of the free functions; about each interval's flight they are linear.
        acting: which functions and which variables it has, (17,) and (v,).
        linear: Gaussians of a tangent alone, written.
        terms: (T,) indices of FREE_FUNCTIONS.
        ends: (K, n), written: the state that each interval ends in.
        by_x: (K, w, w), written: slopes of the first w states by the node's.
        by_term: (K, w, T), written: by a constant of each of the terms.
        by_theta: (K, w, m), written: along each direction.
    """
    n = nodes.shape[1]
    width = by_x.shape[2]
    theta = theta_of(numbers, gaussians)
    x = np.empty(n)
    usual = np.empty(n)
    unmoved = np.empty(n)
    work = np.empty((6, n))
    tangent = linear.tangent
    tangent[:] = 0.0
    last = tangent.shape[0] - 1
    first_own = n - moved.states.shape[2]
    columns = width + terms.shape[0] + moved.sizes.shape[0]
    slopes = np.empty((width, columns))
    power = np.empty((width, width))
    carried = np.empty((width, width))
    rates = np.empty((width, width))
    about = linear if gaussians.num_flown > 0 else gaussians
    basis = np.empty(gaussians.num_flown)
    for k in range(path.rate.shape[0]):
        own = _banked(theta, path.bank[k])
        put(nodes[k], x)
        log_step(path, k, x, own, work)
        put(x, ends[k])
        y = work[3]
        rate = path.rate[k]
        step = path.times[k + 1] - path.times[k]
        now = path.times[k] + 0.5 * step
        wind_x = path.wind[k, 0]
        wind_z = path.wind[k, 1]
        if gaussians.num_flown > 0:
            _set_tangent(now, y, rate, wind_x, wind_z, own, acting, basis, tangent)
        own = _banked(theta_of(numbers, about), path.bank[k])
        put(derivatives(now, y, rate, wind_x, wind_z, own), usual)
        put(y, x)
        for j in range(columns):
            size = DIFFERENCE
            other = own
            own_rate = rate
            before = usual
            in_term = j - width
            in_theta = j - width - terms.shape[0]
            if in_theta >= 0:
                size = moved.sizes[in_theta]
                numbers_there = theta_of(moved.numbers[in_theta], about)
                other = _banked(numbers_there, path.bank[k])
                place = moved.place[in_theta]
                if place >= 0:
                    put(moved.states[place, k], y[first_own:])
                    base = _banked(theta_of(moved.bases[place], about), path.bank[k])
                    put(derivatives(now, y, rate, wind_x, wind_z, base), unmoved)
                    before = unmoved
                own_rate += moved.rate[in_theta, k]
                y[3] += moved.elevator[in_theta, k]
            elif in_term >= 0:
                other = _banked(theta_of(numbers, linear), path.bank[k])
                tangent[last, 1 + terms[in_term]] += size
            else:
                y[j] += size
            d = derivatives(now, y, own_rate, wind_x, wind_z, other)
            put(x, y)
            if in_theta < 0 and in_term >= 0:
                tangent[last, 1 + terms[in_term]] -= size
            for i in range(width):
                slopes[i, j] = (d[i] - before[i]) / size
        slopes[3] = 0.0
        for i in range(width):
            for j in range(width):
                rates[i, j] = slopes[i, j]
        _carry(step, rates, power, carried)
        for i in range(width):
            for j in range(columns):
                total = 0.0
                for m in range(width):
                    total += carried[i, m] * slopes[m, j]
                if j < width:
                    by_x[k, i, j] = total + (1.0 if i == j else 0.0)
                elif j < width + terms.shape[0]:
                    by_term[k, i, j - width] = total
                else:
                    by_theta[k, i, j - width - terms.shape[0]] = total


def log_measure(nodes, numbers, gaussians, pose, by_x):
    """Writes the pose (K, 3) that the sensors show of nodes (K, n), and its slopes.

    Slopes by_x are (K, 3, n), or (K, 3, 0) where they are not asked for.
    """
    theta = theta_of(numbers, gaussians)
    x = np.empty(nodes.shape[1])
    for k in range(nodes.shape[0]):
        put(nodes[k], x)
        put(measure(x, theta), pose[k])
        for j in range(by_x.shape[2]):
            x[j] += DIFFERENCE
            y = measure(x, theta)
            x[j] = nodes[k, j]
            for i in range(3):
                by_x[k, i, j] = (y[i] - pose[k, i]) / DIFFERENCE


def log_flow(times, nodes, elevator, rate, numbers, gaussians, values):
    """Writes flow and acceleration at each node of a log.

    Args:
        times, elevator, rate: (K,) at the nodes.
        nodes: (K, n).
        numbers, gaussians: as in `log_slopes`.
        values: (K, 5 + v), written: accelerations (ẍ, z̈, θ̈), velocity through the air
            (x, z), then FLOW_VARIABLES.
    """
    theta = theta_of(numbers, gaussians)
    x = np.empty(nodes.shape[1])
    for k in range(nodes.shape[0]):
        put(nodes[k], x)
        x[3] += elevator[k]
        flow, free = meet_air(times[k], x, rate[k], 0.0, 0.0, theta)
        a = accelerations(flow, free, x, theta.c)
        put((*a, flow.air_x, flow.air_z, *flow_variables(flow)), values[k])


_ENTRIES = (log_flown, log_slopes, log_measure, log_flow)

LOOPS = Family((_banked, _set_tangent, _carry, log_step, *_ENTRIES), _ENTRIES)

Kinds = tuple[EffectKind, ...]
"""The effects that the compiled dynamics hold, whose coefficients a theta has.

In all functions below, `numbers` are parameters (9,) and coefficients, one after the
other, and `gaussians` are those of the free functions.
"""


class MovedModels(NamedTuple):
    """A model moved along m directions, and what of a log it then flies otherwise.

    Attributes:
        numbers: (m, p) parameters and coefficients.
        sizes: (m,) how far each is moved.
        elevator: (m, K) changes of the elevator's mean angle in the intervals [rad].
        rate: (m, K) changes of its rate [rad/s].
        place: (m,) of each in the arrays below; -1: it moves from the model itself.
        bases: (s, p) numbers of other models that directions move from.
        states: (s, K, e) the effects' own states of these, in the middle of intervals.
    """

    numbers: np.ndarray
    sizes: np.ndarray
    elevator: np.ndarray
    rate: np.ndarray
    place: np.ndarray
    bases: np.ndarray
    states: np.ndarray


def log_path(
    times: np.ndarray,
    elevator: np.ndarray,
    rate: np.ndarray,
    wind: np.ndarray | None = None,
    bank: np.ndarray | None = None,
    pitch: np.ndarray | None = None,
) -> LogPath:
    """Returns a log's path: in still air, level and flown in pitch where not given."""
    count = len(rate)
    return LogPath(
        times=times,
        elevator=elevator,
        rate=rate,
        wind=np.zeros((count, 2)) if wind is None else wind,
        bank=np.ones(count) if bank is None else bank,
        pitch=np.empty((count, 0, 2)) if pitch is None else pitch,
    )


def roll_out(
    kinds: Kinds,
    path: LogPath,
    start: np.ndarray,
    numbers: np.ndarray,
    gaussians: Gaussians,
) -> np.ndarray:
    """Returns the states (K + 1, n) of a flight along a log's path from (n,)."""
    nodes = np.zeros((len(path.times), len(start)))
    nodes[0] = start
    LOOPS.over(kinds).log_flown(path, nodes, numbers, gaussians, 0)
    return nodes


def with_extras(
    kinds: Kinds,
    path: LogPath,
    nodes: np.ndarray,
    numbers: np.ndarray,
    gaussians: Gaussians,
) -> np.ndarray:
    """Returns nodes (K + 1, n) with the effects' own states flown along them.

    They begin as in the first node.
    """
    full = nodes.copy()
    LOOPS.over(kinds).log_flown(path, full, numbers, gaussians, NUM_STATES)
    return full


def measure_nodes(
    kinds: Kinds,
    nodes: np.ndarray,
    numbers: np.ndarray,
    gaussians: Gaussians = NO_GAUSSIANS,
    *,
    with_slopes: bool = True,
) -> tuple[np.ndarray, np.ndarray]:
    """Computes the measured poses (K, 3) of states (K, n), and ∂/∂x (K, 3, n).

    Without slopes, the latter is (K, 3, 0).
    """
    rows, n = nodes.shape
    pose = np.empty((rows, 3))
    by_x = np.empty((rows, 3, n if with_slopes else 0))
    LOOPS.over(kinds).log_measure(nodes, numbers, gaussians, pose, by_x)
    return pose, by_x


def flow_at(
    kinds: Kinds,
    times: np.ndarray,
    nodes: np.ndarray,
    elevator: np.ndarray,
    rate: np.ndarray,
    numbers: np.ndarray,
    gaussians: Gaussians,
) -> np.ndarray:
    """Returns flow and acceleration at states (K, n), see `log_flow`, (K, 5 + v).

    `elevator` (K,) [rad] and `rate` (K,) [rad/s] are at the times.
    """
    values = np.empty((len(nodes), 5 + len(FLOW_VARIABLES)))
    loop = LOOPS.over(kinds).log_flow
    loop(times, nodes, elevator, rate, numbers, gaussians, values)
    return values


def slopes_along(
    kinds: Kinds,
    path: LogPath,
    nodes: np.ndarray,
    numbers: np.ndarray,
    moved: MovedModels,
    gaussians: Gaussians,
    terms: Sequence[int],
    width: int,
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Flies each interval of a log from its own node (K + 1, n), with slopes.

    `moved` is the model along m directions; `terms` are T indices of FREE_FUNCTIONS.

    Returns:
        the ends (K, n), and the slopes of their first `width` states: by the node's
        (K, width, width), by a constant of each term (K, width, T) and along the
        directions (K, width, m).
    """
    ends = np.empty_like(nodes[1:])
    rows = (len(nodes) - 1, width)
    by_x = np.empty((*rows, width))
    by_term = np.empty((*rows, len(terms)))
    found = ends, by_x, by_term, np.empty((*rows, len(moved.sizes)))
    index = np.array(terms, dtype=np.int64)
    variables = len(FLOW_VARIABLES) if gaussians.num_flown else 0
    shape = 1 + variables, 1 + len(FREE_FUNCTIONS)
    linear = NO_GAUSSIANS._replace(tangent=np.empty(shape))
    flown = slice(gaussians.num_flown)
    acting = (
        gaussians.weights[:, flown].any(axis=1),
        gaussians.inverse_widths[:, flown].any(axis=1),
    )
    free = gaussians, acting, linear
    LOOPS.over(kinds).log_slopes(path, nodes, numbers, moved, *free, index, *found)
    return found
