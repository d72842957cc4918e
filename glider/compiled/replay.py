"""Flights along a log: its times, its elevator, its nodes.

Here a model is one vector theta, parameters and coefficients, as a fit changes it.
"""

import numpy as np

from glider.compiled.constants import DIFFERENCE
from glider.compiled.kernel import Family
from glider.compiled.runge_kutta import put
from glider.physics.chain import accelerations, derivatives, measure, meet_air, theta_of
from glider.physics.effects import NO_FIELD, EffectKind, Field
from glider.physics.parameters import Parameters, Theta


def log_step(t, x, step, elevator, rate, wind_x, wind_z, pitch, theta, work):
    """Advances x by one Runge-Kutta step with the elevator's path prescribed.

    Here x[3] is the elevator's constant offset from that path. The step is that of
    `runge_kutta.advance`, which takes a fifth more time here: its data are counted as
    references in each of the many short calls.

    Args:
        t: [s].
        x: (n,), written.
        step: [s].
        elevator: (3,) its path at the start, the middle and the end [rad].
        rate: its mean rate over the step [rad/s].
        wind_x: velocity of the air over the step [m/s].
        wind_z: the same.
        pitch: (3, 2) pitch and its rate there, prescribed too; (0, 2) where they are
            flown.
        theta: the glider's numbers.
        work: (2, n) scratch.
    """
    total, y = work[0], work[1]
    total[:] = 0.0
    put(x, y)
    for stage in range(4):
        node = (stage + 1) // 2
        weight = 1.0 / 6.0 if stage in (0, 3) else 1.0 / 3.0
        ahead = 0.5 * step if stage < 2 else step
        y[3] = x[3] + elevator[node]
        if pitch.shape[0] > 0:
            y[2] = pitch[node, 0]
            y[6] = pitch[node, 1]
        d = derivatives(t + 0.5 * step * node, y, rate, wind_x, wind_z, theta)
        for i in range(x.shape[0]):
            total[i] += weight * d[i]
            y[i] = x[i] + ahead * d[i]
    total[3] = 0.0
    for i in range(x.shape[0]):
        x[i] += step * total[i]
    if pitch.shape[0] > 0:
        x[2] = pitch[2, 0]
        x[6] = pitch[2, 1]


def banked(theta, factor):
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
    return Theta(tilted, theta.c, theta.field)


def log_rollout(
    times, start, pitch, elevator, rate, wind, bank, numbers, field, states
):
    """Flies from one start along a log's times, elevator prescribed.

    Args:
        times: (K + 1,).
        start: (n,).
        pitch: (K, 3, 2) as in `log_step`; or (K, 0, 2).
        elevator: (K, 3) as in `log_step`.
        rate: (K,).
        wind: (K, 2) velocity of the air [m/s].
        bank: (K,) factor of the wing's area.
        numbers: parameters (9,) and coefficients, one after the other.
        field: the residual Field.
        states: (K + 1, n), written.
    """
    theta = theta_of(numbers, field)
    x = start.copy()
    work = np.empty((2, x.shape[0]), x.dtype)
    put(x, states[0])
    for k in range(times.shape[0] - 1):
        step = times[k + 1] - times[k]
        log_step(
            times[k],
            x,
            step,
            elevator[k],
            rate[k],
            wind[k, 0],
            wind[k, 1],
            pitch[k],
            banked(theta, bank[k]),
            work,
        )
        put(x, states[k + 1])


def log_extras(times, nodes, elevator, rate, numbers, field):
    """Flies the effects' own states along given nodes; nodes[1:, 7:] is written."""
    theta = theta_of(numbers, field)
    free_pitch = np.empty((0, 2))
    n = nodes.shape[1]
    x = np.empty_like(nodes[0])
    work = np.empty((2, n), nodes.dtype)
    for k in range(times.shape[0] - 1):
        step = times[k + 1] - times[k]
        put(nodes[k], x)
        log_step(
            times[k], x, step, elevator[k], rate[k], 0.0, 0.0, free_pitch, theta, work
        )
        for i in range(7, n):
            nodes[k + 1, i] = x[i]


def log_slopes(
    times,
    nodes,
    elevator,
    rate,
    wind,
    bank,
    numbers,
    moved,
    sizes,
    field,
    ends,
    by_x,
    by_term,
    by_theta,
):
    """Flies each interval of a log from its own node, with slopes.

    Forward differences in floats: at these steps they are good to 1e-6, half the
    cost of a complex step, and spare the user its compilation.

    Args:
        times: (K + 1,).
        nodes: (K + 1, n) states at the times.
        elevator: (K, 3).
        rate: (K,).
        wind: (K, 2) velocity of the air [m/s].
        bank: (K,) factor of the wing's area.
        numbers: parameters and coefficients.
        moved: (m, len(numbers)) the same, moved along each of m directions.
        sizes: (m,) how far they are moved.
        field: the residual Field, whose last basis function is a constant.
        ends: (K, n), written: the state that each interval ends in.
        by_x: (K, n, n), written: its slopes by the node; or (K, n, 0).
        by_term: (K, n, 6), written: by each constant of FIELD_TERMS; or (K, n, 0).
        by_theta: (K, n, m), written: along each direction.
    """
    n, width = nodes.shape[1], by_x.shape[2]
    theta = theta_of(numbers, field)
    free_pitch = np.empty((0, 2))
    x = np.empty_like(nodes[0])
    work = np.empty((2, n), x.dtype)
    last = field.weights.shape[0] - 1
    columns = 1 + width + by_term.shape[2] + moved.shape[0]
    for k in range(times.shape[0] - 1):
        step = times[k + 1] - times[k]
        for j in range(columns):
            put(nodes[k], x)
            size, own = DIFFERENCE, theta
            in_term, in_theta = j - 1 - width, j - 1 - width - by_term.shape[2]
            if 0 < j <= width:
                x[j - 1] += size
            elif in_theta >= 0:
                size = sizes[in_theta]
                own = theta_of(moved[in_theta], field)
            elif in_term >= 0:
                field.weights[last, in_term] = size
            log_step(
                times[k],
                x,
                step,
                elevator[k],
                rate[k],
                wind[k, 0],
                wind[k, 1],
                free_pitch,
                banked(own, bank[k]),
                work,
            )
            if in_theta < 0 and in_term >= 0:
                field.weights[last, in_term] = 0.0
            for i in range(n):
                if j == 0:
                    ends[k, i] = x[i]
                elif in_theta >= 0:
                    by_theta[k, i, in_theta] = (x[i] - ends[k, i]) / size
                elif in_term >= 0:
                    by_term[k, i, in_term] = (x[i] - ends[k, i]) / size
                else:
                    by_x[k, i, j - 1] = (x[i] - ends[k, i]) / size


def log_measure(nodes, numbers, free, scale, field, pose, by_x, by_theta):
    """Writes the pose that the sensors show of each node, with derivatives.

    Args:
        nodes: (K, n) states.
        numbers: parameters and coefficients.
        free: (m,) indices into them.
        scale: typical sizes of them.
        field: the residual Field; no sensor looks at it.
        pose: (K, 3), written.
        by_x: (K, 3, n), written.
        by_theta: (K, 3, m), written.
    """
    n = nodes.shape[1]
    theta = theta_of(numbers, field)
    moved = numbers.copy()
    x = np.empty_like(nodes[0])
    for k in range(nodes.shape[0]):
        put(nodes[k], x)
        y = measure(x, theta)
        for i in range(3):
            pose[k, i] = y[i]
        for j in range(n):
            x[j] += DIFFERENCE
            y = measure(x, theta)
            x[j] = nodes[k, j]
            for i in range(3):
                by_x[k, i, j] = (y[i] - pose[k, i]) / DIFFERENCE
        for j in range(free.shape[0]):
            size = DIFFERENCE * scale[free[j]]
            moved[free[j]] += size
            y = measure(x, theta_of(moved, field))
            moved[free[j]] = numbers[free[j]]
            for i in range(3):
                by_theta[k, i, j] = (y[i] - pose[k, i]) / size


def log_flow(times, nodes, elevator, rate, numbers, field, values):
    """Writes flow and acceleration at each node of a log.

    Args:
        elevator: (K,) at the nodes.
        rate: (K,) at the nodes.
        values: (K, 9), written: V, sin α, cos α, velocity through the air (x, z),
            accelerations (ẍ, z̈, θ̈), elevator.
    """
    theta = theta_of(numbers, field)
    x = np.empty_like(nodes[0])
    for k in range(nodes.shape[0]):
        put(nodes[k], x)
        x[3] += elevator[k]
        u = rate[k] + 0.0 * x[0]
        flow, terms = meet_air(times[k], x, u, 0.0, 0.0, theta)
        a = accelerations(flow, terms, x, theta.c)
        values[k, 0] = flow.speed
        values[k, 1] = flow.sin_alpha
        values[k, 2] = flow.cos_alpha
        values[k, 3] = flow.air_x
        values[k, 4] = flow.air_z
        values[k, 5] = a[0]
        values[k, 6] = a[1]
        values[k, 7] = a[2]
        values[k, 8] = x[3]


LOOPS = Family(
    (banked, log_step, log_rollout, log_extras, log_slopes, log_measure, log_flow),
    (log_rollout, log_extras, log_slopes, log_measure, log_flow),
)

Kinds = tuple[EffectKind, ...]
"""The effects that the compiled dynamics hold, whose coefficients a theta has."""


def roll_out(
    kinds: Kinds,
    times: np.ndarray,
    start: np.ndarray,
    elevator: np.ndarray,
    rate: np.ndarray,
    wind: np.ndarray,
    bank: np.ndarray,
    numbers: np.ndarray,
    field: Field,
) -> np.ndarray:
    """Returns the states (K + 1, n) of a flight along a log's times.

    Args:
        kinds: the effects.
        times: (K + 1,) [s].
        start: (n,).
        elevator: (K, 3) its path at the start, middle and end of each step [rad].
        rate: (K,) its mean rates [rad/s].
        wind: (K, 2) velocity of the air [m/s].
        bank: (K,) factor of the wing's area, see `glider.sysid.replay.record`.
        numbers: parameters (9,) and coefficients, one after the other.
        field: the residual field.
    """
    free = np.empty((len(rate), 0, 2))
    return translate(
        kinds, times, start, free, elevator, rate, wind, bank, numbers, field
    )


def translate(
    kinds: Kinds,
    times: np.ndarray,
    start: np.ndarray,
    pitch: np.ndarray,
    elevator: np.ndarray,
    rate: np.ndarray,
    wind: np.ndarray,
    bank: np.ndarray,
    numbers: np.ndarray,
    field: Field,
) -> np.ndarray:
    """Returns states as `roll_out` does, with the pitch prescribed.

    `pitch` (K, 3, 2) is pitch and pitch rate at start, middle and end of each step.
    """
    states = np.empty((len(times), len(start)))
    LOOPS.over(kinds, True).log_rollout(
        times, start, pitch, elevator, rate, wind, bank, numbers, field, states
    )
    return states


def advance_nodes(
    kinds: Kinds,
    times: np.ndarray,
    nodes: np.ndarray,
    elevator: np.ndarray,
    rate: np.ndarray,
    wind: np.ndarray,
    bank: np.ndarray,
    numbers: np.ndarray,
    field: Field,
) -> np.ndarray:
    """Returns the ends (K, n) of a log's intervals, each flown from its own node.

    `nodes` is (K + 1, n); the other arguments as in `roll_out`.
    """
    ends = np.empty_like(nodes[1:])
    nothing, free = np.empty((*ends.shape, 0)), np.zeros(0)
    LOOPS.over(kinds, True).log_slopes(
        times,
        nodes,
        elevator,
        rate,
        wind,
        bank,
        numbers,
        np.empty((0, len(numbers))),
        free,
        field,
        ends,
        nothing,
        nothing,
        nothing,
    )
    return ends


def with_extras(
    kinds: Kinds,
    times: np.ndarray,
    nodes: np.ndarray,
    elevator: np.ndarray,
    rate: np.ndarray,
    numbers: np.ndarray,
    field: Field,
) -> np.ndarray:
    """Returns nodes (K + 1, n) with the effects' own states flown along them.

    They begin as in the first node; the other arguments as in `roll_out`.
    """
    full = nodes.copy()
    LOOPS.over(kinds, True).log_extras(times, full, elevator, rate, numbers, field)
    return full


def measure_nodes(
    kinds: Kinds,
    nodes: np.ndarray,
    numbers: np.ndarray,
    free: np.ndarray,
    scale: np.ndarray,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Computes the measured poses of states (K, n), with derivatives.

    The poses (K, 3), their derivatives by the state (K, 3, n) and by the free numbers
    (K, 3, m).
    """
    rows, n = nodes.shape
    pose, by_x = np.empty((rows, 3)), np.empty((rows, 3, n))
    by_theta = np.empty((rows, 3, len(free)))
    LOOPS.over(kinds, True).log_measure(
        nodes, numbers, free, scale, NO_FIELD, pose, by_x, by_theta
    )
    return pose, by_x, by_theta


def flow_at(
    kinds: Kinds,
    times: np.ndarray,
    nodes: np.ndarray,
    elevator: np.ndarray,
    rate: np.ndarray,
    numbers: np.ndarray,
    field: Field,
) -> np.ndarray:
    """Returns flow and acceleration at states (K, n), see `log_flow`, (K, 9).

    `elevator` (K,) [rad] and `rate` (K,) [rad/s] are at the times.
    """
    values = np.empty((len(nodes), 9))
    LOOPS.over(kinds, True).log_flow(
        times, nodes, elevator, rate, numbers, field, values
    )
    return values


def slopes_along(
    kinds: Kinds,
    times: np.ndarray,
    nodes: np.ndarray,
    elevator: np.ndarray,
    rate: np.ndarray,
    wind: np.ndarray,
    bank: np.ndarray,
    numbers: np.ndarray,
    moved: np.ndarray,
    sizes: np.ndarray,
    field: Field,
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Flies each interval of a log from its own node, with slopes.

    Args:
        kinds, times, nodes, elevator, rate, numbers: as in `advance_nodes`.
        wind: (K, 2) velocity of the air in each interval [m/s].
        bank: (K,) factor of the wing's area there.
        moved: (m, len(numbers)) the numbers, moved along each of m directions.
        sizes: (m,) how far they are moved.
        field: the residual field.

    Returns:
        the ends (K, n), and their slopes by the node (K, n, n), by a constant of each
        of FIELD_TERMS (K, n, 6) and along the directions (K, n, m).
    """
    intervals, n, terms = len(nodes) - 1, nodes.shape[1], field.weights.shape[1]
    nothing = np.zeros((1, field.centers.shape[1]))
    with_constant = Field(
        np.vstack([field.centers, nothing]),
        np.vstack([field.inverse_widths, nothing]),
        np.vstack([field.weights, np.zeros((1, terms))]),
    )
    ends, by_x = np.empty((intervals, n)), np.empty((intervals, n, n))
    by_term = np.empty((intervals, n, terms))
    by_theta = np.empty((intervals, n, len(sizes)))
    LOOPS.over(kinds, True).log_slopes(
        times,
        nodes,
        elevator,
        rate,
        wind,
        bank,
        numbers,
        moved,
        sizes,
        with_constant,
        ends,
        by_x,
        by_term,
        by_theta,
    )
    return ends, by_x, by_term, by_theta
