"""Batches of gliders under feedback."""

from typing import NamedTuple

import numpy as np

from glider.compiled.kernel import Family
from glider.compiled.rollouts import slopes
from glider.compiled.runge_kutta import BLOCK, advance_block, put
from glider.physics.chain import demanded_angle
from glider.physics.model import GliderModel
from glider.physics.servo import limited_rate


def feed_back(row, feedback, error, work):
    """Writes into work[n, 1] the commands for states that are seen with an error."""
    n = work.shape[0] - 1
    for j in range(BLOCK):
        work[n, 1, j] = feedback.offset[row]
    for i in range(feedback.gain.shape[1]):
        for j in range(BLOCK):
            work[n, 1, j] -= feedback.gain[row, i] * (work[i, 0, j] + error[i, j])


def approach(wire, before, work, nearest, arrival):
    """Lowers the least squared distances from the wire by one segment of the path.

    Args:
        wire: (x, z) [m].
        before: (n, BLOCK) states where the segment begins.
        work: work[:n, 0] where it ends.
        nearest: (BLOCK,) least squared distances so far, lowered [m²].
        arrival: (n, BLOCK) states there, written with them.
    """
    for j in range(BLOCK):
        from_x = before[0, j] - wire[0]
        from_z = before[1, j] - wire[1]
        along_x = work[0, 0, j] - before[0, j]
        along_z = work[1, 0, j] - before[1, j]
        square = along_x * along_x + along_z * along_z + 1e-300
        share = -(from_x * along_x + from_z * along_z) / square
        share = min(max(share, 0.0), 1.0)
        x = from_x + share * along_x
        z = from_z + share * along_z
        if x * x + z * z < nearest[j]:
            nearest[j] = x * x + z * z
            for i in range(before.shape[0]):
                arrival[i, j] = before[i, j] + share * (work[i, 0, j] - before[i, j])


def slopes_guided(t, node, work, data):
    """Writes the derivatives under feedback, servo limits included.

    As `slopes`; without a hold the commands, work[n, 1], follow the state at once.
    """
    k, feedback, error, servo, theta = data
    n = work.shape[0] - 1
    if feedback.hold == 0:
        feed_back(2 * k + node, feedback, error, work)
    for j in range(BLOCK):
        angle = demanded_angle(work[:, 0, j], theta.c)
        work[n, 0, j] = limited_rate(work[n, 1, j], angle, servo)
    slopes(t, node, work, theta)


def guided(start, steps, step, feedback, servo, wire, theta, miss, arrivals, states):
    """Flies a batch of gliders under the feedback u = offset - gain x.

    Blocks as in `rollouts`. The servo's `limited_rate` lies between command and
    glider.

    Args:
        start: (B, n) states at launch.
        steps: their number, N.
        step: [s].
        feedback: of N steps, see `Feedback`.
        servo: its limits.
        wire: (x, z) [m].
        theta: the gliders' numbers.
        miss: (B,), written: least distance of the path from the wire, by
            straight segments between the steps [m].
        arrivals: (B, n), written: the states there; NaN where no distance is finite.
        states: (B, N + 1, n), written; or (B, 1, n) to keep only the last.
    """
    batch, n = start.shape
    hold = feedback.hold
    noise = feedback.noise
    fed = feedback.gain.shape[1]
    keep = states.shape[1] > 1
    work = np.empty((n + 1, 4, BLOCK))
    error = np.zeros((fed, BLOCK))
    before = np.empty((n, BLOCK))
    nearest = np.empty(BLOCK)
    arrival = np.empty((n, BLOCK))
    path = np.empty((steps if keep else 1, n, BLOCK))
    for first in range(0, batch, BLOCK):
        count = min(BLOCK, batch - first)
        for j in range(BLOCK):  # What is left of the last block repeats a glider.
            for i in range(n):
                work[i, 0, j] = start[first + min(j, count - 1), i]
        nearest[:] = np.inf
        arrival[:] = np.nan
        for k in range(steps):
            for i in range(n):
                put(work[i, 0], before[i])
            if hold > 0 and k % hold == 0:
                if noise.shape[1] > 0:
                    for j in range(BLOCK):
                        for i in range(fed):
                            row = first + min(j, count - 1)
                            error[i, j] = noise[row, k // hold, i]
                feed_back(k // hold, feedback, error, work)
            data = (k, feedback, error, servo, theta)
            advance_block(slopes_guided, step * k, work, step, 4, data)
            approach(wire, before, work, nearest, arrival)
            if keep:
                for i in range(n):
                    put(work[i, 0], path[k, i])
        if not keep:
            for i in range(n):
                put(work[i, 0], path[0, i])
        for j in range(count):
            miss[first + j] = np.sqrt(nearest[j])
            for i in range(n):
                arrivals[first + j, i] = arrival[i, j]
            if keep:
                put(start[first + j], states[first + j, 0])
            for k in range(path.shape[0]):
                for i in range(n):
                    states[first + j, k + keep, i] = path[k, i, j]


LOOPS = Family((slopes, feed_back, approach, slopes_guided, guided), (guided,))


class Feedback(NamedTuple):
    """A feedback u = offset - gain x of N steps, as a table.

    Attributes:
        offset: (2 N + 1,) at the steps and half steps, or with a hold (H,), one for
            each command [rad/s].
        gain: (2 N + 1, m) or (H, m); the first m states are fed back.
        hold: number of steps that a command is held; 0 where it follows at once.
        noise: (B, H, m) added to the states fed back; (B, 0, m) for none.
    """

    offset: np.ndarray
    gain: np.ndarray
    hold: int
    noise: np.ndarray


def fly_feedback(
    model: GliderModel,
    starts: np.ndarray,
    steps: int,
    step: float,
    feedback: Feedback,
    *,
    wire: tuple[float, float] = (0.0, 0.0),
    keep_paths: bool = False,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Flies launches of a glider under a feedback.

    Args:
        model: the glider.
        starts: (B, n) states at launch.
        steps: their number, N.
        step: [s].
        feedback: of N steps.
        wire: (x, z) [m].
        keep_paths: whether to return all states.

    Returns:
        least distances from the wire (B,) [m], the states there (B, n), and all
        states (B, N + 1, n), or (B, 1, n), the last.
    """
    batch, n = starts.shape
    miss = np.empty(batch)
    arrivals = np.empty((batch, n))
    tables = feedback.offset, feedback.gain, feedback.noise
    offset, gain, noise = (np.ascontiguousarray(t, dtype=float) for t in tables)
    states = np.empty((batch, steps + 1 if keep_paths else 1, n))
    LOOPS.over(model.kinds).guided(
        np.ascontiguousarray(starts, dtype=float),
        steps,
        step,
        Feedback(offset, gain, feedback.hold, noise),
        model.parameters.servo,
        (float(wire[0]), float(wire[1])),
        model.numbers,
        miss,
        arrivals,
        states,
    )
    return miss, arrivals, states
