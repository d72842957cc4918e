"""A log's errors against a model, linear in the launch state and in the model.

Each interval between two rows is flown from the smoothed state (multiple
shooting), so that what comes out is the output-error problem of the whole
flight, linearised about the measurement instead of about a wrong model. In that
form a model's error, and each coefficient's signature in it, stay linear even
where free rollouts have long parted from the flight.
"""

import dataclasses

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from glider.compiled.replay import advance_nodes, measure_nodes, propagate, shoot
from glider.physics.state import NUM_STATES
from glider.sysid.replay.nodes import (
    launch_steady_states,
    true_nodes,
)
from glider.sysid.replay.problem import Problem
from glider.sysid.replay.record import Record
from glider.sysid.replay.signals import (
    logged_elevator,
    pose_signals,
)
from glider.sysid.replay.theta import OFFSET


@dataclasses.dataclass(frozen=True, kw_only=True)
class Linearized:
    """A flight's errors against a model, linear in launch state and theta.

    error = residual - by_start δstart - by_theta δtheta, all divided by the
    noise's standard deviation, so that under the true model the errors are
    independent with variance one.

    Attributes:
        residual: (rows,): x, z, pitch row by row, then the elevator, then the
            prior of the launch state.
        by_start: (rows, num_states).
        by_theta: (rows, m).
        start: (num_states,) launch state that δstart is counted from.
    """

    residual: np.ndarray
    by_start: np.ndarray
    by_theta: np.ndarray
    start: np.ndarray


def linearize(
    problem: Problem,
    record: Record,
    theta: np.ndarray,
    free: tuple[int, ...] = (),
    *,
    nodes: np.ndarray | None = None,
    forcing: np.ndarray | None = None,
) -> Linearized:
    """Compares a flight with a model; see the module's docstring.

    Args:
        problem: whose noise, field and knowledge of the elevator to take.
        record: the flight.
        theta: the model, as `layout` has it.
        free: indices into theta of the columns wanted, replayed ones last.
        nodes: (n, num_states) other linearisation points than the smoothed states.
        forcing: (n - 1, num_states, k) further columns: how each of k unnamed
            coefficients moves the end of each interval.
    """
    points = _smoothed(problem, record, theta) if nodes is None else nodes
    return _linearize_about(problem, record, theta, free, points, forcing)


def _smoothed(problem: Problem, record: Record, theta: np.ndarray) -> np.ndarray:
    """Returns the smoothed states, an elevator without a servo at its own angle.

    That can be large, so the flight is linearised about it, not about zero.
    """
    nodes = true_nodes(record, theta, problem.field)
    if record.has_servo or problem.trim_is_known:
        return nodes
    points, trim = nodes.copy(), 0.0
    for _ in range(3):
        points[:, OFFSET] = trim
        errors = _linearize_about(problem, record, theta, (), points, None)
        change = float(np.clip(fitted_start(errors)[OFFSET], -0.3, 0.3))
        trim = float(np.clip(trim + change, -1.2, 1.2))
        if not np.isfinite(trim):
            trim = 0.0
            break
        if abs(change) < 1e-3:
            break
    points[:, OFFSET] = trim
    return points


def _linearize_about(
    problem: Problem,
    record: Record,
    theta: np.ndarray,
    free: tuple[int, ...],
    points: np.ndarray,
    forcing: np.ndarray | None,
) -> Linearized:
    """Linearizes about states (n, num_states) along the flight."""
    noise, field = problem.noise, problem.field
    n, dim = points.shape
    layout = record.layout
    kinds = layout.compiled_kinds
    in_kernel = np.array([i for i in free if i < layout.num_compiled], dtype=np.int64)
    in_signal = [i for i in free if i >= layout.num_compiled]
    if [*in_kernel, *in_signal] != list(free):
        raise ValueError(f"free must name the signals' slots last: {free}")
    dynamics = layout.dynamics(theta)
    signals = pose_signals(record, theta)
    ends, by_x, by_kernel = shoot(
        kinds, record.time, points, *signals, dynamics, field, in_kernel, layout.scale
    )
    columns = [by_kernel]
    for i in in_signal:
        moved, step = theta.copy(), SIGNAL_STEP * layout.scale[i]
        moved[i] += step
        signals = pose_signals(record, moved)
        others = advance_nodes(kinds, record.time, points, *signals, dynamics, field)
        columns.append(((others - ends) / step)[:, :, None])
    if forcing is not None:
        columns.append(forcing)
    inputs = np.concatenate([*columns, (ends - points[1:])[:, :, None]], axis=2)
    states = propagate(by_x, inputs)
    pose, pose_by_x, pose_by_kernel = measure_nodes(
        kinds, points, dynamics, in_kernel, layout.scale
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
            moved, step = theta.copy(), SIGNAL_STEP * layout.scale[i]
            moved[i] += step
            table[:, j] = (logged_elevator(record, moved) - path) / step
        table[:, OFFSET] = 1.0
        table[:, -1] = record.flight.elevator - path - points[:, OFFSET]
        blocks.append(table / noise.elevator)
    is_known = problem.trim_is_known and not record.has_servo
    blocks.append(_launch_prior(record, theta, points[0], is_known, rows.shape[2]))
    table = np.vstack(blocks)
    return Linearized(
        residual=table[:, -1],
        by_start=table[:, :dim],
        by_theta=table[:, dim:-1],
        start=points[0].copy(),
    )


def _launch_prior(
    record: Record, theta: np.ndarray, start: np.ndarray, is_known: bool, width: int
) -> np.ndarray:
    """Returns the rows that hold the elevator's offset and the effects' own states.

    The offset lies about zero, the states about their values at rest.
    """
    spread = _PRIOR_KNOWN if is_known else 1.0
    rest = launch_steady_states(record, theta, start)
    spreads = _PRIOR_EXTRA * record.layout.state_scale
    rows = np.zeros((1 + len(rest), width))
    rows[0, OFFSET], rows[0, -1] = 1.0 / spread, -start[OFFSET] / spread
    rows[1:, NUM_STATES : len(start)] = np.diag(1.0 / spreads)
    rows[1:, -1] = (rest - start[NUM_STATES:]) / spreads
    return rows


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


SIGNAL_STEP = 5e-4
"""Finite-difference step of replayed coefficients, in their own scale: about 1e-5 s
of a delay."""

_PRIOR_EXTRA = 0.05
"""Spread of effects' own states at launch about their steady values, in their
own scales."""

_PRIOR_KNOWN = 1e-6
"""Spread of an elevator that stands where it is known to stand [rad]."""
